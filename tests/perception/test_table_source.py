"""Which percept table a data set has, and what it is known by."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from meal_bayes.datasets import (
    load_percepts,
    make_synthetic,
    percepts,
    save_csv_folder,
    save_percepts,
)
from meal_bayes.digests import digest_of
from meal_bayes.domain import load_domain
from meal_bayes.errors import SettingsError
from meal_bayes.experiments import OfflineConfig, run_offline
from meal_bayes.perception import TableSource, table_source
from meal_bayes.perception.table_source import fingerprint

OWN = 'extends = "{parent}"\nname = "own"\ndata = "roc36"\n'


def test_the_parents_of_a_domain_are_another_run(tmp_path):
    child = tmp_path / "own.toml"
    parent = tmp_path / "parent.toml"
    child.write_text(OWN.format(parent="parent.toml"))
    prints = set()
    for reward in (500.0, 300.0, 300.0):
        parent.write_text(f'extends = "roc36"\nreport_reward = {reward}\n')
        prints.add(fingerprint(str(child)))
    assert len(prints) == 2


def test_recordings_are_another_run(own_data):
    (file,) = (own_data.parent / f for f in ["labels.csv"])
    before = fingerprint(str(own_data), str(own_data.parent))
    content = file.read_bytes()
    file.write_bytes(content + b"\n")
    changed = fingerprint(str(own_data), str(own_data.parent))
    file.write_bytes(content)
    assert changed != before
    assert fingerprint(str(own_data), str(own_data.parent)) == before


def test_renamed_recordings_are_another_run_and_files_that_are_not_read_do_not_count(tmp_path):
    save_csv_folder(small_data(), tmp_path)
    labels, kept = tmp_path / "labels.csv", tmp_path / "labels_v2.csv"
    prints = [fingerprint("toy", tmp_path)]
    kept.write_text(labels.read_text().replace("1", "0"))
    prints.append(fingerprint("toy", tmp_path))
    labels.rename(tmp_path / "label_old.csv")  # the contents stay in their order
    kept.rename(labels)
    prints.append(fingerprint("toy", tmp_path))
    labels.unlink()
    prints.append(fingerprint("toy", tmp_path))
    assert prints[0] == prints[1]
    assert len(set(prints)) == 3


def test_public_recordings_of_ones_own_mirror_are_another_run(tmp_path):
    folder = tmp_path / "sensorimotor_features"
    folder.mkdir()
    (folder / "look.txt").write_text("1 2 3")
    before = fingerprint("roc36", str(tmp_path))
    (folder / "look.txt").write_text("1 2 4")
    assert fingerprint("roc36", str(tmp_path)) != before
    assert fingerprint("roc36") == ""


def test_parts_do_not_run_together(tmp_path):
    (tmp_path / "a").write_text("x")
    values = [("ab", "c"), ("a", "bc"), ("abc",), ({"a": 1},), (["a", 1],), (None,), ()]
    values += [(tmp_path / "a",), (tmp_path,)]
    assert len({digest_of(*parts) for parts in values}) == len(values)
    assert digest_of({"a": 1, "b": 2}) == digest_of({"b": 2, "a": 1})


def small_data(name="toy"):
    """Return recordings of six objects, equal from call to call."""
    rng = np.random.default_rng(1)
    return make_synthetic(load_domain(name), objects=6, recordings=2, rng=rng)


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
    monkeypatch.setattr(table_source, "load_dataset", lambda data, root: f"recordings of {data}")
    monkeypatch.setattr(table_source, "build_percept_table", build)
    return calls


def test_default_is_what_ships_or_ones_own(tmp_path):
    table = TableSource.of("roc36").load()
    assert table.objects == load_percepts("roc36").objects
    save_percepts(table, tmp_path / "own.npz")
    assert TableSource.of(str(tmp_path / "own.npz")).load().objects == table.objects


def test_the_papers_is_computed_once_with_a_note(computed):
    notes = []
    done = []
    table = TableSource.of("roc36", "paper").load(
        on_note=notes.append, on_progress=lambda *p: done.append(p)
    )
    assert computed == [("recordings of roc36", "paper")]
    assert done == [(1, 1)]
    (said,) = notes
    assert "computing the paper percepts of roc36" in said
    assert str(TableSource.of("roc36", "paper").path) in said
    again = TableSource.of("roc36", "paper").load(on_note=notes.append)
    assert len(computed) == len(notes) == 1
    assert again.provenance == table.provenance == {"made": "1"}


@pytest.mark.parametrize("left", [0, 1000])
def test_a_damaged_table_in_the_cache_is_computed_again(computed, caplog, left):
    source = TableSource.of("roc36", "paper")
    table = source.load()
    source.path.write_bytes(source.path.read_bytes()[:left])
    again = TableSource.of("roc36", "paper").load()
    assert len(computed) == 2
    assert "is damaged, and is made again" in caplog.text
    assert np.array_equal(again.log_odds, table.log_odds, equal_nan=True)
    TableSource.of("roc36", "paper").load()
    assert len(computed) == 2


def test_a_variant_shares_the_table_and_keeps_its_costs(computed):
    TableSource.of("roc36", "paper").load()
    variant = TableSource.of("roc36_published", "paper").load()
    assert len(computed) == 1
    assert variant.domain == load_domain("roc36_published")


@pytest.mark.long
def test_other_code_or_another_version_computes_its_own(computed, monkeypatch):
    TableSource.of("roc36", "paper").load()
    monkeypatch.setattr(table_source, "digest_of", lambda *_: "other")
    TableSource.of("roc36", "paper").load()
    monkeypatch.setattr(table_source, "package_version", lambda: "9.0")
    TableSource.of("roc36", "paper").load()
    assert len(computed) == 3


def test_a_table_of_the_requested_method_is_used(tmp_path):
    made = replace(load_percepts("roc36"), provenance={"perception": "method=paper, folds=5"})
    save_percepts(made, tmp_path / "own.npz")
    assert TableSource.of(str(tmp_path / "own.npz"), "paper").load().provenance == made.provenance


def test_what_cannot_be_computed_is_told(computed, tmp_path):
    save_percepts(load_percepts("roc36"), tmp_path / "own.npz")
    with pytest.raises(SettingsError, match="Unknown perception 'papers': did you mean 'paper'"):
        TableSource.of("roc36", "papers").load()
    with pytest.raises(SettingsError, match="is a percept table of another method"):
        TableSource.of(str(tmp_path / "own.npz"), "paper").load()
    with pytest.raises(SettingsError, match="toy has no public recordings"):
        TableSource.of("toy", "paper").load()
    assert computed == []


def test_no_table_is_kept_outside_of_the_cache(tmp_path, monkeypatch):
    """`data` of a domain of others may be any text, also the path of a folder."""
    monkeypatch.setenv("MEAL_BAYES_DATA_DIR", str(tmp_path / "cache"))
    for data in (str(tmp_path / "elsewhere"), "../../elsewhere", ".."):
        (tmp_path / "own.toml").write_text(f'extends = "toy"\nname = "own"\ndata = "{data}"\n')
        path = TableSource.of(str(tmp_path / "own.toml"), root=tmp_path).path
        assert path.resolve().parent == tmp_path / "cache" / "percepts"


def test_a_table_of_other_bins_is_computed_anew(tmp_path, monkeypatch):
    """Percepts that are cut live by other edges than a kept table's would be of another robot."""
    monkeypatch.setenv("MEAL_BAYES_DATA_DIR", str(tmp_path / "cache"))
    (tmp_path / "own.toml").write_text('extends = "toy"\nname = "own"\ndata = "own"\n')
    before = TableSource.of(str(tmp_path / "own.toml"), root=tmp_path).path
    code = Path(percepts.__file__).read_text(encoding="utf-8")
    assert "-3.0" in code
    (tmp_path / "percepts.py").write_text(code.replace("-3.0", "-2.5"), encoding="utf-8")
    monkeypatch.setattr(percepts, "__file__", str(tmp_path / "percepts.py"))
    assert TableSource.of(str(tmp_path / "own.toml"), root=tmp_path).path != before


def test_a_config_of_recordings_writes_nothing(tmp_path, monkeypatch):
    monkeypatch.setenv("MEAL_BAYES_DATA_DIR", str(tmp_path / "cache"))
    data = small_data()
    config = OfflineConfig(data, 1, 2, ("random",))
    assert config.dataset is data
    assert not (tmp_path / "cache").exists()
    assert "Dataset" in config.as_dict()["dataset"]


def test_the_table_of_recordings_in_memory_is_computed_once(computed):
    data = small_data("roc36")
    for _ in range(2):
        TableSource.of(data).load()
    assert computed == [(data, "default")]
    labels = data.labels.copy()
    labels[0] = -1
    other = TableSource.of(replace(data, labels=labels))
    assert other != TableSource.of(data)
    assert other.path != TableSource.of(data).path


def test_a_table_in_memory_is_found_again_by_its_name(tmp_path, monkeypatch):
    monkeypatch.setenv("MEAL_BAYES_DATA_DIR", str(tmp_path / "cache"))
    table = load_percepts("roc36")
    given = TableSource.of(table)
    assert given.load() is table
    kept = TableSource.of(given.name).load()
    assert np.array_equal(kept.training_bins, table.training_bins)
    assert kept.domain == table.domain
    labels = table.labels.copy()
    labels[0] = -1
    changed = replace(table, labels=labels)
    assert TableSource.of(changed).path != given.path


def test_a_run_of_recordings_names_the_table_that_it_kept(tmp_path, monkeypatch):
    monkeypatch.setenv("MEAL_BAYES_DATA_DIR", str(tmp_path / "cache"))
    data = small_data()
    run = run_offline(OfflineConfig(data, 1, 2, ("random",)), logs=tmp_path)
    assert TableSource.of(run.config.dataset).domain == data.domain
    again = run_offline(OfflineConfig(data, 1, 2, ("random",)), logs=tmp_path)
    assert again.folder == run.folder
