"""Objects that lack recordings: what is there counts, and what is not is never heard of."""

from dataclasses import replace

import numpy as np
import pytest
from held_out import held_out_log_odds
from sklearn.naive_bayes import GaussianNB

from meal_bayes.datasets import Dataset, TrainingSet, load_percepts, save_percepts
from meal_bayes.perception import (
    DEFAULT,
    PAPER,
    build_percept_table,
    fit_and_validate,
    table_counts,
    with_classifier,
)

SETTINGS = pytest.mark.parametrize(
    "settings", [DEFAULT, PAPER, with_classifier(GaussianNB())], ids=["default", "paper", "own"]
)


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
    expected[2, 0], expected[5, 1] = 0, 1
    np.testing.assert_array_equal(ragged.recording_counts, expected)
    assert len(TrainingSet.everything(ragged)) == expected.sum()
    assert "0 to 3 recordings" in repr(ragged)


@SETTINGS
def test_tables_hold_what_is_there(ragged, settings, tmp_path):
    table = build_percept_table(ragged, perception=settings)
    there = np.arange(3)[:, None] < ragged.recording_counts[:, None, :]  # (O,R,E)
    np.testing.assert_array_equal(~np.isnan(table.log_odds).any(axis=-1), there)
    others = ~np.eye(10, dtype=bool)
    shown = table.training_bins.sum(axis=-1)  # (O,O,P,E)
    expected = np.broadcast_to(ragged.recording_counts[None, :, None], shown.shape)
    np.testing.assert_array_equal(shown[others], expected[others])
    assert table_counts(table, 0).counts[2, :, 0].sum() == 0
    folds = build_percept_table(ragged, perception=replace(DEFAULT, exact_objects=6, folds=4))
    for written in (table, folds):
        save_percepts(written, tmp_path / "ragged.npz")
        read = load_percepts(tmp_path / "ragged.npz")
        for name in ("recording_counts", "log_odds", "groups", "training_bins"):
            np.testing.assert_array_equal(getattr(read, name), getattr(written, name))


@SETTINGS
def test_every_recording_that_is_there_counts_once(ragged, settings):
    counts = fit_and_validate(ragged, TrainingSet.everything(ragged), settings=settings)[1]
    shown = counts.counts.sum(axis=(3, 4))  # (O,P,E)
    np.testing.assert_array_equal(shown, ragged.recording_counts[:, None].repeat(2, axis=1))
    finite = ~np.isnan(held_out_log_odds(ragged, settings=settings)).any(axis=-1)
    np.testing.assert_array_equal(finite.sum(axis=1), ragged.recording_counts)
