"""Columns of features: those that number or date the rows are told; frames of any package."""

import warnings

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from meal_bayes import Dataset, load_dataset
from meal_bayes.datasets import checked_features
from meal_bayes.errors import DataError
from meal_bayes.robots.robot import Outcome, OutcomeChecker

TABLE = {
    "name": "own",
    "attributes": ["red"],
    "behaviors": [{"name": "look", "cost": 1.0, "modalities": ["c", "h"]}],
    "diagram": {
        "states": ["here"],
        "start": "here",
        "effects": [{"from": "here", "do": "look", "to": "here"}],
    },
}
OBJECTS = [f"o{number:02d}" for number in range(12)]
LABELS = {name: {"red": o < 6} for o, name in enumerate(OBJECTS)}
INDEX = ["index", "frame", "row", "step", "episode", "timestamp", "id", "seq", "trial", "Clock"]
BESIDE = ["", "_id", "_index", " number", "_idx", ".secs", "_no", "_0", ": 0"]
MEASURES = ["force", "contact time", "peak_1", "x", "f0", "torque.z", "sound level", "index_finger"]


def frame(rng, names=("a", "b")):
    keys = {"object": np.repeat(OBJECTS, 3), "recording": np.tile([1, 2, 3], len(OBJECTS))}
    return pd.DataFrame({**keys, **{name: rng.normal(size=36) for name in names}})


def data_of(look):
    rng = np.random.default_rng(7)
    return Dataset.from_frames(TABLE, {("look", "c"): look, ("look", "h"): frame(rng)}, LABELS)


@given(st.sampled_from(INDEX), st.sampled_from(BESIDE), st.integers(0, 2))
def test_a_column_called_as_a_number_or_a_time_of_rows_is_refused_on_every_road(
    tmp_path_factory, word, beside, place
):
    name = word + beside
    look = frame(np.random.default_rng(0))
    look.insert(2 + place, name, np.arange(36.0))
    with pytest.raises(DataError, match=f"{name!r}.*drop it, or rename it"):
        data_of(look)
    with pytest.raises(DataError, match=f"{name!r}.*drop it, or rename it"):
        data_of(
            {o: rows.drop(columns=["object", "recording"]) for o, rows in look.groupby("object")}
        )
    with pytest.raises(DataError, match=f"{name!r}.*drop it, or rename it"):
        checked_features(look.iloc[0].drop(["object", "recording"]).astype(float))
    folder = tmp_path_factory.mktemp("folder")
    pd.DataFrame({"object": OBJECTS, "red": 1}).to_csv(folder / "labels.csv", index=False)
    look.to_csv(folder / "look_c.csv", index=False)
    look.drop(columns=name).to_csv(folder / "look_h.csv", index=False)
    domain = folder / "own.toml"
    domain.write_text(
        'name = "own"\nattributes = ["red"]\n'
        'behaviors = [{name = "look", cost = 1.0, modalities = ["c", "h"]}]\n'
        '[diagram]\nstates = ["here"]\nstart = "here"\n'
        'effects = [{from = "here", do = "look", to = "here"}]\n'
    )
    with pytest.raises(DataError, match=f"look_c.csv, line 1: .*{name!r}.*drop it, or rename it"):
        load_dataset(domain, root=folder)


@given(st.lists(st.sampled_from(MEASURES), min_size=1, unique=True), st.integers(0, 99))
def test_measurements_in_no_order_are_taken_without_a_word(names, seed):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        dataset = data_of(frame(np.random.default_rng(seed), names))
    assert dataset.features["look", "c"].shape == (12, 3, len(names))


@given(
    st.sampled_from([1, -1]),
    st.sampled_from(["rows", "recordings", "objects", "clock"]),
    st.integers(0, 99),
)
def test_a_column_that_only_grows_or_falls_is_named(sign, kind, seed):
    rng = np.random.default_rng(seed)
    numbers = {
        "rows": np.arange(36),
        "recordings": np.tile([0, 1, 2], 12),  # from anew in each object
        "objects": np.repeat(np.arange(12), 3),
        "clock": np.cumsum(rng.exponential(size=36)),
    }[kind]
    look = frame(rng, ("force",)).assign(q=sign * numbers)
    verb = "grows" if sign > 0 else "falls"
    with pytest.warns(UserWarning, match=f"column 'q' only {verb} with the rows"):
        data_of(look)
    arrays = [rows[["force", "q"]].to_numpy() for _, rows in look.groupby("object")]
    with pytest.warns(UserWarning, match=f"column 2 of 2 only {verb} with the rows"):
        dataset = data_of(dict(zip(OBJECTS, arrays, strict=True)))
    with pytest.warns(UserWarning, match=f"column 2 of 2 only {verb} with the rows"):
        Dataset(dataset.domain, dataset.objects, dataset.features, dataset.labels)


@pytest.mark.parametrize("package", ["polars", "pyarrow"])
def test_frames_of_other_packages_are_read_as_those_of_pandas(package_of_frames, package):
    module = package_of_frames(package)
    convert = module.from_pandas if package == "polars" else module.Table.from_pandas
    look = frame(np.random.default_rng(3))
    labels = pd.DataFrame({"object": OBJECTS, "red": [1.0, 0.0, None] * 4})
    features = {("look", "c"): convert(look), ("look", "h"): convert(look)}
    dataset = Dataset.from_frames(TABLE, features, convert(labels))
    expected = Dataset.from_frames(TABLE, {("look", "c"): look, ("look", "h"): look}, labels)
    assert dataset.digest() == expected.digest()
    with pytest.raises(DataError, match="'frame_id'"):
        data_of(convert(look.rename(columns={"b": "frame_id"})))


class Exchanged:
    """A frame of a package that nobody knows, and that cannot be exchanged."""

    columns = ("object", "a")


def test_a_frame_that_cannot_be_converted_is_named():
    with pytest.raises(DataError, match=r"Exchanged.*to_pandas\(\)"):
        data_of(Exchanged())


@pytest.mark.parametrize("package", ["pandas", "polars"])
def test_columns_of_each_object_are_joined_by_their_names(package_of_frames, package):
    look = frame(np.random.default_rng(3), ["force", "pitch", "gain"])
    expected = data_of(look).features["look", "c"]
    rows = {o: some.drop(columns=["object", "recording"]) for o, some in look.groupby("object")}
    for place, name in enumerate(OBJECTS[:6]):
        rows[name] = rows[name].iloc[:, np.roll(np.arange(3), place)]
    if package == "polars":
        rows[OBJECTS[1]] = package_of_frames(package).from_pandas(rows[OBJECTS[1]])
    assert np.array_equal(data_of(rows).features["look", "c"], expected)
    rows[OBJECTS[0]] = rows[OBJECTS[0]].iloc[:0, :1]  # of no recordings
    dataset = Dataset.from_frames(TABLE, {("look", m): rows for m in "ch"}, LABELS)
    for features in dataset.features.values():
        assert np.array_equal(features[1:], np.roll(expected, 1, axis=-1)[1:])
    rows[OBJECTS[2]] = rows[OBJECTS[2]].rename(columns={"pitch": "yaw"})
    with pytest.raises(DataError, match=r"of o02: found the columns .*yaw.*; expected "):
        data_of(rows)


@given(st.sets(st.integers(0, 35), max_size=6), st.booleans())
def test_a_row_of_nan_says_that_a_recording_lacks_the_modality(lacking, both):
    """In frames, dictionaries and arrays alike; other recordings keep their number and partner."""
    rng = np.random.default_rng(5)
    looks = [frame(rng), frame(rng)]
    for table in looks if both else looks[:1]:
        table.loc[sorted(lacking), ["a", "b"]] = np.nan
    kept = [row for row in range(36) if row not in lacking]
    whole = [table.iloc[kept] for table in looks]
    contexts = [("look", "c"), ("look", "h")]
    expected = Dataset.from_frames(TABLE, dict(zip(contexts, whole, strict=True)), LABELS)
    arrays = [table[["a", "b"]].to_numpy().reshape(12, 3, 2) for table in looks]
    by_object = [dict(zip(OBJECTS, array, strict=True)) for array in arrays]
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        for forms in (looks, by_object, arrays):
            features = dict(zip(contexts, forms, strict=True))
            dataset = Dataset.from_frames(TABLE, features, LABELS, objects=OBJECTS)
            assert dataset.digest() == expected.digest()
    texts = [str(warning.message) for warning in told]
    assert len(texts) == (0 if both or not lacking else 3)
    assert all("look are left out, as c is missing" in text for text in texts)


def test_a_live_row_with_a_clock_is_no_percept_and_says_so():
    dataset = data_of(frame(np.random.default_rng(0)))
    checker = OutcomeChecker(dataset.domain)
    sensed = {"c": pd.Series({"a": 1.0, "timestamp": 2.0}), "h": [1.0, 2.0]}
    with pytest.warns(UserWarning, match="by h alone: c: .*'timestamp'"):
        execution = checker.execute(0, Outcome("here", sensed))
    assert list(execution.instance.features) == ["h"]


@pytest.mark.parametrize("kind", ["Int64", "Float64", "Int8", "boolean"])
def test_numbers_of_pandas_own_kinds_are_numbers(kind):
    whole = frame(np.random.default_rng(3)).assign(a=[0.0, 1.0, 0.0] * 12)
    assert data_of(whole.astype({"a": kind})).digest() == data_of(whole).digest()
    with pytest.raises(DataError, match="column 'a'"):
        data_of(whole.assign(a="x"))
