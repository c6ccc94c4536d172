"""Features of raw signals: compute a vector for each modality from the messages of an execution.

The domain names the source of each modality (`[sources.<modality>]`: topic, fields, feature,
settings). The import of recordings (`meal-bayes data import`) and live drivers use the same
`Recorder` and the same function `extract`, so equal messages give equal features. If a signal has
no samples, is not numeric or has a wrong shape, a `DataError` says so in one line.
"""

import functools
import inspect
import io
import math
import re
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.domain import Domain, unknown
from meal_bayes.errors import DataError, DomainError, SettingsError

Function = Callable[..., ArrayLike]
Faults = Callable[[str, str], object]
_NS = 1_000_000_000
_JUMP = 1.0  # s by which the header's clock may drift from the receiver's in one execution
_STEP = re.compile(r"(\w+)(?:\[([^\]]+)\])?")  # of a field's path
_SOUND = {"s16le": ("<i2", 2.0**15, 0.0), "f32le": ("<f4", 1.0, 0.0), "u8": ("u1", 128.0, 1.0)}
_IMAGES = {  # channels by encoding
    "rgb8": "rgb", "bgr8": "bgr", "8UC3": "bgr", "rgba8": "rgba", "bgra8": "bgra", "mono8": "g",
    "8UC1": "g",
}  # fmt: skip


class Signal(NamedTuple):
    """Samples (T, ...) of one modality, the times (s) of its messages, and a fault, if any."""

    values: NDArray[Any]
    times: NDArray[np.float64] = np.empty(0)
    fault: str = ""


def temporal_bins(
    values: ArrayLike, bins: int = 10, times: ArrayLike | None = None
) -> NDArray[np.float64]:
    """Return the mean of each channel in bins of equal duration, as in CY101's haptic features.

    Parameters
    ----------
    values : ArrayLike
        (T, C) samples of C channels, or (T,) samples of one channel.
    bins : int
        Number of bins. A bin without a sample is interpolated between its neighbors.
    times : ArrayLike | None
        (T,) ascending times of the samples, s. By default samples are equally spaced.

    Returns
    -------
    NDArray[np.float64]
        (bins * C,) means, all bins of the first channel first. Source: J. Sinapov et al.,
        "Grounding semantic categories in behavioral interactions", RAS 62(5), 2014.

    Examples
    --------
    >>> temporal_bins([1, 1, 3, 3], bins=2)
    array([1., 3.])
    """
    array = _finite(values, 1, 2)
    bins = _count("bins", bins)
    moments = _finite(np.arange(len(array)) if times is None else times, 1)
    if len(moments) != len(array) or (np.diff(moments) < 0).any():
        raise DataError(f"{len(moments)} times of {len(array)} samples; give each one, ascending")
    place = (moments - moments[0]) / (moments[-1] - moments[0] or 1.0) * bins
    filled, first, counts = np.unique(
        np.minimum(place, bins - 1).astype(int), return_index=True, return_counts=True
    )
    sums = np.add.reduceat(array.reshape(len(array), -1), first, axis=0)
    means = (sums / counts[:, None]).T
    if len(filled) < bins:
        means = np.array([np.interp(np.arange(bins), filled, channel) for channel in means])
    return means.ravel()


def spectrogram_bins(
    sound: ArrayLike, rate: float, frequency_bins: int = 10, time_bins: int = 10
) -> NDArray[np.float64]:
    """Return the binned log power of sound over frequency and time.

    Parameters
    ----------
    sound : ArrayLike
        (T,) samples in [-1, 1], or (T, C) samples of several channels, which are averaged.
    rate : float
        Sampling rate, Hz.
    frequency_bins, time_bins : int
        Numbers of equal bins from 0 Hz to rate / 2, and from the first sample to the last.

    Returns
    -------
    NDArray[np.float64]
        (frequency_bins * time_bins,) log10 of the mean power density (1/Hz), all times of the
        lowest frequencies first. Silence has the value -10. See J. Sinapov et al., "Interactive
        learning of the acoustic properties of household objects", ICRA 2009.

    Examples
    --------
    >>> spectrogram_bins(np.zeros(800), rate=8000, frequency_bins=2, time_bins=1)
    array([-10., -10.])
    """
    from scipy.signal import spectrogram  # noqa: PLC0415  takes a third of a second

    array = _finite(sound, 1, 2)
    if not 0 < float(rate) < np.inf:
        raise DataError(f"the rate of the sound is {rate}; give samples a second, above 0")
    length = min(len(array), max(2, round(0.032 * rate)))  # 32 ms, as usual for speech
    window = "boxcar" if length < 3 else "hann"
    mono = array.reshape(len(array), -1).mean(axis=1)
    power = spectrogram(mono, rate, window, length, length // 2, detrend=False)[2]
    by_frequency = temporal_bins(power, frequency_bins).reshape(power.shape[1], -1)
    return np.asarray(np.log10(temporal_bins(by_frequency, time_bins) + 1e-10))


def color_histogram(image: ArrayLike, bins: int = 4) -> NDArray[np.float64]:
    """Return the joint histogram of red, green and blue.

    Parameters
    ----------
    image : ArrayLike
        (H, W, 3) colors of an image, (T, H, W, 3) colors of several images, or (H, W) gray values:
        whole numbers from 0 to 255, or fractions from 0 to 1.
    bins : int
        Number of bins of each color.

    Returns
    -------
    NDArray[np.float64]
        (bins ** 3,) fractions of the pixels, which sum to 1; blue varies fastest. See M. J. Swain
        and D. H. Ballard, "Color indexing", IJCV 7(1), 1991.

    Examples
    --------
    >>> color_histogram(np.full((2, 2, 3), 255), bins=2)
    array([0., 0., 0., 0., 0., 0., 0., 1.])
    """
    bins = _count("bins", bins)
    array = np.asarray(image)
    if array.dtype != np.uint8 or not array.size:
        top = 255 if array.dtype.kind in "ui" else 1
        array = _finite(array, 2, 3, 4)
        if array.min() < 0 or array.max() > top:
            raise DataError(f"an image has values {array.min()} to {array.max()}; {top} is white")
        array = (array * (255 / top)).astype(np.uint8)
    array = np.repeat(array[..., None], 3, axis=2) if array.ndim == 2 else array
    if array.ndim not in {3, 4} or array.shape[-1] != 3:
        raise DataError(f"an image has shape {array.shape}; expected (H, W, 3) or (H, W)")
    place = (np.arange(256) * bins // 256).astype(np.min_scalar_type(bins**3))
    red, green, blue = (place[array[..., color]] for color in range(3))
    counts = np.bincount(((red * bins + green) * bins + blue).ravel(), minlength=bins**3)
    return np.asarray(counts / counts.sum())


FUNCTIONS: Mapping[str, Function] = {
    function.__name__: function for function in (temporal_bins, spectrogram_bins, color_histogram)
}


def extract(
    domain: Domain,
    behavior: str,
    signals: Mapping[str, Signal | ArrayLike],
    functions: Mapping[str, Function] | None = None,
    on_fault: Faults | None = None,
) -> dict[str, NDArray[np.float32]]:
    """Return the feature vector (D,) of each modality of one execution.

    Parameters
    ----------
    domain, behavior : Domain, str
        Domain, and name of the executed behavior. Each modality of the behavior must have a source
        in the domain.
    signals : Mapping[str, Signal | ArrayLike]
        Samples of each modality; `Recorder.signals` makes them from messages.
    functions : Mapping[str, Function] | None
        Your own feature functions, by the names that the domain uses. A function with a parameter
        `times` also gets the times of the samples, s.
    on_fault : Callable[[str, str], object] | None
        Called with the name of a modality and what is wrong with its signal; the modality is then
        left out. By default the first fault raises a `DataError`.

    Examples
    --------
    >>> from meal_bayes.domain import load_domain
    >>> lab = {"extends": "toy", "sources": {"color": {
    ...     "topic": "/camera", "feature": "color_histogram", "settings": {"bins": 2}}}}
    >>> black = {"color": np.zeros((1, 4, 4, 3), np.uint8)}
    >>> extract(load_domain(lab), "look", black)["color"][:2]
    array([1., 0.], dtype=float32)
    """
    found = {}
    for modality, (function, settings) in check_sources(domain, [behavior], functions).items():
        signal = signals.get(modality, Signal(np.empty(0), fault="there is no signal"))
        signal = signal if isinstance(signal, Signal) else Signal(np.asarray(signal))
        if "times" in settings and len(signal.times) == len(signal.values):
            settings["times"] = signal.times
        try:
            if signal.fault:
                raise DataError(signal.fault)  # noqa: TRY301
            with np.errstate(over="ignore"):
                vector = _finite(function(signal.values, **settings), 0, 1).astype(np.float32)
            found[modality] = _finite(np.atleast_1d(vector), 1).astype(np.float32)
        except (DataError, ValueError, TypeError) as fault:
            message = f"{domain.sources[modality]['topic']}: {fault}"
            if on_fault is None:
                raise DataError(message) from fault
            on_fault(modality, message)
    return found


def check_sources(
    domain: Domain, behaviors: Iterable[str], functions: Mapping[str, Function] | None = None
) -> dict[str, tuple[Function, dict[str, Any]]]:
    """Return the feature function, with its settings, for each modality of some behaviors.

    Raises
    ------
    DomainError
        A modality has no source, or its feature function does not have one of the settings.
    SettingsError
        A feature function is neither in the package nor in `functions`.
    """
    known = {**(functions or {}), **FUNCTIONS}
    if taken := sorted(name for name in functions or {} if name in FUNCTIONS):
        raise SettingsError(
            f"{taken[0]!r} is a feature of the package; give your own feature another name."
        )
    found = {}
    executed = [domain.behaviors[domain.behavior_index(name)] for name in behaviors]
    for modality in dict.fromkeys(name for one in executed for name in one.modalities):
        source = domain.sources.get(modality)
        if source is None:
            raise DomainError(f"The modality {modality!r} has no source; add [sources.{modality}] "
                              "with topic and feature to the domain.")  # fmt: skip
        name, settings = source["feature"], dict(source.get("settings", {}))
        if name not in known:
            raise SettingsError(unknown("feature", name, sorted(known)))
        signature = _signature(known[name])
        if "times" in signature.parameters:
            settings["times"] = None  # `extract` gives them
        try:
            signature.bind(None, **settings)
        except TypeError as fault:
            raise DomainError(f"[sources.{modality}] {name}: {fault}.") from None
        found[modality] = known[name], settings
    return found


_signature = functools.lru_cache(inspect.signature)


class Recorder:
    """Collect the messages of one execution, live or from a bag, and compute their features.

    The parameters are those of `extract`.

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
        self.domain, self.behavior, self._functions = domain, behavior, functions
        self._sources = {m: domain.sources[m] for m in check_sources(domain, [behavior], functions)}
        self.topics = frozenset(source["topic"] for source in self._sources.values())
        self.channels: dict[str, tuple[str, ...]] = {}
        self._faults: dict[str, str] = {}
        # Of each message: when it was sent and received (ns), and its samples.
        self._taken: dict[str, list[tuple[int, int, NDArray[Any]]]] = {m: [] for m in self._sources}

    def add(self, topic: str, time: int, message: Any) -> None:
        """Add a message of a topic, which was received at a time (ns).

        The message is one of `rclpy` or `rosbags`, or any object with the fields of the source. If
        it has a header, the time in the header is used instead. Messages of topics that the
        behavior does not need are ignored.
        """
        for modality, source in self._sources.items():
            if source["topic"] != topic or modality in self._faults:
                continue
            taken = self._taken[modality]
            try:
                sent = _stamp_of(message) or time
                channels, values = read_message(source, message)
                before = self.channels.setdefault(modality, channels)
                if taken and abs(time - sent - taken[0][1] + taken[0][0]) > _JUMP * _NS:
                    raise DataError("the clock jumps")  # noqa: TRY301
                if channels != before:
                    raise DataError(f"the number of channels changed from {before} to {channels}")  # noqa: TRY301
                if taken and taken[0][2].shape[1:] != values.shape[1:]:
                    raise DataError("messages have several sizes")  # noqa: TRY301
                taken.append((sent, time, values))
            except (DataError, AttributeError, ValueError, TypeError, OSError) as fault:
                self._faults[modality] = f"{fault} at {time / _NS:.3f} s"

    def signals(self) -> dict[str, Signal]:
        """Return the signal of each modality so far, in the order of the times in the headers."""
        found = {}
        for modality, messages in self._taken.items():
            fault = self._faults.get(modality, "" if messages else "no message in the window")
            taken = sorted(messages, key=lambda one: one[0])
            values = np.concatenate([one[2] for one in taken]) if taken else np.empty(0)
            times = np.array([(sent - taken[0][0]) / _NS for sent, _, _ in taken])
            found[modality] = Signal(values, times, fault)
        return found

    def features(self, on_fault: Faults | None = None) -> dict[str, NDArray[np.float32]]:
        """Return the features of the messages so far; see `extract`."""
        return extract(self.domain, self.behavior, self.signals(), self._functions, on_fault)


def _stamp_of(message: Any) -> int:
    """Return the time (ns) in a message's header, of ROS 2 or ROS 1; 0 where there is none."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is None:
        return 0
    names = ("secs", "nsecs") if hasattr(stamp, "secs") else ("sec", "nanosec")
    seconds, nanoseconds = (int(getattr(stamp, name)) for name in names)
    return seconds * _NS + nanoseconds


def read_message(source: Mapping[str, Any], message: Any) -> tuple[tuple[str, ...], NDArray[Any]]:
    """Return the names (C,) of a message's channels, and its samples, as a source defines them.

    The samples have the shape (1, C), (n,) for sound, and (1, H, W, 3) for an image. The `fields`
    of the source are paths such as "wrench.force.x", "position[2]" or "effort[elbow]" (by the
    message's `name`). Without fields, the type of the message must be JointState, WrenchStamped,
    Imu, Float64MultiArray, Image, CompressedImage or AudioData. Joints are sorted by name, so the
    features do not depend on their order in the message. `encoding` is the encoding of sound
    ("s16le", "f32le" or "u8"). If an image has more than `pixels` pixels (10,000 by default; 0
    means no limit), only every n-th row and column is kept.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> read_message({"fields": ["data[1]"]}, SimpleNamespace(data=[4.0, 5.0]))
    (('data[1]',), array([[5.]]))
    """
    kind = type(message).__name__.rpartition("__")[2]
    fields = source.get("fields") or _TYPES.get(kind)
    if fields is None:
        raise DataError(f"{kind} has no default fields; name them in the source's `fields`")
    if callable(fields):
        return (), fields(message, source)
    names: list[str] = []
    numbers: list[float] = []
    for path in fields:
        value = functools.reduce(_field, path.split("."), message)
        if axes := [axis for axis in "xyz" if hasattr(value, axis)]:
            names += [f"{path}.{axis}" for axis in axes]
            numbers += [float(getattr(value, axis)) for axis in axes]
            continue
        array = np.asarray(value, float)
        keys = list(getattr(message, "name", ())) if kind == "JointState" else []
        if array.size == 0 or (keys and array.ndim and len(keys) != array.size):
            raise DataError(f"{path} has {array.size} values, and there are {len(keys)} names")
        order = sorted(range(array.size), key=(keys or range(array.size)).__getitem__)
        names += [f"{path}[{keys[i] if keys else i}]" for i in order] if array.ndim else [path]
        numbers += array.ravel()[order].tolist()
    return tuple(names), np.array([numbers])


def _field(owner: Any, text: str) -> Any:
    part = _STEP.fullmatch(text)
    if part is None or not hasattr(owner, part[1]):
        raise DataError(f"{type(owner).__name__.rpartition('__')[2]} has no field {text!r}")
    value, key = getattr(owner, part[1]), part[2]
    if key is None:
        return value
    names = list(getattr(owner, "name", ()))
    place = names.index(key) if key in names else int(key) if key.isdecimal() else -1
    if not 0 <= place < len(value):
        raise DataError(f"{text!r} is not there ({len(value)} values)")
    return value[place]


def _sound(message: Any, source: Mapping[str, Any]) -> NDArray[np.float64]:
    encoding = source.get("encoding", "s16le")
    if encoding not in _SOUND:
        raise DataError(unknown("encoding", encoding, sorted(_SOUND)))
    form, scale, shift = _SOUND[encoding]
    return np.frombuffer(bytes(getattr(message, "audio", message).data), form) / scale - shift


def _image(message: Any, source: Mapping[str, Any]) -> NDArray[np.uint8]:
    encoding, height, width, step = message.encoding, message.height, message.width, message.step
    if encoding not in _IMAGES:  # depth and Bayer patterns have no colors
        raise DataError(unknown("encoding of an image", encoding, sorted(_IMAGES)))
    order = _IMAGES[encoding]
    data = np.asarray(message.data, np.uint8)
    if min(height, width) < 1 or step < width * len(order) or len(data) < height * step:
        raise DataError(f"an image of {width} x {height} pixels has {len(data)} bytes")
    rows = data[: height * step].reshape(height, step)[:, : width * len(order)]
    image = _thinned(rows.reshape(height, width, len(order)), source)
    return image if order == "rgb" else image[..., [max(order.find(c), 0) for c in "rgb"]]


def _packed_image(message: Any, source: Mapping[str, Any]) -> NDArray[np.uint8]:
    from PIL import Image  # noqa: PLC0415  comes with matplotlib

    try:
        with Image.open(io.BytesIO(bytes(message.data)), formats=["JPEG", "PNG"]) as image:
            return _thinned(np.asarray(image.convert("RGB")), source)
    except (Image.DecompressionBombError, OSError, SyntaxError) as fault:
        raise DataError(f"a compressed image cannot be read ({fault})") from None


def _thinned(image: NDArray[np.uint8], source: Mapping[str, Any]) -> NDArray[np.uint8]:
    """Return the image (1, H, W, C) with every n-th row and column, so that it fits `pixels`."""
    pixels = image.shape[0] * image.shape[1]
    every = math.ceil(math.sqrt(pixels / (source.get("pixels", 10_000) or pixels)))
    return image[None, ::every, ::every].copy() if every > 1 else image[None]


_TYPES: Mapping[str, Any] = {  # by message type: fields where the source names none, or a reader
    "JointState": ("effort",),
    "WrenchStamped": ("wrench.force", "wrench.torque"),
    "Imu": ("linear_acceleration", "angular_velocity"),
    "Float64MultiArray": ("data",),
    "AudioData": _sound,
    "AudioDataStamped": _sound,
    "Image": _image,
    "CompressedImage": _packed_image,
}


def _finite(values: ArrayLike, *dimensions: int) -> NDArray[np.float64]:
    """Return an array of one or more finite numbers that has one of these numbers of axes."""
    array = np.asarray(values, dtype=float)
    if array.ndim not in dimensions:
        raise DataError(f"an array of {array.ndim} axes; expected {min(dimensions)}")
    if array.size == 0:
        raise DataError("there are no samples")
    if not (good := np.isfinite(array)).all():
        raise DataError(f"{array[~good][0]} in sample {np.argwhere(~good)[0][:1]}; give numbers")
    return array


def _count(name: str, value: Any) -> int:
    if isinstance(value, bool) or int(value) != value or not 1 <= value <= 10_000:
        raise DataError(f"{name} is {value!r}; give a whole number, 1 to 10,000")
    return int(value)
