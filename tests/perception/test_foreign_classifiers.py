"""Classifiers of other people: their faults in one line, their copies apart, dead sensors."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.calibration import CalibratedClassifierCV
from sklearn.decomposition import PCA
from sklearn.discriminant_analysis import QuadraticDiscriminantAnalysis
from sklearn.ensemble import (
    HistGradientBoostingClassifier,
    RandomForestClassifier,
    StackingClassifier,
    VotingClassifier,
)
from sklearn.linear_model import LogisticRegression
from sklearn.naive_bayes import ComplementNB, GaussianNB
from sklearn.neighbors import KNeighborsClassifier
from sklearn.neural_network import MLPClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC

from meal_bayes.datasets import Dataset
from meal_bayes.domain import load_domain
from meal_bayes.errors import DataError, SettingsError
from meal_bayes.perception import (
    build_percept_table,
    with_classifier,
)
from meal_bayes.perception.own_classifier import checked_probabilities


class Foreign(ClassifierMixin, BaseEstimator):
    """Does as it is told, in `fit` or when it is asked."""

    def __init__(self, probabilities=None, classes=(0, 1), raises=None, when="fit"):
        self.probabilities = probabilities
        self.classes = classes
        self.raises = raises
        self.when = when

    def fit(self, rows, labels):
        self.classes_ = np.array(self.classes)
        self.mean_ = rows[labels == 1].mean(axis=0)
        rows += 7.0  # of its own copy
        return self._told("fit", self)

    def predict_proba(self, rows):
        near = np.exp(-((rows - self.mean_) ** 2).mean(axis=1))
        rows[:] = 0.0
        both = np.stack([1 - near, near], axis=1)
        return self._told("decide", both if self.probabilities is None else self.probabilities)

    def _told(self, moment, value):
        if self.raises is not None and moment == self.when:
            raise self.raises
        return value


class Shared(Foreign):
    """Is its own clone."""

    def __sklearn_clone__(self):
        return self


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:Stochastic Optimizer")  # twenty steps do not converge
@pytest.mark.parametrize(
    "pipeline",
    [
        make_pipeline(StandardScaler(), MLPClassifier((8,), max_iter=20)),
        make_pipeline(PCA(3), LogisticRegression()),
    ],
    ids=["scaler and MLP", "PCA and logistic"],
)
def test_a_pipeline_is_judged_by_its_contract_and_not_by_its_quality(make, pipeline):
    table = build_percept_table(make(3, objects=8), classifier=pipeline)
    assert np.abs(table.log_odds[:, :, :2]).max() > 0


@pytest.mark.parametrize("kind", [Foreign, object(), "forest"])
def test_what_is_no_classifier_is_told(kind):
    with pytest.raises(SettingsError, match=r"give an instance|expected a scikit-learn"):
        with_classifier(kind)


def test_what_is_its_own_copy_cannot_be_held_out():
    with pytest.raises(SettingsError, match="share one trained classifier"):
        with_classifier(Shared())


def test_a_classifier_that_writes_into_its_input_changes_nothing_else(make):
    dataset = make(3, objects=8)
    table = build_percept_table(dataset, classifier=Foreign())
    assert np.abs(table.log_odds[:, :, :2]).max() > 0
    alone = [dataset.domain.attributes[0]]
    labels = np.where(np.arange(dataset.labels.shape[1]) == 0, dataset.labels, -1)
    first = build_percept_table(replace(dataset, labels=labels), classifier=Foreign())
    np.testing.assert_array_equal(
        first.log_odds[..., :2, : len(alone)], table.log_odds[..., :2, : len(alone)]
    )


EXCEPTIONS = [ValueError, RuntimeError, IndexError, ZeroDivisionError, KeyError, Exception]
NUMBERS = st.floats(-2, 3) | st.sampled_from([np.nan, np.inf, -np.inf, 50.0])


@given(
    st.sampled_from(EXCEPTIONS), st.text(max_size=40), st.sampled_from(["fit", "decide"])
)  # fmt: skip
def test_what_a_classifier_raises_is_one_line_with_its_place(kind, text, when):
    raises = kind(text)
    dataset = some_cups()
    with pytest.raises(DataError, match=r"Foreign cannot (learn|decide) 'red' by 'look'") as told:
        build_percept_table(dataset, classifier=Foreign(raises=raises, when=when))
    assert isinstance(told.value.__cause__, kind)
    assert len(str(told.value).splitlines()) == 1
    assert "folds left out: " in str(told.value)


@given(st.lists(NUMBERS, min_size=1, max_size=3), st.permutations([0, 1]), st.integers(1, 4))
def test_probabilities_are_taken_as_they_are_or_refused(row, classes, recordings):
    values = [row] * recordings
    if len(row) == 2 and min(row) >= 0 and abs(sum(row) - 1) <= 1e-3:
        true = checked_probabilities(values, np.array(classes), recordings)
        assert true.tolist() == [row[classes.index(1)]] * recordings
    else:
        with pytest.raises(ValueError, match="found probabilities"):
            checked_probabilities(values, np.array(classes), recordings)


@pytest.mark.parametrize(
    "options",
    [
        {"classes": ("no", "yes")},
        {"classes": (1, 2)},
        {"probabilities": [[30.0, 70.0]]},
        {"probabilities": [0.5]},
        {"probabilities": "much"},
        {"probabilities": None, "classes": (1,)},
    ],
)
def test_numbers_that_are_no_probabilities_are_told(options):
    with pytest.raises(DataError, match=r"Foreign cannot decide 'red' by 'look'"):
        build_percept_table(some_cups(), classifier=Foreign(**options))


def some_cups(objects=6, **features):
    """Few objects, of which "red" is known."""
    domain = load_domain(
        {
            "name": "k",
            "attributes": ["red"],
            "behaviors": [{"name": "look", "cost": 1.0, "modalities": ["c"]}],
            "diagram": {
                "states": ["t"],
                "start": "t",
                "effects": [{"from": "t", "do": "look", "to": "t"}],
            },
        }
    )
    cups = {f"cup {n}": [[float(n % 2)] * 3 + [0.1 * (5 * n % 16)]] for n in range(objects)}
    labels = {name: {"red": n % 2 == 0} for n, name in enumerate(cups)}
    return Dataset.from_frames(domain, {("look", "c"): features or cups}, labels)


@pytest.mark.parametrize(
    "estimator",
    [
        LogisticRegression(), RandomForestClassifier(5), SVC(), KNeighborsClassifier(1),
        GaussianNB(), HistGradientBoostingClassifier(), make_pipeline(StandardScaler(), SVC()),
    ],
    ids=lambda estimator: type(estimator).__name__,
)  # fmt: skip
def test_a_dead_sensor_is_at_even_odds_for_any_classifier(estimator):
    dead = some_cups(**{f"cup {n}": np.zeros((2, 3)) for n in range(6)})
    with pytest.warns(UserWarning, match="None of the features of"):
        table = build_percept_table(dead, classifier=estimator)
    assert (table.log_odds[:, :, 0] == 0).all()


@pytest.mark.parametrize(
    "estimator",
    [
        CalibratedClassifierCV(),
        KNeighborsClassifier(50),
        ComplementNB(),
        QuadraticDiscriminantAnalysis(),
        VotingClassifier([("a", GaussianNB())]),
    ],
    ids=lambda estimator: type(estimator).__name__,
)
def test_what_a_known_classifier_cannot_do_is_one_line(estimator):
    name = type(estimator).__name__
    with pytest.raises(DataError, match=rf"{name} cannot (learn|decide) 'red' by 'look'"):
        build_percept_table(some_cups(), classifier=estimator)


def test_what_decides_only_once_fitted_is_a_classifier():
    stacked = StackingClassifier([("a", GaussianNB())], cv=2)
    assert with_classifier(stacked).classifier is stacked
    assert np.isfinite(build_percept_table(some_cups(16), classifier=stacked).log_odds).all()
