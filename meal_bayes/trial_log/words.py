"""Percepts and probabilities in words, for whatever shows a log."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents.trial import Trial
from meal_bayes.momdp import MOMDP

SILENT = "says nothing"  # of a percept that carries no information
NOT_TOLD = "not told"  # of a truth that nobody knows
_SAME = 1e-9  # probabilities that differ by less are equal
_LEVELS = {2: ("no", "yes"), 4: ("surely no", "no", "yes", "surely yes")}
_ROUNDED = 0.0005  # probabilities nearer to 0 or 1 would print as certain


def level_words(levels: int) -> tuple[str, ...]:
    """Name the K levels of a percept; the upper half speaks for "true".

    >>> level_words(4)
    ('surely no', 'no', 'yes', 'surely yes')
    """
    return _LEVELS.get(levels) or tuple(f"level {z}" for z in range(levels))


def percept_words(
    momdp: MOMDP,
    behavior: int,
    observation: NDArray[np.int8],
    words: Sequence[str] = (),
    silent: str = SILENT,
) -> list[str]:
    """Name the percept of each queried attribute, (N,).

    Where every level is as likely of true objects as of false ones, a percept carries no
    information and "says nothing", whatever its level.

    Parameters
    ----------
    words : names of the levels; `level_words` by default.
    silent : what is written of percepts without information.
    """
    named = words or level_words(momdp.levels)
    rows = momdp.rows[:, behavior]  # (N,2,K)
    informative = np.abs(rows[:, 1] - rows[:, 0]).max(axis=-1) > _SAME
    pairs = zip(observation, informative, strict=True)
    return [named[z] if told else silent for z, told in pairs]


def truth_words(attributes: Sequence[str], truth: Sequence[int] | NDArray[np.int8]) -> str:
    """Name the truth of what was asked; "not told" where it is not known.

    Of several attributes of which some are known, those are named.
    """
    known = [
        name if value == 1 else f"not {name}"
        for name, value in zip(attributes, truth, strict=True)
        if value >= 0
    ]
    missing = len(truth) - len(known)
    return ", ".join([*known, NOT_TOLD] if missing else known)


def verdict_word(trial: Trial) -> str:
    """Judge a trial in a word or two."""
    if trial.ended:
        return "broken off"
    if trial.success is None:
        return NOT_TOLD
    if trial.report is None:
        return "no answer"
    return "right" if trial.success else "wrong"


def percent(p: float) -> str:
    """Round a probability, but never to certainty.

    >>> percent(0.5), percent(0.99999)
    ('50.0 %', '>99.9 %')
    """
    if 0 < p < _ROUNDED or 1 - _ROUNDED < p < 1:
        return "<0.1 %" if p < _ROUNDED else ">99.9 %"
    return f"{100 * p:.1f} %"
