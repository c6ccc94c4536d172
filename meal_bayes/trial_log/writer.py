"""Trials -> one MCAP file, flushed after every trial (or every few) and named when whole."""

import hashlib
import itertools
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from meal_bayes.errors import LogError
from meal_bayes.trial_log import schema
from meal_bayes.trial_log.compact import encode_outcomes
from meal_bayes.trial_log.encode import Packed, TrialEncoder, encode_momdp, numbered
from meal_bayes.trial_log.log_file import LogFile
from meal_bayes.trial_log.names import timing_of
from meal_bayes.trials import Step, Trial, TrialOutcomes

ROWS = 250  # trials in a message of the compact form


class _Placed(NamedTuple):
    """A MOMDP of the file."""

    number: int
    size: int  # bytes of its message


class TrialWriter(LogFile):
    """Writes whole trials into one log; see `LogFile` for drafts, timing and parameters.

    When `write` returns, the trial has left the process, and `salvage` reads it whatever happens
    next. It is a `Recorder` as well: a trial that comes step by step is on disk step by step.
    """

    form = schema.FULL

    def __init__(self, path: str | Path, header: Mapping[str, object]) -> None:
        super().__init__(path, header)
        self._momdps = 0
        self._known: dict[bytes, _Placed] = {}  # by content, the newest MOMDP_MEMORY
        self._last: Trial | None = None
        self._content = b""  # a digest of its MOMDP and counts

    def write(self, trial: Trial, *, seconds: float | None = None) -> None:
        """Append one trial, and to the timing table the wall-clock seconds it took.

        Raises
        ------
        LogError
            The trial's arrays do not fit each other, and the file stays as it was; or the disk is
            full, and the trials before stay in the draft.
        """
        with self.trial_named(self.written.trials):
            packed = self._place(trial) + self._encoder.whole(trial)
        self.put(packed, seconds=[seconds])
        self._close(trial)

    def begin(self, trial: Trial) -> None:
        """Write the start of a trial to disk; its steps follow one by one, then its end."""
        with self.trial_named(self.written.trials):
            packed = self._place(trial) + self._encoder.begin(trial)
        self.begun = True
        self.put(packed, sync=True)

    def step(self, step: Step) -> None:
        """Write the next step of the trial that was begun to disk."""
        with self.trial_named(self.written.trials):
            packed = self._encoder.step(step)
        self.put(packed, sync=True)

    def end(self, trial: Trial) -> None:
        """Write the outcome of the trial that was begun to disk."""
        with self.trial_named(self.written.trials):
            packed = self._encoder.end(trial)
        self.put(packed, sync=True)
        self.begun = False
        self._close(trial)

    def _place(self, trial: Trial) -> list[Packed]:
        """Create the encoder of the next trial, and pack its MOMDP where that is new."""
        self.check_open()
        if self.begun:
            raise LogError(f"{self.path} is not open for another trial: one has no end yet.")
        number, momdp = self.written.trials, b""
        same = False
        if self._last is not None:
            same = np.array_equal(self._last.counts, trial.counts)  # type: ignore[arg-type]  # or None
            same &= self._last.momdp is trial.momdp
        if not same:
            packed = encode_momdp(trial)
            self._content = hashlib.blake2b(packed, digest_size=16).digest()
            if self._content not in self._known:
                momdp = numbered(self._momdps, packed)
        self._momdp_size = len(momdp)
        known = self._known.get(self._content)
        self._encoder = TrialEncoder(number, known.number if known else self._momdps)
        return [] if known else [Packed(schema.MOMDPS, schema.log_time(number, 0), momdp)]

    def _close(self, trial: Trial) -> None:
        """Count a trial, keep its MOMDP, and forget the oldest as the reader does."""
        self.written = self.written.after(trial)
        self._last = trial
        if self._content not in self._known:
            self._known[self._content] = _Placed(self._momdps, self._momdp_size)
            self._momdps += 1
            schema.forget_oldest(self._known)


class OutcomeWriter(LogFile):
    """Writes the outcomes of trials into one compact log; see `LogFile`.

    Trials leave the process 250 at a time, as columns in one message; what is lost when it is
    killed is less than that.
    """

    form = schema.COMPACT

    def __init__(self, path: str | Path, header: Mapping[str, object]) -> None:
        super().__init__(path, header)
        self._waiting: list[TrialOutcomes] = []
        self._seconds: list[float | None] = []

    def write(self, trial: Trial, *, seconds: float | None = None) -> None:
        """Append the outcome of one trial; parameters and errors as for `TrialWriter.write`."""
        self.check_open()
        with self.trial_named(self.written.trials + len(self._waiting)):
            self._waiting.append(TrialOutcomes.of([trial]))
        self._seconds.append(seconds)
        if len(self._waiting) == ROWS:
            self.flush()

    def write_outcomes(
        self, outcomes: TrialOutcomes, *, seconds: Sequence[float | None] = ()
    ) -> None:
        """Append outcomes, at once.

        Raises
        ------
        LogError
            The disk is full; or 250 trials do not fit in a message.
        """
        for begin in range(0, len(outcomes), ROWS):
            part = outcomes.rows(slice(begin, begin + ROWS))
            first = self.written.trials
            data = encode_outcomes(part, first)
            if len(data) > schema.MESSAGE_LIMIT:
                raise LogError(f"{len(part)} outcomes take {len(data)} bytes: too many attributes.")
            packed = [Packed(schema.OUTCOMES, schema.log_time(first, 0), data)]
            self.put(packed, seconds=seconds[begin : begin + ROWS])
            self.written = self.written.after(part)

    def flush(self) -> None:
        """Write the outcomes that are waiting."""
        waiting, seconds = TrialOutcomes.join(self._waiting), self._seconds
        self._waiting, self._seconds = [], []
        self.write_outcomes(waiting, seconds=seconds)


def write_trials(
    path: str | Path,
    trials: Iterable[Trial | TrialOutcomes],
    *,
    header: Mapping[str, object],
    seconds: Sequence[float] = (),
) -> None:
    """Write trials into one log, with the seconds of the first of them.

    Parameters
    ----------
    trials : Iterable[Trial | TrialOutcomes]
        Whole ones make a full log, outcomes a compact one.
    """
    found = iter(trials)
    first = next(found, None)
    known = itertools.chain(seconds, itertools.repeat(None))
    if isinstance(first, TrialOutcomes):
        with OutcomeWriter(path, header) as compact:
            for part in itertools.chain([first], found):
                assert isinstance(part, TrialOutcomes)
                taken = tuple(itertools.islice(known, len(part)))
                compact.write_outcomes(part, seconds=taken)
        return
    with TrialWriter(path, header) as log:
        for trial in itertools.chain([] if first is None else [first], found):
            assert isinstance(trial, Trial)
            log.write(trial, seconds=next(known))


def read_seconds(path: str | Path) -> list[float]:
    """Read the wall-clock seconds of a log's trials; none where no whole table is beside it."""
    try:
        rows = timing_of(Path(path)).read_text(encoding="utf-8").splitlines()[1:]
        return [float(row.split(",")[1]) for row in rows]
    except (FileNotFoundError, IndexError, ValueError):
        return []
