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
    assert facts["inputs"] == 48
    assert {facts[key] for key in ("silent", "hangs", "tracebacks", "changed")} == {0}
    assert 0 < facts["peak_mb"] <= 500


@pytest.fixture
def fuzz(monkeypatch):
    """The command's module, and a tally."""
    import fuzz  # noqa: PLC0415  of the benchmarks

    monkeypatch.setattr(fuzz, "MEMORY", float("inf"))  # of this process: other tests' too
    return fuzz, fuzz.Tally()


def test_a_wrong_result_is_counted(fuzz, tmp_path):
    module, tally = fuzz
    module.make_sound(tmp_path)
    for kind, name in module.FILES.items():
        for reading in module.readings(kind, tmp_path / name):
            tally.run(kind, reading, tmp_path / name)
    assert not tally.counts  # of what is sound, nothing is wrong
    log, other = tmp_path / module.FILES["log"], tmp_path / "other.mcap"
    write_trials(other, list(read_trials(log))[:-1], header=read_header(log))
    tally.run("a trial less", module.readings("log", log)[0], other)
    assert tally.counts == {"silent": 1}


def test_an_unforeseen_error_a_changed_file_and_memory_are_counted(fuzz, tmp_path, monkeypatch):
    module, tally = fuzz
    (path := tmp_path / "a").write_text("1")
    tally.run("breaks", lambda _: {}["key"], path)
    tally.run("changes", lambda path: path.write_text("2"), path)
    monkeypatch.setattr(module, "MEMORY", 1.0)
    tally.run("takes", lambda _: None, path)
    assert tally.counts == {"tracebacks": 1, "changed": 1, "memory": 1}
    assert "KeyError" in tally.told[0]
