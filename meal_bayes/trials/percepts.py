"""The words for percepts, one wording on all surfaces."""

import numpy as np
from numpy.typing import ArrayLike

from meal_bayes.display import level_names
from meal_bayes.momdp import MOMDP

SILENT = "says nothing"  # of a percept without information
_SAME = 1e-9  # probabilities that differ by less are equal


def percept_labels(momdp: MOMDP, behavior: int, observation: ArrayLike) -> list[str]:
    """Return the level of each queried attribute's percept by name, (N,).

    A percept "says nothing" if all its levels are as likely of true objects as of false ones.
    """
    names = level_names(momdp.levels)
    rows = momdp.rows[:, behavior]  # (N,2,K)
    informed = np.abs(rows[:, 1] - rows[:, 0]).max(axis=-1) > _SAME
    percepts = zip(np.asarray(observation).tolist(), informed.tolist(), strict=True)
    return [names[level] if known else SILENT for level, known in percepts]
