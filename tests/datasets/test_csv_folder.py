"""One's own data in files: read as written, and every mistake told."""

import csv
import os
import re
import unicodedata
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from meal_bayes.datasets import (
    csv_files,
    load_dataset,
    make_synthetic,
    save_csv_folder,
)
from meal_bayes.datasets.csv_files import read_features, read_rows
from meal_bayes.domain import load_domain
from meal_bayes.errors import DataError, MealBayesError, OutputError, SettingsError


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


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_lines_end_as_on_any_system(files, end):
    for path in files.glob("*.csv"):
        path.write_bytes(path.read_bytes().replace(b"\n", end.encode()))
    dataset = load_dataset(files / "own.toml", root=files)
    assert dataset.objects == ("cup", "stone")
    assert dataset.recordings == 2


@pytest.mark.parametrize("name", ["labels.csv", "look_color.csv"])
@pytest.mark.parametrize(("sign", "word"), [(";", "semicolons"), ("\t", "tabs"), ("|", "bars")])
def test_other_separators_are_named(files, name, sign, word):
    path = files / name
    path.write_text(path.read_text().replace(",", sign))
    with pytest.raises(DataError, match=f"{name}, line 1: .*by commas, not {word}"):
        load_dataset(files / "own.toml", root=files)


@pytest.mark.parametrize("code", ["utf-16", "utf-16-le", "utf-16-be"])
@pytest.mark.parametrize("name", ["labels.csv", "look_color.csv", "own.toml"])
def test_text_of_two_bytes_a_sign_is_told(files, name, code):
    path = files / name
    path.write_bytes(path.read_text().encode(code))
    with pytest.raises(MealBayesError, match=f"{name}.*(UTF-16 text; save it as UTF-8|zero byte)"):
        load_dataset(files / "own.toml", root=files)


def test_names_that_differ_in_the_code_of_their_accents_are_told(files):
    for name, accents in (
        ("labels.csv", "NFC"),
        ("look_color.csv", "NFD"),
        ("lift_haptics.csv", "NFC"),
    ):
        path = files / name
        text = path.read_text().replace("cup", "caf\u00e9")
        path.write_text(unicodedata.normalize(accents, text), encoding="utf-8")
    with pytest.raises(DataError, match="only in what cannot be seen"):
        load_dataset(files / "own.toml", root=files)


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
    ("stone,1,3,4", "stone,1,3,inf", 4, "inf in column 4", "remove this recording from the behav"),
    ("stone,1,3,4", "stone,1,1e39,4", 4, "1e+39 in column 3", "a finite number"),
    ("stone,1,3,4", "cup,2,3,4", 4, "recording 2 of cup again, after line 3", "once"),
    ("stone,1,3,4", "stone,1,\u0663,4", 4, "'\u0663' in column 3", "a number"),
    ("stone,1", "stome,1", 4, "object 'stome'", "did you mean 'stone'?"),
    ("stone,1,3,4", "stone,-1,3,4", 4, "'-1' as a recording", "0 or more"),
    ("stone,1,3,4", "stone,1.5,3,4", 4, "'1.5' as a recording", "0 or more"),
    ("stone,1,3,4", "stone,nan,3,4", 4, "'nan' as a recording", "0 or more"),
    ("stone,1,3,4", "stone,,3,4", 4, "'' as a recording", "0 or more"),
    ("object,recording,r,g", "object,recording,r,r", 1, "two columns 'r'", "rename one"),
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


def test_labels_are_read_as_pandas_writes_them(files):
    """Of columns of truth values, and of numbers where some are unknown."""
    path = files / "labels.csv"
    expected = load_dataset(files / "own.toml", root=files).labels
    text = path.read_text()
    for one, zero in (("True", "False"), ("TRUE", "FALSE"), ("1.0", "0.0")):
        path.write_text(text.replace(",1", f",{one}").replace(",0", f",{zero}"))
        np.testing.assert_array_equal(load_dataset(files / "own.toml", root=files).labels, expected)
    path.write_text(text.replace(",1", ",yes"))
    with pytest.raises(DataError, match=r"'yes' in column .*expected 1, 0, true, false"):
        load_dataset(files / "own.toml", root=files)


def test_a_file_of_no_behavior_is_named(files, caplog):
    (files / "shake_smell.csv").write_text("object,recording,x\n")
    load_dataset(files / "own.toml", root=files)
    (told,) = [record for record in caplog.records if record.levelname == "WARNING"]
    assert "not read, as own has no such behavior and modality: shake_smell.csv" in (
        told.getMessage()
    )


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
    with pytest.raises(DataError, match=f"{name}: the file is missing, and {wrong} belongs to no"):
        load_dataset(files / "own.toml", root=files)


BROKEN_LABELS = [
    ("cup,0,1", "cup,yes,1", "line 2: found 'yes' in column 2 (heavy); expected 1, 0"),
    ("cup,0,1", "cup,0", "line 2: found 2 columns; expected 3 as in the header"),
    ("stone,1,", "cup,1,", "line 3: found object 'cup' again; expected each object once"),
    ("object,heavy,red", "thing,heavy,red", "line 1: found the header 'thing'"),
    ("object,heavy,red", "object,heavy,rad", "line 1: found 0 columns 'red'"),
    ("object,heavy,red", "object,red,red", "line 1: found 2 columns 'red'; expected one"),
    ("object,heavy,red", "object,heavy,red,note", "line 1: found a column 'note'; expected"),
    ("cup,0,1", ",,", "line 2: found an object's name that is empty"),
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


def synthetic(seed):
    rng = np.random.default_rng(seed)
    return make_synthetic(load_domain("toy"), objects=4 + seed, recordings=2, rng=rng)


@pytest.mark.parametrize("number", range(3))
def test_recordings_are_not_replaced_without_a_word(number, tmp_path):
    """They cannot be computed again: one file of them is enough."""
    save_csv_folder(synthetic(1), tmp_path)
    kept = sorted(tmp_path.iterdir())[number]
    for path in tmp_path.iterdir():
        if path != kept:
            path.unlink()
    content = kept.read_bytes()
    with pytest.raises(OutputError, match=rf"{kept.name} exists already.*overwrite=True"):
        save_csv_folder(synthetic(0), tmp_path)
    assert list(tmp_path.iterdir()) == [kept]
    assert kept.read_bytes() == content
    save_csv_folder(synthetic(0), tmp_path, overwrite=True)
    assert load_dataset("toy", root=tmp_path) == synthetic(0)


@pytest.mark.parametrize("writes", range(3))
def test_a_folder_that_was_replaced_in_part_is_not_complete(writes, tmp_path, monkeypatch):
    save_csv_folder(synthetic(1), tmp_path)
    write = csv_files.write_whole
    calls = iter(range(3))

    def killed(*args, **options):
        if next(calls) == writes:
            raise KeyboardInterrupt
        write(*args, **options)

    monkeypatch.setattr(csv_files, "write_whole", killed)
    with pytest.raises(KeyboardInterrupt):
        save_csv_folder(synthetic(0), tmp_path, overwrite=True)
    with pytest.raises(DataError, match=r"labels\.csv"):
        load_dataset("toy", root=tmp_path)
