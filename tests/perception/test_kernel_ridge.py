"""The closed forms equal honest refits, and each cure of a trap of cross-validation is needed."""

from dataclasses import replace

import numpy as np
import pytest
from held_out import cohens_kappa
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize

from meal_bayes.datasets import TrainingSet
from meal_bayes.datasets.percepts import BIN_EDGES, THRESHOLD, levels_of, round_log_odds
from meal_bayes.perception import DEFAULT, build_percept_table, fit_and_validate, table_counts
from meal_bayes.perception.compiled_stacking import fit_stacker
from meal_bayes.perception.confusion import youden
from meal_bayes.perception.feature_spaces import assign_folds
from meal_bayes.perception.kernel_ridge import (
    NOBODY,
    RIDGE,
    each_group,
    kernel_problem,
    landmark_problem,
    leave_out,
)
from meal_bayes.posterior import ConfusionPosterior

NOISE = 0.2


def some_problem(seed, sizes, modalities=2, attributes=2):
    """Recordings of objects with these numbers of recordings, both classes in every attribute."""
    rng = np.random.default_rng(seed)
    objects = np.repeat(np.arange(len(sizes)), sizes)
    truth = np.array([rng.permutation(len(sizes)) % 2 == 0 for _ in range(attributes)]).T
    features = rng.normal(size=(modalities, len(objects), 3))
    features[:, :, 0] += truth[objects, 0]
    distance = ((features[:, :, None] - features[:, None]) ** 2).sum(axis=-1)
    return np.exp(-distance / 6), truth[objects], objects


def refit(gram, targets, train, test):
    """Kernel ridge trained on some rows, its decisions on others, (B,P)."""
    matrix = gram[np.ix_(train, train)] + NOISE * np.eye(train.sum())
    return gram[np.ix_(test, train)] @ np.linalg.solve(matrix, targets[train])


def optimum(features, target, weight, *, nonnegative):
    """Stacker by scipy's bounded optimizer from (n,M) features."""

    def loss(theta):
        z = theta[0] + features @ theta[1:]
        value = (weight * np.logaddexp(0, -target * z)).sum() + RIDGE / 2 * (theta[1:] ** 2).sum()
        residual = -weight * target / (1 + np.exp(target * z))
        slope = features.T @ residual + RIDGE * theta[1:]
        return value, np.append(residual.sum(), slope)

    low = 0.0 if nonnegative else None
    bounds = [(None, None)] + [(low, None)] * features.shape[1]
    options = {"ftol": 1e-15, "gtol": 1e-10, "maxiter": 2000}
    start = np.zeros(1 + features.shape[1])
    return minimize(loss, start, jac=True, bounds=bounds, method="L-BFGS-B", options=options).x


def weights_of(objects, target):
    """Recordings 2/R, classes n/(2 n_c)."""
    weight = 2.0 / np.bincount(objects)[objects]
    side = np.where(target > 0, weight[target > 0].sum(), weight[target < 0].sum())
    return weight * weight.sum() / 2 / side


def by_hand(grams, truth, objects, left_out):
    """What the stacker without `left_out` says of them, all by refits: (P, rows of left_out)."""
    targets = np.where(truth, 1.0, -1.0)
    out = np.isin(objects, left_out)
    decisions = np.zeros((len(grams), *targets.shape))
    for m, gram in enumerate(grams):
        for k in np.unique(objects[~out]):
            rows = objects == k
            decisions[m, rows] = refit(gram, targets, ~out & ~rows, rows)
        decisions[m, out] = refit(gram, targets, ~out, out)
    said = []
    for p in range(targets.shape[1]):
        target = targets[~out, p]
        weight = weights_of(objects[~out], target)
        theta = optimum(decisions[:, ~out, p].T, target, weight, nonnegative=True)
        said.append(theta[0] + theta[1:] @ decisions[:, out, p])
    return np.array(said)


@given(
    seed=st.integers(0, 999),
    sizes=st.lists(st.integers(1, 3), min_size=4, max_size=7),
    n_out=st.integers(0, 2),
)
def test_decisions_equal_refits_without_the_objects(seed, sizes, n_out):
    grams, truth, objects = some_problem(seed, sizes)
    problem = kernel_problem(grams, truth, objects, NOISE)
    left_out = np.random.default_rng(seed).permutation(len(sizes))[:n_out]
    out = np.isin(objects, left_out)
    left_out = left_out.astype(np.int64)
    left, others = problem.score(left_out, problem.rows(left_out), True)
    targets = np.where(truth, 1.0, -1.0)
    rows = np.concatenate([np.flatnonzero(objects == k) for k in left_out] + [[]]).astype(int)
    for m in range(2):
        if n_out:
            expected = refit(grams[m], targets, ~out, np.isin(np.arange(len(objects)), rows))
            place = np.argsort(np.argsort(rows))
            np.testing.assert_allclose(left[m].T, expected[place], atol=1e-9)
        for k in np.setdiff1d(np.arange(len(sizes)), left_out):
            mine = objects == k
            expected = refit(grams[m], targets, ~out & ~mine, mine)
            np.testing.assert_allclose(others[m][:, mine].T, expected, atol=1e-9)
        assert (others[m][:, out] == 0).all()


@given(seed=st.integers(0, 999), n=st.integers(4, 40), nonnegative=st.booleans())
def test_the_stacker_is_the_optimum(seed, n, nonnegative):
    rng = np.random.default_rng(seed)
    features = rng.normal(size=(3, n)) * rng.choice([0.1, 1.0, 4.0])
    target = np.where(np.arange(n) % 2, 1.0, -1.0)
    features[0] += rng.normal() * target
    weight = rng.uniform(0.1, 2.0, n)
    theta = rng.normal(size=4) ** 2  # Newton's method starts anywhere
    loss = fit_stacker(features, target, weight, RIDGE, nonnegative, theta)
    wrong = np.logaddexp(0, -target * (theta[0] + theta[1:] @ features))
    assert loss == pytest.approx(weight @ wrong + RIDGE / 2 * (theta[1:] ** 2).sum())
    expected = optimum(features.T, target, weight, nonnegative=nonnegative)
    np.testing.assert_allclose(theta, expected, atol=2e-4 * (1 + np.abs(expected).max()))
    assert not nonnegative or (theta[1:] >= 0).all()


@pytest.mark.parametrize("left_out", [[4], [1, 4]])
def test_log_odds_equal_everything_done_by_hand(left_out):
    grams, truth, objects = some_problem(3, [2, 1, 2, 3, 2, 2, 1])
    problem = kernel_problem(grams, truth, objects, NOISE)
    (log_odds,) = leave_out(problem, np.array([left_out]), DEFAULT).log_odds
    np.testing.assert_allclose(log_odds, by_hand(grams, truth, objects, left_out), atol=1e-4)


def test_a_warm_start_changes_nothing():
    grams, truth, objects = some_problem(5, [2] * 8)
    problem = kernel_problem(grams, truth, objects, NOISE)
    warm = leave_out(problem, NOBODY, DEFAULT).weights[0]
    cold = each_group(problem, DEFAULT)
    np.testing.assert_allclose(each_group(problem, DEFAULT, warm), cold, atol=1e-6)


def test_one_class_left_says_nothing():
    grams, _, objects = some_problem(1, [2, 2, 2])
    truth = np.repeat([[True], [False], [False]], 2, axis=0)
    outputs = each_group(kernel_problem(grams, truth, objects, NOISE), DEFAULT)
    assert (outputs[objects == 0] == 0).all()  # without the only positive object
    assert np.isfinite(outputs).all()


FOLDS = 4
ABOVE = {"exact_recordings": 30, "folds": FOLDS}


def test_neighbors_are_in_different_folds_in_no_fixed_order():
    folds = assign_folds(np.arange(60), 5).reshape(12, 5)
    assert (np.sort(folds) == np.arange(5)).all()
    assert len(set(map(tuple, folds))) > 6
    np.testing.assert_array_equal(
        assign_folds(np.array([3, 17, 44]), 5), folds.ravel()[[3, 17, 44]]
    )


@pytest.mark.parametrize("nested", [True, False])
def test_with_all_recordings_as_landmarks_outputs_equal_the_exact_ones(nested):
    rng = np.random.default_rng(1)
    folds = np.repeat(np.arange(5), 6)
    objects = np.repeat(np.arange(15), 2)
    points = rng.normal(size=(2, 30, 3))
    truth = rng.random((30, 2)) < 0.5
    grams = np.exp(-((points[:, :, None] - points[:, None]) ** 2).sum(axis=-1) / 4)
    exact = kernel_problem(grams, truth, folds, 0.2)
    exact = replace(exact, weights=np.ones(30))  # 2 an object, of two recordings each
    near = landmark_problem(grams, grams, truth, (folds, objects), 0.2)
    np.testing.assert_array_equal(near.weights, exact.weights)
    decided = [problem.duals @ grams for problem in (near, exact)]
    np.testing.assert_allclose(*decided, atol=1e-4)
    settings = replace(DEFAULT, nested=nested)
    for sets in ([[]], [[0], [3]], [[1, 4], [0, 2]]):
        outputs, expected = (
            leave_out(problem, np.array(sets, np.int64), settings) for problem in (near, exact)
        )
        for output, wanted in zip(outputs, expected, strict=True):
            np.testing.assert_allclose(output, wanted, atol=1e-4)


@pytest.mark.parametrize("landmarks", [9, 64])
def test_many_objects_are_told_apart_by_what_is_compared_with_landmarks(make, landmarks):
    dataset = make(6, objects=40, signal=8.0)
    settings = replace(DEFAULT, **ABOVE, landmarks=landmarks)
    training = TrainingSet.everything(dataset, range(30))
    perception, counts = fit_and_validate(dataset, training, settings=settings)
    assert cohens_kappa(counts.sum(axis=0))[:, :2].max(axis=1).min() > 0.5
    rows = next(iter(perception.classifiers["lift"].spaces.values())).rows
    assert len(rows) == min(landmarks, 60)


def test_fitting_counts_recordings_and_a_table_objects_too(make):
    dataset = make(2, objects=8, recordings=4)
    settings = replace(DEFAULT, folds=3)
    training = TrainingSet.everything(dataset)
    exact = fit_and_validate(dataset, training, settings=settings)[1]
    for few in ({"exact_recordings": 30}, {"exact_objects": 7}):
        some = replace(settings, **few)
        assert build_percept_table(dataset, perception=some).groups.max() == 2
        counts = fit_and_validate(dataset, training, settings=some)[1]
        assert np.array_equal(counts, exact) == ("exact_objects" in few)


SIGNED = replace(DEFAULT, nonnegative=False)  # slopes of both signs, so that the leak shows fully
LEAKY = replace(SIGNED, nested=False)


def outputs_of(truth, left_out, settings):
    """Outputs on some objects of a fixed random problem with these labels."""
    rng = np.random.default_rng(7)
    features = rng.normal(size=(3, 20, 4))
    grams = np.exp(-((features[:, :, None] - features[:, None]) ** 2).sum(axis=-1) / 8)
    problem = kernel_problem(grams, np.repeat(truth, 2)[:, None], np.repeat(np.arange(10), 2), 0.2)
    return leave_out(problem, np.array([left_out]), settings).log_odds[0]


@pytest.mark.parametrize("left_out", [[3], [3, 8]])
def test_second_level_leak_labels_of_left_out_objects_change_nothing(left_out):
    truth = np.array([1, 0, 1, 0, 1, 0, 1, 0, 1, 0], dtype=bool)
    flipped = truth.copy()
    flipped[left_out] = ~flipped[left_out]

    def change(settings):
        before, after = (outputs_of(labels, left_out, settings) for labels in (truth, flipped))
        return np.abs(after - before).max()

    assert change(DEFAULT) < 1e-6
    assert change(SIGNED) < 1e-6
    assert change(LEAKY) > 0.1  # stackers that learn from decisions which saw the left-out objects


def test_no_inverted_table_is_used(make):
    def counts_of(settings):
        """Yield the percept counts on the training side of every held-out object."""
        for seed in range(3):
            dataset = make(seed, objects=12, signal=0.0)  # features say nothing of the labels
            table = build_percept_table(dataset, perception=settings)
            yield from (table_counts(table, o) for o in range(12))

    def informedness(settings):
        """TPR - FPR of every held-out object, attribute and behavior."""
        return np.array([youden(counts.sum(axis=0))[:, :2] for counts in counts_of(settings)])

    uncured = replace(DEFAULT, balanced=False, nonnegative=False, positive_youden_only=False)
    assert informedness(uncured).min() < -0.5
    assert informedness(replace(DEFAULT, positive_youden_only=False)).min() < -0.1
    for counts in counts_of(DEFAULT):
        for posterior in (
            ConfusionPosterior.from_counts(counts),
            ConfusionPosterior.from_objects(counts),
        ):
            inverted = youden(posterior.counts) < 0
            rows, _ = posterior.select(range(len(counts[0])))
            np.testing.assert_allclose(rows[inverted, 0], rows[inverted, 1])  # say nothing


def test_anti_correlation_class_balance_takes_the_base_rate_out():
    # Without any feature the best unbalanced guess is the base rate of the others, which is lower
    # for positive objects: it votes against the held-out label.
    truth = np.array([True] * 4 + [False] * 6)
    problem = kernel_problem(np.ones((1, 10, 10)), truth[:, None], np.arange(10), 0.5)

    def gap(settings):
        said = each_group(problem, settings)[:, 0]
        return said[truth].mean() - said[~truth].mean()

    assert gap(replace(DEFAULT, balanced=False)) < -0.1
    assert abs(gap(DEFAULT)) < 1e-6


def test_threshold_rounding_does_not_leak():
    # Constant features: the stacker says 0 up to rounding, whose sign depends on the class sizes
    # that remain, and these on the label of the object left out. Assume the worst of it.
    rng = np.random.default_rng(0)
    truth = np.array([rng.permutation(21) < size for size in range(4, 18)]).T
    problem = kernel_problem(np.ones((1, 21, 21)), truth, np.arange(21), 0.5)
    said = each_group(problem, DEFAULT, np.full((14, 2), 0.7))
    assert np.abs(said).max() < THRESHOLD / 1000
    worst = np.where(truth, 1.0, -1.0) * max(np.abs(said).max(), 1e-16)

    def informedness(percepts):
        return percepts[truth].mean() - percepts[~truth].mean()

    assert informedness(worst > 0) == 1  # cut at 0, an empty percept is a perfect one
    for levels in (2, 4, 8):
        assert informedness(levels_of(round_log_odds(worst), BIN_EDGES, levels)) == 0
