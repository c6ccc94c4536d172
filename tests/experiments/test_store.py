"""What names a run's folder, when a unit of it is done, and which percept table it works on."""

from dataclasses import replace

import pytest

from meal_bayes.datasets import load_percepts
from meal_bayes.datasets.percepts import save_percepts
from meal_bayes.domain import load_domain
from meal_bayes.errors import SettingsError
from meal_bayes.experiments import OfflineConfig, percepts, run_offline, store
from meal_bayes.experiments.percepts import percepts_for, table_path
from meal_bayes.experiments.store import digest_of, fingerprint, is_whole, run_folder

CONFIG = OfflineConfig("roc36", 2, 3, ("random",), seed=5)
OWN = 'extends = "{parent}"\nname = "own"\ndata = "roc36"\n'


@pytest.fixture(scope="module")
def unit(tmp_path_factory):
    """A finished unit."""
    (path,) = run_offline(CONFIG, logs=tmp_path_factory.mktemp("logs")).paths
    return path


@pytest.fixture
def content(unit):
    """Its content, which is put back when the test is over."""
    content = unit.read_bytes()
    yield content
    unit.write_bytes(content)


@pytest.mark.parametrize("damage", ["flipped", "torn", "text"])
def test_a_damaged_unit_is_made_again(unit, content, damage, caplog):
    flipped = bytearray(content)
    flipped[len(content) // 2] ^= 1
    unit.write_bytes({"flipped": flipped, "torn": content[:-10], "text": b"hello"}[damage])
    assert not is_whole(unit)
    assert "it is made again" in caplog.text
    run_offline(CONFIG, logs=unit.parents[2])
    assert unit.read_bytes() == content


def test_fresh_replaces_and_never_deletes(unit, content, monkeypatch):
    """As when it is killed before it has made anything."""

    def killed(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr("meal_bayes.experiments.offline.Learner", killed)
    with pytest.raises(KeyboardInterrupt):
        run_offline(CONFIG, logs=unit.parents[2], fresh=True)
    assert unit.read_bytes() == content
    monkeypatch.undo()
    before = unit.stat().st_ino
    run_offline(CONFIG, logs=unit.parents[2], fresh=True)
    assert unit.stat().st_ino != before
    assert unit.read_bytes() == content


def test_the_parents_of_a_domain_are_another_run(tmp_path):
    child, parent = tmp_path / "own.toml", tmp_path / "parent.toml"
    child.write_text(OWN.format(parent="parent.toml"))
    prints = set()
    for reward in (500.0, 300.0, 300.0):
        parent.write_text(f'extends = "roc36"\nreport_reward = {reward}\n')
        prints.add(fingerprint(str(child)))
    assert len(prints) == 2


def test_recordings_are_another_run(own_data):
    (file,) = (own_data.parent / f for f in ["labels.csv"])
    before, content = fingerprint(str(own_data), str(own_data.parent)), file.read_bytes()
    file.write_bytes(content + b"\n")
    changed = fingerprint(str(own_data), str(own_data.parent))
    file.write_bytes(content)
    assert changed != before
    assert fingerprint(str(own_data), str(own_data.parent)) == before


def test_public_recordings_of_ones_own_mirror_are_another_run(tmp_path):
    folder = tmp_path / "sensorimotor_features"
    folder.mkdir()
    (folder / "look.txt").write_text("1 2 3")
    before = fingerprint("roc36", str(tmp_path))
    (folder / "look.txt").write_text("1 2 4")
    assert fingerprint("roc36", str(tmp_path)) != before
    assert fingerprint("roc36") == ""


def test_versions_of_libraries_are_another_run(tmp_path, monkeypatch):
    folders = [run_folder(tmp_path, "run", CONFIG) for _ in range(2)]
    monkeypatch.setattr(store.metadata, "version", lambda name: "0.1")
    folders.append(run_folder(tmp_path, "run", CONFIG))
    assert len(set(folders)) == 2


def test_parts_do_not_run_together(tmp_path):
    (tmp_path / "a").write_text("x")
    values = [("ab", "c"), ("a", "bc"), ("abc",), ({"a": 1},), (["a", 1],), (None,), ()]
    values += [(tmp_path / "a",), (tmp_path,)]
    assert len({digest_of(*parts) for parts in values}) == len(values)
    assert digest_of({"a": 1, "b": 2}) == digest_of({"b": 2, "a": 1})


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
    monkeypatch.setattr(percepts, "load_dataset", lambda data, root: f"recordings of {data}")
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


@pytest.mark.long
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
