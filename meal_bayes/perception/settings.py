"""Settings of perception, and the two named ones."""

from dataclasses import dataclass
from typing import Any

from meal_bayes.arrays import plain_fields
from meal_bayes.datasets.percepts import BIN_EDGES, level_edges
from meal_bayes.domain import unknown
from meal_bayes.errors import SettingsError

METHODS = ("stacked", "paper", "classifier")


@dataclass(frozen=True, slots=True)
class PerceptionSettings:
    """How a behavior's percept is made from its modalities.

    For ablations, `joint`, `by_object`, `nested`, `balanced`, `nonnegative` and
    `positive_youden_only` can be switched off.

    Attributes
    ----------
    method : str
        "stacked"; "paper": support vector machines, weighted by Cohen's kappa; "classifier".
    width : float | None
        "stacked" only: w of the kernels exp(-d^2 / w^2), in median distances; None: learned, one of
        `kernel_ridge.WIDTHS`.
    joint : bool
        "stacked" only: one more kernel, of all modalities at once.
    levels : int
        K of an observed percept: 2 yes or no, 4 graded.
    exact_objects : int
        Up to so many objects "stacked" leaves every one out alone; percept tables, pairs of them.
        Above, it leaves out `folds` groups.
    exact_recordings : int
        Up to so many recordings of a behavior "stacked" compares all with each other.
    landmarks : int
        Above `exact_recordings`, recordings are compared with so many of them.
    folds : int
        "paper" and "classifier", and "stacked" above the exact sizes: groups of objects that are
        left out together, an object never split.
    by_object : bool
        Cross-validate over objects; False: over samples, as published.
    nested : bool
        Stackers learn from decisions that saw none of the objects left out.
    balanced : bool
        Both classes weigh the same, so a percept is a likelihood ratio.
    nonnegative : bool
        A modality may be ignored, never inverted.
    positive_youden_only : bool
        Percepts of further objects are at even odds where Youden's J <= 0 in training; the counts
        of training stay as they are.
    classifier : Any
        Of the method "classifier" only: a scikit-learn classifier, see `with_classifier`.
    """

    method: str = "stacked"
    width: float | None = None
    joint: bool = True
    levels: int = 2
    exact_objects: int = 128
    exact_recordings: int = 1500
    landmarks: int = 512
    folds: int = 10
    by_object: bool = True
    nested: bool = True
    balanced: bool = True
    nonnegative: bool = True
    positive_youden_only: bool = True
    classifier: Any = None

    def __post_init__(self) -> None:
        plain_fields(self)
        if self.method not in METHODS:
            raise SettingsError(unknown("method", self.method, METHODS))
        if (self.method == "classifier") != (self.classifier is not None):
            raise SettingsError("A classifier and the method 'classifier' go together; give both.")
        if self.classifier is not None:
            from meal_bayes.perception.own_classifier import check_classifier  # noqa: PLC0415

            check_classifier(self.classifier)  # scikit-learn takes a second
        if self.width is not None and not (self.width > 0 and self.method == "stacked"):
            raise SettingsError(
                f"width is {self.width}; give a number above 0 to 'stacked', and None to others."
            )
        level_edges(BIN_EDGES, self.levels)  # raises where K does not fit
        least = {"folds": 2, "landmarks": 1, "exact_objects": 0, "exact_recordings": 0}
        for name, lowest in least.items():
            if getattr(self, name) < lowest:
                raise SettingsError(f"{name} is {getattr(self, name)}; give at least {lowest}.")


FOLDS_TRAINED_ANEW = 5  # where every fold has classifiers of its own: the paper's, and one's own
DEFAULT = PerceptionSettings()
PAPER = PerceptionSettings(method="paper", folds=FOLDS_TRAINED_ANEW)
NAMED = {"default": DEFAULT, "paper": PAPER}


def with_classifier(classifier: Any, **others: Any) -> PerceptionSettings:
    """Return settings for a classifier of one's own.

    Parameters
    ----------
    classifier : Any
        A scikit-learn classifier, or pipeline that ends in one, with `predict_proba` or
        `decision_function`. A clone an attribute and behavior learns from the features of all
        modalities side by side, squashed, standardized and clipped.
    **others : Any
        Further settings, such as ``levels=4`` or ``folds=10``; 5 folds by default.

    Raises
    ------
    SettingsError
        What cannot be cloned, fitted, or asked for a decision.
    """
    settings = {"folds": FOLDS_TRAINED_ANEW, **others}
    return PerceptionSettings(**settings, method="classifier", classifier=classifier)
