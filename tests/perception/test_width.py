"""How wide kernels are is learned from labels, but never from those of the held-out object."""

from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.datasets import TrainingSet, load_dataset
from meal_bayes.perception import DEFAULT, PAPER, fit_and_validate
from meal_bayes.perception.modality import FeatureSpace
from meal_bayes.perception.recordings import BehaviorRecordings, gather
from meal_bayes.perception.width import WIDTHS, _losses_of_widths, learned_widths


def recordings_in(dataset):
    return list(gather(dataset, TrainingSet.everything(dataset), DEFAULT).values())


def on_a_line(truth_of, objects=40):
    """One behavior that places objects on a line; kernels of width 1 are half a unit wide."""
    place = np.random.default_rng(0).uniform(0, 8, objects)
    space = FeatureSpace(np.zeros(1), np.zeros(1), np.ones(1), place[:, None], "rbf", 0.5)
    return BehaviorRecordings(
        np.arange(objects), truth_of(place)[:, None].astype(np.int8), (space,)
    )


def losses(recordings, held):
    return _losses_of_widths((0, recordings), held, DEFAULT)[1][0]  # of the narrowest


def stripes():
    return on_a_line(lambda x: np.floor(2 * x) % 2)


def noisy_halves():
    return on_a_line(lambda x: (x > 4) ^ (np.random.default_rng(2).random(len(x)) < 0.2))


def test_stripes_want_narrow_kernels_and_noise_wide_ones():
    assert learned_widths([stripes()], DEFAULT)[0] == min(WIDTHS)
    assert learned_widths([noisy_halves()], DEFAULT)[0] == max(WIDTHS)


def test_all_behaviors_have_a_vote():
    assert learned_widths([stripes(), noisy_halves()], DEFAULT)[0] == min(WIDTHS)
    assert learned_widths([stripes(), *[noisy_halves()] * 20], DEFAULT)[0] == max(WIDTHS)


@pytest.mark.parametrize("hidden", [(), ((2, 0), (5, 0), (5, 1))])
def test_losses_without_an_object_are_those_of_a_robot_that_never_met_it(make, relabel, hidden):
    dataset = make(2, objects=9)
    labels = dataset.labels.copy()
    for place in hidden:
        labels[place] = -1
    for recordings in recordings_in(relabel(dataset, labels)):
        found = losses(recordings, np.arange(9))
        assert len(set(found)) > 8  # the object without a label is no loss
        for held in range(9):
            rest = recordings.objects != held
            others = BehaviorRecordings(
                recordings.objects[rest],
                recordings.labels[rest],
                tuple(space.at(rest) for space in recordings.spaces),
            )
            (expected,) = losses(others, np.empty(0, np.int64))
            assert found[1 + held] == pytest.approx(expected, rel=1e-6)
        flipped = np.where(recordings.labels < 0, -1, 1 - recordings.labels)
        own = recordings.objects == 4
        changed = replace(recordings, labels=np.where(own[:, None], flipped, recordings.labels))
        again = losses(changed, np.arange(9))
        assert again[5] == pytest.approx(found[5], rel=1e-6)
        assert again[0] != pytest.approx(found[0], rel=1e-3)


def test_what_the_settings_say_is_taken(make):
    dataset = make(3)
    fixed = replace(DEFAULT, width=1.25)
    factor, without = learned_widths(recordings_in(dataset), fixed, [1, 2])
    assert (factor, without.tolist()) == (1.25, [1.25, 1.25])
    assert learned_widths(recordings_in(dataset), PAPER)[0] == 1.0  # its kernels have no width
    unit, wide = (
        fit_and_validate(
            dataset, TrainingSet.everything(dataset), settings=replace(DEFAULT, width=width)
        )[0]
        for width in (1.0, 1.25)
    )
    for modality, space in unit.classifiers["look"].spaces.items():
        assert wide.classifiers["look"].spaces[modality].width == pytest.approx(1.25 * space.width)


@pytest.mark.real_data
@pytest.mark.parametrize(("name", "expected"), [("roc36", 1.0), ("ispy32", 1.5), ("cy101", 1.0)])
def test_no_single_object_decides_how_wide(recordings, name, expected):
    dataset = load_dataset(name, root=recordings)
    held = range(0, len(dataset.objects), 7)
    factor, without = learned_widths(recordings_in(dataset), DEFAULT, held)
    assert {factor, *without} == {expected}
