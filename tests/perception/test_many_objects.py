"""Above the exact sizes: folds of objects are left out, recordings compared with landmarks."""

from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.datasets import TrainingSet
from meal_bayes.perception import DEFAULT, build_percept_table, fit_and_validate
from meal_bayes.perception.confusion import cohens_kappa
from meal_bayes.perception.leave_out import kernel_problem, landmark_problem, leave_out
from meal_bayes.perception.recordings import dealt

FOLDS = 4
ABOVE = {"exact_recordings": 30, "folds": FOLDS}


def test_neighbors_are_in_different_folds_in_no_fixed_order():
    folds = dealt(np.arange(60), 5).reshape(12, 5)
    assert (np.sort(folds) == np.arange(5)).all()
    assert len(set(map(tuple, folds))) > 6
    np.testing.assert_array_equal(dealt(np.array([3, 17, 44]), 5), folds.ravel()[[3, 17, 44]])


@pytest.mark.parametrize("nested", [True, False])
def test_with_all_recordings_as_landmarks_outputs_equal_the_exact_ones(nested):
    rng = np.random.default_rng(1)
    folds, objects = np.repeat(np.arange(5), 6), np.repeat(np.arange(15), 2)
    points, truth = rng.normal(size=(2, 30, 3)), rng.random((30, 2)) < 0.5
    grams = np.exp(-((points[:, :, None] - points[:, None]) ** 2).sum(axis=-1) / 4)
    exact = kernel_problem(grams, truth, folds, 0.2)
    exact = replace(exact, weights=np.ones(30))  # 2 an object, of two recordings each
    near = landmark_problem(grams, grams, truth, (folds, objects), 0.2)
    np.testing.assert_array_equal(near.weights, exact.weights)
    decided = [problem.duals @ grams for problem in (near, exact)]
    np.testing.assert_allclose(*decided, atol=1e-4)
    settings = replace(DEFAULT, nested=nested)
    for sets in ([[]], [[0], [3]], [[1, 4], [0, 2]]):
        found, expected = (
            leave_out(problem, np.array(sets, np.int64), settings) for problem in (near, exact)
        )
        for one, other in zip(found, expected, strict=True):
            np.testing.assert_allclose(one, other, atol=1e-4)


@pytest.mark.parametrize("landmarks", [9, 64])
def test_many_objects_are_told_apart_by_what_is_compared_with_landmarks(make, landmarks):
    dataset = make(6, objects=40, signal=8.0)
    settings = replace(DEFAULT, **ABOVE, landmarks=landmarks)
    training = TrainingSet.everything(dataset, range(30))
    perception, counts = fit_and_validate(dataset, training, settings=settings)
    assert cohens_kappa(counts.total())[:, :2].max(axis=1).min() > 0.5
    rows = next(iter(perception.classifiers["lift"].spaces.values())).rows
    assert len(rows) == min(landmarks, 60)


def test_fitting_counts_recordings_and_a_table_objects_too(make):
    dataset, settings = make(2, objects=8, recordings=4), replace(DEFAULT, folds=3)
    training = TrainingSet.everything(dataset)
    exact = fit_and_validate(dataset, training, settings=settings)[1].counts
    for few in ({"exact_recordings": 30}, {"exact_objects": 7}):
        some = replace(settings, **few)
        assert build_percept_table(dataset, perception=some).groups.max() == 2
        counts = fit_and_validate(dataset, training, settings=some)[1].counts
        assert np.array_equal(counts, exact) == ("exact_objects" in few)
