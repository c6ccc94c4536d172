"""What names a run's folder, and when a unit of it is done."""

import pytest

from meal_bayes.experiments import OfflineConfig, run_offline, store
from meal_bayes.experiments.store import is_finished, run_folder

CONFIG = OfflineConfig("roc36", 2, 3, ("random",), seed=5)


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
    assert not is_finished(unit)
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


def test_versions_of_libraries_are_another_run(tmp_path, monkeypatch):
    folders = [run_folder(tmp_path, "run", CONFIG) for _ in range(2)]
    monkeypatch.setattr(store, "environment", lambda: {"numpy": "0.1"})
    folders.append(run_folder(tmp_path, "run", CONFIG))
    assert len(set(folders)) == 2
