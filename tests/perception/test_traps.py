"""Three ways to fool oneself with cross-validation; each test fails when its cure is taken out."""

from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.datasets.percepts import BIN_EDGES, THRESHOLD, levels_of, round_log_odds
from meal_bayes.perception import DEFAULT, build_percept_table, table_counts
from meal_bayes.perception.confusion import youden
from meal_bayes.perception.leave_out import each_group, kernel_problem, leave_out

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
    def informedness(settings):
        """TPR - FPR on the training side for every held-out object, attribute and behavior."""
        found = []
        for seed in range(3):
            dataset = make(seed, objects=12, signal=0.0)  # features say nothing of the labels
            table = build_percept_table(dataset, perception=settings)
            found += [youden(table_counts(table, o).total())[:, :2] for o in range(12)]
        return np.array(found)

    uncured = replace(DEFAULT, balanced=False, nonnegative=False, positive_youden_only=False)
    assert informedness(uncured).min() < -0.5
    assert informedness(replace(DEFAULT, positive_youden_only=False)).min() < -0.1
    assert informedness(DEFAULT).min() >= 0


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
