"""Above the exact sizes: folds of objects are left out, recordings compared with landmarks."""

from dataclasses import replace

import numpy as np
import pytest
from sklearn.naive_bayes import GaussianNB

from meal_bayes.datasets import TrainingSet, load_percepts, save_percepts
from meal_bayes.errors import SettingsError
from meal_bayes.perception import (
    DEFAULT,
    PAPER,
    build_percept_table,
    fit_and_validate,
    table_counts,
    with_classifier,
)
from meal_bayes.perception.confusion import cohens_kappa
from meal_bayes.perception.leave_out import kernel_problem, landmark_problem, leave_out
from meal_bayes.perception.recordings import dealt

FOLDS = 4
ABOVE = {"exact_objects": 6, "folds": FOLDS}
SETTINGS = pytest.mark.parametrize(
    "settings",
    [replace(DEFAULT, **ABOVE), replace(PAPER, **ABOVE), with_classifier(GaussianNB(), **ABOVE)],
    ids=["default", "paper", "classifier"],
)


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


@SETTINGS
def test_a_fold_leaves_no_trace_in_what_is_learned_without_it(make, relabel, settings):
    dataset, fold = make(3, objects=14), dealt(np.arange(14), FOLDS)
    labels = dataset.labels.copy()
    labels[fold == 2] = 1 - labels[fold == 2]
    before, after = (
        build_percept_table(data, perception=settings)
        for data in (dataset, relabel(dataset, labels))
    )
    np.testing.assert_array_equal(before.groups, fold)
    assert before.training_bins.shape[:2] == (FOLDS, 14)
    np.testing.assert_allclose(before.log_odds[fold == 2], after.log_odds[fold == 2], atol=1e-2)
    np.testing.assert_array_equal(before.training_bins[2], after.training_bins[2])
    assert not np.array_equal(before.training_bins[1], after.training_bins[1])
    counts = table_counts(before, int(np.flatnonzero(fold == 2)[0])).counts.sum(axis=(3, 4))
    assert (counts[fold == 2] == 0).all()
    assert (counts[fold != 2][:, :, :2] == 2).all()


@SETTINGS
def test_a_table_of_some_objects_is_a_part_of_the_whole(make, settings):
    dataset = make(6, objects=14)
    whole = build_percept_table(dataset, perception=settings)
    some = [dataset.objects[o] for o in (2, 7)]
    part = build_percept_table(dataset, perception=settings, objects=some)
    np.testing.assert_array_equal(part.log_odds[[2, 7]], whole.log_odds[[2, 7]])
    assert np.isnan(part.log_odds[0]).all()
    groups = whole.groups[[2, 7]]
    np.testing.assert_array_equal(part.training_bins[groups], whole.training_bins[groups])


def test_a_table_of_folds_is_read_as_it_was_written(make, tmp_path):
    table = build_percept_table(make(1, objects=14), perception=replace(DEFAULT, **ABOVE))
    save_percepts(table, tmp_path / "many.npz")
    found = load_percepts(tmp_path / "many.npz")
    for name in ("groups", "training_bins", "log_odds"):
        np.testing.assert_array_equal(getattr(found, name), getattr(table, name))


@pytest.mark.parametrize("landmarks", [9, 64])
def test_many_objects_are_told_apart_by_what_is_compared_with_landmarks(make, landmarks):
    dataset = make(6, objects=40, signal=8.0)
    settings = replace(DEFAULT, **ABOVE, landmarks=landmarks)
    training = TrainingSet.everything(dataset, range(30))
    perception, counts = fit_and_validate(dataset, training, settings=settings)
    assert cohens_kappa(counts.total())[:, :2].max(axis=1).min() > 0.5
    rows = next(iter(perception.classifiers["lift"].spaces.values())).rows
    assert len(rows) == min(landmarks, 60)


def test_many_recordings_of_few_objects_are_many_too(make):
    settings = replace(DEFAULT, exact_recordings=30, folds=3)
    table = build_percept_table(make(2, objects=8, recordings=4), perception=settings)
    assert table.groups.max() == 2


@pytest.mark.parametrize("wrong", [{"folds": 1}, {"landmarks": 0}, {"exact_objects": -1}])
def test_sizes_that_mean_nothing_are_refused(wrong):
    (name,) = wrong
    with pytest.raises(SettingsError, match=f"{name} is"):
        replace(DEFAULT, **wrong)
