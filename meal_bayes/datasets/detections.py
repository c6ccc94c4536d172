"""Percepts that a detector of the robot's own gives as such, in place of features."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import label_values, lowest_yes
from meal_bayes.domain import Domain, unknown
from meal_bayes.errors import DataError

# How sure a detector is, from -1 (no) to 1 (yes).
_SURENESS = {
    "surely yes": 1.0, "yes": 0.5, "no": -0.5, "not": -0.5, "surely no": -1.0, "surely not": -1.0,
}  # fmt: skip


def checked_percepts(values: object, domain: Domain) -> dict[str, float]:
    """Return how sure a detector is of each attribute, from -1 (surely no) to 1 (surely yes).

    A value is True or False (1 or 0), "yes", "no", "surely yes" or "surely no"; of a group, by its
    name, the value that is seen. None says nothing.

    Parameters
    ----------
    values : object
        By attribute, or a group's name.
    domain : Domain
        Of the attributes.

    Raises
    ------
    DataError
        No mapping, a name that the domain does not have, or a value that is none of these.

    Examples
    --------
    >>> from meal_bayes.domain import load_domain
    >>> toy = load_domain("toy")
    >>> checked_percepts({toy.attributes[0]: True, toy.attributes[1]: "no"}, toy)
    {'red': 1.0, 'heavy': -0.5}
    """
    if not isinstance(values, Mapping):
        raise DataError(f"percepts are {values!r:.60}; expected {{attribute: True or False}}")
    sure: dict[str, float] = {}
    for name, value in values.items():
        members = domain.groups.get(name, ()) if name not in domain.attributes else ()
        if members and value is not None:
            if value not in members:
                raise DataError(unknown(f"value of {name!r}", str(value), members))
            sure |= {member: 1.0 if member == value else -1.0 for member in members}
        elif name in domain.attributes:
            sure |= _sureness(name, value)
        elif not members:
            raise DataError(unknown("attribute", str(name), (*domain.attributes, *domain.groups)))
    return sure


def _sureness(name: str, value: object) -> dict[str, float]:
    """Return how sure one value is, by the attribute's name; nothing where it says nothing."""
    if isinstance(value, str) and value in _SURENESS:
        return {name: _SURENESS[value]}
    try:
        label = int(label_values(value))
    except (DataError, TypeError, ValueError):
        names = ", ".join(_SURENESS)
        raise DataError(
            f"the percept of {name!r} is {value!r:.60}; expected True or False, or one of {names}"
        ) from None
    if label < 0:
        return {}
    return {name: 1.0 if label else -1.0}


def detected_levels(
    percepts: Mapping[str, float] | None, domain: Domain, levels: int
) -> NDArray[np.int8]:
    """Return what a detector gave as percept levels (P,), of 0 to K - 1; -1 none.

    A bare "yes" or "no" is one of the two middle levels, what is sure one of the extremes.
    """
    percept = np.full(len(domain.attributes), -1, np.int8)
    for name, sure in (percepts or {}).items():
        middle = lowest_yes(levels) - (sure < 0)
        extreme = levels - 1 if sure > 0 else 0
        percept[domain.attribute_index(name)] = extreme if abs(sure) == 1 else middle
    return percept
