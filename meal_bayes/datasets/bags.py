"""Recordings from bags of ROS 1 and ROS 2, read by `rosbags` without ROS.

Each bag is read once, in the order of time; only the messages of executions that are under way are
held. What is wrong with a bag is one line, and the others go on.
"""

import csv
import io
import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.datasets.csv_files import read_labels, read_rows
from meal_bayes.domain import Domain, unknown
from meal_bayes.errors import DataError, OutputError, SettingsError
from meal_bayes.features import Function, Recorder, Signal, check_sources
from meal_bayes.files import checked_path, keep_folder
from meal_bayes.look import BLUE, drawn_in_style, listed, name_axes
from meal_bayes.untrusted import name_fault

if TYPE_CHECKING:
    from meal_bayes.canvas import Axes

EXECUTIONS = ("bag", "object", "behavior", "start", "end")
_NS = 1_000_000_000
_EPOCH = 100_000_000  # s; a greater time is counted from 1970, a smaller one from the bag's start


@dataclass
class Execution:
    """One execution of a behavior in a bag.

    Attributes
    ----------
    bag, object_name, behavior : str
        Of what.
    start, end : int
        Times of the bag's clock, ns; messages from `start` on and before `end` belong to it.
    features : dict[str, NDArray[np.float32]]
        (D,) by modality.
    recorder : Recorder | None
        Of the messages, while the bag is read.
    signals : dict[str, Signal]
        By modality, of the one execution that is kept to be drawn.
    """

    bag: str
    object_name: str
    behavior: str
    start: int
    end: int = 1 << 62
    features: dict[str, NDArray[np.float32]] = field(default_factory=dict)
    recorder: Recorder | None = None
    signals: dict[str, Signal] = field(default_factory=dict)


class Topic(NamedTuple):
    """What a bag holds of one topic: number of messages, their rate (Hz), the longest gap (s)."""

    bag: str
    topic: str
    messages: int
    rate: float
    gap: float


@dataclass
class BagReport:
    """What was found in bags: executions, topics, and a line for each thing that is wrong."""

    executions: list[Execution] = field(default_factory=list)
    topics: list[Topic] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)


def find_bags(paths: Iterable[str | Path]) -> list[Path]:
    """Return the bags that are named, or that lie in the folders that are named.

    A bag is a `.bag` or `.mcap` or `.db3` file, or a folder with a `metadata.yaml`.

    Raises
    ------
    SettingsError
        A path that holds no bag, or two bags of one name.
    """
    found: list[Path] = []
    for given in paths:
        path = checked_path("The bag", given)
        inside = sorted(path.iterdir()) if path.is_dir() and not _is_bag(path) else [path]
        bags = [one for one in inside if _is_bag(one)]
        if not bags:
            raise SettingsError(f"{path} holds no bag (.bag, .mcap, .db3 or a ROS 2 folder).")
        found += [bag for bag in bags if bag not in found]
    names = [path.name for path in found]
    if twice := [name for name in names if names.count(name) > 1]:
        raise SettingsError(f"Two bags have the name {twice[0]!r}; rename one.")
    return found


def _is_bag(path: Path) -> bool:
    if path.is_dir():
        return (path / "metadata.yaml").is_file()
    return path.suffix in {".bag", ".mcap", ".db3"} and path.is_file()


def read_executions(
    path: str | Path, domain: Domain, bags: Sequence[str], *, others: bool = False
) -> list[Execution]:
    """Read `bag,object,behavior,start,end`: seconds since the bag's first message, or since 1970.

    The bag is its file's name, with or without the ending. Where there may be `others`, rows of
    bags that are not given are passed over.

    Raises
    ------
    DataError
        A row that names no bag or behavior, or whose times are no numbers, or in the wrong order.
    """
    rows = read_rows(checked_path("The executions", path))
    where, header = next(rows)
    if tuple(header) != EXECUTIONS:
        raise DataError(f"{where}: the header {','.join(header)[:60]!r}; write "
                        f"{','.join(EXECUTIONS)}.")  # fmt: skip
    by_name = {Path(name).stem: name for name in bags} | {name: name for name in bags}
    executions = []
    for where, cells in rows:
        if len(cells) != len(EXECUTIONS):
            raise DataError(f"{where}: {len(cells)} columns; expected {','.join(EXECUTIONS)}.")
        bag, name, behavior, *times = cells
        if bag not in by_name and others:
            continue
        if bag not in by_name:
            raise DataError(f"{where}: {unknown('bag', bag, sorted(bags))}")
        if fault := _execution_fault(domain, name, behavior):
            raise DataError(f"{where}: {fault}")
        try:
            start, end = (Decimal(time) * _NS for time in times)
            in_order = 0 <= start < end < 1 << 62
        except InvalidOperation:
            in_order = False
        if not in_order:
            raise DataError(f"{where}: from {times[0]!r} to {times[1]!r} s; give start < end.")
        executions.append(Execution(by_name[bag], name, behavior, int(start), int(end)))
    return executions


def _execution_fault(domain: Domain, name: str, behavior: str) -> str:
    if fault := name_fault(name):
        return f"the object's name {name[:40]!r} {fault}."
    names = [domain.behaviors[place].name for place in domain.recorded]
    return "" if behavior in names else unknown("behavior with modalities", behavior, names)


def read_bags(
    domain: Domain,
    bags: Sequence[Path],
    *,
    executions: Sequence[Execution] = (),
    markers: str | None = None,
    functions: Mapping[str, Function] | None = None,
    progress: Callable[[float, int], object] | None = None,
    keep: int = 0,
) -> BagReport:
    """Extract the features of all executions in bags.

    Parameters
    ----------
    domain : Domain
        With a source of each modality.
    bags : Sequence[Path]
        As of `find_bags`.
    executions : Sequence[Execution]
        As of `read_executions`.
    markers : str | None
        In their place, a topic of std_msgs/String: "lift: red mug" begins an execution (behavior,
        object), an empty text ends it, and so does the next one.
    functions : Mapping[str, Function] | None
        As of `meal_bayes.features.extract`.
    progress : Callable[[float, int], object] | None
        Called with the number of bags that are done, in parts, and how many there are.
    keep : int
        Number of the execution, from 1 on in each bag, whose signals are kept.

    Returns
    -------
    BagReport
        Of a damaged bag it holds no execution, and one line says what is wrong.

    Raises
    ------
    SettingsError
        `rosbags` is not installed.
    DomainError
        A modality without a source.
    """
    check_sources(domain, [domain.behaviors[place].name for place in domain.recorded], functions)
    report = BagReport()
    channels: dict[tuple[str, str], tuple[str, ...]] = {}
    for number, bag in enumerate(bags):
        listed_here = [one for one in executions if one.bag == bag.name]
        reading = _Reading(domain, bag, listed_here, markers, functions, keep)
        try:
            with _opened(bag) as reader:
                for part in reading.read(reader):
                    if progress is not None:
                        progress(number + part, len(bags))
        except SettingsError:
            raise
        except Exception as fault:  # a torn file raises whatever its decoder does
            report.faults.append(f"{bag.name}: {reading.place()}{_reason(fault)}; left out")
            continue
        finally:
            if progress is not None:
                progress(number + 1, len(bags))
        report.topics += reading.topics
        report.faults += reading.faults
        for done in reading.done:
            _check_channels(done, channels, report.faults)
            if done.features:
                report.executions.append(done)
            done.recorder = None
    return report


def _reason(fault: Exception) -> str:
    text = " ".join(str(fault).split())[:200].rstrip(".")
    return f"cannot be read ({type(fault).__name__}{': ' if text else ''}{text})"


@contextmanager
def _opened(bag: Path) -> Iterator[Any]:
    try:
        from rosbags.highlevel import AnyReader  # noqa: PLC0415  an extra
        from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415
    except ImportError:
        raise SettingsError(
            "Bags are read by rosbags, which is not installed: pip install 'meal-bayes[bags]'"
        ) from None
    # Older bags of ROS 2 (sqlite) hold no definitions of their messages.
    with AnyReader([bag], default_typestore=get_typestore(Stores.LATEST)) as reader:
        yield reader


def _check_channels(
    done: Execution, channels: dict[tuple[str, str], tuple[str, ...]], faults: list[str]
) -> None:
    """Leave out features whose channels or size are not those of the executions before."""
    recorder = done.recorder
    names = {} if recorder is None else recorder.channels
    for modality, vector in list(done.features.items()):
        now = (*names.get(modality, ()), f"{len(vector)} features")
        before = channels.setdefault((done.behavior, modality), now)
        if now != before:
            del done.features[modality]
            faults.append(
                f"{done.bag}: {done.behavior}, {modality} at {done.start / _NS:.3f} s has "
                f"{listed(now)}; the bags before have {listed(before)}"
            )


class _Reading:
    """One bag on its way: windows that are open, and what was found so far."""

    def __init__(
        self,
        domain: Domain,
        bag: Path,
        executions: Sequence[Execution],
        markers: str | None,
        functions: Mapping[str, Function] | None,
        keep: int,
    ) -> None:
        self._domain = domain
        self._bag = bag
        self._functions = functions
        self._markers = markers
        self._keep = keep
        self._waiting = list(executions)
        self._open: list[Execution] = []
        self._absent: set[str] = set()
        self._last: tuple[str, int] | None = None
        self.done: list[Execution] = []
        self.topics: list[Topic] = []
        self.faults: list[str] = []

    def place(self) -> str:
        """Return where the reading is, for a message: topic and time of the last good message."""
        return "" if self._last is None else f"{self._last[0]} at {self._last[1] / _NS:.3f} s "

    def read(self, reader: Any) -> Iterator[float]:
        """Read the bag; yield the part of its time that is done."""
        wanted = sorted({source["topic"] for source in self._domain.sources.values()})
        wanted += [self._markers] if self._markers else []
        connections = [one for one in reader.connections if one.topic in wanted and one.msgcount]
        here = {connection.topic for connection in connections}
        self._absent = {topic for topic in wanted if topic not in here}
        self.faults += [f"{self._bag.name}: no message on {one}" for one in sorted(self._absent)]
        if not connections:
            return
        first, length = reader.start_time, max(reader.duration, 1)
        for one in self._waiting:
            if one.start < _EPOCH * _NS:
                one.start, one.end = one.start + first, one.end + first
            if one.end > reader.end_time:
                self.faults.append(f"{self._bag.name}: {self._name(one)} ends after the bag's end")
        self._waiting = [one for one in self._waiting if one.end <= reader.end_time]
        self._waiting.sort(key=lambda one: one.start)
        clocks: dict[str, list[int]] = {}  # number, first, last, longest gap
        shown = 0.0
        messages = reader.messages(connections=connections)
        for time, group in itertools.groupby(messages, key=lambda message: message[1]):
            # Of equal times, markers come first whatever order the bag has.
            together = list(group)
            if len(together) > 1:
                together.sort(key=lambda one: one[0].topic != self._markers)
            for connection, _, data in together:
                topic = connection.topic
                clock = clocks.setdefault(topic, [0, time, time, 0])
                clock[:] = clock[0] + 1, clock[1], time, max(clock[3], time - clock[2])
                self._move_to(time)
                if topic == self._markers:
                    self._mark(time, reader.deserialize(data, connection.msgtype))
                else:
                    takers = [r for one in self._open if (r := one.recorder) and topic in r.topics]
                    message = reader.deserialize(data, connection.msgtype) if takers else None
                    for recorder in takers:
                        recorder.add(topic, time, message)
                self._last = topic, time
            if (time - first) / length > shown + 0.01:
                shown = (time - first) / length
                yield shown
        self._move_to(1 << 62)
        expected = sum(connection.msgcount for connection in connections)
        found = sum(clock[0] for clock in clocks.values())
        if found != expected:
            raise DataError(f"{found} messages were read of the {expected} that it counts")
        if not self.done:
            self.faults.append(f"{self._bag.name}: no execution")
        for topic in sorted(clocks):
            count, start, end, gap = clocks[topic]
            rate = (count - 1) * _NS / (end - start) if end > start else float("nan")
            self.topics.append(Topic(self._bag.name, topic, count, rate, gap / _NS))

    def _name(self, one: Execution) -> str:
        return f"{one.behavior} of {one.object_name} at {one.start / _NS:.3f} s"

    def _move_to(self, time: int) -> None:
        """Close the windows that ended by this time, and open those that began."""
        for one in [one for one in self._open if one.end <= time]:
            self._close(one)
        while self._waiting and self._waiting[0].start <= time < 1 << 62:
            one = self._waiting.pop(0)
            one.recorder = Recorder(self._domain, one.behavior, self._functions)
            self._open.append(one)
            if one.end <= time:  # no message came in its time
                self._close(one)

    def _close(self, one: Execution) -> None:
        self._open.remove(one)
        if one.recorder is None:
            return

        def note(modality: str, fault: str) -> None:
            if self._domain.sources[modality]["topic"] not in self._absent:  # one line is enough
                self.faults.append(f"{self._bag.name}: {self._name(one)}, {modality}: {fault}")

        one.features = one.recorder.features(note)
        if len(self.done) + 1 == self._keep:
            one.signals = one.recorder.signals()
        one.recorder.drop()
        self.done.append(one)

    def _mark(self, time: int, message: Any) -> None:
        """Take a marker: "behavior: object" begins an execution, and ends the one before."""
        for one in self._open:
            one.end = min(one.end, time)
        self._move_to(time)
        text = str(getattr(message, "data", "")).strip()
        if not text:
            return
        behavior, _, name = (part.strip() for part in text.partition(":"))
        if fault := _execution_fault(self._domain, name, behavior):
            where = f"{self._bag.name}: {self._markers} at {time / _NS:.3f} s"
            self.faults.append(f"{where}: the marker {text[:60]!r}: {fault.rstrip('.')}")
            return
        self._waiting.insert(0, Execution(self._bag.name, name, behavior, time))
        self._move_to(time)


def save_recordings(
    domain: Domain,
    report: BagReport,
    folder: str | Path,
    labels: str | Path | None = None,
) -> None:
    """Write the folder that `load_dataset` reads, whole or not at all.

    Parameters
    ----------
    domain : Domain
        Of the recordings.
    report : BagReport
        As of `read_bags`.
    folder : str | Path
        To be made.
    labels : str | Path | None
        A `labels.csv` of the objects; an object that it lacks, or all of them where there is none,
        is of unknown labels.

    Raises
    ------
    DataError
        A behavior and modality of which there is no recording, or labels that cannot be read.
    OutputError
        A folder that is there already.
    """
    folder = checked_path("The folder", folder)
    if folder.exists():
        raise OutputError(f"{folder} is there already; remove it, or give another --out.")
    names = list(dict.fromkeys(one.object_name for one in report.executions))
    known: dict[str, list[int]] = {}
    if labels is not None:
        objects, values = read_labels(checked_path("The labels", labels), domain)
        known = dict(zip(objects, values.tolist(), strict=True))
    texts = {"labels.csv": [["object", *domain.attributes]]}
    for name in names:
        row = known.get(name, [-1] * len(domain.attributes))
        texts["labels.csv"].append([name, *("" if value < 0 else str(value) for value in row)])
    numbers: dict[tuple[str, str], int] = {}
    numbered = []
    for one in report.executions:
        key = one.object_name, one.behavior
        numbers[key] = numbers.get(key, 0) + 1
        numbered.append((one, numbers[key]))
    for behavior, modality in domain.contexts:
        found = [pair for pair in numbered if pair[0].behavior == behavior]
        sizes = [len(one.features[modality]) for one, _ in found if modality in one.features]
        if not sizes:
            raise DataError(f"The bags hold no {modality} of {behavior}; {folder} is not written.")
        rows = [["object", "recording", *(f"f{place}" for place in range(sizes[0]))]]
        for one, number in found:
            vector = one.features.get(modality)
            cells = [""] * sizes[0] if vector is None else [f"{x:.9g}" for x in vector.tolist()]
            rows.append([one.object_name, str(number), *cells])
        texts[f"{behavior}_{modality}.csv"] = rows

    def write(draft: Path) -> None:
        draft.mkdir()
        for name, rows in texts.items():
            text = io.StringIO()
            csv.writer(text, lineterminator="\n").writerows(rows)
            (draft / name).write_text(text.getvalue(), encoding="utf-8")

    keep_folder(folder, write)


def plot_execution(one: Execution) -> "Axes":
    """Draw the signals of an execution, its time bins, and the features made from them.

    Parameters
    ----------
    one : Execution
        With its signals, as `read_bags` keeps them of one.

    Returns
    -------
    Axes
        The first of a figure with a row for each modality: signal on the left, features right.
    """
    from meal_bayes.canvas import Figure  # noqa: PLC0415  takes half a second

    shown = [name for name in one.signals if name in one.features]
    with drawn_in_style():
        figure = Figure(figsize=(7.2, 1.0 + 1.9 * len(shown)), layout="constrained")
        rows = figure.subplots(len(shown), 2, squeeze=False, width_ratios=(3, 2))
        for (left, right), name in zip(rows, shown, strict=True):
            signal = one.signals[name]
            values = signal.values.reshape(len(signal.values), -1)
            span = signal.times[-1] - signal.times[0] if len(signal.times) else 0.0
            timed = len(signal.times) == len(values)
            times = signal.times if timed else np.linspace(0, span, len(values))
            left.plot(times, values, lw=0.8, marker="." if len(values) < 3 else "")
            left.axvspan(times[0], times[-1], color="#E6E6E6", zorder=0)
            left.set_title(f"{name}: {len(signal.times)} messages", loc="left")
            name_axes(
                left, "time since the first message (s)", "share" if signal.ready else "signal"
            )
            right.stairs(one.features[name], baseline=None, color=BLUE)
            right.set_title(f"{len(one.features[name])} features", loc="left")
            name_axes(right, "number of the feature", "value", grid="y")
        figure.suptitle(f"{one.behavior} of {one.object_name} in {one.bag}")
    axes: Axes = rows[0, 0]
    return axes
