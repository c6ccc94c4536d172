"""Which table a run works on: shipped, one's own, or the paper's, computed once and kept."""

from dataclasses import replace

import pytest

from meal_bayes.datasets import load_percepts
from meal_bayes.datasets.percepts import save_percepts
from meal_bayes.domain import load_domain
from meal_bayes.errors import SettingsError
from meal_bayes.experiments import percepts
from meal_bayes.experiments.percepts import percepts_for, table_path


@pytest.fixture
def computed(tmp_path, monkeypatch):
    """Let the paper's table cost nothing; return the calls that would have computed it."""
    calls = []

    def build(recordings, *, perception, progress):
        calls.append((recordings, perception))
        if progress is not None:
            progress(1, 1)
        return replace(load_percepts("roc36"), provenance={"made": str(len(calls))})

    monkeypatch.setenv("MEAL_BAYES_DATA_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(percepts, "load_dataset", lambda data: f"recordings of {data}")
    monkeypatch.setattr(percepts, "build_percept_table", build)
    return calls


def test_default_is_what_ships_or_ones_own(tmp_path):
    table = percepts_for("roc36")
    assert table.objects == load_percepts("roc36").objects
    save_percepts(table, tmp_path / "own.npz")
    assert percepts_for(str(tmp_path / "own.npz")).objects == table.objects


def test_the_papers_is_computed_once_with_a_note(computed):
    notes, done = [], []
    table = percepts_for(
        "roc36", "paper", on_note=notes.append, on_progress=lambda *p: done.append(p)
    )
    assert computed == [("recordings of roc36", "paper")]
    assert done == [(1, 1)]
    (said,) = notes
    assert "computing the paper percepts of roc36" in said
    assert str(table_path("roc36", "paper")) in said
    again = percepts_for("roc36", "paper", on_note=notes.append)
    assert len(computed) == len(notes) == 1
    assert again.provenance == table.provenance == {"made": "1"}


def test_a_variant_shares_the_table_and_keeps_its_costs(computed):
    percepts_for("roc36", "paper")
    variant = percepts_for("roc36_published", "paper")
    assert len(computed) == 1
    assert variant.domain == load_domain("roc36_published")


def test_a_damaged_table_is_computed_again(computed):
    percepts_for("roc36", "paper")
    path = table_path("roc36", "paper")
    path.write_bytes(path.read_bytes()[:1000])
    assert percepts_for("roc36", "paper").provenance == {"made": "2"}
    assert [p.name for p in path.parent.iterdir()] == [path.name]


def test_other_code_or_another_version_computes_its_own(computed, monkeypatch):
    percepts_for("roc36", "paper")
    monkeypatch.setattr(percepts, "digest_of", lambda *_: "other")
    percepts_for("roc36", "paper")
    monkeypatch.setattr(percepts, "package_version", lambda: "9.0")
    percepts_for("roc36", "paper")
    assert len(computed) == 3


def test_a_table_of_the_requested_method_is_used(tmp_path):
    made = replace(load_percepts("roc36"), provenance={"perception": "method=paper, folds=5"})
    save_percepts(made, tmp_path / "own.npz")
    assert percepts_for(str(tmp_path / "own.npz"), "paper").provenance == made.provenance


def test_what_cannot_be_computed_is_told(computed, tmp_path):
    save_percepts(load_percepts("roc36"), tmp_path / "own.npz")
    with pytest.raises(SettingsError, match="Unknown perception 'papers': did you mean 'paper'"):
        percepts_for("roc36", "papers")
    with pytest.raises(SettingsError, match="is a percept table of another method"):
        percepts_for(str(tmp_path / "own.npz"), "paper")
    with pytest.raises(SettingsError, match="toy has no public recordings"):
        percepts_for("toy", "paper")
    assert computed == []


def test_no_table_is_kept_outside_of_the_cache(tmp_path, monkeypatch):
    """`data` of a domain of others may be any text, also the path of a folder."""
    monkeypatch.setenv("MEAL_BAYES_DATA_DIR", str(tmp_path / "cache"))
    for data in (str(tmp_path / "elsewhere"), "../../elsewhere", ".."):
        (tmp_path / "own.toml").write_text(f'extends = "toy"\nname = "own"\ndata = "{data}"\n')
        path = table_path(str(tmp_path / "own.toml"), root=tmp_path)
        assert path.resolve().parent == tmp_path / "cache" / "percepts"
