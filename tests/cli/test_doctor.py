"""`doctor` fits on a screen, tells what there is, and works where parts are broken."""

import json
from importlib import import_module

from meal_bayes.datasets import registry

PARTS = {"package", "system", "versions", "cache", "data", "viewer", "settings"}


def test_it_fits_on_a_screen_and_json_holds_the_same(run):
    lines = run("doctor").stdout.splitlines()
    assert len(lines) <= 40
    assert {line[2:12].strip() for line in lines} >= PARTS
    assert "meal-bayes 0." in lines[0]
    facts = json.loads(run("doctor", "--json").stdout)
    assert set(facts) == PARTS
    assert not any(text.startswith("broken") for text in facts.values())
    for name in ("roc36", "ispy32", "cy101"):
        assert f"{name} 0 of {len(registry(name))} files" in facts["data"]
    assert "does not load" not in facts["versions"]


def test_a_broken_part_is_told_and_hides_no_other(run, monkeypatch):
    def broken(name):
        if name == "rerun":
            raise ImportError("GLIBC_2.99 not found\nin this system")

    doctor = import_module("meal_bayes.cli.doctor")  # in the package it is the command's name
    monkeypatch.setattr(doctor, "import_module", broken)
    monkeypatch.setattr("meal_bayes.viewer.window.viewer_program", lambda: 1 / 0)
    facts = json.loads(run("doctor", "--json").stdout)
    assert "does not load: ImportError: GLIBC_2.99 not found in this system" in facts["versions"]
    assert facts["viewer"].startswith("broken: ZeroDivisionError")
    assert facts["system"].startswith("Python 3")


def test_folders_that_others_can_change_stand_out(run, tmp_path, monkeypatch):
    shared = tmp_path / "shared"
    shared.mkdir()
    shared.chmod(0o777)
    (tmp_path / "link").symlink_to(shared)
    monkeypatch.setenv("MEAL_BAYES_DATA_DIR", str(tmp_path / "link"))
    told = json.loads(run("doctor", "--json").stdout)["data"]
    assert told.startswith(f"{shared}, mode 0777, writable, OTHERS can write; roc36 ")
    monkeypatch.setenv("MEAL_BAYES_DATA_DIR", str(tmp_path / "new" / "data"))
    assert "can be made" in json.loads(run("doctor", "--json").stdout)["data"]


def test_passwords_in_addresses_are_not_told(run, tmp_path, monkeypatch):
    monkeypatch.setenv("MEAL_BAYES_DATA_URL", "https://me:secret@mirror/data")
    told = run("doctor").stdout
    assert list(tmp_path.iterdir()) == []  # nothing is written
    assert "secret" not in told
    assert "https://...@mirror/data" in told.replace("\n", "")
