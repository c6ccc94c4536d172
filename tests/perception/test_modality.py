from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from meal_bayes.datasets import TrainingSet
from meal_bayes.domain import Query
from meal_bayes.perception import DEFAULT, fit_and_validate, fit_spaces
from meal_bayes.perception.confusion import youden
from meal_bayes.perception.modality import fit_space, joint_kernel


def gram(space):
    return space.similarity(space.rows)


def features(seed=0, n=12, d=4):
    return np.random.default_rng(seed).normal(size=(n, d)) * [1.0, 1e3, 1e-3, 1.0][:d]


@given(st.integers(0, 99), st.sampled_from(["rbf", "polynomial"]))
def test_the_kernel_is_symmetric_and_positive(seed, kernel):
    kernels = gram(fit_space(features(seed), kernel))
    np.testing.assert_allclose(kernels, kernels.T, atol=1e-12)
    assert np.linalg.eigvalsh(kernels).min() > -1e-9


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


def test_training_recordings_keep_their_place():
    raw = features()
    space = fit_space(raw, "rbf")
    np.testing.assert_allclose(space.standardize(raw), space.rows, atol=1e-12)


def test_constant_features_are_dropped():
    raw = features()
    with_constant = np.insert(raw, 1, 7.0, axis=1)
    space = fit_space(with_constant, "rbf")
    assert space.varying.tolist() == [0, 2, 3, 4]
    np.testing.assert_allclose(gram(space), gram(fit_space(raw, "rbf")), atol=1e-12)


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
