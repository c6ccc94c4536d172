"""Each rule that a classifier owes is broken once, and told."""

from typing import Any

import numpy as np
import pytest
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.ensemble import RandomForestClassifier
from sklearn.linear_model import LogisticRegression
from sklearn.naive_bayes import GaussianNB
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC

from meal_bayes.errors import ConformanceError
from meal_bayes.testing import check_classifier

REMEMBERED: list[Any] = []


class Nearest(ClassifierMixin, BaseEstimator):
    """Decides by the first feature's distance to the means; the fault is a parameter."""

    def __init__(self, fault: str = "", trained: int = 0) -> None:
        self.fault = fault
        self.trained = trained

    def fit(self, x: Any, y: Any) -> "Nearest":
        if self.fault == "needs many features" and x.shape[1] < 4:
            raise ValueError("at least 4 features")
        self.classes_ = np.array([0, 1])
        self.means_ = [x[y == value, 0].mean() for value in (0, 1)]
        if self.fault == "keeps parameters":
            self.trained = 1
        if self.fault == "shares what it learned":
            REMEMBERED.append(self.means_)
            self.means_ = REMEMBERED[0]
        return self

    def predict_proba(self, x: Any) -> Any:
        low, high = self.means_
        true = 1 / (1 + np.exp(-(x[:, 0] - (low + high) / 2) * (high - low)))
        if self.fault == "turned round":
            true = 1 - true
        if self.fault == "guesses":
            true = np.full(len(x), 0.5)
        if self.fault == "draws without a seed":
            true = np.clip(true + np.random.default_rng().normal(0, 0.01, len(x)), 0, 1)
        if self.fault == "sums to two":
            return np.stack([1 - true, 1 + true], axis=1)
        if self.fault == "one column":
            return true
        if self.fault == "not finite":
            true[0] = np.nan
        return np.stack([1 - true, true], axis=1)


FAULTS = {
    "needs many features": "cannot learn from 60 recordings of 1 features",
    "shares what it learned": "copies share what they learned",
    "turned round": "Let decision_function rise",
    "guesses": "expected 80% at least",
    "draws without a seed": "trained again on the same recordings",
    "sums to two": "whose sums are not 1",
    "one column": "expected \\(recordings, classes\\)",
    "not finite": "probabilities below 0, or whose sums are not 1",
}


@pytest.fixture(autouse=True)
def _forget() -> None:
    REMEMBERED.clear()


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_found(fault: str) -> None:
    with pytest.raises(ConformanceError, match=FAULTS[fault]) as told:
        check_classifier(Nearest(fault))
    assert "Nearest" in str(told.value)


@pytest.mark.parametrize("found", [Nearest, object(), "forest", None])
def test_what_is_no_classifier_is_told(found: object) -> None:
    with pytest.raises(ConformanceError, match=r"give an instance|expected a scikit-learn"):
        check_classifier(found)


@pytest.mark.parametrize(
    "classifier",
    [
        Nearest(),
        GaussianNB(),
        SVC(),
        RandomForestClassifier(20),
        make_pipeline(StandardScaler(), LogisticRegression()),
    ],
    ids=lambda classifier: type(classifier).__name__,
)
def test_sound_classifiers_pass(classifier: Any) -> None:
    check_classifier(classifier)
