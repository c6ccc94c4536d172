"""Percept tables: the type, the file, and the three that ship."""

import io
import json
import tracemalloc
import zipfile
from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.datasets.percepts import (
    BIN_EDGES,
    LIMIT,
    THRESHOLD,
    PerceptTable,
    level_edges,
    levels_of,
    load_percepts,
    round_log_odds,
    save_percepts,
)
from meal_bayes.domain import domain_table, load_domain
from meal_bayes.errors import DataError, SettingsError

NAMES = ("roc36", "ispy32", "cy101")
BARS = {"roc36": 0.43, "ispy32": 0.61, "cy101": 0.285}  # held-out log-loss, nats


@pytest.fixture
def table():
    """Return a table of random percepts on `toy`: 3 objects, 2 recordings."""
    rng = np.random.default_rng(0)
    log_odds = np.full((3, 2, 3, 2), np.nan)
    log_odds[:, :, :2] = rng.normal(size=(3, 2, 2, 2)) * 3
    log_odds[1, :, :, 0] = np.nan  # not computed
    bins = np.zeros((3, 3, 2, 3, 8), np.uint8)
    bins[:, :, :, :2] = rng.multinomial(2, np.full(8, 1 / 8), size=(3, 3, 2, 2))
    bins[np.arange(3), np.arange(3)] = 0
    labels = np.array([[0, 1], [1, 0], [1, -1]])
    domain = load_domain("toy")
    provenance = {"package": "test", "source": "own data"}
    objects = ("cup", "tin", "jar")
    return PerceptTable(domain, objects, labels, log_odds, BIN_EDGES, bins, provenance)


@pytest.fixture
def path(table, tmp_path):
    save_percepts(table, tmp_path / "table.npz")
    return tmp_path / "table.npz"


def large(objects):
    """Return a table of no percepts, whose training bins take 4,000 bytes a pair of objects."""
    behaviors = [{"name": f"b{e}", "cost": 1, "modalities": ["v"]} for e in range(10)]
    effects = [{"from": "s", "do": b["name"], "to": "s"} for b in behaviors]
    domain = load_domain(
        {"name": "big", "attributes": [f"a{p}" for p in range(50)], "behaviors": behaviors,
         "diagram": {"states": ["s"], "start": "s", "effects": effects}}
    )  # fmt: skip
    log_odds = np.full((objects, 1, 10, 50), np.nan)
    bins = np.zeros((objects, objects, 50, 10, 8), np.uint8)
    names = tuple(f"cup {o}" for o in range(objects))
    return PerceptTable(domain, names, np.ones((objects, 50)), log_odds, BIN_EDGES, bins, {})


@pytest.mark.parametrize(("objects", "fits"), [(100, True), (130, False)])
def test_what_is_saved_can_be_read_and_what_is_too_large_is_refused(tmp_path, objects, fits):
    path = tmp_path / "large.npz"
    if fits:
        save_percepts(large(objects), path)
        assert len(load_percepts(path).objects) == objects
        return
    with pytest.raises(DataError, match="has 67,600,256 bytes, more than the 67,108,864"):
        save_percepts(large(objects), path)
    assert not path.exists()


def rewrite(path, change):
    """Write the file's arrays again after `change` had a go at them."""
    with np.load(path) as archive:
        arrays = dict(archive)
    change(arrays)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, values in arrays.items():
            buffer = io.BytesIO()
            np.lib.format.write_array(buffer, values, version=(1, 0))
            archive.writestr(f"{name}.npy", buffer.getvalue())


def rewrite_meta(path, **fields):
    def change(arrays):
        meta = {**json.loads(arrays["meta"].tobytes()), **fields}
        meta = {key: value for key, value in meta.items() if value is not None}
        arrays["meta"] = np.frombuffer(json.dumps(meta).encode(), np.uint8)

    rewrite(path, change)


def assert_same(first, second):
    for name in ("labels", "log_odds", "edges", "training_bins"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    assert first.objects == second.objects
    assert first.provenance == second.provenance
    assert first.domain == second.domain


def test_levels_merge_neighboring_bins(table):
    values = np.random.default_rng(0).normal(size=1000) * 3
    fine = levels_of(values, BIN_EDGES, 8)
    for levels in (2, 4, 8):
        coarse = table.levels_of(values, levels)
        np.testing.assert_array_equal(coarse, fine // (8 // levels))
        assert len(level_edges(table.edges, levels)) == levels - 1
        assert (coarse[np.argsort(values)] == np.sort(coarse)).all()
        shown = table.training_levels(0, levels)
        np.testing.assert_array_equal(
            shown, table.training_bins[0].reshape(3, 2, 3, levels, -1).sum(axis=-1)
        )
    assert level_edges(table.edges, 2).tolist() == [THRESHOLD]
    assert pytest.approx(0.501) == 1 / (1 + np.exp(-THRESHOLD))
    for levels in (0, 1, 3, 6, 16):
        with pytest.raises(SettingsError, match="expected one of"):
            table.training_levels(0, levels)


def test_percepts_and_counts_follow_one_rule_of_merging(table, monkeypatch):
    """Were surely yes and surely no to be rare, that would be said in one place."""
    lowest = np.array([0, 1, 4, 7])
    monkeypatch.setattr("meal_bayes.datasets.percepts.lowest_bins", lambda bins, levels: lowest)
    middles = np.interp(np.arange(-0.5, 7), np.arange(7), BIN_EDGES)
    middles[[0, -1]] = BIN_EDGES[0] - 1, BIN_EDGES[-1] + 1
    of_bin = table.levels_of(middles, 4)
    assert of_bin.tolist() == [0, 1, 1, 1, 2, 2, 2, 3]
    bins = table.training_bins[0]
    counts = np.stack([bins[..., of_bin == level].sum(axis=-1) for level in range(4)], axis=-1)
    np.testing.assert_array_equal(table.training_levels(0, 4), counts)


def test_rounding_keeps_log_odds_to_a_hundredth():
    values = np.random.default_rng(0).uniform(-8, 8, 10000)
    assert np.abs(round_log_odds(values) - values).max() < 0.005
    assert round_log_odds([-50, 50]).tolist() == [-LIMIT, LIMIT]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"labels": np.zeros((3, 3))}, r"labels has shape \(3, 3\); expected \(3, 2\)"),
        ({"log_odds": np.zeros((3, 2, 2, 2))}, r"expected \(3, 2, 3, 2\)"),
        ({"training_bins": np.zeros((3, 3, 2, 3, 7))}, r"expected \(3, 3, 2, 3, 8\)"),
        ({"edges": BIN_EDGES[::-1]}, "each above the last"),
        ({"training_bins": np.ones((3, 3, 2, 3, 8))}, "count its own recordings"),
        ({"recording_counts": np.full((3, 3), 9)}, "in 0 to 2"),
    ],
)
def test_tables_that_do_not_fit_are_refused(table, change, message):
    with pytest.raises(DataError, match=message):
        replace(table, **change)


def test_a_table_is_read_back_as_it_was_and_written_as_before(table, path, tmp_path):
    assert_same(load_percepts(path), table)
    assert_same(load_percepts(str(path), domain=table.domain), table)
    save_percepts(table, tmp_path / "again.npz")
    assert (tmp_path / "again.npz").read_bytes() == path.read_bytes()


def test_columns_follow_the_domain_that_is_asked_for(table, path):
    toy = table.domain
    swapped = replace(toy, attributes=toy.attributes[::-1], behaviors=toy.behaviors[::-1])
    percepts = load_percepts(path, domain=swapped)
    np.testing.assert_array_equal(percepts.labels, table.labels[:, ::-1])
    np.testing.assert_array_equal(percepts.log_odds, table.log_odds[:, :, ::-1, ::-1])
    np.testing.assert_array_equal(percepts.training_bins, table.training_bins[:, :, ::-1, ::-1])
    fewer = replace(toy, attributes=("heavy",))
    assert load_percepts(path, domain=fewer).labels.shape == (3, 1)
    other = replace(toy, attributes=("heavy", "round"))
    with pytest.raises(DataError, match="Unknown attribute 'round'"):
        load_percepts(path, domain=other)


def test_names_without_a_table_are_refused(tmp_path):
    with pytest.raises(SettingsError, match="No percept table ships for 'toy'"):
        load_percepts("toy")
    with pytest.raises(SettingsError, match="Unknown domain 'roc'"):
        load_percepts("roc")
    with pytest.raises(SettingsError, match="No file"):
        load_percepts(tmp_path / "none.npz")


def test_the_domain_must_ship_or_be_given(path, table):
    rewrite_meta(path, domain="/own/kitchen.toml")
    with pytest.raises(SettingsError, match="which is not in the package; pass domain="):
        load_percepts(path)
    assert_same(load_percepts(path, domain=table.domain), table)


def test_torn_and_changed_bytes_are_a_data_error(path, table):
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    for number in range(200):
        damaged = bytearray(whole)
        if number % 2:
            damaged = damaged[: rng.integers(len(whole))]
        else:
            damaged[rng.integers(len(whole))] ^= 1 << rng.integers(8)
        path.write_bytes(damaged)
        try:
            percepts = load_percepts(path)
        except (DataError, SettingsError):
            continue
        assert_same(percepts, table)  # a bit that means nothing


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda a: a.pop("labels"), "not a complete percept table"),
        (lambda a: a.update(meta=np.frombuffer(b"{", np.uint8)), "not a complete percept table"),
        (lambda a: a.update(labels=a["labels"].astype(float)), "labels is float64"),
        (lambda a: a.update(labels=a["labels"] + np.int8(5)), "expected 1 or True"),
    ],
)
def test_wrong_contents_are_a_data_error(path, change, message):
    rewrite(path, change)
    with pytest.raises(DataError, match=message):
        load_percepts(path)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"format": 2}, "has format 2; this version reads format 1"),
        ({"objects": None}, "not a complete percept table"),
        ({"objects": ["cup"]}, r"labels has shape \(3, 2\); expected \(1, 2\)"),
        ({"objects": ["cup", "cup", "jar"]}, "named twice"),
        ({"behaviors": ["look"]}, "Unknown behavior 'lift'"),
    ],
)
def test_wrong_metadata_is_a_data_error(path, fields, message):
    rewrite_meta(path, **fields)
    with pytest.raises(DataError, match=message):
        load_percepts(path)


@pytest.mark.parametrize("name", ["own", "toy"])
def test_a_domain_of_one_s_own_comes_back(table, tmp_path, name):
    toy = table.domain
    dear = replace(toy.behaviors[0], cost=9.0)
    domain = replace(toy, name=name, data=name, behaviors=(dear, *toy.behaviors[1:]))
    save_percepts(replace(table, domain=domain), tmp_path / "own.npz")
    assert load_percepts(tmp_path / "own.npz").domain == domain


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: "toy", "found str"),
        (lambda t: {**t, "behaviors": 5}, "expected rows"),
        (lambda t: {**t, "extends": "/etc/own.toml"}, "Unknown key 'extends'"),
        (lambda t: {**t, "attributes": ["red", "round"]}, "not well formed|'round'"),
        (lambda t: {**t, "diagram": {**t["diagram"], "start": "x7"}}, "x7"),
        (lambda t: {**t, "report_reward": 1e999}, "Out of range"),
    ],
)
def test_a_spoiled_domain_is_a_data_error(table, path, change, message):
    rewrite_meta(path, domain_table=change(domain_table(table.domain)))
    with pytest.raises(DataError, match=message):
        load_percepts(path)


def test_a_small_file_asks_for_no_great_memory(path):
    rewrite(path, lambda a: a.update(training_bins=np.zeros((70, 1000, 1000, 1, 1), np.uint8)))
    assert path.stat().st_size < 10 << 20
    tracemalloc.start()
    with pytest.raises(DataError, match="claims 70"):
        load_percepts(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 20 << 20


def test_a_domain_that_blows_its_table_up_is_refused(table, path):
    many = tuple(replace(table.domain.behaviors[2], name=f"b{i}") for i in range(980))
    effects = tuple(replace(table.domain.diagram.effects[0], behavior=b.name) for b in many)
    diagram = table.domain.diagram
    domain = replace(
        table.domain, name="own", behaviors=(*table.domain.behaviors, *many),
        diagram=replace(diagram, effects=(*diagram.effects, *effects)),
    )  # fmt: skip
    rewrite(path, lambda a: a.update(training_bins=np.zeros((3, 2, 2, 3, 8000), np.uint8)))
    with pytest.raises(DataError, match="does not fit into memory"):
        load_percepts(path, domain=domain)


@pytest.mark.parametrize("name", NAMES)
def test_shipped_tables_are_whole(name):
    table = load_percepts(name)
    sensing = table.domain.recorded
    assert np.isfinite(table.log_odds[:, :, sensing]).all()
    total = table.training_bins[:, :, :, sensing].sum(axis=-1)
    others = ~np.eye(len(table.objects), dtype=bool)
    assert (total[others] == table.recordings).all()
    assert (total[~others] == 0).all()
    assert f"--dataset {name}" in table.provenance["command"]
    assert len(table.provenance["recordings_sha256"]) == 64
    published = replace(table, domain=load_domain(f"{name}_published"))
    assert_same(load_percepts(f"{name}_published"), published)


@pytest.mark.parametrize("name", NAMES)
def test_shipped_outputs_beat_the_bars(name):
    table = load_percepts(name)
    truth = table.labels == 1
    n = len(table.objects)
    asked = np.minimum(truth.sum(axis=0), (~truth).sum(axis=0)) > table.domain.asked_minimum
    base = (truth.sum(axis=0) - truth + 1) / (n + 1)  # of the other objects
    prior = np.log(base / (1 - base))[:, None, None, :]
    sensing = table.domain.recorded
    log_odds = table.log_odds[:, :, sensing].astype(float) + prior
    loss = np.logaddexp(0, np.where(truth[:, None, None], -log_odds, log_odds))
    assert np.mean(loss[..., asked]) <= BARS[name]
