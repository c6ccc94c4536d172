"""Streams, places and settings that are not what a program hopes for: a result or one line."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import meal_bayes

ROOT = Path(meal_bayes.__file__).resolve().parents[1]
SAMPLE = Path(__file__).resolve().parents[2] / "logs" / "sample.mcap"
LIST = ("data", "list", "roc36")
SHOW = ("log", "show", str(SAMPLE))

# Variables, command, redirections, and what is said of a failure; "" where there is none.
CASES = {
    "HOME that is not there": ({"HOME": "/nowhere"}, LIST, "", ""),
    "ascii, strict": ({"PYTHONIOENCODING": "ascii:strict"}, SHOW, "", ""),
    "stdin and stderr closed": ({}, LIST, "<&- 2>&-", ""),
    "stdout closed": ({}, LIST, ">&-", "output is closed"),
    "stdout full": ({}, LIST, ">/dev/full", "No space left on device"),
    "report into /proc": ({}, ("report", str(SAMPLE), "-o", "/proc/a.html"), "", "be written"),
    "not UTF-8": ({}, ("log", "check", os.fsdecode(b"caf\xe9")), "", "no log caf"),
}


@pytest.mark.parametrize("name", CASES)
def test_a_result_or_one_line(name, tmp_path):
    variables, arguments, redirections, said = CASES[name]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "MEAL_BAYES_OFFLINE": "1", **variables}
    script = f'exec "$0" -m meal_bayes "$@" {redirections}'
    command = ["/bin/sh", "-c", script, sys.executable, *arguments]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, check=False)
    assert b"Traceback" not in done.stderr
    if said:
        assert done.returncode in (1, 2)
        (line,) = done.stderr.decode().splitlines()
        assert line.startswith("error: ")
        assert said in line
    else:
        assert done.returncode == 0, done.stderr
        assert done.stdout
