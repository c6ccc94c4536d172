"""MCAP -> trials, every byte checked; what a file is, in short; what is left of a torn one."""

import contextlib
import itertools
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from mcap.records import Chunk, Footer
from mcap.writer import MCAP0_MAGIC

from meal_bayes.errors import LogCorruptError, LogError
from meal_bayes.files import checked_path, command_line
from meal_bayes.trial_log import schema
from meal_bayes.trial_log.container import FAULTS, fault_text, next_log, read_records
from meal_bayes.trial_log.decode import NO_END, TrialBuilder
from meal_bayes.trial_log.encode import End
from meal_bayes.trial_log.feedback import Feedback
from meal_bayes.trial_log.foreign import ForeignFileError, check_size
from meal_bayes.trial_log.names import RECOVERED, feedback_files, log_files, stem_of
from meal_bayes.trial_log.opening import find_log, opened, way_out
from meal_bayes.trial_log.writer import write_trials
from meal_bayes.trials import Trial, TrialOutcomes

_PROBLEMS = 20  # that are kept of one file
_FREE_BYTES = 64 << 20  # that any file may unpack to
_UNPACKING = 256  # times its own size that a larger one may
GROUP = 100  # trials whose outcomes are computed at a time


@dataclass(frozen=True, slots=True)
class LogInfo:
    """What can be read of a log."""

    path: Path
    form: str  # "full", "compact" or "feedback"
    trials: int
    steps: int
    cost: float  # s, of all trials
    header: dict[str, object]
    problems: tuple[str, ...] = ()
    unread: int = 0  # bytes that are passed over
    ours: bool = True  # False: no log, torn or not, but another file

    @property
    def whole(self) -> bool:
        """Whether nothing is missing, and nothing was changed."""
        return not self.problems


def read_trials(path: str | Path) -> Iterator[Trial]:
    """Read the trials of a whole log one by one, or of a folder's logs in order of their names.

    They are equal to what was written. Each is checked before it is yielded, its whole file after
    the last one. `Logs` reads a folder as far as it can be read.

    Raises
    ------
    LogError
        There is no such file.
    LogCorruptError
        The file is unfinished, torn or changed.
    LogVersionError
        The file has another format version.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> import meal_bayes
    >>> with TemporaryDirectory() as folder:
    ...     log = Path(folder, "trial.mcap")
    ...     trial = meal_bayes.ask(
    ...         "heavy", dataset="roc36", object="heavy_green_beans", agent="greedy", log=log
    ...     )
    ...     (again,) = meal_bayes.read_trials(log)
    >>> again.success
    True
    """
    log = checked_path("The log", path)
    files = log_files(log) if log.is_dir() else [log]
    return itertools.chain.from_iterable([_trials(Scan(file)) for file in files])


def _trials(scan: "Scan") -> Iterator[Trial]:
    for entry in scan.entries():
        if isinstance(entry, TrialOutcomes):
            raise LogError(
                f"{scan.path} is a compact log: outcomes without steps; see them with: "
                + command_line("meal-bayes report", scan.path)
            )
        yield entry


def read_outcomes(path: str | Path) -> TrialOutcomes:
    """Read the outcomes of a whole log, of either form; errors as for `read_trials`."""
    return TrialOutcomes.join([outcomes for outcomes, _ in grouped(Scan(path))])


def read_feedback(path: str | Path) -> list[Feedback]:
    """Read what people told of trials, from a log of feedback or all on a folder's, in order.

    Errors are those of `read_trials`; a folder may hold none.
    """
    log = checked_path("The log", path)
    files = feedback_files(log) if log.is_dir() else [log]
    entries = list[Feedback]()
    for file in files:
        scan = Scan(file)
        deque(scan.entries(), maxlen=0)
        entries += scan.builder.feedback
    return entries


def readable_feedback(
    files: Iterable[Path], on_fault: Callable[[str], object]
) -> Iterator[Feedback]:
    """Yield what people told, in the order of the files; of one that is torn, note the fault."""
    for file in files:
        try:
            yield from read_feedback(file)
        except LogError as fault:
            on_fault(str(fault))


def grouped(
    scan: "Scan", *, unfinished: bool = False
) -> Iterator[tuple[TrialOutcomes, tuple[Trial, ...]]]:
    """Yield trials in groups: their outcomes, and of a full log the trials; see `Scan.entries`."""
    waiting = list[Trial]()
    for entry in scan.entries(unfinished=unfinished):
        if isinstance(entry, TrialOutcomes):
            yield entry, ()
            continue
        waiting.append(entry)
        if len(waiting) == GROUP:
            yield TrialOutcomes.of(waiting), tuple(waiting)
            waiting = []
    if waiting:
        yield TrialOutcomes.of(waiting), tuple(waiting)


def read_header(path: str | Path) -> dict[str, object]:
    """Read what the run was (config, seed, versions), also from a torn file; errors as above."""
    builder = TrialBuilder()
    with opened(find_log(path)) as file:
        for record in read_records(file):
            next(builder.records(record), None)  # it stands in a chunk of its own
            if builder.header is not None:
                break
        return builder.check_header()


def log_info(path: str | Path) -> LogInfo:
    """Read what a whole log holds; every byte is checked, no trial decoded; errors as above."""
    path = find_log(path)
    builder = TrialBuilder()
    header = read_header(path)
    with opened(path) as file:
        for record in read_records(file):
            if not isinstance(record, Chunk):
                next(builder.records(record), None)
        if builder.end is None:
            raise LogCorruptError(NO_END)
    return LogInfo(path, builder.form, **builder.end._asdict(), header=header)


class Scan:
    """One reading of a file; a tolerant one notes the faults and goes on behind them."""

    def __init__(self, path: str | Path, *, tolerant: bool = False) -> None:
        self.path = find_log(path)
        self._tolerant = tolerant
        if not tolerant and self.path.name.endswith(schema.ACTIVE):
            unfinished = f"{self.path} was not finished by its writer"
            raise LogCorruptError(f"{unfinished}; {way_out(self.path)}")
        self.problems: list[str] = []
        self.builder = TrialBuilder()
        self.read = End()  # in all logs of the file
        self._foreign: ForeignFileError | None = None  # why a log in the file is none
        self.unread = 0  # bytes that are passed over

    def entries(self, *, unfinished: bool = False) -> Iterator[Trial | TrialOutcomes]:
        """Yield every whole trial, or of a compact log the outcomes of many trials each.

        A tolerant reading goes on with a log that follows in the same file, as `cat` leaves it. At
        the end of each it yields the `unfinished` trial too.
        """
        with opened(self.path) as file:
            size = os.fstat(file.fileno()).st_size
            begin = 0
            while True:
                offset = begin  # behind the last whole record
                file.seek(begin)
                # A small file may claim to unpack to gigabytes: zeros compress a thousandfold.
                builder = TrialBuilder(limit=_FREE_BYTES + _UNPACKING * size)
                self.builder = builder if begin == 0 else self.builder
                with self._noting():
                    check_size(self.path, size)
                    for record in read_records(file):
                        offset = file.tell()
                        if isinstance(record, Footer):
                            offset = min(offset + len(MCAP0_MAGIC), size)  # ends it, if not torn
                        with self._noting():
                            yield from self._counted(builder.records(record))
                with self._noting():
                    if self.foreign is None:
                        builder.check_end()
                if unfinished:
                    with self._noting():
                        yield from filter(None, [builder.unfinished()])
                begin = next_log(file, max(offset, begin + 1)) if self._tolerant else size
                self.unread += begin - offset
                if begin >= size:
                    return

    def salvage(self) -> Iterator[Trial | TrialOutcomes]:
        """Yield every whole trial, and the one that was under way when a log ends."""
        yield from self.entries(unfinished=True)
        if self.foreign is not None:
            raise LogCorruptError(f"{self.foreign.of(self.path)}.")
        if self.builder.header is None and not self.read.trials:
            raise LogCorruptError(
                f"{self.path} holds nothing of a trial log: {self.problems[0]}; expected a "
                f"{schema.SUFFIX} file that meal_bayes wrote."
            )

    @property
    def foreign(self) -> ForeignFileError | None:
        """Why the file, as far as it was read, holds no log of ours; None of one that does."""
        return None if self.read.trials or self.builder.header else self._foreign

    def _counted(self, entries: Iterator[Trial | TrialOutcomes]) -> Iterator[Trial | TrialOutcomes]:
        for entry in entries:
            self.read = self.read.after(entry)
            yield entry

    @contextlib.contextmanager
    def _noting(self) -> Iterator[None]:
        """Note a fault of the block where the reading is tolerant."""
        try:
            yield
        except FAULTS as fault:
            if not self._tolerant:
                raise
            if isinstance(fault, ForeignFileError):
                self._foreign = self._foreign or fault
            if len(self.problems) < _PROBLEMS:
                self.problems.append(fault_text(fault))


def check_log(path: str | Path) -> LogInfo:
    """Read a file to its end and report its contents and faults; damage does not raise."""
    scan = Scan(path, tolerant=True)
    deque(scan.entries(), maxlen=0)
    header = scan.builder.header or {}
    form = scan.builder.form
    problems = tuple(scan.problems if scan.foreign is None else [str(scan.foreign)])
    read = scan.read._asdict()
    return LogInfo(
        scan.path,
        form,
        **read,
        header=header,
        problems=problems,
        unread=scan.unread,
        ours=scan.foreign is None,
    )


def salvage(path: str | Path) -> Iterator[Trial | TrialOutcomes]:
    """Read every whole trial of a file, torn or not; the faults between them are passed over.

    Of a compact log it yields the outcomes of many trials each. A trial that was under way when the
    file ends comes last, as far as it went, with `ended`. Errors are as for `read_trials`, but only
    a file without a header and a trial is corrupt.
    """
    return Scan(path, tolerant=True).salvage()


def recover_log(path: str | Path, out: str | Path | None = None) -> Path:
    """Write the trials of a torn file, as `salvage` reads them, into a new file; return its name.

    The new file is `<stem>.recovered.mcap` beside the torn one, or `out`; its header is the old one
    with `recovered_from`. The torn file stays as it is. Readers of the folder use the recovered
    file only where the log itself and its drafts are gone.

    Raises
    ------
    LogError
        `out` exists; and as for `salvage`.
    """
    scan = Scan(path, tolerant=True)
    beside = scan.path.with_name(f"{stem_of(scan.path)}{RECOVERED}{schema.SUFFIX}")
    out = beside if out is None else checked_path("The log", out)
    if out.exists():
        raise LogError(f"{out} exists already; remove it or name another file to recover into.")
    trials = scan.salvage()
    first = next(trials, None)
    if first is None:
        why = scan.problems[0] if scan.problems else "it is whole, and empty"
        raise LogCorruptError(f"{scan.path} holds no whole trial to recover: {why}.")
    header = {**(scan.builder.header or {}), "recovered_from": scan.path.name}
    write_trials(out, itertools.chain([first], trials), header=header)
    return out
