"""Settings of the classifiers, with the two named settings "default" and "paper"."""

from dataclasses import dataclass
from typing import Any

from meal_bayes.arrays import plain_fields
from meal_bayes.datasets.percepts import BIN_EDGES, level_edges
from meal_bayes.domain import unknown
from meal_bayes.errors import SettingsError

METHODS = ("stacked", "paper", "classifier")


@dataclass(frozen=True, slots=True)
class PerceptionSettings:
    """Settings of the classifiers that turn the features of a behavior into percepts.

    For ablations, `joint`, `by_object`, `nested`, `balanced`, `nonnegative` and
    `positive_youden_only` can be switched off.

    Attributes
    ----------
    method : str
        "stacked" for kernel classifiers that a stacker combines; "paper" for support vector
        machines, weighted by Cohen's kappa; or "classifier" for a scikit-learn classifier.
    width : float | None
        Width w of the kernels exp(-d^2 / w^2), in median distances, for the method "stacked". With
        None, w is learned and is one of `kernel_ridge.WIDTHS`.
    joint : bool
        Whether the method "stacked" has an additional kernel for all modalities together.
    levels : int
        Number K of levels of a percept: 2 for no and yes, 4 for graded percepts.
    exact_objects : int
        Largest number of objects for which the method "stacked" leaves out single objects (pairs of
        objects, for percept tables). With more objects, it leaves out folds.
    exact_recordings : int
        Largest number of recordings of a behavior that the method "stacked" compares with each
        other.
    landmarks : int
        Number of recordings with which all others are compared, if a behavior has more recordings
        than `exact_recordings`.
    folds : int
        Number of groups of objects that are left out together, for the methods "paper" and
        "classifier", and for "stacked" above the exact sizes. Recordings of an object are always in
        the same fold.
    by_object : bool
        Whether cross-validation leaves out objects. If False, it leaves out recordings, as the
        published code does.
    nested : bool
        Whether stackers learn only from decisions of classifiers that were trained on none of the
        left-out objects.
    balanced : bool
        Whether both classes have the same weight, so that a percept is a likelihood ratio.
    nonnegative : bool
        Whether the slopes of stackers are at least 0, so that the output of a modality may be
        ignored but not inverted.
    positive_youden_only : bool
        Whether percepts of new objects get even odds if Youden's J <= 0 on the training objects.
        The counts of the training objects do not change.
    classifier : Any
        A scikit-learn classifier, for the method "classifier"; see `with_classifier`.
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
            raise SettingsError("The method 'classifier' needs a classifier, and only this method.")
        if self.classifier is not None:
            from meal_bayes.perception.own_classifier import check_classifier  # noqa: PLC0415

            check_classifier(self.classifier)  # scikit-learn takes a second
        if self.width is not None and not (self.width > 0 and self.method == "stacked"):
            raise SettingsError(
                f"width is {self.width}; give a number above 0 with the method 'stacked', and None "
                "with other methods."
            )
        level_edges(BIN_EDGES, self.levels)  # raises where K does not fit
        least = {"folds": 2, "landmarks": 1, "exact_objects": 0, "exact_recordings": 0}
        for name, lowest in least.items():
            if getattr(self, name) < lowest:
                raise SettingsError(f"{name} is {getattr(self, name)}; give at least {lowest}.")


FOLDS_TRAINED_ANEW = 5  # folds of methods that train classifiers for every fold
DEFAULT = PerceptionSettings()
PAPER = PerceptionSettings(method="paper", folds=FOLDS_TRAINED_ANEW)
NAMED = {"default": DEFAULT, "paper": PAPER}


def with_classifier(classifier: Any, **others: Any) -> PerceptionSettings:
    """Return settings for your own classifier.

    Parameters
    ----------
    classifier : Any
        A scikit-learn classifier, or a pipeline that ends with one, with `predict_proba` or
        `decision_function`. For each attribute and behavior, a clone learns from the features of
        all modalities side by side, after the transformation sign(x) log(1 + |x|), standardization
        and clipping.
    **others : Any
        Further settings, such as ``levels=4`` or ``folds=10``; by default, there are 5 folds.

    Raises
    ------
    SettingsError
        If the classifier cannot be cloned or fitted, or returns no decisions.
    """
    settings = {"folds": FOLDS_TRAINED_ANEW, **others}
    return PerceptionSettings(**settings, method="classifier", classifier=classifier)
