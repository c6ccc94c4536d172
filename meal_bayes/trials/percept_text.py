"""The words for percepts, one wording on all surfaces."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from meal_bayes.arrays import check_place, lowest_yes, whole_array
from meal_bayes.domain.words import denied
from meal_bayes.look import level_names
from meal_bayes.momdp import MOMDP

SILENT = "says nothing"  # of a percept without information
_SAME = 1e-9  # probabilities that differ by less are equal


def percept_labels(momdp: MOMDP, behavior: int, observation: ArrayLike) -> list[str]:
    """Return the percept of each question by name; of a group the value that it speaks for.

    A percept "says nothing" if all its levels are as likely of true objects as of false ones.

    Parameters
    ----------
    momdp : MOMDP
        Its rows say which percepts inform.
    behavior : int
        Index of the behavior that sensed it.
    observation : ArrayLike
        (N,) levels, 0 to K - 1, or -1 where nothing came of an attribute.
    """
    check_place("behavior", behavior, momdp.n_behaviors)
    percept = whole_array("observation", observation, len(momdp.query)).tolist()
    for level in percept:
        if level != -1:
            check_place("level", level, momdp.levels)
    names = level_names(momdp.levels)
    rows = momdp.rows[:, behavior]  # (N,2,K)
    informed = np.abs(rows[:, 1] - rows[:, 0]).max(axis=-1) > _SAME
    labels = []
    for _, indices in momdp.query.questions:
        informative = [i for i in indices if informed[i] and percept[i] >= 0]
        levels = [percept[i] for i in informative]
        if not informative:
            labels.append(SILENT)
        elif len(indices) == 1:
            labels.append(names[levels[0]])
        else:
            members = [momdp.query.attributes[i] for i in informative]
            labels.append(_spoken_for(names, members, levels))
    return labels


def attribute_labels(momdp: MOMDP, behavior: int, observation: ArrayLike) -> list[str]:
    """Return the percept of each attribute by name, (N,); all of a group have the group's."""
    labels = [""] * len(momdp.query)
    words = percept_labels(momdp, behavior, observation)
    for (_, indices), word in zip(momdp.query.questions, words, strict=True):
        for i in indices:
            labels[i] = word
    return labels


def _spoken_for(names: Sequence[str], members: Sequence[str], levels: Sequence[int]) -> str:
    """Return what percept levels of a group's members say, as in "surely half"."""
    top = max(levels)
    likeliest = " or ".join(m for m, z in zip(members, levels, strict=True) if z == top)
    if top >= lowest_yes(len(names)):
        return _said(likeliest, names[top], "yes")
    least = min(levels)
    ruled_out = " or ".join(m for m, z in zip(members, levels, strict=True) if z == least < top)
    return _said(denied(ruled_out), names[least], "no") if ruled_out else "none of them"


def _said(value: str, level: str, word: str) -> str:
    """Return a value with how sure a percept is: "surely half"; of nameless levels their number.

    >>> _said("half", "surely yes", "yes"), _said("half", "level 5", "yes")
    ('surely half', 'half (level 5)')
    """
    if level.endswith(word):
        return f"{level.removesuffix(word)}{value}"
    return f"{value} ({level})"
