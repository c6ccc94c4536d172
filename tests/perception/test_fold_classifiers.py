"""Classifiers of one's own: they learn, they repeat, and they cannot leak."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from held_out import cohens_kappa, held_out_log_odds, permuted, yes_counts
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.ensemble import (
    RandomForestClassifier,
)
from sklearn.linear_model import LinearRegression, LogisticRegression
from sklearn.naive_bayes import GaussianNB
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC

from meal_bayes.datasets import TrainingSet, make_synthetic
from meal_bayes.domain import Query, load_domain
from meal_bayes.errors import DataError, SettingsError
from meal_bayes.perception import (
    DEFAULT,
    PAPER,
    build_percept_table,
    fit_and_validate,
    table_counts,
    with_classifier,
)
from meal_bayes.perception.fold_classifiers import FoldProblem, KappaPool, fit_sigmoid

BY_HEART = KNeighborsClassifier(1)


def kappa(counts):
    return cohens_kappa(counts.sum(axis=0))[:, :2]  # of look and lift


class Remembers(ClassifierMixin, BaseEstimator):
    """Says the label of rows it was fitted to, and 0 of any other row."""

    def fit(self, rows, labels):
        self.told_ = {
            row.tobytes(): 2.0 * label - 1 for row, label in zip(rows, labels, strict=True)
        }
        return self

    def decision_function(self, rows):
        return np.array([self.told_.get(row.tobytes(), 0.0) for row in rows])


class Undecided(Remembers):
    """Says no number."""

    def decision_function(self, rows):
        return np.full(len(rows), np.nan)


def test_no_output_comes_from_a_classifier_that_saw_the_row(make):
    dataset = make(3, objects=12)
    every = np.ones(3, bool)
    truth = np.array([[True], [False], [True]])
    ids = np.arange(3)
    problem = FoldProblem(np.eye(3)[None], truth, ids, ids, ids, ["it"], Remembers(), None)
    spy = problem.train(every)
    assert spy.decide([np.eye(3)])[:, 0, 0].tolist() == [1.0, -1.0, 1.0]  # the spy would tell
    settings = with_classifier(Remembers(), positive_youden_only=False)
    table = build_percept_table(dataset, perception=settings)
    sensing = table.log_odds[:, :, :2]
    np.testing.assert_allclose(sensing, 0.0, atol=1e-6)
    nothing = table.training_bins[..., 3].sum(axis=-1) + table.training_bins[..., 4].sum(axis=-1)
    assert nothing.sum() == table.training_bins.sum()
    np.testing.assert_allclose(
        held_out_log_odds(dataset, settings=settings)[:, :, :2], 0, atol=1e-6
    )


@pytest.mark.long
@pytest.mark.statistical
@pytest.mark.parametrize("estimator", [BY_HEART, GaussianNB()], ids=["by heart", "Bayes"])
def test_permuted_labels_cannot_be_told(estimator):
    kappas = []
    side = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        made = make_synthetic(load_domain("toy"), objects=90, recordings=2, dimensions=4, rng=rng)
        dataset = permuted(made, rng)
        table = build_percept_table(dataset, perception=with_classifier(estimator))
        kappas.append(kappa(yes_counts(table.log_odds.astype(float), dataset.labels)))
        without = replace(with_classifier(estimator), positive_youden_only=False)
        table = build_percept_table(dataset, perception=without)
        side.append(kappa(table_counts(table, 0)))
    assert abs(np.mean(kappas)) <= 0.03
    assert abs(np.mean(side)) <= 0.03


@pytest.mark.parametrize(
    "estimator",
    [
        GaussianNB(),  # predict_proba alone
        SVC(),  # decision_function alone
        make_pipeline(StandardScaler(), LogisticRegression()),
        pytest.param(RandomForestClassifier(20), marks=pytest.mark.long),
    ],
    ids=["Bayes", "SVC", "pipeline", "forest"],
)
def test_any_classifier_learns(make, estimator):
    dataset = make(1, objects=24, signal=8.0)
    settings = with_classifier(estimator)
    log_odds = held_out_log_odds(dataset, settings=settings)
    assert kappa(yes_counts(log_odds, dataset.labels)).max(axis=1).min() > 0.5


def test_what_was_fitted_perceives_as_its_counts_say(make):
    dataset = make(1, objects=20, signal=8.0)
    settings = with_classifier(LogisticRegression(), levels=4)
    training = TrainingSet.everything(dataset, range(1, len(dataset.objects)))
    perception, counts = fit_and_validate(dataset, training, settings=settings)
    assert counts[0].sum() == 0
    assert counts[1:].sum() == 19 * 2 * 2 * 2  # objects, recordings, behaviors, attributes
    query = Query(dataset.domain.attributes)
    instance = dataset.instance(0, "lift", 1)
    said = perception.observe(instance, query, np.random.default_rng(0))
    assert set(said.tolist()) <= set(range(4))


@pytest.mark.long
def test_equal_calls_give_equal_tables_and_leave_warning_filters_as_before(make):
    dataset = make(2, objects=8)
    before = list(warnings.filters)
    first, second = (
        build_percept_table(dataset, classifier=RandomForestClassifier(5)) for _ in range(2)
    )
    np.testing.assert_array_equal(first.log_odds, second.log_odds)
    np.testing.assert_array_equal(first.training_bins, second.training_bins)
    assert list(warnings.filters) == before


def test_the_classifier_enters_the_provenance(make):
    told = build_percept_table(make(1), classifier=KNeighborsClassifier(3)).provenance
    assert told["classifier"].endswith(":KNeighborsClassifier")
    assert "n_neighbors=3" in told["classifier_parameters"]


@pytest.mark.parametrize(
    ("options", "kind", "message"),
    [
        ({"classifier": RandomForestClassifier}, SettingsError, "give an instance"),
        ({"classifier": StandardScaler()}, SettingsError, "expected a scikit-learn classifier"),
        ({"classifier": "forest"}, SettingsError, "classifier is str"),
        ({"classifier": GaussianNB(), "perception": "paper"}, SettingsError, "not both"),
        ({"classifier": LinearRegression()}, SettingsError, "expected a scikit-learn classifier"),
        ({"classifier": Undecided()}, DataError, r"Undecided cannot decide '.*' by 'look'"),
        ({"perception": "svm"}, SettingsError, "Unknown perception"),
    ],
)
def test_what_no_table_is_made_of_is_told(make, options, kind, message):
    with pytest.raises(kind, match=message):
        build_percept_table(make(1), **options)


def log_odds(probability):
    return np.log(probability / (1 - probability))


def test_the_behavior_says_the_kappa_weighted_mean():
    sigmoid = np.zeros((2, 1, 2))
    sigmoid[..., 1] = 1.0  # probability = expit(decision)
    pool = KappaPool(sigmoid, np.array([[0.6], [0.2]]))
    said = pool.log_odds(log_odds(np.array([0.9, 0.3]))[None, :, None])
    expected = (0.6 * 0.9 + 0.2 * 0.3) / 0.8
    assert said[0, 0] == pytest.approx(log_odds(expected))


def test_without_any_reliable_modality_it_says_one_half():
    pool = KappaPool(np.ones((2, 1, 2)), np.zeros((2, 1)))
    assert pool.log_odds(np.full((3, 2, 1), 5.0)).tolist() == [[0.0]] * 3


@given(st.integers(0, 999), st.integers(5, 40))
def test_the_sigmoid_is_platts(seed, n):
    rng = np.random.default_rng(seed)
    truth = np.arange(n) % 3 == 0
    decisions = rng.normal(size=n) + truth
    n_true = truth.sum()
    n_false = (~truth).sum()
    soft = np.where(truth, (n_true + 1) / (n_true + 2), 1 / (n_false + 2))

    def loss(theta):
        z = theta[0] + theta[1] * decisions
        return (soft * np.logaddexp(0, -z) + (1 - soft) * np.logaddexp(0, z)).sum()

    expected = minimize(loss, [0.0, 0.0], method="BFGS", options={"gtol": 1e-8}).x
    np.testing.assert_allclose(fit_sigmoid(decisions, truth), expected, atol=2e-2, rtol=1e-2)


@pytest.mark.parametrize("perception", [DEFAULT, PAPER], ids=["default", "paper"])
@pytest.mark.parametrize("objects", [1, 2, 3, 4])
def test_hardly_any_objects_are_no_error(make, perception, objects):
    table = build_percept_table(make(1, objects=objects, recordings=1), perception=perception)
    assert np.isfinite(table.log_odds[:, :, :2]).all()
    if objects < 3:
        assert (table.log_odds[:, :, :2] == 0).all()
