"""Recordings that are written as CSV read back equal."""

from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.datasets import load_dataset, make_synthetic, save_csv_folder
from meal_bayes.domain import load_domain


@pytest.mark.parametrize("ragged", [False, True])
def test_a_data_set_reads_back_equal(tmp_path, ragged):
    rng = np.random.default_rng(3)
    dataset = make_synthetic(load_domain("toy"), objects=5, recordings=3, rng=rng)
    labels = dataset.labels.copy()
    labels[0, 0] = -1
    features = {context: values.copy() for context, values in dataset.features.items()}
    if ragged:
        behavior = dataset.domain.behavior_names[0]
        for context, values in features.items():
            if context[0] == behavior:
                values[1, 1:] = np.nan
                values[2] = np.nan
    dataset = replace(dataset, labels=labels, features=features)
    save_csv_folder(dataset, tmp_path)
    read = load_dataset("toy", root=tmp_path)
    assert read.objects == dataset.objects
    np.testing.assert_array_equal(read.labels, dataset.labels)
    for context, values in dataset.features.items():
        np.testing.assert_array_equal(read.features[context], values)
