"""One's own data in files, frames and arrays: read as written, and every mistake told."""

import csv
import os
import re
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from meal_bayes.datasets import (
    Dataset,
    load_dataset,
    load_percepts,
    make_synthetic,
    save_csv_folder,
    save_percepts,
)
from meal_bayes.datasets.csv_files import load_csv_folder, read_features, read_rows
from meal_bayes.domain import load_domain
from meal_bayes.errors import DataError, SettingsError
from meal_bayes.perception import build_percept_table


def test_rows_are_joined_by_key(files):
    dataset = load_dataset(files / "own.toml", root=files)
    assert dataset.objects == ("cup", "stone")
    assert dataset.domain.attributes == ("red", "heavy")
    np.testing.assert_array_equal(dataset.labels, [[1, 0], [-1, 1]])
    np.testing.assert_array_equal(dataset.features["lift", "haptics"], [[[1], [2]], [[8], [9]]])
    np.testing.assert_array_equal(
        dataset.features["look", "color"], np.float32([[[0.5, 1], [0.25, 2]], [[3, 4], [-1e-3, 5]]])
    )
    assert dataset.features["look", "color"].dtype == np.float32
    assert dataset.recordings == 2


def test_spreadsheet_habits_are_understood(files):
    text = (files / "look_color.csv").read_text().replace("cup", '"cup"').replace("\n", "\r\n\r\n")
    (files / "look_color.csv").write_bytes(b"\xef\xbb\xbf" + text.encode())
    assert load_dataset(files / "own.toml", root=files).objects == ("cup", "stone")


def test_a_table_holds_no_recordings():
    with pytest.raises(SettingsError, match="which holds no recordings"):
        load_dataset("own.npz")


def test_own_data_needs_a_folder(files):
    with pytest.raises(SettingsError, match="give root="):
        load_dataset(files / "own.toml")
    with pytest.raises(SettingsError, match="make_synthetic"):
        load_dataset("toy")


BROKEN_FEATURES = [
    ("cup,2,0.25,2", "cup,2,0.25", 3, "3 columns (too short)", "4"),
    ("cup,2,0.25,2", "cup,2,0.25,2,", 3, "5 columns (too long)", "4"),
    ("stone,1,3,4", "stone,1,three,4", 4, "'three' in column 3", "a number"),
    ("stone,1,3,4", 'stone,1,"3,5",4', 4, "'3,5' in column 3", "a number"),
    ("stone,1,3,4", "stone,1,,4", 4, "'' in column 3", "a number"),
    ("stone,1,3,4", "stone,1,3,nan", 4, "nan in column 4", "a finite number"),
    ("stone,1,3,4", "stone,1,1e39,4", 4, "1e+39 in column 3", "a finite number"),
    ("stone,1,3,4", "cup,2,3,4", 4, "recording 2 of cup again, after line 3", "once"),
    ("stone,1,3,4", "stone,1,\u0663,4", 4, "'\u0663' in column 3", "a number"),
    ("stone,1", "stome,1", 4, "object 'stome'", "did you mean 'stone'?"),
    ("object,recording,r,g", "object;recording;r;g", 1, "header", "not semicolons"),
    ("object,recording,r,g\n", "", 1, "the header 'cup,1,0.5,1'", "object,recording"),
    ("stone,1,3,4", "stone,1,3,\udcb54", 4, "the byte 0xb5", "UTF-8"),
]


@pytest.mark.parametrize(("old", "new", "line", "content", "expected"), BROKEN_FEATURES)
def test_broken_feature_file(files, change, old, new, line, content, expected):
    change(files / "look_color.csv", old, new)
    with pytest.raises(DataError) as caught:
        load_dataset(files / "own.toml", root=files)
    message = str(caught.value)
    assert f"look_color.csv, line {line}" in message
    assert content in message
    assert expected in message.split(content, 1)[1]
    assert "\n" not in message
    assert len(message.split("; ")) >= 3  # found; expected; how to mend


def test_recordings_may_be_ragged(files, change):
    change(files / "look_color.csv", "cup,1,0.5,1\n", "")  # one recording of cup is left
    change(files / "lift_haptics.csv", "stone,2,9\n", "")
    change(files / "lift_haptics.csv", "stone,1,8\n", "")  # stone lacks the behavior
    dataset = load_dataset(files / "own.toml", root=files)
    assert dataset.recording_counts.tolist() == [[1, 2], [2, 0]]
    assert dataset.instance(0, "look", 0).features["color"].tolist() == [0.25, 2.0]
    with pytest.raises(DataError, match="'stone' has no recording 0 of 'lift'; it has 0"):
        dataset.instance(1, "lift", 0)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("cup,2,2", "cup,3,2", "line 5: found recording '3' of cup; expected one of 1, 2"),
        ("cup,2,2\n", "", "line 4 (its last): found no row of recording 2 of cup; expected 2"),
    ],
)
def test_files_of_one_behavior_hold_the_same_recordings(files, change, old, new, expected):
    (files / "lift_audio.csv").write_text((files / "lift_haptics.csv").read_text())
    change(files / "own.toml", 'modalities=["haptics"]', 'modalities=["haptics", "audio"]')
    assert load_dataset(files / "own.toml", root=files).recordings == 2
    change(files / "lift_audio.csv", old, new)
    with pytest.raises(DataError, match=re.escape(f"lift_audio.csv, {expected}")):
        load_dataset(files / "own.toml", root=files)


@pytest.mark.parametrize("name", ["labels.csv", "look_color.csv"])
def test_files_without_rows(files, name):
    header = (files / name).read_text().split("\n")[0]
    for content, expected in (
        ("\n \n", ", line 1: found an empty file; expected rows"),
        (header, ", line 1: found no rows under the header"),
        (None, r": cannot be read \(No such file .*; expected it"),
    ):
        (files / name).unlink() if content is None else (files / name).write_text(content)
        with pytest.raises(DataError, match=f"{name}{expected}"):
            load_dataset(files / "own.toml", root=files)


@pytest.mark.parametrize("name", ["labels.csv", "look_color.csv", "lift_haptics.csv"])
@pytest.mark.parametrize("wrong", ["Look-color.csv", "label.csv", "lift_haptic.csv"])
def test_a_misnamed_file_is_named(files, name, wrong):
    (files / name).rename(files / wrong)
    with pytest.raises(DataError, match=f"{name}: there is no such file, and {wrong} is of no"):
        load_dataset(files / "own.toml", root=files)


BROKEN_LABELS = [
    ("cup,0,1", "cup,yes,1", "line 2: found 'yes' in column 2 (heavy); expected 1, 0"),
    ("cup,0,1", "cup,0", "line 2: found 2 columns; expected 3 as in the header"),
    ("stone,1,", "cup,1,", "line 3: found object 'cup' again; expected each object once"),
    ("object,heavy,red", "thing,heavy,red", "line 1: found the header 'thing'"),
    ("object,heavy,red", "object,heavy,rad", "line 1: found 0 columns 'red'"),
    ("object,heavy,red", "object,red,red", "line 1: found 2 columns 'red'; expected one"),
]


@pytest.mark.parametrize(("old", "new", "expected"), BROKEN_LABELS)
def test_broken_labels(files, change, old, new, expected):
    change(files / "labels.csv", old, new)
    with pytest.raises(DataError, match=re.escape(expected)) as caught:
        load_dataset(files / "own.toml", root=files)
    assert "\n" not in str(caught.value)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.sampled_from(["labels.csv", "look_color.csv"]),
    st.integers(0, 80),
    st.integers(0, 4),
    st.one_of(st.binary(max_size=6), st.sampled_from([b'"', b"\n", b",", b"1e999", b"1", b"cup"])),
)
def test_damage_is_told_in_one_line_or_read_as_it_stands(files, name, place, length, damage):
    """Text has no checksum: what the format allows is a value, and that very value is read."""
    whole = (files / name).read_bytes()
    damaged = whole[:place] + damage + whole[place + length :]
    (files / name).write_bytes(damaged)
    message = ""
    try:
        dataset = load_dataset(files / "own.toml", root=files)
    except DataError as error:
        message = str(error)
    finally:
        (files / name).write_bytes(whole)
    if message:
        assert "\n" not in message
        return
    head, *rows = [row for row in csv.reader(damaged.decode().splitlines()) if any(row)]
    for row in rows:
        at = dataset.objects.index(row[0].strip())
        if name == "labels.csv":
            read = dataset.labels[at, [dataset.domain.columns([word])[0] for word in head[1:]]]
            assert read.tolist() == [int(cell) if cell.strip() else -1 for cell in row[1:]]
        else:
            read = dataset.features["look", "color"][at]
            assert np.float32(row[2:]).tolist() in read.tolist()


def test_a_hole_in_a_file_is_told(files):
    os.truncate(files / "labels.csv", 1000)
    with pytest.raises(DataError, match="a zero byte"):
        load_dataset(files / "own.toml", root=files)


def test_huge_quoted_cell(files, change):
    change(files / "look_color.csv", "stone,1,3,4", f'stone,1,3,"{"4" * 200_000}"')
    with pytest.raises(DataError, match="line 4: found a row of 1 columns") as caught:
        load_dataset(files / "own.toml", root=files)
    assert len(str(caught.value)) < 500


def test_numbers_in_every_usual_form_are_read(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text('object,recording,a,b,c,d\nmug,1, -.5 ,1e-3,+2.,"7"\n')
    rows = read_features(path, ("object", "recording"), header=True)
    assert rows.values.tolist() == [[-0.5, 1e-3, 2.0, 7.0]]


def test_a_quote_in_the_middle_joins_no_cells(tmp_path):
    (tmp_path / "a.csv").write_text('"a"b,1\n"a,b",1\n')
    cells = [cells for _, cells in read_rows(tmp_path / "a.csv")]
    assert cells == [['"a"b,1'], ["a,b", "1"]]


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
        ("missing", r"No features of \('lift', 'haptics'\)"),
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
