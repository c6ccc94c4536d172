"""One's own data: read as written, and every mistake told in one line."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from meal_bayes.datasets import load_dataset, make_synthetic, save_csv_folder
from meal_bayes.datasets.csv_files import read_features, read_rows
from meal_bayes.domain import load_domain
from meal_bayes.errors import DataError, SettingsError


def test_rows_are_joined_by_key(own):
    dataset = load_dataset(own / "own.toml", root=own)
    assert dataset.objects == ("cup", "stone")
    assert dataset.domain.attributes == ("red", "heavy")
    np.testing.assert_array_equal(dataset.labels, [[1, 0], [-1, 1]])
    np.testing.assert_array_equal(dataset.features["lift", "haptics"], [[[1], [2]], [[8], [9]]])
    np.testing.assert_array_equal(
        dataset.features["look", "color"], np.float32([[[0.5, 1], [0.25, 2]], [[3, 4], [-1e-3, 5]]])
    )
    assert dataset.features["look", "color"].dtype == np.float32
    assert dataset.recordings == 2


def test_spreadsheet_habits_are_understood(own):
    text = (own / "look_color.csv").read_text().replace("cup", '"cup"').replace("\n", "\r\n\r\n")
    (own / "look_color.csv").write_bytes(b"\xef\xbb\xbf" + text.encode())
    assert load_dataset(own / "own.toml", root=own).objects == ("cup", "stone")


def test_a_table_holds_no_recordings():
    with pytest.raises(SettingsError, match="which holds no recordings"):
        load_dataset("own.npz")


def test_own_data_needs_a_folder(own):
    with pytest.raises(SettingsError, match="give root="):
        load_dataset(own / "own.toml")
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


@pytest.mark.parametrize(("old", "new", "line", "found", "expected"), BROKEN_FEATURES)
def test_broken_feature_file(own, change, old, new, line, found, expected):
    change(own / "look_color.csv", old, new)
    with pytest.raises(DataError) as caught:
        load_dataset(own / "own.toml", root=own)
    message = str(caught.value)
    assert f"look_color.csv, line {line}" in message
    assert found in message
    assert expected in message.split(found, 1)[1]
    assert "\n" not in message
    assert len(message.split("; ")) >= 3  # found; expected; how to mend


def test_recordings_may_be_ragged(own, change):
    change(own / "look_color.csv", "cup,1,0.5,1\n", "")  # one recording of cup is left
    change(own / "lift_haptics.csv", "stone,2,9\n", "")
    change(own / "lift_haptics.csv", "stone,1,8\n", "")  # stone lacks the behavior
    dataset = load_dataset(own / "own.toml", root=own)
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
def test_files_of_one_behavior_hold_the_same_recordings(own, change, old, new, expected):
    (own / "lift_audio.csv").write_text((own / "lift_haptics.csv").read_text())
    change(own / "own.toml", 'modalities=["haptics"]', 'modalities=["haptics", "audio"]')
    assert load_dataset(own / "own.toml", root=own).recordings == 2
    change(own / "lift_audio.csv", old, new)
    with pytest.raises(DataError, match=re.escape(f"lift_audio.csv, {expected}")):
        load_dataset(own / "own.toml", root=own)


@pytest.mark.parametrize("name", ["labels.csv", "look_color.csv"])
def test_files_without_rows(own, name):
    header = (own / name).read_text().split("\n")[0]
    for content, expected in (
        ("\n \n", ", line 1: found an empty file; expected rows"),
        (header, ", line 1: found no rows under the header"),
        (None, r": cannot be read \(No such file .*; expected it"),
    ):
        (own / name).unlink() if content is None else (own / name).write_text(content)
        with pytest.raises(DataError, match=f"{name}{expected}"):
            load_dataset(own / "own.toml", root=own)


BROKEN_LABELS = [
    ("cup,0,1", "cup,yes,1", "line 2: found 'yes' in column 2 (heavy); expected 1, 0"),
    ("cup,0,1", "cup,0", "line 2: found 2 columns; expected 3 as in the header"),
    ("stone,1,", "cup,1,", "line 3: found object 'cup' again; expected each object once"),
    ("object,heavy,red", "thing,heavy,red", "line 1: found the header 'thing'"),
    ("object,heavy,red", "object,heavy,rad", "line 1: found 0 columns 'red'"),
    ("object,heavy,red", "object,red,red", "line 1: found 2 columns 'red'; expected one"),
]


@pytest.mark.parametrize(("old", "new", "expected"), BROKEN_LABELS)
def test_broken_labels(own, change, old, new, expected):
    change(own / "labels.csv", old, new)
    with pytest.raises(DataError, match=re.escape(expected)) as caught:
        load_dataset(own / "own.toml", root=own)
    assert "\n" not in str(caught.value)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.sampled_from(["labels.csv", "look_color.csv"]),
    st.integers(0, 80),
    st.integers(0, 4),
    st.one_of(st.binary(max_size=6), st.sampled_from([b'"', b"\n", b",", b"1e999", b"1", b"cup"])),
)
def test_any_damage_is_told_or_harmless(own, name, place, length, damage):
    whole = (own / name).read_bytes()
    (own / name).write_bytes(whole[:place] + damage + whole[place + length :])
    message = ""
    try:
        load_dataset(own / "own.toml", root=own)
    except DataError as error:
        message = str(error)
    finally:
        (own / name).write_bytes(whole)
    assert "\n" not in message


def test_huge_quoted_cell(own, change):
    change(own / "look_color.csv", "stone,1,3,4", f'stone,1,3,"{"4" * 200_000}"')
    with pytest.raises(DataError, match="line 4: found a row of 1 columns") as caught:
        load_dataset(own / "own.toml", root=own)
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
