"""Percepts, truths and verdicts as text, for whatever shows a log."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents.trial import Trial
from meal_bayes.display import level_names
from meal_bayes.momdp import MOMDP

SILENT = "says nothing"  # of a percept that carries no information
UNKNOWN = "truth unknown"
_SAME = 1e-9  # probabilities that differ by less are equal


def percept_labels(
    momdp: MOMDP, behavior: int, observation: NDArray[np.int8], silent: str = SILENT
) -> list[str]:
    """Return the level of each queried attribute's percept by name, (N,).

    A percept whose levels are all as likely of true objects as of false ones carries no
    information.

    Parameters
    ----------
    observation : (N,) levels.
    silent : stands for percepts without information.
    """
    names = level_names(momdp.levels)
    rows = momdp.rows[:, behavior]  # (N,2,K)
    informed = np.abs(rows[:, 1] - rows[:, 0]).max(axis=-1) > _SAME
    return [names[z] if known else silent for z, known in zip(observation, informed, strict=True)]


def truth_text(attributes: Sequence[str], truth: Sequence[int] | NDArray[np.int8]) -> str:
    """Return the known truths (N,) by name, and "unknown" where one of them is not known."""
    named = zip(attributes, truth, strict=True)
    known = [name if value == 1 else f"not {name}" for name, value in named if value >= 0]
    return ", ".join([*known, "unknown"] if len(known) < len(truth) else known)


def verdict_text(trial: Trial) -> str:
    """Return "right", "wrong", "abstained", "broken off", or "truth unknown"."""
    if trial.ended:
        return "broken off"
    if trial.success is None:
        return UNKNOWN
    if trial.report is None:
        return "abstained"
    return "right" if trial.success else "wrong"
