"""A saved table of one's own carries its domain, and what a file claims is not believed."""

import io
import json
import zipfile
from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.datasets import load_percepts
from meal_bayes.datasets.percept_file import save_percepts
from meal_bayes.datasets.percepts import BIN_EDGES, PerceptTable
from meal_bayes.domain import domain_table, load_domain
from meal_bayes.errors import DataError


@pytest.fixture
def table():
    """Return a table of nothing but zeros on a domain of one's own."""
    toy = load_domain("toy")
    domain = replace(toy, name="own", data="own", behaviors=(replace(toy.behaviors[0], cost=9.0),
                     *toy.behaviors[1:]), synonyms={"crimson": "red"})  # fmt: skip
    log_odds = np.full((2, 1, 3, 2), np.nan)
    log_odds[:, :, :2] = 0.0
    bins = np.zeros((2, 2, 2, 3, 8), np.uint8)
    return PerceptTable(domain, ("cup", "tin"), np.ones((2, 2)), log_odds, BIN_EDGES, bins, {})


@pytest.fixture
def path(table, tmp_path):
    save_percepts(table, tmp_path / "own.npz")
    return tmp_path / "own.npz"


def meta_of(path):
    with np.load(path) as archive:
        return json.loads(archive["meta"].tobytes())


def rewrite(path, **fields):
    with np.load(path) as archive:
        arrays = dict(archive)
    meta = {**json.loads(arrays["meta"].tobytes()), **fields}
    arrays["meta"] = np.frombuffer(json.dumps(meta).encode(), np.uint8)
    with zipfile.ZipFile(path, "w") as archive:
        for name, values in arrays.items():
            buffer = io.BytesIO()
            np.lib.format.write_array(buffer, values, version=(1, 0))
            archive.writestr(f"{name}.npy", buffer.getvalue())


def test_the_domain_comes_back(table, path):
    found = load_percepts(path)
    assert found.domain == table.domain
    assert found.domain.behaviors[0].cost == 9.0
    np.testing.assert_array_equal(found.log_odds, table.log_odds)


def test_a_changed_copy_of_a_shipped_domain_is_kept(table, tmp_path):
    dear = replace(table.domain, name="toy", data="toy", synonyms={})
    save_percepts(replace(table, domain=dear), tmp_path / "dear.npz")
    assert load_percepts(tmp_path / "dear.npz").domain == dear


def test_a_shipped_domain_is_kept_by_its_name(table, tmp_path):
    save_percepts(replace(table, domain=load_domain("toy")), tmp_path / "toy.npz")
    assert "domain_table" not in meta_of(tmp_path / "toy.npz")
    assert load_percepts(tmp_path / "toy.npz").domain == load_domain("toy")


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (lambda t: "toy", "found str"),
        (lambda t: {**t, "behaviors": 5}, "expected rows"),
        (lambda t: {**t, "extends": "/etc/own.toml"}, "Only a TOML file"),
        (lambda t: {**t, "attributes": ["red", "round"]}, "not well formed|'round'"),
        (lambda t: {**t, "diagram": {**t["diagram"], "start": "x7"}}, "x7"),
        (lambda t: {**t, "report_reward": 1e999}, "inf"),
    ],
)
def test_a_spoiled_domain_is_a_data_error(table, path, change, found):
    rewrite(path, domain_table=change(domain_table(table.domain)))
    with pytest.raises(DataError, match=found):
        load_percepts(path)
