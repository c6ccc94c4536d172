"""Kernels laid out once say what a fit from the features says."""

from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.datasets import Instance, TrainingSet
from meal_bayes.datasets.percepts import BIN_EDGES, levels_of
from meal_bayes.domain import Query
from meal_bayes.perception import (
    DEFAULT,
    PAPER,
    Kernels,
    fit_and_score,
    fit_and_validate,
    scored_percepts,
)

BOTH = Query(("red", "heavy"))
SENSING = (0, 1)  # look and lift
SETTINGS = pytest.mark.parametrize("settings", [DEFAULT, PAPER], ids=["default", "paper"])


def partly_labelled(training_set, rng):
    hidden = rng.random(training_set.labels.shape) < 0.2
    return TrainingSet(
        training_set.object, training_set.behavior, training_set.recording,
        np.where(hidden, -1, training_set.labels),
    )  # fmt: skip


@SETTINGS
@pytest.mark.parametrize(("levels", "signal"), [(2, 6.0), (4, 6.0), (2, 0.0)])
def test_counts_and_log_odds_equal_a_fit_from_features(make, settings, levels, signal):
    settings = replace(settings, levels=levels)
    dataset, rng = make(6, objects=12, signal=signal), np.random.default_rng(0)
    training_set = partly_labelled(TrainingSet.everything(dataset, range(8)), rng)
    perception, expected = fit_and_validate(dataset, training_set, settings=settings)
    kernels = Kernels.of(dataset, training_set, kernel=settings.kernel)
    objects = np.array([2, 9, 11])
    log_odds, counts = fit_and_score(kernels, training_set, objects, settings=settings)
    np.testing.assert_array_equal(counts.counts, expected.counts)
    percepts = scored_percepts(dataset.domain, dataset.labels, log_odds, levels)
    for o in objects.tolist():
        for behavior in ("look", "lift"):
            for r in range(dataset.recordings):
                instance = dataset.instance(o, behavior, r)
                e = dataset.domain.behavior_index(behavior)
                own = perception.log_odds(instance, BOTH)
                np.testing.assert_allclose(log_odds[o, r, e], own, atol=0.005)  # of float16
                seen = percepts.observe(Instance(o, behavior, r), BOTH, rng)
                levels_seen = levels_of(log_odds[o, r, e], BIN_EDGES, levels)
                assert seen.tolist() == levels_seen.tolist()
    said = log_odds[objects][:, :, :2] != 0
    assert said.all() if signal else not said.all()  # others are at even odds
    rest = np.setdiff1d(np.arange(12), objects)
    assert np.isnan(log_odds[rest]).all()
    assert np.isnan(log_odds[:, :, 2:]).all()  # neither senses


def test_spaces_stay_those_of_the_start(make):
    dataset = make(4, objects=12)
    start = TrainingSet.everything(dataset, range(4))
    kernels = Kernels.of(dataset, start)
    features = {key: values.copy() for key, values in dataset.features.items()}
    for values in features.values():
        values[5:] *= 7
    altered = Kernels.of(replace(dataset, features=features), start)
    known = np.arange(5 * dataset.recordings)
    pairs = zip(kernels.spaces_of("look", known), altered.spaces_of("look", known), strict=True)
    for space, other in pairs:
        np.testing.assert_array_equal(space.gram(), other.gram())


def test_labels_play_no_part_in_the_spaces(make, relabel):
    dataset = make(4)
    changed = relabel(dataset, 1 - dataset.labels)
    spaces = [
        Kernels.of(d, TrainingSet.everything(d), whiten=True).spaces for d in (dataset, changed)
    ]
    for key in spaces[0]:
        np.testing.assert_array_equal(spaces[0][key].rows, spaces[1][key].rows)


def test_whitening_shrinks_what_differs_between_repeats(make):
    """A feature that is noise on every recording counts for less than one that objects keep."""
    dataset, rng = make(2, objects=30, recordings=4), np.random.default_rng(3)
    kept = rng.normal(size=(30, 1, 1)) + 0.05 * rng.normal(size=(30, 4, 1))
    features = {
        key: np.concatenate([kept, rng.normal(size=(30, 4, 1))], axis=2).astype(np.float32)
        for key in dataset.features
    }
    noisy = replace(dataset, features=features)
    everything = TrainingSet.everything(noisy)
    plain, white = (
        next(iter(Kernels.of(noisy, everything, whiten=on).spaces.values())).rows.std(axis=0)
        for on in (False, True)
    )
    np.testing.assert_allclose(plain, 1.0, atol=0.01)
    assert white[0] > 0.9
    assert white[1] < 0.6  # sqrt(.3 / 1.3) is .48


def test_a_behavior_never_recorded_says_nothing(make):
    dataset = make(1)
    everything = TrainingSet.everything(dataset)
    looks = everything.behavior == 0
    only = TrainingSet(
        everything.object[looks], everything.behavior[looks], everything.recording[looks],
        everything.labels[looks],
    )  # fmt: skip
    log_odds, counts = fit_and_score(Kernels.of(dataset, only), only, np.arange(10))
    assert (log_odds[:, :, 1] == 0).all()
    assert counts.counts[:, :, 1].sum() == 0
    later = fit_and_score(Kernels.of(dataset, only), everything, np.arange(10))
    assert (later[0][:, :, 1] == 0).all()  # its space was never laid out


@pytest.mark.statistical
def test_leaving_samples_out_claims_what_leaving_objects_out_does_not(make):
    """Objects that differ for other reasons than the attribute: samples know their object."""
    claims = {}
    for by_object in (True, False):
        differences = []
        for seed in range(5):
            dataset = make(seed, objects=20, recordings=4, signal=0.0, object_effect=3.0)
            counts = fit_and_validate(
                dataset, TrainingSet.everything(dataset),
                settings=replace(DEFAULT, by_object=by_object),
            )[1]  # fmt: skip
            rates = counts.rates()[:, SENSING]
            differences.append((rates[..., 1] - rates[..., 0]).mean())
        claims[by_object] = np.mean(differences)
    assert claims[False] > 0.8
    assert claims[True] < 0.2
