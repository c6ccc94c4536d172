"""Feature spaces, and how wide their kernels are: never learned from the held-out object."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.datasets import TrainingSet, load_dataset
from meal_bayes.domain import Query
from meal_bayes.perception import DEFAULT, PAPER, fit_and_validate, fit_spaces
from meal_bayes.perception.confusion import youden
from meal_bayes.perception.feature_spaces import (
    BehaviorRecordings,
    FeatureSpace,
    fit_space,
    gather,
    joint_kernel,
)
from meal_bayes.perception.kernel_ridge import WIDTHS, _losses_of_widths, learned_widths


def gram(space):
    return space.similarity(space.rows)


def features(seed=0, n=12, d=4):
    return np.random.default_rng(seed).normal(size=(n, d)) * [1.0, 1e3, 1e-3, 1.0][:d]


def test_rbf_is_as_wide_as_the_median_distance():
    space = fit_space(features(), "rbf")
    distance = np.linalg.norm(space.rows[:, None] - space.rows[None], axis=-1)
    assert space.width == pytest.approx(np.median(distance[np.triu_indices(12, 1)]))
    np.testing.assert_allclose(gram(space), np.exp(-((distance / space.width) ** 2)), atol=1e-12)


def test_polynomial_is_of_degree_two():
    space = fit_space(features(), "polynomial")
    expected = (1 + space.rows @ space.rows.T / 4) ** 2
    np.testing.assert_allclose(gram(space), expected, atol=1e-12)


def test_standardized_features_are_comparable_and_bounded():
    raw = features(n=400)
    raw[0, 1] = -(2.0**31)  # an overflow in a published file
    rows = fit_space(raw, "rbf").rows
    assert np.abs(rows).max() <= 5
    np.testing.assert_allclose(rows.std(axis=0), 1, atol=0.1)


def test_constant_features_are_dropped():
    raw = features()
    with_constant = np.insert(raw, 1, 7.0, axis=1)
    space = fit_space(with_constant, "rbf")
    assert space.varying.tolist() == [0, 2, 3, 4]
    np.testing.assert_allclose(gram(space), gram(fit_space(raw, "rbf")), atol=1e-12)


@pytest.mark.parametrize(("offset", "told"), [(1e5, ""), (1e8, "few steps"), (1e12, "None of the")])
def test_an_offset_that_hides_what_varies_is_told(make, offset, told):
    """Features are single precision: of 1e8 and 1e8 + 1 both are 1e8."""
    dataset = make(3)
    moved = {context: values + np.float32(offset) for context, values in dataset.features.items()}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        spaces = fit_spaces(replace(dataset, features=moved), TrainingSet.everything(dataset))
    assert spaces
    assert told in "".join(str(warning.message) for warning in caught)
    assert bool(caught) is bool(told)


def test_units_do_not_matter_to_what_is_kept():
    tiny = fit_space(1e-12 * features(), "rbf")
    assert len(tiny.varying) == 4
    small = fit_space(1e-6 * features(), "rbf")
    np.testing.assert_allclose(gram(tiny), gram(small), atol=1e-3)


@pytest.mark.parametrize("kernel", ["rbf", "polynomial"])
@pytest.mark.parametrize("raw", [np.zeros((5, 3)), np.ones((1, 2)), np.full((2, 1), -4.0)])
def test_modalities_that_never_vary_are_harmless(raw, kernel):
    kernels = gram(fit_space(raw, kernel))
    np.testing.assert_array_equal(kernels, np.ones_like(kernels))


def test_mostly_equal_recordings_have_a_width():
    raw = np.zeros((20, 1))
    raw[3] = 1.0
    space = fit_space(raw, "rbf")
    assert 0 < space.width < np.inf
    assert np.isfinite(gram(space)).all()


def test_the_joint_kernel_is_that_of_the_features_side_by_side():
    spaces = [fit_space(features(seed, d=d), "rbf") for seed, d in ((1, 2), (2, 4), (3, 3))]
    kernels = np.stack([gram(space) for space in spaces])
    together = np.concatenate([space.rows / space.width for space in spaces], axis=1)
    squares = ((together[:, None] - together[None]) ** 2).sum(axis=-1)
    np.testing.assert_allclose(joint_kernel(kernels), np.exp(-squares / 3), atol=1e-12)


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
    dataset = make(2, objects=30, recordings=4)
    rng = np.random.default_rng(3)
    signal = rng.normal(size=(30, 1, 1)) + 0.05 * rng.normal(size=(30, 4, 1))
    features = {
        key: np.concatenate([signal, rng.normal(size=(30, 4, 1))], axis=2).astype(np.float32)
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
        assert counts[:, :, 1].sum() == 0


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
            differences.append(youden(counts.sum(axis=0))[:, :2].mean())  # of look and lift
        claims[by_object] = np.mean(differences)
    assert claims[False] > 0.8
    assert claims[True] < 0.2


def recordings_in(dataset):
    return list(gather(dataset, TrainingSet.everything(dataset), DEFAULT).values())


def on_a_line(truth_of, objects=40):
    """One behavior that places objects on a line; kernels of width 1 are half a unit wide."""
    place = np.random.default_rng(0).uniform(0, 8, objects)
    space = FeatureSpace(np.zeros(1), np.zeros(1), np.ones(1), place[:, None], "rbf", 0.5)
    return BehaviorRecordings(
        np.arange(objects), truth_of(place)[:, None].astype(np.int8), (space,), ("it",)
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
        all_losses = losses(recordings, np.arange(9))
        assert len(set(all_losses)) > 8  # the object without a label is no loss
        for held in range(9):
            rest = recordings.objects != held
            others = BehaviorRecordings(
                recordings.objects[rest],
                recordings.labels[rest],
                tuple(space.at(rest) for space in recordings.spaces),
                recordings.questions,
            )
            (expected,) = losses(others, np.empty(0, np.int64))
            assert all_losses[1 + held] == pytest.approx(expected, rel=1e-6)
        flipped = np.where(recordings.labels < 0, -1, 1 - recordings.labels)
        rows = recordings.objects == 4
        changed = replace(recordings, labels=np.where(rows[:, None], flipped, recordings.labels))
        again = losses(changed, np.arange(9))
        assert again[5] == pytest.approx(all_losses[5], rel=1e-6)
        assert again[0] != pytest.approx(all_losses[0], rel=1e-3)


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


@pytest.mark.long
@pytest.mark.real_data
@pytest.mark.parametrize(
    ("name", "expected"),
    [("roc36", 1.0), ("ispy32", 1.5), ("cy101", 1.0)],
)
def test_no_single_object_decides_how_wide(recordings, name, expected):
    dataset = load_dataset(name, root=recordings)
    held = range(0, len(dataset.objects), 7)
    factor, without = learned_widths(recordings_in(dataset), DEFAULT, held)
    assert {factor, *without} == {expected}
