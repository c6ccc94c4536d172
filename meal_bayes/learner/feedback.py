"""What a person says: a verdict on a report, or labels of an object."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import label_values
from meal_bayes.domain import Domain
from meal_bayes.errors import DataError, SettingsError


def implied(report: NDArray[np.bool_], *, right: bool) -> NDArray[np.int8]:
    """Return the labels (N,) that a verdict on a report (N,) implies; -1 unknown.

    A wrong report of several attributes implies none, as any of them may be wrong (Sect. 7.3).
    """
    if right:
        return report.astype(np.int8)
    return (~report).astype(np.int8) if len(report) == 1 else np.full(len(report), -1, np.int8)


def checked_labels(values: Mapping[str, bool | None], domain: Domain) -> NDArray[np.int8]:
    """Return labels by attribute as an array (P,); -1 where there is none."""
    labels = np.full(len(domain.attributes), -1, np.int8)
    if not isinstance(values, Mapping):
        raise SettingsError(f"Labels are {values!r}; give {{attribute: True, False or None}}.")
    for name, value in domain.with_values(values).items():
        p = domain.attribute_index(name)
        try:
            labels[p] = label_values(value)
        except (DataError, ValueError) as fault:  # or a list
            raise SettingsError(f"{name}: {fault}") from None
    return labels


def replacing(
    labels: NDArray[np.int8], known: NDArray[np.int8], domain: Domain, name: str
) -> NDArray[np.int8]:
    """Add to labels (P,) of an object that no other value of a group is true, where it was `known`.

    Raises
    ------
    SettingsError
        Then no value of a group would be true.
    """
    after = labels.copy()
    for group, values in domain.groups.items():
        columns = np.array(domain.columns(values))
        if (labels[columns] == 1).any():
            after[columns[(labels[columns] < 0) & (known[columns] == 1)]] = 0
        if (np.where(after[columns] < 0, known[columns], after[columns]) == 0).all():
            raise SettingsError(f"Then {name!r} would have no {group!r}; say which it has.")
    return after
