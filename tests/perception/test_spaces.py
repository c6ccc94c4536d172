"""Feature spaces that many refits share, fitted without labels."""

from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.datasets import TrainingSet
from meal_bayes.domain import Query
from meal_bayes.perception import DEFAULT, fit_and_validate, fit_spaces
from meal_bayes.perception.confusion import youden


def test_spaces_stay_those_of_the_start(make):
    dataset = make(4, objects=12)
    start = TrainingSet.everything(dataset, range(4))
    spaces = fit_spaces(dataset, start)
    features = {key: values.copy() for key, values in dataset.features.items()}
    for values in features.values():
        values[5:] *= 7
    altered = fit_spaces(replace(dataset, features=features), start)
    for context, space in spaces.items():
        known = space.rows[: 5 * dataset.recordings]
        np.testing.assert_array_equal(known, altered[context].rows[: 5 * dataset.recordings])
        np.testing.assert_array_equal(space.width, altered[context].width)


def test_labels_play_no_part_in_the_spaces(make, relabel):
    dataset = make(4)
    changed = relabel(dataset, 1 - dataset.labels)
    spaces = [fit_spaces(d, TrainingSet.everything(d), whiten=True) for d in (dataset, changed)]
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
        next(iter(fit_spaces(noisy, everything, whiten=on).values())).rows.std(axis=0)
        for on in (False, True)
    )
    np.testing.assert_allclose(plain, 1.0, atol=0.01)
    assert white[0] > 0.9
    assert white[1] < 0.6  # sqrt(.3 / 1.3) is .48


def test_a_behavior_never_recorded_says_nothing(make):
    dataset = make(1)
    everything = TrainingSet.everything(dataset)
    looks = everything.behavior == 0
    names = "object", "behavior", "recording", "labels"
    only = TrainingSet(*(getattr(everything, name)[looks] for name in names))
    for training in (only, everything):  # its space was never fitted
        spaces = fit_spaces(dataset, only)
        perception, counts = fit_and_validate(dataset, training, spaces=spaces)
        said = perception.log_odds(dataset.instance(3, "lift", 0), Query(("red", "heavy")))
        assert said.tolist() == [0, 0]
        assert counts.counts[:, :, 1].sum() == 0


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
            differences.append(youden(counts.total())[:, :2].mean())  # of look and lift
        claims[by_object] = np.mean(differences)
    assert claims[False] > 0.8
    assert claims[True] < 0.2
