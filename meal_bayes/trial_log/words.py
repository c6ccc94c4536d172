"""Percepts and probabilities in words, for whatever shows a log."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents.trial import Trial
from meal_bayes.display import level_names
from meal_bayes.momdp import MOMDP

SILENT = "says nothing"  # of a percept that carries no information
NOT_TOLD = "not told"  # of a truth that nobody knows
_SAME = 1e-9  # probabilities that differ by less are equal


def percept_words(
    momdp: MOMDP,
    behavior: int,
    observation: NDArray[np.int8],
    silent: str = SILENT,
) -> list[str]:
    """Name the percept of each queried attribute, (N,).

    Where every level is as likely of true objects as of false ones, a percept carries no
    information and "says nothing", whatever its level.

    Parameters
    ----------
    silent : what is written of percepts without information.
    """
    named = level_names(momdp.levels)
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
        return "abstained"
    return "right" if trial.success else "wrong"
