"""The check of a classifier of one's own, before it perceives in place of ours."""

from typing import Any

import numpy as np
from sklearn.base import clone

from meal_bayes.arrays import Floats, Ints, check_whole
from meal_bayes.errors import ConformanceError, MealBayesError
from meal_bayes.perception.own_classifier import blamed, decisions_of, repeatable
from meal_bayes.perception.own_classifier import check_classifier as check_interface

_RECORDINGS = 60
_FEATURES = (1, 4, 40)  # modalities have one number or many
_SIGNAL = 4.0  # standard deviations between true and false
_RIGHT = 0.8  # of new recordings, where guessing gets half


def check_classifier(classifier: Any, *, seed: int = 0) -> None:
    """Check a scikit-learn classifier as percepts need it, on made-up recordings.

    It must be copied for every fold, learn from a few recordings of one or many features, also of
    unequal classes and constant features; decide by one finite number a recording, which rises with
    the probability of "true"; repeat itself; and keep nothing of one attribute for the next.

    Parameters
    ----------
    classifier : Any
        With `fit`, `get_params`, and `predict_proba` or `decision_function`.
    seed : int
        Of the recordings.

    Raises
    ------
    ConformanceError
        What was found, what was expected, and how to mend it.
    """
    name = type(classifier).__name__
    try:
        check_whole("seed", seed)
        check_interface(classifier)
        for number, features in enumerate(_FEATURES):
            rng = np.random.default_rng([seed, number])
            _check_on(classifier, features, rng, name)
    except MealBayesError as fault:
        if isinstance(fault, ConformanceError):
            raise
        raise ConformanceError(str(fault)) from fault


def _check_on(classifier: Any, features: int, rng: np.random.Generator, name: str) -> None:
    before = repr(sorted(classifier.get_params().items(), key=str))
    labels = rng.permutation(np.arange(_RECORDINGS) % 3 == 0).astype(np.int64)  # a third is true
    rows = _recordings(labels, features, rng)
    new = np.arange(_RECORDINGS) % 2
    unseen = _recordings(new, features, rng)
    decisions, opposite = _decide(classifier, rows, labels, unseen)
    accuracy = ((decisions > np.median(decisions)) == new).mean()
    if accuracy < _RIGHT:
        raise ConformanceError(
            f"{name} is right about {accuracy:.0%} of recordings that lie {_SIGNAL:.0f} standard "
            f"deviations apart ({features} features); expected {_RIGHT:.0%} at least. Let "
            "decision_function rise with the probability of the class 1, and predict_proba have "
            "the columns of classes_; if copies share what they learned, let fit() set it anew."
        )
    if ((opposite > np.median(opposite)) == 1 - new).mean() < _RIGHT:
        raise ConformanceError(
            f"{name} does not learn the opposite from opposite labels: copies share what they "
            "learned. Keep what fit() learns in attributes that fit() sets anew."
        )
    if not np.array_equal(decisions, _decide(classifier, rows, labels, unseen)[0]):
        raise ConformanceError(
            f"{name} decides differently when it is trained again on the same recordings. Draw "
            "from a parameter random_state alone, which is set where it is None."
        )
    if repr(sorted(classifier.get_params().items(), key=str)) != before:
        raise ConformanceError(
            f"{name} has other parameters after its copies were trained. Let fit() set attributes "
            "with a trailing underscore, and leave parameters as they are."
        )


def _recordings(labels: Ints, features: int, rng: np.random.Generator) -> Floats:
    """Draw recordings (B,D): a feature tells the label, one is constant, the others are noise."""
    rows = rng.normal(size=(len(labels), features))
    rows[:, 0] += _SIGNAL * labels
    if features > 1:
        rows[:, -1] = 7.0
    return rows


def _decide(classifier: Any, rows: Floats, labels: Ints, unseen: Floats) -> tuple[Floats, Floats]:
    """Return decisions (B,) of a copy that has learned the labels, and of one of the opposite."""
    estimator = repeatable(classifier)
    with blamed(classifier, f"learn from {len(rows)} recordings of {rows.shape[1]} features"):
        fitted = clone(estimator).fit(rows.copy(), labels.copy())
        opposite = clone(estimator).fit(rows.copy(), 1 - labels)
    with blamed(classifier, f"decide about {len(unseen)} recordings"):
        return decisions_of(fitted, unseen.copy()), decisions_of(opposite, unseen.copy())
