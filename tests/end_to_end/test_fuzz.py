"""The fuzz command: finds nothing in a few inputs, and would find what it looks for."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from meal_bayes.trial_log import read_header, read_trials, write_trials

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.mark.long
def test_it_finds_nothing():
    done = subprocess.run(
        [sys.executable, os.fspath(BENCHMARKS / "fuzz.py"), "--json", "--inputs", "24",
         "--only", "log", "--only", "toml"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    facts = json.loads(done.stdout)
    assert facts["told"] == []
    assert [facts[key] for key in ("inputs", "silent", "hangs", "tracebacks", "changed")] == [
        48, 0, 0, 0, 0,
    ]  # fmt: skip
    assert 0 < facts["peak_mb"] <= 500


@pytest.fixture
def fuzz(monkeypatch):
    """The command's modules, and a tally."""
    monkeypatch.syspath_prepend(os.fspath(BENCHMARKS))
    import fuzz  # noqa: PLC0415  of that folder

    monkeypatch.setattr(fuzz, "MEMORY", float("inf"))  # of this process: other tests' too
    return fuzz, fuzz.Tally()


def test_a_wrong_result_is_counted(fuzz, tmp_path):
    module, tally = fuzz
    module.make_sound(tmp_path)
    for kind in ("log", "table", "outcomes", "csv", "toml", "pomdp"):
        sound = tmp_path / module.SOUND[kind]
        for check in module.readers(kind, sound):
            tally.run(kind, lambda check=check, sound=sound: check(sound))
    assert not tally.counts  # of what is sound, nothing is wrong
    log, other = tmp_path / module.SOUND["log"], tmp_path / "other.mcap"
    write_trials(other, list(read_trials(log))[:-1], header=read_header(log))
    tally.run("a trial less", lambda: module.readers("log", log)[0](other))
    assert tally.counts["silent"] == 1


def test_unforeseen_errors_changed_files_and_memory_are_counted(fuzz, tmp_path, monkeypatch):
    module, tally = fuzz
    tally.run("breaks", lambda: {}["key"])
    (tmp_path / "a").write_text("1")
    with module.unchanged(tmp_path, "changes", tally):
        (tmp_path / "a").write_text("2")
    monkeypatch.setattr(module, "MEMORY", 1.0)
    tally.run("takes", lambda: None)
    assert tally.counts == {"tracebacks": 1, "changed": 1, "memory": 1}
    assert "KeyError" in tally.told[0]
