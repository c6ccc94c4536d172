"""One's own data in frames, dictionaries and arrays: read as files are, and mistakes told."""

import numpy as np
import pandas as pd
import pytest

from meal_bayes.datasets import Dataset, load_dataset
from meal_bayes.domain import load_domain
from meal_bayes.errors import DataError


@pytest.fixture
def from_files(files):
    """Read `files` as the CSV folder's reader does, with a recording of stone left out."""
    path = files / "lift_haptics.csv"
    path.write_text(path.read_text().replace("stone,2,9\n", ""))
    return load_dataset(files / "own.toml", root=files)


def frames(files):
    features = {
        ("look", "color"): pd.read_csv(files / "look_color.csv"),
        ("lift", "haptics"): pd.read_csv(files / "lift_haptics.csv"),
    }
    return features, pd.read_csv(files / "labels.csv")


def same(dataset, expected):
    assert dataset.objects == expected.objects
    np.testing.assert_array_equal(dataset.labels, expected.labels)
    np.testing.assert_array_equal(dataset.recording_counts, expected.recording_counts)
    for context, values in expected.features.items():
        np.testing.assert_array_equal(dataset.features[context], values)


def test_frames_are_read_as_files_are(files, from_files):
    features, labels = frames(files)
    same(Dataset.from_frames(from_files.domain, features, labels), from_files)
    indexed = {c: frame.set_index(["object", "recording"]) for c, frame in features.items()}
    dataset = Dataset.from_frames(from_files.domain, indexed, labels.set_index("object"))
    same(dataset, from_files)


def test_dictionaries_and_arrays_are_read_as_files_are(from_files):
    by_object = {
        context: {
            name: values[o, : from_files.recording_counts[o, e]]
            for o, name in enumerate(from_files.objects)
        }
        for e, (context, values) in enumerate(from_files.features.items())
    }
    for nothing in (None, "", -1, np.nan, pd.NA):
        labels = {"cup": {"red": True, "heavy": False}, "stone": {"heavy": 1, "red": nothing}}
        same(Dataset.from_frames(from_files.domain, by_object, labels), from_files)
    dataset = Dataset.from_frames(
        from_files.domain, from_files.features, from_files.labels, objects=from_files.objects
    )
    same(dataset, from_files)


def spoil(name, features, labels):
    """Make one mistake in the frames of look, or in those of the labels."""
    look = features["look", "color"]
    looks = {
        "object": lambda: look.replace("stone", "stome"),
        "twice": lambda: pd.concat([look, look]),
        "text": lambda: look.astype(object).replace(0.5, "much"),
        "nan": lambda: look.replace(0.5, np.nan),
    }
    if name in looks:
        return {**features, ("look", "color"): looks[name]()}, labels
    if name == "context":
        return {**features, ("poke", "color"): look}, labels
    if name == "missing":
        return {("look", "color"): look}, labels
    wrong = {"label": labels.astype(object).replace(1, "yes")}
    return features, wrong.get(name, labels.rename(columns={"red": "rad"}))


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("context", "Unknown context"),
        ("missing", r"Features of \('lift', 'haptics'\) are missing"),
        ("object", "did you mean 'stone'"),
        ("twice", "recording 1 of cup again, after row 1"),
        ("text", "found objects; expected real numbers"),
        ("nan", "found NaN or infinity, recording 1"),
        ("label", "of 'cup': (heavy|red): .*'yes'"),
        ("column", "did you mean 'rad'"),
    ],
)
def test_mistakes_are_told(files, from_files, name, message):
    features, labels = spoil(name, *frames(files))
    with pytest.raises(DataError, match=message):
        Dataset.from_frames(from_files.domain, features, labels)


def test_labels_of_attributes_that_do_not_exist_are_told(files, from_files):
    domain = from_files.domain
    with pytest.raises(DataError, match=r"'cup': .*did you mean 'heavy'"):
        Dataset.from_frames(domain, frames(files)[0], {"cup": {"heavey": 1}, "stone": {}})


def test_labels_of_an_object_that_is_not_named_are_left_out_with_a_warning(from_files):
    labels = {"Cup": {"heavy": 1}, "stone": {"heavy": 0}}
    with pytest.warns(UserWarning, match=r"Labels of Cup are left out"):
        Dataset.from_frames(
            from_files.domain, from_files.features, labels, objects=from_files.objects
        )


@pytest.mark.parametrize(
    "rows",
    [[["4_0", "1"]], [[1j, 2]], np.ma.array([[1.0, 2.0]], mask=[[False, True]]), [[None, 1]]],
)
def test_what_is_no_real_number_is_no_feature(from_files, rows):
    """NumPy would read 40, drop the imaginary part, and drop the mask."""
    features = {**from_files.features, ("look", "color"): {"cup": rows, "stone": [[1, 2]]}}
    with pytest.raises(DataError, match="numbers"):
        Dataset.from_frames(
            from_files.domain, features, from_files.labels, objects=from_files.objects
        )


def test_recordings_of_one_behavior_are_joined_by_their_number(files):
    """Equal counts of other recordings were once joined by their order."""
    (files / "own.toml").write_text(
        (files / "own.toml").read_text().replace('["haptics"]', '["haptics", "audio"]')
    )
    features, labels = frames(files)
    haptics = features["lift", "haptics"]
    features["lift", "audio"] = haptics.assign(recording=haptics["recording"] + 1)
    with pytest.raises(DataError, match=r"audio.*recording '3'"):
        Dataset.from_frames(load_domain(files / "own.toml"), features, labels)
