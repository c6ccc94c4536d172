"""Names of objects and numbers of recordings in frames and dictionaries: one text each, or said."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from meal_bayes import Dataset, load_domain
from meal_bayes.errors import DataError

DOMAIN = load_domain(
    {
        "name": "k",
        "attributes": ["red"],
        "behaviors": [{"name": "look", "cost": 1.0, "modalities": ["c"]}],
        "diagram": {
            "states": ["t"],
            "start": "t",
            "effects": [{"from": "t", "do": "look", "to": "t"}],
        },
    }
)
MISSING = [np.nan, None, pd.NA, pd.NaT, float("inf"), 1.5, True, b"a", ()]


def data_of(frame, labels):
    return Dataset.from_frames(DOMAIN, {("look", "c"): frame}, labels)


def frame_of(objects, recordings):
    values = np.arange(len(objects), dtype=float)
    keys = {"object": pd.Series(objects, dtype=object)}
    keys["recording"] = pd.Series(recordings, dtype=object)
    return pd.DataFrame({**keys, "r": values})


@given(st.sampled_from(MISSING), st.integers(0, 3), st.sampled_from(["object", "recording"]))
def test_a_key_that_is_none_is_named_by_its_row(missing, row, column):
    keys = {"object": ["a", "a", "b", "b"], "recording": [1, 2, 1, 2]}
    keys[column][row] = missing
    frame = frame_of(keys["object"], keys["recording"])
    with pytest.raises(DataError, match=f"row {row + 1}: found .* as an? {column}"):
        data_of(frame, {"a": {"red": True}, "b": {"red": False}})


@given(
    st.one_of(st.integers(max_value=-1), st.floats(max_value=-0.5, allow_infinity=False)),
    st.integers(0, 3),
    st.sampled_from([str, lambda number: number]),
)
def test_no_recording_has_a_number_below_nothing(number, row, typed):
    numbers = [1, 2, 1, 2]
    numbers[row] = typed(number)
    with pytest.raises(DataError, match=rf"row {row + 1}: found .* as a recording; .*; number it"):
        data_of(frame_of(["a", "a", "b", "b"], numbers), {"a": {"red": True}, "b": {"red": False}})


@pytest.mark.parametrize("first", [0, 1, 7, "0", "1.0", "morning"])
def test_recordings_count_from_where_they_begin_or_have_names(first):
    data = data_of(frame_of(["a", "b"], [first] * 2), {"a": {"red": True}, "b": {"red": False}})
    assert data.recording_counts.tolist() == [[1], [1]]


@given(st.sampled_from(MISSING))
def test_labels_of_nobody_are_refused(missing):
    frame = frame_of(["a", "b"], [1, 1])
    with pytest.raises(DataError, match="as an object"):
        data_of(frame, {"a": {"red": True}, missing: {"red": False}})


@given(st.lists(st.integers(1, 99), min_size=2, max_size=5, unique=True), st.data())
def test_numbers_name_the_same_however_they_are_typed(names, data):
    """A gap makes integers of a column floats; Arrow, categories and nullable ones are others."""
    kinds = ("int64", "float64", "Int64", "object", "category", "string")
    typed = pd.Series(names).astype(data.draw(st.sampled_from(kinds)))
    number = pd.Series([1] * len(names)).astype(data.draw(st.sampled_from(kinds)))
    frame = pd.DataFrame({"object": typed, "recording": number, "r": np.arange(len(names))})
    labels = {name: {"red": name % 2 == 0} for name in names}
    dataset = data_of(frame, labels)
    assert dataset.objects == tuple(map(str, names))
    assert dataset.features["look", "c"][:, 0, 0].tolist() == list(range(len(names)))


def test_keys_that_are_one_name_are_refused():
    with pytest.raises(DataError, match="object '1' again"):
        data_of({1: [[1.0]], "1": [[2.0]]}, {"1": {"red": True}})
    with pytest.raises(DataError, match="object '1' again"):
        data_of({"1": [[2.0]]}, {1: {"red": True}, "1": {"red": False}})


def test_keys_stand_in_columns_or_in_the_index():
    flat = frame_of(["a", "a", "b"], [1, 2, 1])
    labels = {"a": {"red": True}, "b": {"red": False}}
    forms = [
        flat,
        flat.set_index("object"),
        flat.set_index(["object", "recording"]),
        flat.set_index(["object", "recording"], drop=False),
        flat.drop(columns="recording"),
        flat.drop(columns="recording").set_index("object", drop=False),
    ]
    arrays = [data_of(form, labels).features["look", "c"] for form in forms]
    for array in arrays[1:]:
        np.testing.assert_array_equal(array, arrays[0])


def test_two_columns_of_one_name_are_refused():
    frame = frame_of(["a", "b"], [1, 1])
    frame = pd.concat([frame, frame[["r"]]], axis=1)
    with pytest.raises(DataError, match="two columns 'r'"):
        data_of(frame, {"a": {"red": True}, "b": {"red": False}})
    rows = {name: pd.DataFrame([[1.0, 2.0]], columns=["r", "r"]) for name in "ab"}
    with pytest.raises(DataError, match="two columns 'r'"):
        data_of(rows, {"a": {"red": True}, "b": {"red": False}})
    numbered = {name: pd.DataFrame([[1.0, 2.0]], columns=[0, 0]) for name in "ab"}
    assert data_of(numbered, {"a": {"red": True}, "b": {"red": False}}).recordings == 1


WRITINGS = [str, "{:02d}".format, "{:03d}".format, "{}.0".format, "+{}".format, "{}e0".format]


@given(
    st.lists(st.integers(0, 120), min_size=2, max_size=5, unique=True),
    st.lists(st.sampled_from(range(len(WRITINGS))), min_size=10, max_size=10),
)
def test_a_recording_has_one_number_however_it_is_written(numbers, writings):
    """Two modalities agree; what one file holds twice is told."""
    writes = [WRITINGS[number] for number in writings]
    two = [write(number) for write, number in zip(writes, numbers, strict=False)]
    names = ["a"] * len(numbers)
    labels = {"a": {"red": True}}
    plain = data_of(frame_of(names, numbers), labels)
    written = data_of(frame_of(names, two), labels)
    assert np.array_equal(plain.features["look", "c"], written.features["look", "c"])
    again = frame_of([*names, "a"], [*two, writes[-1](numbers[0])])
    with pytest.raises(DataError, match=f"found recording {numbers[0]} of a again, after row 1"):
        data_of(again, labels)


@pytest.mark.parametrize("names", [("1_0", "10"), ("a1", "a01"), ("x", "1")])
def test_names_of_recordings_are_as_they_are(names):
    data = data_of(frame_of(["a", "a"], names), {"a": {"red": True}})
    assert data.recording_counts.tolist() == [[2]]


@pytest.mark.parametrize(
    "names",
    [("caf\u00e9", "cafe\u0301"), ("a b", "a  b"), ("a b", "a\u00a0b"), ("ab", "a\u200bb")],
)
def test_two_objects_do_not_look_the_same(names):
    with pytest.raises(DataError, match="look the same"):
        data_of(frame_of(names, [1, 1]), {name: {"red": True} for name in names})
