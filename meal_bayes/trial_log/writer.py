"""Trials -> one MCAP file, flushed after every trial (or every few) and named when whole."""

import hashlib
import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from meal_bayes.errors import LogError, SettingsError
from meal_bayes.trial_log import schema
from meal_bayes.trial_log.encode import (
    Packed,
    TrialEncoder,
    encode_momdp,
    encode_outcomes,
    numbered,
)
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
        packed = self._pack(lambda: self._place(trial) + self._encoder.whole(trial))
        self.put(packed, seconds=[seconds])
        self._close(trial)

    def begin(self, trial: Trial) -> None:
        """Write the start of a trial to disk; its steps follow one by one, then its end."""
        packed = self._pack(lambda: self._place(trial) + self._encoder.begin(trial))
        self.begun = True
        self.put(packed, sync=True)

    def step(self, step: Step) -> None:
        """Write the next step of the trial that was begun to disk."""
        self.put(self._pack(lambda: self._encoder.step(step)), sync=True)

    def end(self, trial: Trial) -> None:
        """Write the outcome of the trial that was begun to disk."""
        self.put(self._pack(lambda: self._encoder.end(trial)), sync=True)
        self.begun = False
        self._close(trial)

    def _pack(self, messages: Callable[[], list[Packed]]) -> list[Packed]:
        """Turn the errors of a trial that no message can hold into ours, with its number."""
        try:
            return messages()
        except (SettingsError, TypeError, ValueError, OverflowError) as fault:
            trial = self.written.trials
            raise LogError(f"Trial {trial} cannot be logged: {fault}.") from fault

    def _place(self, trial: Trial) -> list[Packed]:
        """Create the encoder of the next trial, and pack its MOMDP where that is new."""
        self.check_open()
        if self.begun:
            raise LogError(f"{self.path} is not open for another trial: one has no end yet.")
        number, momdp, last = self.written.trials, b"", self._last
        if (
            last is None
            or last.momdp is not trial.momdp
            or not np.array_equal(last.counts, trial.counts)  # type: ignore[arg-type]  # or None
        ):
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
        Whole ones make a full log, outcomes a compact one: columns, 250 trials in a message.
    """
    entries, times = iter(trials), itertools.chain(seconds, itertools.repeat(None))
    first = next(entries, None)
    entries = itertools.chain([] if first is None else [first], entries)
    if not isinstance(first, TrialOutcomes):
        with TrialWriter(path, header) as log:
            for trial in entries:
                assert isinstance(trial, Trial)
                log.write(trial, seconds=next(times))
        return
    with LogFile(path, header, schema.COMPACT) as compact:
        for outcomes in entries:
            assert isinstance(outcomes, TrialOutcomes)
            for begin in range(0, len(outcomes), ROWS):
                rows, number = outcomes.rows(slice(begin, begin + ROWS)), compact.written.trials
                time, data = schema.log_time(number, 0), encode_outcomes(rows, number)
                taken = list(itertools.islice(times, len(rows)))
                compact.put([Packed(schema.OUTCOMES, time, data)], seconds=taken)
                compact.written = compact.written.after(rows)


def read_seconds(path: str | Path) -> list[float]:
    """Read the wall-clock seconds of a log's trials; none where no whole table is beside it."""
    try:
        rows = timing_of(Path(path)).read_text(encoding="utf-8").splitlines()[1:]
        return [float(row.split(",")[1]) for row in rows]
    except (FileNotFoundError, IndexError, ValueError):
        return []
