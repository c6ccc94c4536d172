"""Percept tables: no held-out label reaches its table; what is not recorded is never counted."""

from dataclasses import replace

import numpy as np
import pytest
from held_out import cohens_kappa, held_out_log_odds, permuted, yes_counts
from sklearn.naive_bayes import GaussianNB

from meal_bayes.datasets import (
    Dataset,
    TrainingSet,
    load_dataset,
    load_percepts,
    save_percepts,
)
from meal_bayes.datasets.percepts import BIN_EDGES, round_log_odds
from meal_bayes.perception import (
    DEFAULT,
    PAPER,
    build_percept_table,
    fit_and_validate,
    table_counts,
    with_classifier,
)
from meal_bayes.perception.feature_spaces import assign_folds, gather
from meal_bayes.perception.kernel_ridge import NOISE, each_group, kernel_problem, learned_widths

ALL = replace(DEFAULT, positive_youden_only=False)
FEW = [DEFAULT, replace(PAPER, folds=4), with_classifier(GaussianNB(), folds=4)]
SETTINGS = pytest.mark.parametrize("settings", FEW, ids=["default", "paper", "classifier"])
MANY = [replace(settings, exact_objects=6, folds=4) for settings in FEW]
ANY_SIZE = pytest.mark.parametrize(
    "settings",
    [*FEW, *MANY],
    ids=lambda s: f"{s.method} {'few' if s.exact_objects > 6 else 'many'}",
)


def bins_of(log_odds):
    """Histogram of (R,P) in the fine bins, (P,L)."""
    place = np.searchsorted(BIN_EDGES, round_log_odds(log_odds))
    return np.array([np.bincount(column, minlength=8) for column in place.T])


def test_held_out_outputs_are_the_nested_ones(make):
    dataset = make(1)
    table = build_percept_table(dataset, perception=ALL)
    expected = round_log_odds(held_out_log_odds(dataset, settings=ALL))
    np.testing.assert_array_equal(np.isnan(table.log_odds), np.isnan(expected))
    np.testing.assert_allclose(table.log_odds, expected, atol=1e-2)


def test_the_training_side_is_that_of_a_robot_without_the_object(make):
    dataset = make(2, objects=8)
    table = build_percept_table(dataset, perception=ALL)
    gathered = gather(dataset, TrainingSet.everything(dataset), ALL)
    _, widths = learned_widths(gathered.values(), ALL, range(8))
    assert len(set(widths)) > 1  # so that each table has its own
    objects = gathered[1].objects
    truth = gathered[1].labels == 1
    for held_out in range(8):
        rest = objects != held_out
        wide = gathered[1].widened(widths[held_out]).kernels(joint=True)[:, rest][:, :, rest]
        problem = kernel_problem(wide, truth[rest], objects[rest], NOISE)
        outputs = each_group(problem, ALL)
        for other in range(8):
            bins = table.training_bins[held_out, other, :, 1]
            if other == held_out:
                assert bins.sum() == 0
            else:
                expected = bins_of(outputs[objects[rest] == other])
                np.testing.assert_array_equal(bins, expected)


@pytest.mark.quick(2)
@ANY_SIZE
def test_labels_of_what_is_held_out_do_not_reach_its_table(make, relabel, settings):
    dataset = make(3, objects=14)
    before = build_percept_table(dataset, perception=settings)
    held = before.groups == before.groups[4]
    labels = np.where(held[:, None], 1 - dataset.labels, dataset.labels)
    after = build_percept_table(relabel(dataset, labels), perception=settings)
    np.testing.assert_allclose(before.log_odds[held], after.log_odds[held], atol=1e-2)
    changed = (before.training_bins != after.training_bins).any(axis=(1, 2, 3, 4))
    assert not changed[before.groups[4]]
    assert changed.any()


@pytest.mark.quick(3)
@ANY_SIZE
def test_every_recording_of_the_others_is_counted_once(make, settings):
    table = build_percept_table(make(4, objects=14), perception=settings)
    many = settings.exact_objects == 6
    np.testing.assert_array_equal(
        table.groups, assign_folds(np.arange(14), 4) if many else np.arange(14)
    )
    total = table.training_bins.sum(axis=-1)  # (G,O,P,E)
    assert (total[:, :, :, 2:] == 0).all()  # reinit and ask
    others = np.arange(len(total))[:, None] != table.groups
    assert (total[others][:, :, :2] == 2).all()
    assert (total[~others] == 0).all()
    assert np.isfinite(table.log_odds[:, :, :2]).all()


@pytest.mark.long
@SETTINGS
def test_objects_with_unknown_labels_are_perceived_but_teach_nothing(make, relabel, settings):
    dataset = make(5)
    labels = dataset.labels.copy()
    labels[3, 0] = -1
    table = build_percept_table(relabel(dataset, labels), perception=settings)
    assert np.isfinite(table.log_odds[3, :, :2]).all()
    known = np.delete(np.arange(10), 3)
    assert (table.training_bins[3, known, 0, :2].sum(axis=-1) == 2).all()
    assert (table.training_bins[known, 3, 0].sum(axis=-1) == 0).all()
    # The other attribute, whose labels are all known, is as it was, but for the width they share.
    settings = replace(settings, width=1.0 if settings.method == "stacked" else None)
    table = build_percept_table(relabel(dataset, labels), perception=settings)
    whole = build_percept_table(dataset, perception=settings)
    np.testing.assert_array_equal(table.training_bins[:, :, 1], whole.training_bins[:, :, 1])


def test_provenance_tells_how_the_table_was_made(make):
    first, again = (build_percept_table(make(7)).provenance for _ in range(2))
    other = build_percept_table(make(8), perception="paper").provenance
    assert first == again
    assert set(first) == {"package", "perception", "source", "recordings_sha256", "command"}
    assert first["recordings_sha256"] != other["recordings_sha256"]
    assert first["command"] == "meal-bayes data percepts --dataset toy"
    assert other["command"].endswith("--perception paper")


@pytest.mark.long
@pytest.mark.real_data
@pytest.mark.parametrize("name", ["roc36", "ispy32"])
def test_shipped_tables_can_be_made_again(recordings, name):
    dataset = load_dataset(name, root=recordings)
    shipped = load_percepts(name)
    made = build_percept_table(dataset)
    assert shipped.objects == dataset.objects
    np.testing.assert_array_equal(shipped.labels, dataset.labels)
    log_odds = made.log_odds.astype(float)
    expected = shipped.log_odds.astype(float)
    np.testing.assert_allclose(log_odds, expected, atol=1e-2)
    differ = made.training_bins != shipped.training_bins
    assert differ.mean() < 1e-4  # an output on the very edge of a bin may fall over
    assert made.provenance["recordings_sha256"] == shipped.provenance["recordings_sha256"]
    assert made.provenance["source"] == shipped.provenance["source"]


@pytest.mark.long
@pytest.mark.real_data
@pytest.mark.statistical
@pytest.mark.parametrize("name", ["roc36", "ispy32", "cy101"])
def test_permuted_labels_cannot_be_told_from_real_recordings(recordings, name):
    dataset = load_dataset(name, root=recordings)
    sensing = dataset.domain.recorded
    true = (dataset.labels == 1).sum(axis=0)
    asked = np.minimum(true, len(dataset.objects) - true) > dataset.domain.asked_minimum
    kappa = []
    for seed in range(1 if name == "cy101" else 2):
        shuffled = permuted(dataset, np.random.default_rng(seed))
        counts = yes_counts(held_out_log_odds(shuffled), shuffled.labels)
        kappa.append(cohens_kappa(counts.sum(axis=0))[np.ix_(asked, sensing)].mean())
    assert abs(np.mean(kappa)) < 0.03


@pytest.fixture
def ragged(make) -> Dataset:
    """Take recordings out: object 2 lacks look, object 5 has one of three of lift."""
    whole = make(4, objects=10, recordings=3, signal=5.0)
    features = {context: values.copy() for context, values in whole.features.items()}
    for modality in "abc":
        features["look", modality][2] = np.nan
        features["lift", modality][5, 1:] = np.nan
    return Dataset(whole.domain, whole.objects, features, whole.labels)


def test_counts_tell_what_is_there(ragged):
    expected = np.zeros((10, 4), int)
    expected[:, :2] = 3
    expected[2, 0] = 0
    expected[5, 1] = 1
    np.testing.assert_array_equal(ragged.recording_counts, expected)
    assert len(TrainingSet.everything(ragged)) == expected.sum()
    assert "0 to 3 recordings" in repr(ragged)


@pytest.mark.quick(1)
@SETTINGS
def test_tables_hold_what_is_there(ragged, settings, tmp_path):
    table = build_percept_table(ragged, perception=settings)
    there = np.arange(3)[:, None] < ragged.recording_counts[:, None, :]  # (O,R,E)
    np.testing.assert_array_equal(~np.isnan(table.log_odds).any(axis=-1), there)
    others = ~np.eye(10, dtype=bool)
    shown = table.training_bins.sum(axis=-1)  # (O,O,P,E)
    expected = np.broadcast_to(ragged.recording_counts[None, :, None], shown.shape)
    np.testing.assert_array_equal(shown[others], expected[others])
    assert table_counts(table, 0)[2, :, 0].sum() == 0
    folds = build_percept_table(ragged, perception=replace(DEFAULT, exact_objects=6, folds=4))
    for written in (table, folds):
        save_percepts(written, tmp_path / "ragged.npz")
        read = load_percepts(tmp_path / "ragged.npz")
        for name in ("recording_counts", "log_odds", "groups", "training_bins"):
            np.testing.assert_array_equal(getattr(read, name), getattr(written, name))


@pytest.mark.quick(1)
@SETTINGS
def test_every_recording_that_is_there_counts_once(ragged, settings):
    counts = fit_and_validate(ragged, TrainingSet.everything(ragged), settings=settings)[1]
    shown = counts.sum(axis=(3, 4))  # (O,P,E)
    np.testing.assert_array_equal(shown, ragged.recording_counts[:, None].repeat(2, axis=1))
    finite = ~np.isnan(held_out_log_odds(ragged, settings=settings)).any(axis=-1)
    np.testing.assert_array_equal(finite.sum(axis=1), ragged.recording_counts)
