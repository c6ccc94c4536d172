"""Make recordings from bags of ROS 1 and ROS 2, which `rosbags` reads without ROS.

Each bag is read once, in the order of time; only the messages of executions in progress are in
memory. Each fault of a bag is reported in one line, and the import continues with the other bags.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.datasets.csv_files import read_labels, read_rows, save_csv_folder
from meal_bayes.datasets.dataset import Dataset
from meal_bayes.domain import Domain, unknown
from meal_bayes.errors import DataError, OutputError, SettingsError
from meal_bayes.features import Function, Recorder, Signal, check_sources
from meal_bayes.files import checked_path, keep_folder
from meal_bayes.look import BLUE, drawn_in_style, listed, name_axes, warn_user
from meal_bayes.untrusted import name_fault

if TYPE_CHECKING:
    from meal_bayes.canvas import Axes

_COLUMNS = ["bag", "object", "behavior", "start", "end"]
_NS = 1_000_000_000
_EPOCH = 100_000_000 * _NS  # greater times are counted from 1970, smaller ones from the bag's start
_NEVER = 1 << 62


@dataclass
class Execution:
    """One execution, its start and end (ns), and its features, channels and signals by modality."""

    bag: str
    object_name: str
    behavior: str
    start: int
    end: int = _NEVER
    features: dict[str, NDArray[np.float32]] = field(default_factory=dict)
    channels: dict[str, tuple[str, ...]] = field(default_factory=dict)
    signals: dict[str, Signal] = field(default_factory=dict)

    def __str__(self) -> str:
        return f"{self.behavior} of {self.object_name} at {self.start / _NS:.3f} s"


class Topic(NamedTuple):
    """A topic in a bag: number of messages, their rate (Hz), and the longest gap (s)."""

    bag: str
    topic: str
    messages: int
    rate: float
    gap: float


@dataclass
class BagReport:
    """Content of bags: executions, topics, and a line for each fault."""

    executions: list[Execution] = field(default_factory=list)
    topics: list[Topic] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    last: tuple[str, int] = "", 0  # topic and time (ns) of the message that was read last


def find_bags(paths: Iterable[str | Path]) -> list[Path]:
    """Return the bags among some paths, and those in folders among them.

    A bag is a `.bag`, `.mcap` or `.db3` file, or a folder with a file `metadata.yaml`.

    Raises
    ------
    SettingsError
        A path contains no bag, or two bags have the same name.
    """
    found: dict[str, Path] = {}
    for path in [checked_path("The bag", given) for given in paths]:
        bags = [path] if _is_bag(path) else sorted(filter(_is_bag, path.glob("*")))
        if not bags:
            raise SettingsError(f"{path} holds no bag (.bag, .mcap, .db3 or a ROS 2 folder).")
        for bag in bags:
            if found.setdefault(bag.name, bag) != bag:
                raise SettingsError(f"Two bags have the name {bag.name!r}; rename one.")
    return list(found.values())


def _is_bag(path: Path) -> bool:
    of_file = path.suffix in {".bag", ".mcap", ".db3"} and path.is_file()
    return of_file or (path / "metadata.yaml").is_file()


def read_bags(
    domain: Domain,
    bags: Iterable[str | Path],
    *,
    executions: str | Path | None = None,
    markers: str | None = None,
    functions: Mapping[str, Function] | None = None,
    progress: Callable[[float, int], object] = lambda done, total: None,
    keep: int = 0,
) -> BagReport:
    """Extract the features of all executions in bags.

    Parameters
    ----------
    domain : Domain
        Domain with a source for each modality.
    bags : Iterable[str | Path]
        Bags, or folders that contain bags; see `find_bags`.
    executions : str | Path | None
        CSV file with the columns `bag,object,behavior,start,end`: the name of the bag, with or
        without its ending, and times in seconds since the first message of the bag, or since 1970.
    markers : str | None
        Topic of type std_msgs/String that marks executions, in place of `executions`. The text
        "lift: red mug" (behavior and object) begins an execution; an empty text, or the next
        marker, ends it.
    functions : Mapping[str, Function] | None
        Your own feature functions, as for `meal_bayes.features.extract`.
    progress : Callable[[float, int], object]
        Called with the number of finished bags, which may be a fraction, and the number of bags.
    keep : int
        Number of the execution in each bag, counted from 1, whose signals are kept.

    Returns
    -------
    BagReport
        Executions, topics and faults. A damaged bag has no executions, and one fault.

    Raises
    ------
    DataError
        A row of `executions` is not valid.
    SettingsError
        A bag or a feature function is missing, or rosbags is not installed.
    """
    try:
        from rosbags.highlevel import AnyReader  # noqa: PLC0415  an extra
        from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415
    except ImportError:
        raise SettingsError(
            "Bags are read by rosbags, which is not installed: pip install 'meal-bayes[bags]'"
        ) from None
    check_sources(domain, [domain.behaviors[place].name for place in domain.recorded], functions)
    types = get_typestore(Stores.LATEST)  # older bags of ROS 2 hold no definitions
    paths = find_bags(bags)
    names = _bag_names(paths)
    rows = [] if executions is None else _listed(executions, domain, names, others=keep > 0)
    report = BagReport()
    channels: dict[tuple[str, str], tuple[str, ...]] = {}
    for number, bag in enumerate(paths):
        found = BagReport([one for one in rows if one.bag == bag.name])
        try:
            with AnyReader([bag], default_typestore=types) as reader:
                for part in _read(reader, found, bag.name, domain, markers, functions, keep):
                    progress(number + part, len(paths))
        except Exception as fault:  # a torn file raises whatever its decoder does
            where = "" if not found.last[0] else f"{found.last[0]} at {found.last[1] / _NS:.3f} s "
            text = " ".join(f"{where}cannot be read ({type(fault).__name__}: {fault}".split())
            found = BagReport(faults=[f"{text[:250]}); left out"])
        for one in found.executions:  # features must have the channels of those before
            for modality, vector in list(one.features.items()):
                now = (*one.channels[modality], f"{len(vector)} features")
                before = channels.setdefault((one.behavior, modality), now)
                if now != before:
                    del one.features[modality]
                    found.faults.append(f"{one}, {modality} has {now}; the ones before {before}")
        report.executions += [one for one in found.executions if one.features]
        report.topics += found.topics
        report.faults += [f"{bag.name}: {fault}" for fault in found.faults]
        progress(number + 1, len(paths))
    return report


def _bag_names(paths: Iterable[Path]) -> dict[str, str | None]:
    """Map the names of bags, with and without ending, to bags; None if a name is ambiguous."""
    names: dict[str, str | None] = {}
    for path in paths:
        names[path.stem] = None if path.stem in names else path.name
    return names | {path.name: path.name for path in paths}


def _listed(
    path: str | Path, domain: Domain, bags: Mapping[str, str | None], *, others: bool
) -> list[Execution]:
    """Read a file of executions; with `others`, rows of other bags are ignored."""
    (where, header), *rows = read_rows(checked_path("The executions", path))
    if header != _COLUMNS:
        raise DataError(f"{where}: the header {','.join(header)[:60]!r}; write {_COLUMNS}.")
    found = []
    wheres: dict[tuple[object, ...], str] = {}  # of executions, where each one is listed
    for where, cells in rows:
        try:
            bag, name, behavior, *times = cells
            start, end = (_nanoseconds(time) for time in times)
            if not 0 <= start < end < _NEVER:
                raise DataError(f"from {times[0]!r} to {times[1]!r} s")  # noqa: TRY301
            if named := bags.get(bag):
                other = wheres.setdefault((named, name, behavior, start, end), where)
                if other != where:
                    raise DataError(f"the execution of {other} again")  # noqa: TRY301
                found.append(_execution(domain, named, name, behavior, start, end))
            elif bag in bags:
                raise DataError(f"two bags are called {bag!r}: give the ending")  # noqa: TRY301
            elif not others:
                raise DataError(unknown("bag", bag, bags))  # noqa: TRY301
        except (DataError, ValueError) as fault:
            text = f"{fault}; expected {','.join(_COLUMNS)}, with start < end (s)."
            raise DataError(f"{where}: {text}") from None
    return found


def _nanoseconds(text: str) -> int:
    """Convert seconds to nanoseconds; raise `DataError` if the text is no time, or too large."""
    try:
        seconds = Decimal(text) if text.isascii() and "_" not in text else Decimal("nan")
        # Before it is whole: the digits of 1e999999 would fill the memory.
        if seconds.adjusted() < len(str(_NEVER)):
            return int(seconds * _NS)
    except (ValueError, ArithmeticError):  # of `Decimal`: NaN, infinity, other texts
        pass
    raise DataError(f"the time {text!r:.40}")


def _execution(
    domain: Domain, bag: str, name: str, behavior: str, start: int, end: int = _NEVER
) -> Execution:
    names = [domain.behaviors[place].name for place in domain.recorded]
    if fault := name_fault(name):
        raise DataError(f"the object's name {name[:40]!r} {fault}")
    if behavior not in names:
        raise DataError(unknown("behavior with modalities", behavior, names).rstrip("."))
    return Execution(bag, name, behavior, start, end)


def _read(
    reader: Any,
    found: BagReport,
    bag: str,
    domain: Domain,
    markers: str | None,
    functions: Mapping[str, Function] | None,
    keep: int,
) -> Iterator[float]:
    """Read a bag into a report of its executions; yield the fraction of its duration so far."""
    wanted = {source["topic"] for source in domain.sources.values()} | {markers or ""} - {""}
    connections = [one for one in reader.connections if one.topic in wanted and one.msgcount]
    absent = wanted - {one.topic for one in connections}
    found.faults += [f"no message on {topic}" for topic in sorted(absent)]
    if not connections:
        found.executions.clear()
        return
    waiting = _windows(reader, found, bag, domain, [c for c in connections if c.topic == markers])
    running: list[tuple[Execution, Recorder]] = []
    clocks: dict[str, list[int]] = {}  # by topic: number of messages, first, last, longest gap
    first, length, shown = reader.start_time, max(reader.duration, 1), 0.0

    def close(time: int) -> None:
        for one, recorder in [pair for pair in running if pair[0].end <= time]:
            running.remove((one, recorder))
            faults: dict[str, str] = {}
            one.features = recorder.features(faults.__setitem__)
            one.channels = recorder.channels
            found.executions.append(one)
            if len(found.executions) == keep:
                one.signals = recorder.signals()
            for modality, fault in faults.items():
                if domain.sources[modality]["topic"] not in absent:  # one line is enough
                    found.faults.append(f"{one}, {modality}: {fault}")

    for connection, time, raw in reader.messages(connections):
        topic = connection.topic
        while waiting and waiting[-1].start <= time:
            one = waiting.pop()
            running.append((one, Recorder(domain, one.behavior, functions)))
        if running:
            close(time)
            takers = [recorder for _, recorder in running if topic in recorder.topics]
            message = reader.deserialize(raw, connection.msgtype) if takers else None
            for recorder in takers:
                recorder.add(topic, time, message)
        clock = clocks.setdefault(topic, [0, time, time, 0])
        clock[0] += 1
        clock[2], clock[3] = time, max(clock[3], time - clock[2])
        found.last = topic, time
        if (time - first) / length > shown + 0.01:
            yield (shown := (time - first) / length)
    running += [(one, Recorder(domain, one.behavior, functions)) for one in reversed(waiting)]
    close(_NEVER)
    number = sum(count for count, *_ in clocks.values())
    if number != (counted := sum(connection.msgcount for connection in connections)):
        raise DataError(f"{number} messages were read of the {counted} that it counts")
    if not found.executions:
        found.faults.append("no execution")
    for topic, (count, begin, end, gap) in sorted(clocks.items()):
        rate = (count - 1) * _NS / (end - begin) if end > begin else float("nan")
        found.topics.append(Topic(bag, topic, count, rate, gap / _NS))


def _windows(
    reader: Any, found: BagReport, bag: str, domain: Domain, markers: list[Any]
) -> list[Execution]:
    """Return the executions of the table or of the markers, the last one first."""
    windows: list[Execution] = []
    for one in found.executions:
        shift = reader.start_time if one.start < _EPOCH else 0
        one.start, one.end = one.start + shift, one.end + shift
        if one.end > reader.end_time:
            found.faults.append(f"{one} ends after the bag's end")
        elif one.start < reader.start_time:
            found.faults.append(f"{one} starts before the bag's start")
        elif one in windows:  # once in seconds since 1970, and once in seconds of the bag
            found.faults.append(f"{one} is listed twice")
        else:
            windows.append(one)
    found.executions = []
    for connection, time, raw in reader.messages(markers) if markers else ():
        if windows:
            windows[-1].end = min(windows[-1].end, time)
        text = str(reader.deserialize(raw, connection.msgtype).data).strip()
        behavior, _, name = (part.strip() for part in text.partition(":"))
        try:
            windows += [_execution(domain, bag, name, behavior, time)] if text else []
        except DataError as fault:
            where = f"{connection.topic} at {time / _NS:.3f} s"
            found.faults.append(f"{where}: the marker {text[:60]!r}: {fault}")
    return sorted(windows, key=lambda one: one.start, reverse=True)


def save_recordings(
    domain: Domain, report: BagReport, folder: str | Path, labels: str | Path | None = None
) -> None:
    """Write recordings as a folder that `load_dataset` reads; after an error, write nothing.

    `labels` is a file with the labels of the objects; labels of other objects are unknown. If a
    behavior and modality has no recording, the function raises a `DataError`; if the folder
    exists, an `OutputError`.
    """
    folder = checked_path("The folder", folder)
    if folder.exists():
        raise OutputError(f"{folder} exists already; remove it, or name another folder.")
    names = list(dict.fromkeys(one.object_name for one in report.executions))
    known: dict[str, Any] = {}
    if labels is not None:
        objects, values = read_labels(checked_path("The labels", labels), domain)
        known = dict(zip(objects, values, strict=True))
        strangers = [name for name in objects if name not in names]
        if strangers and not known.keys() >= {*names}:
            warn_user(
                f"{labels} labels {listed(strangers)}, of which the bags have no execution, and "
                f"has no labels of {listed([name for name in names if name not in known])}; is a "
                "name written in two ways?"
            )
    features: dict[tuple[str, str], dict[str, list[NDArray[np.float32]]]] = {}
    for behavior, modality in domain.contexts:
        executed = [one for one in report.executions if one.behavior == behavior]
        example = [one.features[modality] for one in executed if modality in one.features]
        if not example:
            raise DataError(f"The bags hold no {modality} of {behavior}; {folder} is not written.")
        features[behavior, modality] = {one.object_name: [] for one in executed}
        for one in executed:
            vector = one.features.get(modality, np.full_like(example[0], np.nan))
            features[behavior, modality][one.object_name].append(vector)
    unlabeled = np.full(len(domain.attributes), -1)
    table = np.array([known.get(name, unlabeled) for name in names])
    dataset = Dataset.from_frames(domain, features, table, objects=names)

    def write(draft: Path) -> None:
        draft.mkdir()
        save_csv_folder(dataset, draft)

    keep_folder(folder, write)


def plot_execution(one: Execution) -> "Axes":
    """Draw the signals of an execution (left) and its features (right); return the first axes.

    For images, the mean color is drawn.
    """
    from meal_bayes.canvas import Figure  # noqa: PLC0415  takes half a second

    shown = [name for name in one.signals if name in one.features]
    with drawn_in_style():
        figure = Figure(figsize=(7.2, 1.0 + 1.9 * len(shown)), layout="constrained")
        rows = figure.subplots(len(shown), 2, squeeze=False, width_ratios=(3, 2))
        for (left, right), name in zip(rows, shown, strict=True):
            values, times, _ = one.signals[name]
            left.set_title(f"{name}: {len(times)} messages", loc="left")
            what = "mean color" if values.ndim == 4 else "signal"
            values = values.mean(axis=(1, 2)) if values.ndim == 4 else values
            if len(times) != len(values):  # sound: many samples a message
                times = np.linspace(0, times[-1], len(values))
            lines = left.plot(times, values, lw=0.8, marker="." if len(values) < 3 else "")
            if 1 < len(lines) < 7:
                names = one.channels[name] or ("red", "green", "blue")
                left.legend(lines, names, frameon=True, fontsize=7)
            left.axvspan(times[0], times[-1], color="#E6E6E6", zorder=0)
            name_axes(left, "time since the first message (s)", what)
            right.stairs(one.features[name], baseline=None, color=BLUE)
            right.set_title(f"{len(one.features[name])} features", loc="left")
            name_axes(right, "number of the feature", "value", grid="y")
        figure.suptitle(f"{one.behavior} of {one.object_name} in {one.bag}")
    axes: Axes = rows[0, 0]
    return axes
