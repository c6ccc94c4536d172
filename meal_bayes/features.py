"""Features of a robot's raw signals: from messages of one execution to a vector per modality.

A domain says where each modality comes from (`[sources.<modality>]`: topic, fields, feature,
settings). Recordings (`meal-bayes data import`) and a live driver read messages by the same
`Recorder` and call the same `extract`, so that equal messages give equal features.
"""

import functools
import inspect
import io
import itertools
import re
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.domain import Domain, unknown
from meal_bayes.errors import DataError, DomainError, SettingsError

Function = Callable[..., ArrayLike]
_NS = 1_000_000_000
_JUMP = 1.0  # s by which the header's clock may drift from the receiver's in one execution
_FLOOR = 1e-10  # power of silence
_SECONDS = 0.032  # of one window of a spectrogram, as usual for speech
_PART = re.compile(r"(\w+)(?:\[([^\]]+)\])?")
_FIELDS = {  # by message type, where the source names none
    "JointState": ("effort",),
    "WrenchStamped": ("wrench.force", "wrench.torque"),
    "Imu": ("linear_acceleration", "angular_velocity"),
    "Float64MultiArray": ("data",),
}
_SOUND = {"s16le": ("<i2", 2.0**15, 0.0), "f32le": ("<f4", 1.0, 0.0), "u8": ("u1", 128.0, 1.0)}
_SOUNDS = {"AudioData": "data", "AudioDataStamped": "audio.data"}
_RGB, _BGR, _GRAY = slice(0, 3), slice(2, None, -1), [0, 0, 0]
_IMAGES: dict[str, tuple[int, int, Any]] = {  # channels, bytes of one, where red, green, blue are
    "rgb8": (3, 1, _RGB), "bgr8": (3, 1, _BGR), "8UC3": (3, 1, _BGR), "rgba8": (4, 1, _RGB),
    "bgra8": (4, 1, _BGR), "mono8": (1, 1, _GRAY), "8UC1": (1, 1, _GRAY), "mono16": (1, 2, _GRAY),
}  # fmt: skip


class Signal(NamedTuple):
    """What one modality measured during one execution.

    Attributes
    ----------
    values : NDArray[Any]
        Samples along the first axis: (T, C) numbers, (T,) sound, or (T, H, W, 3) images.
    times : NDArray[np.float64]
        Time of each message, s since the first one.
    fault : str
        Why the signal cannot be used; "" where it can.
    ready : bool
        Whether the samples are features of single images (T, D), whose mean is the vector.
    """

    values: NDArray[Any]
    times: NDArray[np.float64] = np.empty(0)
    fault: str = ""
    ready: bool = False


def temporal_bins(
    values: ArrayLike, bins: int = 10, times: ArrayLike | None = None
) -> NDArray[np.float64]:
    """Return the mean of each channel in bins of equal duration, as CY101's haptic features.

    Parameters
    ----------
    values : ArrayLike
        (T, C) samples of C channels in their own unit, or (T,) of one.
    bins : int
        Number of bins.
    times : ArrayLike | None
        (T,) s, ascending. By default samples have equal distances. A bin without a sample is
        interpolated between its neighbors.

    Returns
    -------
    NDArray[np.float64]
        (bins * C,), all bins of the first channel first.

    Raises
    ------
    DataError
        No samples, or values that are not finite.

    References
    ----------
    J. Sinapov et al., "Grounding semantic categories in behavioral interactions", Robotics and
    Autonomous Systems 62(5), 2014: joint torques in ten temporal bins.

    Examples
    --------
    >>> temporal_bins([1, 1, 3, 3], bins=2)
    array([1., 3.])
    """
    array = _finite(values, (1, 2))
    array = array.reshape(len(array), -1)
    bins = _count("bins", bins)
    if times is None:
        return _means(array, bins).T.ravel()
    moments = _finite(times, (1,))
    if len(moments) != len(array):
        raise DataError(f"{len(moments)} times of {len(array)} samples; expected one each.")
    span = moments[-1] - moments[0]
    if not span > 0:
        return np.repeat(array.mean(axis=0), bins)
    place = np.minimum((moments - moments[0]) / span * bins, bins - 1).astype(int)
    counts = np.bincount(place, minlength=bins)
    filled = np.flatnonzero(counts)
    columns = []
    for channel in array.T:
        sums = np.bincount(place, channel, bins)[filled]
        columns.append(np.interp(np.arange(bins), filled, sums / counts[filled]))
    return np.concatenate(columns)


def spectrogram_bins(
    sound: ArrayLike, rate: float, frequency_bins: int = 10, time_bins: int = 10
) -> NDArray[np.float64]:
    """Return the binned log power of sound over frequency and time.

    Parameters
    ----------
    sound : ArrayLike
        (T,) samples, 1 is full scale; several channels (T, C) are averaged.
    rate : float
        Samples a second, Hz.
    frequency_bins, time_bins : int
        Numbers of equal bins, from 0 Hz to rate / 2, and from the first sample to the last.

    Returns
    -------
    NDArray[np.float64]
        (frequency_bins * time_bins,) log10 of the mean power density (1/Hz), all times of the
        lowest frequencies first; -10 is silence.

    Raises
    ------
    DataError
        No samples, values that are not finite, or a rate that is not above 0.

    References
    ----------
    J. Sinapov et al., "Interactive learning of the acoustic properties of household objects",
    ICRA 2009: spectrograms in ten by ten bins.

    Examples
    --------
    >>> spectrogram_bins(np.zeros(800), rate=8000, frequency_bins=2, time_bins=1)
    array([-10., -10.])
    """
    from scipy.signal import spectrogram  # noqa: PLC0415  takes a third of a second

    array = _finite(sound, (1, 2))
    array = array.reshape(len(array), -1).mean(axis=1)
    rate = float(rate)
    if not 0 < rate < np.inf:
        raise DataError(f"The rate of the sound is {rate}; give samples a second, above 0.")
    counts = _count("frequency_bins", frequency_bins), _count("time_bins", time_bins)
    length = min(len(array), max(2, round(_SECONDS * rate)))
    power = spectrogram(array, rate, "boxcar" if length < 3 else "hann", length, length // 2,
                        detrend=False)[2]  # fmt: skip
    binned: NDArray[np.float64] = np.log10(_means(_means(power, counts[0]).T, counts[1]).T + _FLOOR)
    return np.ravel(binned)


def color_histogram(image: ArrayLike, bins: int = 4) -> NDArray[np.float64]:
    """Return the joint histogram of red, green and blue.

    Parameters
    ----------
    image : ArrayLike
        (H, W, 3) colors, or (H, W) gray; whole numbers 0 to 255, or fractions 0 to 1.
        Of (T, H, W, 3) images the mean of their histograms is returned.
    bins : int
        Number of bins of each color.

    Returns
    -------
    NDArray[np.float64]
        (bins ** 3,) fractions of the pixels, which sum to 1; blue varies fastest.

    Raises
    ------
    DataError
        No pixels, another shape, or values out of the range.

    References
    ----------
    M. J. Swain and D. H. Ballard, "Color indexing", IJCV 7(1), 1991.

    Examples
    --------
    >>> color_histogram(np.full((2, 2, 3), 255), bins=2)
    array([0., 0., 0., 0., 0., 0., 0., 1.])
    """
    bins = _count("bins", bins)
    array = np.asarray(image)
    if array.ndim == 4:
        return np.asarray(np.mean([color_histogram(one, bins) for one in array], axis=0))
    whole = array.dtype.kind in "ui"
    array = array if array.dtype == np.uint8 and array.size else _finite(array, (2, 3))
    if array.ndim == 2:
        array = np.repeat(array[:, :, None], 3, axis=2)
    if array.ndim != 3 or array.shape[2] != 3:
        raise DataError(f"An image has shape {array.shape}; expected (H, W, 3) or (H, W).")
    top = 255 if whole else 1
    if array.dtype != np.uint8 and (array.min() < 0 or array.max() > top):
        raise DataError(f"An image has values {array.min()} to {array.max()}; expected 0 to {top}.")
    kind = np.min_scalar_type(bins**3)  # as small as can be, since images are large
    if whole and bins > 1 and 256 % bins == 0:
        place = array.astype(np.uint8, copy=False) // np.uint8(256 // bins)
    elif whole:
        of_value = (np.arange(256) * bins // 256).astype(kind)
        place = of_value[array.astype(np.uint8, copy=False)]
    else:
        place = np.minimum(array * bins, bins - 1).astype(kind)
    cell = (place[..., 0] * kind.type(bins) + place[..., 1]) * kind.type(bins) + place[..., 2]
    counts = np.bincount(cell.ravel(), minlength=bins**3)
    return np.asarray(counts / counts.sum())


FUNCTIONS: Mapping[str, Function] = {
    function.__name__: function for function in (temporal_bins, spectrogram_bins, color_histogram)
}


def extract(
    domain: Domain,
    behavior: str,
    signals: Mapping[str, Signal | ArrayLike],
    functions: Mapping[str, Function] | None = None,
    on_fault: Callable[[str, str], object] | None = None,
) -> dict[str, NDArray[np.float32]]:
    """Return the features of one execution, as the domain's sources describe them.

    Parameters
    ----------
    domain : Domain
        With a source of each modality of the behavior.
    behavior : str
        What was executed.
    signals : Mapping[str, Signal | ArrayLike]
        By modality; `Recorder.signals` makes them from messages.
    functions : Mapping[str, Function] | None
        Feature functions of your own by the names that the domain uses. One that has a parameter
        `times` is given the seconds of the samples.
    on_fault : Callable[[str, str], object] | None
        Called with a modality and what is wrong with it, which is then left out; by default the
        first fault is raised.

    Returns
    -------
    dict[str, NDArray[np.float32]]
        (D,) by modality, in the precision in which recordings are kept.

    Raises
    ------
    DataError
        A signal that is missing, empty, or not of finite numbers.
    DomainError, SettingsError
        As of `check_sources`.

    Examples
    --------
    >>> from meal_bayes.domain import load_domain
    >>> lab = {"extends": "toy", "sources": {"color": {
    ...     "topic": "/camera", "feature": "color_histogram", "settings": {"bins": 2}}}}
    >>> black = {"color": np.zeros((1, 4, 4, 3), np.uint8)}
    >>> extract(load_domain(lab), "look", black)["color"][:2]
    array([1., 0.], dtype=float32)
    """
    check_sources(domain, [behavior], functions)
    return _extract(domain, behavior, signals, functions, on_fault)


def _extract(
    domain: Domain,
    behavior: str,
    signals: Mapping[str, Signal | ArrayLike],
    functions: Mapping[str, Function] | None,
    on_fault: Callable[[str, str], object] | None,
) -> dict[str, NDArray[np.float32]]:
    """Do what `extract` says, with sources that were checked."""
    found = {}
    for modality in domain.behaviors[domain.behavior_index(behavior)].modalities:
        source = domain.sources[modality]
        function = {**FUNCTIONS, **(functions or {})}[source["feature"]]
        try:
            signal = signals.get(modality)
            if signal is None:
                raise DataError(f"There is no signal of {modality!r}.")  # noqa: TRY301
            signal = signal if isinstance(signal, Signal) else Signal(np.asarray(signal))
            if signal.fault:
                raise DataError(signal.fault)  # noqa: TRY301
            settings = dict(source.get("settings", {}))
            timed = len(signal.times) == len(signal.values) > 0
            if timed and "times" in _signature(function).parameters:
                settings["times"] = signal.times
            with np.errstate(over="ignore"):
                made = (
                    signal.values.mean(axis=0)
                    if signal.ready
                    else function(signal.values, **settings)
                )
                vector = _finite(made, (0, 1)).astype(np.float32)
            found[modality] = _finite(np.atleast_1d(vector), (1,)).astype(np.float32)
        except (DataError, ValueError, TypeError) as fault:
            message = f"{source['topic']}: {fault}"
            if on_fault is None:
                raise DataError(message) from fault
            on_fault(modality, message)
    return found


def check_sources(
    domain: Domain, behaviors: "list[str]", functions: Mapping[str, Function] | None = None
) -> None:
    """Refuse behaviors that have a modality without a source, unknown features, and wrong settings.

    Raises
    ------
    DomainError
        A modality without a source, or settings that its feature does not have.
    SettingsError
        A feature that is neither ours nor in `functions`.
    """
    if taken := sorted({*FUNCTIONS} & {*(functions or {})}):
        raise SettingsError(f"{taken[0]!r} is a feature of the package; name your own otherwise.")
    known = {**FUNCTIONS, **(functions or {})}
    for behavior in behaviors:
        for modality in domain.behaviors[domain.behavior_index(behavior)].modalities:
            if modality not in domain.sources:
                raise DomainError(
                    f"The modality {modality!r} of {behavior!r} has no source; add "
                    f"[sources.{modality}] with topic and feature to the domain."
                )
            source = domain.sources[modality]
            name = source["feature"]
            if name not in known:
                raise SettingsError(unknown("feature", name, sorted(known)))
            settings = dict(source.get("settings", {}))
            try:
                signature = _signature(known[name])
                if "times" in signature.parameters:
                    settings.setdefault("times", None)  # `extract` gives them
                signature.bind(None, **settings)
            except TypeError as fault:
                raise DomainError(f"[sources.{modality}] {name}: {fault}.") from None


_signature = functools.lru_cache(256)(inspect.signature)


class Recorder:
    """Collects the messages of one execution, live or from a bag, and holds no others.

    Parameters
    ----------
    domain : Domain
        With a source of each modality of the behavior.
    behavior : str
        What is executed.
    functions : Mapping[str, Function] | None
        As of `extract`.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> from meal_bayes.domain import load_domain
    >>> lab = {"extends": "toy", "sources": {"color": {"topic": "/light", "fields": ["data"],
    ...     "feature": "temporal_bins", "settings": {"bins": 1}}}}
    >>> recorder = Recorder(load_domain(lab), "look")
    >>> recorder.add("/light", 0, SimpleNamespace(data=[1.0, 3.0]))
    >>> recorder.features()["color"]
    array([1., 3.], dtype=float32)
    """

    def __init__(
        self, domain: Domain, behavior: str, functions: Mapping[str, Function] | None = None
    ) -> None:
        check_sources(domain, [behavior], functions)
        self.domain = domain
        self.behavior = behavior
        self._functions = functions
        modalities = domain.behaviors[domain.behavior_index(behavior)].modalities
        self._sources = {name: domain.sources[name] for name in modalities}
        self.topics = frozenset(source["topic"] for source in self._sources.values())
        self._parts: dict[str, list[NDArray[Any]]] = {name: [] for name in modalities}
        self._clocks: dict[str, list[tuple[int, int]]] = {name: [] for name in modalities}
        self._faults: dict[str, str] = {}
        self.channels: dict[str, tuple[str, ...]] = {}

    def add(self, topic: str, time: int, message: Any) -> None:
        """Take one message.

        Parameters
        ----------
        topic : str
            Where it came; topics that the behavior does not need are left aside.
        time : int
            When it was received, ns. A header's stamp, where there is one, counts before it.
        message : Any
            Of `rclpy`, of `rosbags`, or any object with the fields of the source.
        """
        for modality, source in self._sources.items():
            if source["topic"] != topic or modality in self._faults:
                continue
            stamp = getattr(getattr(message, "header", None), "stamp", None)
            sent = 0 if stamp is None else stamp.sec * _NS + stamp.nanosec
            sent = sent or time
            clocks = self._clocks[modality]
            if clocks and abs((time - sent) - (clocks[0][1] - clocks[0][0])) > _JUMP * _NS:
                self._faults[modality] = f"the clock jumps at {time / _NS:.3f} s"
                continue
            try:
                channels, values = read_message(source, message)
                if self.channels.setdefault(modality, channels) != channels:
                    expected = ", ".join(self.channels[modality])
                    raise DataError(f"channels {', '.join(channels)}; before, {expected}")  # noqa: TRY301
                if source["feature"] == "color_histogram":
                    # Of images the histogram alone is kept, as a minute of them is gigabytes.
                    values = color_histogram(values, **source.get("settings", {}))[None]
                self._parts[modality].append(values)
                clocks.append((sent, time))
            except (DataError, AttributeError, ValueError, TypeError, OSError) as fault:
                self._faults[modality] = f"{fault} at {time / _NS:.3f} s"

    def signals(self) -> dict[str, Signal]:
        """Return what came so far, by modality, in the order of the senders' clocks."""
        found = {}
        for modality, source in self._sources.items():
            parts = self._parts[modality]
            fault = self._faults.get(modality, "")
            if not parts:
                found[modality] = Signal(np.empty(0), fault=fault or "no message in the window")
                continue
            sent = np.array([pair[0] for pair in self._clocks[modality]])
            order = np.argsort(sent, kind="stable")
            if len({part.shape[1:] for part in parts}) > 1:
                fault = fault or f"messages of several sizes on {source['topic']}"
                found[modality] = Signal(np.empty(0), fault=fault)
                continue
            values = np.concatenate([parts[place] for place in order.tolist()])
            times = (sent[order] - sent.min()) / _NS
            ready = source["feature"] == "color_histogram"
            found[modality] = Signal(values, times, fault, ready)
        return found

    def drop(self) -> None:
        """Let the messages go; the names of their channels stay."""
        for modality in self._sources:
            self._parts[modality].clear()
            self._clocks[modality].clear()

    def features(
        self, on_fault: Callable[[str, str], object] | None = None
    ) -> dict[str, NDArray[np.float32]]:
        """Return `extract` of what came so far; parameters and errors as there."""
        return _extract(self.domain, self.behavior, self.signals(), self._functions, on_fault)


def read_message(source: Mapping[str, Any], message: Any) -> tuple[tuple[str, ...], NDArray[Any]]:
    """Return the channels of a message and its samples, as a source reads them.

    Parameters
    ----------
    source : Mapping[str, Any]
        Of a modality: `fields`, paths such as "wrench.force.x", "position[2]" or "effort[elbow]"
        (by the message's `name`), by default those of the type; `encoding` of sound ("s16le",
        "f32le" or "u8").
    message : Any
        JointState, WrenchStamped, Imu, Float64MultiArray, Image, CompressedImage, AudioData, or
        any other by its fields. Joints are put in the order of their names, so that a driver that
        lists them in another order gives equal features.

    Returns
    -------
    tuple[tuple[str, ...], NDArray[Any]]
        Names of the channels (C,), and samples (1, C); (n,) of sound; (1, H, W, 3) of an image.

    Raises
    ------
    DataError
        A field that the message lacks, that is empty or no number; a type that has no default
        fields; an image or sound of an encoding that is not known.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> read_message({"fields": ["data[1]"]}, SimpleNamespace(data=[4.0, 5.0]))
    (('data[1]',), array([[5.]]))
    """
    kind = type(message).__name__.rpartition("__")[2]
    fields = source.get("fields", ())
    if not fields and kind in {"Image", "CompressedImage"}:
        image = _raw_image(message) if kind == "Image" else _packed_image(message)
        return (), image[None]
    if not fields and kind in _SOUNDS:
        encoding = source.get("encoding", "s16le")
        if encoding not in _SOUND:
            raise DataError(unknown("encoding", encoding, sorted(_SOUND)))
        form, scale, shift = _SOUND[encoding]
        data = np.asarray(_value(message, _SOUNDS[kind]), np.uint8).tobytes()
        if len(data) % np.dtype(form).itemsize:
            raise DataError(f"sound of {len(data)} bytes is not {encoding}")
        return (), np.frombuffer(data, form).astype(float) / scale - shift
    fields = fields or _FIELDS.get(kind, ())
    if not fields:
        raise DataError(f"{kind} has no default fields; name them in the source's `fields`")
    names: list[str] = []
    numbers: list[float] = []
    for path in fields:
        value = _value(message, path)
        if all(hasattr(value, axis) for axis in "xyz"):
            parts = {f"{path}.{axis}": getattr(value, axis) for axis in "xyz"}
        else:
            array = np.atleast_1d(np.asarray(value, float))
            joints = list(getattr(message, "name", ())) if kind == "JointState" else []
            if array.size == 0:
                raise DataError(f"{path} is empty")
            if joints and array.size > 1 and len(joints) != array.size:
                raise DataError(f"{path} has {array.size} values of {len(joints)} joints")
            if joints and len(joints) == array.size and "[" not in path:
                parts = {f"{path}[{name}]": array[joints.index(name)] for name in sorted(joints)}
            elif array.size == 1:
                parts = {path: array.ravel()[0]}
            else:
                parts = {f"{path}[{place}]": one for place, one in enumerate(array.ravel())}
        names += parts
        numbers += map(float, parts.values())
    return tuple(names), np.array([numbers])


def _value(message: Any, path: str) -> Any:
    """Return what a path of fields leads to; [n] is an index, [name] a joint's."""
    value = message
    for text in path.split("."):
        part = _PART.fullmatch(text)
        if part is None or not hasattr(value, part[1]):
            kind = type(message).__name__.rpartition("__")[2]
            raise DataError(f"{kind} has no field {path!r}")
        owner, value = value, getattr(value, part[1])
        if part[2] is None:
            continue
        names = list(getattr(owner, "name", ()))
        place = names.index(part[2]) if part[2] in names else -1
        place = int(part[2]) if place < 0 and part[2].isdecimal() else place
        if not 0 <= place < len(value):
            raise DataError(f"{path!r} is not there ({len(value)} values)")
        value = value[place]
    return value


def _raw_image(message: Any) -> NDArray[Any]:
    """Return (H, W, 3) of a sensor_msgs/Image; depth and Bayer patterns have no colors."""
    if message.encoding not in _IMAGES:
        raise DataError(unknown("encoding of an image", message.encoding, sorted(_IMAGES)))
    channels, size, order = _IMAGES[message.encoding]
    height, width, step = message.height, message.width, message.step
    data = np.asarray(message.data, np.uint8)
    if min(height, width) < 1 or step < width * channels * size or len(data) < height * step:
        raise DataError(f"an image of {width} x {height} pixels has {len(data)} bytes")
    rows = data[: height * step].reshape(height, step)[:, : width * channels * size]
    if size == 2:  # the higher byte alone, as histograms have few bins
        rows = rows[:, 0 if message.is_bigendian else 1 :: 2]
    return rows.reshape(height, width, channels)[:, :, order]


def _packed_image(message: Any) -> NDArray[Any]:
    from PIL import Image, UnidentifiedImageError  # noqa: PLC0415  comes with matplotlib

    try:
        with Image.open(io.BytesIO(bytes(message.data)), formats=["JPEG", "PNG"]) as image:
            return np.asarray(image.convert("RGB"))
    except (UnidentifiedImageError, Image.DecompressionBombError, OSError, SyntaxError) as fault:
        raise DataError(f"a compressed image cannot be read ({fault})") from None


def _finite(values: ArrayLike, dimensions: tuple[int, ...]) -> NDArray[np.float64]:
    """Return an array of finite numbers, at least one, of one of these numbers of axes."""
    array = np.asarray(values, dtype=float)
    if array.ndim not in dimensions:
        expected = " or ".join(map(str, dimensions))
        raise DataError(f"an array of shape {array.shape}; expected {expected} axes")
    if array.size == 0:
        raise DataError("there are no samples")
    if not np.isfinite(array).all():
        place = int(np.argwhere(~np.isfinite(array))[0][0]) if array.ndim else 0
        raise DataError(f"{array[~np.isfinite(array)][0]} in sample {place}; expected numbers")
    return array


def _count(name: str, value: Any) -> int:
    if isinstance(value, bool) or int(value) != value or not 1 <= value <= 10_000:
        raise DataError(f"{name} is {value!r}; give a whole number, 1 to 10,000")
    return int(value)


def _means(rows: NDArray[np.float64], bins: int) -> NDArray[np.float64]:
    """Return the means (bins, ...) of equal parts of the rows; of few rows one may fill several."""
    edges = np.arange(bins + 1) * len(rows) // bins
    return np.array(
        [
            rows[min(a, len(rows) - 1) : max(b, a + 1)].mean(axis=0)
            for a, b in itertools.pairwise(edges.tolist())
        ]
    )
