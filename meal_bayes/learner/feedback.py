"""What a person says: a verdict on a report, or labels of an object."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import label_values
from meal_bayes.domain import Domain, unknown
from meal_bayes.errors import DataError, SettingsError
from meal_bayes.trials import Trial

_ANSWERS = ("verdict", "all", "joint")


@dataclass(frozen=True, slots=True)
class Feedback:
    """What a person says after a trial.

    Attributes
    ----------
    answers : str
        "verdict", whether the report was right; "all", every queried attribute; or "joint", a
        verdict by which each gets the label of the whole query, as the authors' code has it.
    error : float
        Probability that a verdict or a label is wrong.

    Raises
    ------
    SettingsError
        Unknown answers, an error rate outside [0, 1).
    """

    answers: str = "verdict"
    error: float = 0.0

    def __post_init__(self) -> None:
        if self.answers not in _ANSWERS:
            raise SettingsError(unknown("feedback", self.answers, _ANSWERS))
        if not 0 <= self.error < 1:
            raise SettingsError(f"A person errs with probability {self.error}; give 0 to below 1.")

    def labels(self, trial: Trial, rng: np.random.Generator) -> NDArray[np.int8]:
        """Return the labels of the queried attributes that the feedback implies, (N,); -1 unknown.

        A verdict implies all labels where the report was right, or where a single attribute was
        queried (Sect. 7.3). It implies none after an abstention, or where the truth is not known.
        """
        if self.answers == "all":
            errs = rng.random(len(trial.truth)) < self.error
            return np.where(trial.truth < 0, -1, (trial.truth == 1) ^ errs).astype(np.int8)
        if trial.report is None or trial.success is None:
            return np.full(len(trial.truth), -1, np.int8)
        labels = implied(trial.report, right=trial.success ^ bool(rng.random() < self.error))
        if self.answers == "joint":
            labels = np.where(labels < 0, labels, (labels == 1).all()).astype(np.int8)
        return labels


def implied(report: NDArray[np.bool_], *, right: bool) -> NDArray[np.int8]:
    """Return the labels (N,) that a verdict on a report (N,) implies; -1 unknown.

    A wrong report of several attributes implies none, as any of them may be wrong.
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
    labels: NDArray[np.int8], known: NDArray[np.int8], domain: Domain
) -> NDArray[np.int8]:
    """Add to labels (P,) that no other value of a group is true, where `known` (P,) says so."""
    after = labels.copy()
    for group in domain.groups.values():
        columns = np.array(domain.columns(group))
        if (labels[columns] == 1).any():
            after[columns[(labels[columns] < 0) & (known[columns] == 1)]] = 0
    return after
