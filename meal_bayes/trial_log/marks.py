"""Marks: what measures need of many trials, as one small table beside their log.

A learning curve is made of millions of trials; their measures must not wait for whole logs to be
read back. A table holds one row a trial, in numbers that a text file keeps exactly.
"""

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents.trial import Trial
from meal_bayes.arrays import freeze, set_frozen
from meal_bayes.errors import LogError
from meal_bayes.files import write_whole
from meal_bayes.untrusted import read_bytes

_MOST = 1 << 31  # objects
_SEAL = "# sha256 "  # begins the last line: a changed digit is a number like any other
_KINDS = {"object_index": np.int64, "success": np.bool_, "truth": np.bool_, "column": np.int64}


@dataclass(frozen=True, slots=True)
class Marks:
    """Measures of n trials of N queried attributes."""

    object_index: NDArray[np.int64]  # (n,)
    success: NDArray[np.bool_]  # (n,) Eq. 5
    cost: NDArray[np.float64]  # (n,) s, Eq. 6
    reward: NDArray[np.float64]  # (n,) unshaped
    claimed: NDArray[np.float64]  # (n,) the agent's own Pr(its report is right)
    positive: NDArray[np.float64]  # (n,N) its final belief
    truth: NDArray[np.bool_]  # (n,N)
    column: NDArray[np.int64]  # (n,N) attributes asked, by their place in the domain

    def __post_init__(self) -> None:
        for field in fields(self):
            kind = _KINDS.get(field.name, np.float64)
            set_frozen(self, **{field.name: freeze(getattr(self, field.name), kind)})

    @classmethod
    def of(cls, trials: Iterable[Trial], attributes: tuple[str, ...]) -> "Marks":
        """Take the measures of trials; `attributes` are those of the domain."""
        place = {name: i for i, name in enumerate(attributes)}
        rows = [
            (
                trial.task.object_index,
                trial.success,
                trial.cost,
                trial.reward,
                trial.last_belief.certainty,
                trial.last_belief.positive,
                trial.truth,
                [place[name] for name in trial.task.query.attributes],
            )
            for trial in trials
        ]
        return cls(*(np.array(part) for part in zip(*rows, strict=True)))

    def save(self, path: Path) -> None:
        """Write a table, which is there whole or not at all; `OutputError` where it cannot be."""
        single = [self.object_index, self.success, self.cost, self.reward, self.claimed]
        parts = [*(part[:, None] for part in single), self.positive, self.truth, self.column]
        lines = [_header(self.truth.shape[1])]
        rows = zip(*(part.tolist() for part in parts), strict=True)
        lines += [",".join(_text(value) for part in row for value in part) for row in rows]
        write_whole(path, _sealed("\n".join(lines) + "\n"))

    @classmethod
    def load(cls, path: Path) -> "Marks":
        """Read a table back, equal to what was written.

        Raises
        ------
        LogError : a file that is no such table.
        """
        try:
            whole = read_bytes(path).decode("utf-8")
            text = whole.rpartition(_SEAL)[0]
            header, _, body = text.partition("\n")
            n = header.count("truth_")
            if whole != _sealed(text):
                raise ValueError("it was changed or torn")  # noqa: TRY301
            if header != _header(n) or not body.strip():
                raise ValueError("its header or its rows are missing")  # noqa: TRY301
            values = np.loadtxt(body.splitlines(), delimiter=",", ndmin=2)
            if values.shape[1] != 5 + 3 * n:
                raise ValueError(f"{values.shape[1]} columns")  # noqa: TRY301
            _check(values, n)
        except (OSError, ValueError) as fault:
            raise LogError(
                f"{path} is not a table of marks ({fault}); remove it, and run again."
            ) from fault
        o, success, cost, reward, claimed = values[:, :5].T
        positive, truth, column = np.split(values[:, 5:], 3, axis=1)
        return cls(
            o.astype(np.int64), success != 0, cost, reward, claimed,
            positive, truth != 0, column.astype(np.int64),
        )  # fmt: skip


class BatchMarks(NamedTuple):
    """Marks of the test trials after a batch of an online run; batch 0 is before any training."""

    agent: str
    repeat: int
    batch: int
    hours: float  # of exploration so far: summed cost of the training trials
    marks: Marks


def _check(values: NDArray[np.float64], n: int) -> None:
    """Check the ranges of what a trial can measure."""
    whole = values[:, [0, 1, *range(5 + n, 5 + 3 * n)]]
    if not ((whole >= 0) & (whole < _MOST) & (whole == np.round(whole))).all():
        raise ValueError("an index or a truth that is no whole number, 0 or more")
    if not ((values[:, [1, *range(5 + n, 5 + 2 * n)]]) <= 1).all():
        raise ValueError("a truth that is neither 0 nor 1")
    shares = values[:, 4 : 5 + n]
    if not ((shares >= 0) & (shares <= 1)).all() or not np.isfinite(values[:, 2:4]).all():
        raise ValueError("a probability outside [0, 1], or a cost or reward that is not finite")


def _sealed(text: str) -> str:
    return f"{text}{_SEAL}{hashlib.sha256(text.encode()).hexdigest()}\n"


def _header(n: int) -> str:
    names = ["object_index", "success", "cost", "reward", "claimed"]
    names += [f"{part}_{i}" for part in ("positive", "truth", "column") for i in range(n)]
    return ",".join(names)


def _text(value: float | bool) -> str:
    return str(int(value)) if isinstance(value, bool) else repr(value)
