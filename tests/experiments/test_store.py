"""What names a run's folder, and when a unit of it counts as done."""

import pytest

from meal_bayes.experiments import OfflineConfig, run_offline, store
from meal_bayes.experiments.store import digest_of, fingerprint, is_whole, run_folder

CONFIG = OfflineConfig("roc36", 2, 3, ("random",), seed=5)
OWN = 'extends = "{parent}"\nname = "own"\ndata = "roc36"\n'


@pytest.fixture(scope="module")
def unit(tmp_path_factory):
    """A finished unit."""
    (path,) = run_offline(CONFIG, logs=tmp_path_factory.mktemp("logs")).paths
    return path


@pytest.fixture
def kept(unit):
    """Its content, which is put back when the test is over."""
    content = unit.read_bytes()
    yield content
    unit.write_bytes(content)


@pytest.mark.parametrize("damage", ["flipped", "torn", "text"])
def test_a_damaged_unit_is_made_again(unit, kept, damage, caplog):
    flipped = bytearray(kept)
    flipped[len(kept) // 2] ^= 1
    unit.write_bytes({"flipped": flipped, "torn": kept[:-10], "text": b"hello"}[damage])
    assert not is_whole(unit)
    assert "it is made again" in caplog.text
    run_offline(CONFIG, logs=unit.parents[2])
    assert unit.read_bytes() == kept


def test_a_unit_of_fewer_trials_is_made_again(unit, kept, caplog):
    assert is_whole(unit, trials=3)
    assert not is_whole(unit, trials=4)
    assert "holds 3 trials, expected 4" in caplog.text


def test_fresh_replaces_and_never_deletes(unit, kept, monkeypatch):
    """As when it is killed before it has made anything."""

    def killed(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr("meal_bayes.experiments.offline.Learner", killed)
    with pytest.raises(KeyboardInterrupt):
        run_offline(CONFIG, logs=unit.parents[2], fresh=True)
    assert unit.read_bytes() == kept
    monkeypatch.undo()
    before = unit.stat().st_ino
    run_offline(CONFIG, logs=unit.parents[2], fresh=True)
    assert unit.stat().st_ino != before
    assert unit.read_bytes() == kept


def test_the_parents_of_a_domain_are_another_run(tmp_path):
    child, parent = tmp_path / "own.toml", tmp_path / "parent.toml"
    child.write_text(OWN.format(parent="parent.toml"))
    found = set()
    for reward in (500.0, 300.0, 300.0):
        parent.write_text(f'extends = "roc36"\nreport_reward = {reward}\n')
        found.add(fingerprint(str(child)))
    assert len(found) == 2


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
    folders = [run_folder(tmp_path, "run", {"seed": 1}) for _ in range(2)]
    monkeypatch.setattr(store.metadata, "version", lambda name: "0.1")
    folders.append(run_folder(tmp_path, "run", {"seed": 1}))
    assert len(set(folders)) == 2


def test_parts_do_not_run_together(tmp_path):
    (tmp_path / "a").write_text("x")
    values = [("ab", "c"), ("a", "bc"), ("abc",), ({"a": 1},), (["a", 1],), (None,), ()]
    values += [(tmp_path / "a",), (tmp_path,)]
    assert len({digest_of(*parts) for parts in values}) == len(values)
    assert digest_of({"a": 1, "b": 2}) == digest_of({"b": 2, "a": 1})
