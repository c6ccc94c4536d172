"""Names in files of one's own: each comes back as it was, or is refused."""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from meal_bayes import Dataset
from meal_bayes.datasets import load_percepts, make_synthetic, save_csv_folder, save_percepts
from meal_bayes.datasets.csv_files import load_csv_folder
from meal_bayes.domain import load_domain
from meal_bayes.errors import DataError
from meal_bayes.perception import build_percept_table

NAMES = st.text("aB_./", min_size=1, max_size=3)


@given(st.sets(st.tuples(NAMES, NAMES), min_size=1, max_size=4), st.integers(0, 99))
def test_every_context_has_a_file_of_its_own_or_is_refused(contexts, seed):
    by_behavior = {}
    for behavior, modality in contexts:
        by_behavior.setdefault(behavior, []).append(modality)
    table = {
        "name": "lab",
        "attributes": ["full"],
        "behaviors": [
            {"name": name, "cost": 1.0, "modalities": modalities}
            for name, modalities in by_behavior.items()
        ],
        "diagram": {
            "states": ["t"],
            "start": "t",
            "effects": [{"from": "t", "do": name, "to": "t"} for name in by_behavior],
        },
    }
    rng = np.random.default_rng(seed)
    dataset = make_synthetic(load_domain(table), objects=2, recordings=2, rng=rng)
    with TemporaryDirectory() as folder:
        place = Path(folder, "lab")
        try:
            save_csv_folder(dataset, place)
        except DataError:
            assert not place.exists()
            return
        back = load_csv_folder(dataset.domain, place)
        for context, values in dataset.features.items():
            np.testing.assert_array_equal(back.features[context], values)


TEXTS = st.text(st.characters(exclude_categories=[]), max_size=5) | st.just("tasse_\udce9")


@given(st.sets(TEXTS, min_size=1, max_size=3))
def test_names_of_objects_come_back_from_files_or_are_refused(names):
    domain = load_domain("toy")
    rng = np.random.default_rng(0)
    dataset = make_synthetic(domain, objects=len(names), recordings=1, rng=rng)
    try:
        dataset = replace(dataset, objects=tuple(names))
    except DataError:
        return
    with TemporaryDirectory() as folder:
        save_csv_folder(dataset, Path(folder))
        assert load_csv_folder(domain, Path(folder)).objects == tuple(names)
        table = build_percept_table(dataset)
        save_percepts(table, Path(folder, "t.npz"))
        assert load_percepts(Path(folder, "t.npz")).objects == tuple(names)


@pytest.mark.parametrize("index", [None, "object"])
def test_an_attribute_may_be_called_object(index, tmp_path):
    domain = load_domain("ispy32")
    assert "object" in domain.attributes
    dataset = make_synthetic(domain, objects=3, recordings=1, rng=np.random.default_rng(0))
    save_csv_folder(dataset, tmp_path)
    assert load_csv_folder(domain, tmp_path) == dataset
    names = pd.Index(dataset.objects, name=index)
    labels = pd.DataFrame(dataset.labels, names, domain.attributes)
    again = Dataset.from_frames(domain, dataset.features, labels)
    assert np.array_equal(again.labels, dataset.labels)


def test_answers_of_another_person_are_not_lost_without_a_word(tmp_path):
    dataset = make_synthetic(
        load_domain("toy"), objects=3, recordings=1, rng=np.random.default_rng(0)
    )
    with pytest.warns(UserWarning, match="no answers of another person"):
        save_csv_folder(replace(dataset, answers=dataset.labels), tmp_path)
    assert load_csv_folder(dataset.domain, tmp_path) == dataset
