from dataclasses import replace

import numpy as np
import pytest
from held_out import cohens_kappa, held_out_log_odds
from sklearn.naive_bayes import GaussianNB

from meal_bayes.datasets import Dataset, Instance, TrainingSet
from meal_bayes.domain import Query
from meal_bayes.errors import DataError, SettingsError
from meal_bayes.perception import (
    DEFAULT,
    PAPER,
    PerceptionSettings,
    fit_and_validate,
    with_classifier,
)
from meal_bayes.perception.confusion import youden

BOTH = Query(("red", "heavy"))
RNG = np.random.default_rng(0)
SETTINGS = pytest.mark.parametrize("settings", [DEFAULT, PAPER], ids=["default", "paper"])


def some_rows(dataset, rng, share):
    """Make a training set of some instances, some of their labels unknown."""
    everything = TrainingSet.everything(dataset)
    rows = np.flatnonzero(rng.random(len(everything)) < share)
    labels = np.where(rng.random((len(rows), 2)) < 0.3, -1, everything.labels[rows])
    return TrainingSet(
        everything.object[rows], everything.behavior[rows], everything.recording[rows], labels
    )


@pytest.mark.quick(6)
@SETTINGS
@pytest.mark.parametrize("share", [0.0, 0.1, 0.4, 1.0])
@pytest.mark.parametrize("levels", [2, 4])
def test_each_labelled_instance_is_one_count(make, settings, share, levels):
    dataset = make(1)
    training_set = some_rows(dataset, np.random.default_rng(4), share)
    counts = fit_and_validate(dataset, training_set, settings=replace(settings, levels=levels))[1]
    assert counts.shape == (10, 2, 4, 2, levels)
    expected = np.zeros((10, 2, 4, 2), int)
    for o, e, row in zip(
        training_set.object, training_set.behavior, training_set.labels, strict=True
    ):
        for p in np.flatnonzero(row >= 0):
            expected[o, p, e, row[p]] += 1
    np.testing.assert_array_equal(counts.sum(axis=-1), expected)


@SETTINGS
def test_separable_attributes_are_perceived_in_unseen_objects(make, settings):
    dataset = make(2, objects=16, signal=14.0, object_effect=0.2)
    perception, counts = fit_and_validate(
        dataset, TrainingSet.everything(dataset, range(12)), settings=settings
    )
    assert cohens_kappa(counts.sum(axis=0))[:, :2].max(axis=1).min() > 0.9
    said = np.array(
        [
            [perception.observe(dataset.instance(o, b, 0), BOTH, RNG) for b in ("look", "lift")]
            for o in range(12, 16)
        ]
    )
    right = said == dataset.labels[12:, None]
    assert right.mean(axis=0).max(axis=0).min() == 1  # by the better behavior


def test_an_unseen_object_s_held_out_output_is_what_a_robot_without_it_says(make):
    # Leave-one-object-out by closed form against a perception fitted on the others; spaces are
    # shared there, so this one takes a data set whose spaces hardly depend on one object.
    dataset = make(5, objects=40, recordings=3, signal=4.0)
    settings = replace(DEFAULT, positive_youden_only=False)
    nested = held_out_log_odds(dataset, settings=settings)
    for o in (0, 17):
        perception = fit_and_validate(
            dataset, TrainingSet.everything(dataset, {*range(40)} - {o}), settings=settings
        )[0]
        for e, behavior in enumerate(("look", "lift")):
            log_odds = perception.log_odds(dataset.instance(o, behavior, 2), BOTH)
            np.testing.assert_allclose(log_odds, nested[o, 2, e], atol=0.05)


def test_one_class_and_empty_training_sets_say_nothing(make, relabel):
    dataset = make(6)
    one_class = relabel(dataset, np.ones_like(dataset.labels))
    for data, training_set in (
        (one_class, TrainingSet.everything(one_class)),
        (dataset, TrainingSet.everything(dataset, [])),
        (dataset, TrainingSet.everything(dataset, [0])),
    ):
        for settings in (DEFAULT, PAPER):
            perception, counts = fit_and_validate(data, training_set, settings=settings)
            assert counts[..., 1].sum() == 0  # always the level around even odds
            instance = data.instance(3, "look", 0)
            assert perception.log_odds(instance, BOTH).tolist() == [0, 0]


def test_percepts_without_positive_youden_are_counted_as_they_are_and_then_at_even_odds(make):
    """How far below chance such pairs fall tells how far others rise above it by chance."""
    below = []
    for seed in range(4):
        dataset = make(seed, signal=0.0)
        perception, counts = fit_and_validate(dataset, TrainingSet.everything(dataset))
        free = replace(DEFAULT, positive_youden_only=False)
        _, unsilenced = fit_and_validate(dataset, TrainingSet.everything(dataset), settings=free)
        np.testing.assert_array_equal(counts, unsilenced)
        below.append((youden(counts.sum(axis=0))[:, :2] < 0).any())
        for e, behavior in enumerate(("look", "lift")):
            silent = ~perception.classifiers[behavior].used
            np.testing.assert_array_equal(silent, youden(counts.sum(axis=0))[:, e] <= 0)
            for o in range(10):
                log_odds = perception.log_odds(dataset.instance(o, behavior, 0), BOTH)
                assert (log_odds[silent] == 0).all()
    assert any(below)


def test_a_person_is_asked_through_perception_too(make):
    dataset = make(7)
    perception = fit_and_validate(dataset, TrainingSet.everything(dataset))[0]
    instance = Instance(0, "ask", 0)
    said = [
        perception.observe(instance, BOTH, np.random.default_rng(seed)).tolist()
        for seed in range(60)
    ]
    assert (np.mean(np.array(said) == dataset.labels[0], axis=0) > 0.5).all()


@pytest.mark.quick(2)
@pytest.mark.parametrize("method", [DEFAULT, PAPER, with_classifier(GaussianNB())])
def test_percepts_are_made_from_the_modalities_that_are_there(make, method):
    dataset = make(8, objects=30, signal=8.0)
    perception, _ = fit_and_validate(dataset, TrainingSet.everything(dataset), settings=method)

    def log_odds(o, **features):
        return perception.log_odds(Instance(o, "lift", 0, features), BOTH)

    correct = []
    for o, labels in enumerate(dataset.labels):
        complete = dict(dataset.instance(o, "lift", 0).features)
        whole = log_odds(o, **complete)
        broken = np.full(5, np.nan)
        np.testing.assert_array_equal(log_odds(o, **complete, smell=np.ones(2)), whole)
        part = log_odds(o, a=complete["a"], b=complete["b"])
        np.testing.assert_array_equal(log_odds(o, **{**complete, "c": broken}), part)
        correct.append((part > 0) == (labels == 1))
        with pytest.raises(DataError, match="has no finite features"):
            log_odds(o, c=broken)
    assert np.mean(correct) > 0.55


def test_a_sensor_that_never_varies_is_warned_of(make):
    dataset = make(8)
    silent = {**dataset.features, ("lift", "b"): np.full((10, 2, 5), 3.0)}
    dataset = Dataset(dataset.domain, dataset.objects, silent, dataset.labels)
    with pytest.warns(UserWarning, match=r"None of the features of \('lift', 'b'\) varies"):
        fit_and_validate(dataset, TrainingSet.everything(dataset))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"method": "papr"}, "did you mean 'paper'"),
        ({"folds": 1}, "folds is 1; give at least 2"),
        ({"exact_objects": -1}, "exact_objects is -1"),
        ({"width": 0.0}, "width is 0"),
        ({"width": 1.0, "method": "paper"}, "width is 1.0; give .* None with other methods"),
        ({"levels": 3}, r"3 levels; expected one of \[2, 4, 8\]"),
    ],
)
def test_settings_out_of_range_are_refused(change, message):
    with pytest.raises(SettingsError, match=message):
        PerceptionSettings(**change)
