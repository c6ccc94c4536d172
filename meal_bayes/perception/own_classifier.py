"""Checks of a user's own classifier, and error messages if it fails.

The classifier gets copies of the features, so it may modify them.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from scipy.special import logit
from sklearn.base import clone, is_classifier

from meal_bayes.arrays import Floats
from meal_bayes.errors import DataError, SettingsError

_SEED = 0  # random state of estimators without one
_LARGEST = 1e100  # decisions are clipped to this size, so that their squares are finite
_SUM = 1e-3  # tolerance of the sums of probabilities
_ROUNDING = 1e-9  # tolerance of probabilities below 0
_SURE = 1e-3  # smallest distance of a probability from 0 and 1: 50 agreeing trees may be wrong


def check_classifier(classifier: Any) -> None:
    """Raise `SettingsError` for a value that is not a classifier or cannot be copied."""
    name = type(classifier).__name__
    if isinstance(classifier, type):
        name = classifier.__name__
        raise SettingsError(f"classifier is the class {name}; give an instance: {name}().")
    try:  # some, such as StackingClassifier, show how they decide only once they are fitted
        decides = any(hasattr(classifier, way) for way in ("predict_proba", "decision_function"))
        decides = decides or (hasattr(classifier, "__sklearn_tags__") and is_classifier(classifier))
        fresh = None
        if decides and hasattr(classifier, "fit") and hasattr(classifier, "get_params"):
            fresh = clone(classifier)
    except Exception as fault:  # whatever it raises
        reason = " ".join(str(fault).split()).rstrip(".")
        raise SettingsError(f"The classifier {name} cannot be copied: {reason:.300}.") from fault
    if fresh is None:
        raise SettingsError(
            f"classifier is {name}; expected a scikit-learn "
            "classifier: with fit, get_params, and predict_proba or decision_function."
        )
    if fresh is classifier:
        raise SettingsError(
            f"scikit-learn's clone() returns the classifier {name} itself, so all folds would "
            "share one trained classifier; give a classifier that can be cloned."
        )


def repeatable(classifier: Any) -> Any:
    """Return a clone in which all unset random states are set, so that results repeat."""
    parameters = clone(classifier).get_params().items()
    unset = [n for n, v in parameters if v is None and n.split("__")[-1] == "random_state"]
    return clone(classifier).set_params(**dict.fromkeys(unset, _SEED))


@contextmanager
def blamed(classifier: Any, task: str) -> Iterator[None]:
    """Turn any exception of a user's classifier into a `DataError` with a message of one line."""
    try:
        yield
    except Exception as fault:  # whatever it raises
        reason = " ".join(f"{type(fault).__name__}: {fault}".split()).rstrip(".")
        raise DataError(
            f"The classifier {type(classifier).__name__} cannot {task}. {reason:.300}. "
            "Change its settings, or give it more objects with known labels."
        ) from fault


def decisions_of(estimator: Any, features: Floats) -> Floats:
    """Return a number for each row, (B,), which increases with the probability of "true"."""
    if hasattr(estimator, "decision_function"):
        decisions = np.asarray(estimator.decision_function(features), np.float64)
        if decisions.shape != (len(features),) or not np.isfinite(decisions).all():
            raise ValueError(
                f"found decisions of shape {decisions.shape}, perhaps not finite; "
                f"expected one finite number for each of {len(features)} recordings"
            )
        return np.clip(decisions, -_LARGEST, _LARGEST)
    if not hasattr(estimator, "predict_proba"):
        raise TypeError("it is fitted, and has neither predict_proba nor decision_function")
    probabilities = estimator.predict_proba(features)
    classes = getattr(estimator, "classes_", ())
    true = checked_probabilities(probabilities, classes, len(features))
    return np.asarray(logit(np.clip(true, _SURE, 1 - _SURE)))


def checked_probabilities(probabilities: Any, classes: Any, recordings: int) -> Floats:
    """Check the result of `predict_proba` and return Pr(true), (B,).

    Parameters
    ----------
    probabilities : Any
        (B, classes) probabilities; rows must sum to 1 within 1e-3.
    classes : Any
        Attribute `classes_` of the estimator, which must contain 0 and 1.
    recordings : int
        Number B of rows.

    Raises
    ------
    ValueError
        If the probabilities or the classes are invalid.
    """
    names = list(classes)
    values = np.asarray(probabilities, np.float64)
    if not {0, 1} <= set(names):
        raise ValueError(f"found classes_ {names!r:.60}; expected 0 and 1")
    if values.shape != (recordings, len(names)):
        raise ValueError(
            f"found probabilities of shape {values.shape}; "
            f"expected (recordings, classes) = ({recordings}, {len(names)})"
        )
    sums = values.sum(axis=1)
    if not (values >= -_ROUNDING).all() or not (np.abs(sums - 1) <= _SUM).all():
        raise ValueError("found probabilities below 0, or whose sums are not 1; expected Pr(class)")
    return values[:, names.index(1)]
