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
ASK = ("ask", "heavy", "--object", "heavy_blue_beans", "--agent", "greedy")
SHOW = ("log", "show", str(SAMPLE))
DOCTOR = ("doctor",)

# Those tried by default, one of each sort; the others are `long`.
QUICK = {
    "no HOME", "HOME that is not there", "LANG C", "ascii, strict", "COLUMNS 1",
    "stdin closed", "stderr closed", "stdout closed", "stdout full", "logs in /proc",
    "no such mode",
}  # fmt: skip
# Variables, command, redirections, exit code, what is told. A None takes a variable away.
GOOD = {
    "no HOME": ({"HOME": None}, LIST, ""),
    "HOME that is not there": ({"HOME": "/nowhere"}, LIST, ""),
    "HOME without rights": ({"HOME": "/proc"}, ASK, ""),
    "TERM dumb": ({"TERM": "dumb"}, LIST, ""),
    "no TERM": ({"TERM": None}, LIST, ""),
    "TERM unknown": ({"TERM": "nonsense"}, LIST, ""),
    "LANG C": ({"LANG": "C", "LC_ALL": "C", "PYTHONUTF8": "0"}, SHOW, ""),
    "POSIX, no coercion": (
        {"LC_ALL": "POSIX", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"},
        SHOW,
        "",
    ),
    "LANG that is not installed": ({"LANG": "xx_YY.UTF-8", "LC_ALL": "xx_YY.UTF-8"}, LIST, ""),
    "latin-1": ({"PYTHONIOENCODING": "latin-1"}, LIST, ""),
    "ascii": ({"PYTHONIOENCODING": "ascii"}, SHOW, ""),
    "ascii, strict": ({"PYTHONIOENCODING": "ascii:strict"}, LIST, ""),
    "utf-16": ({"PYTHONIOENCODING": "utf-16"}, LIST, ""),
    "COLUMNS 0": ({"COLUMNS": "0"}, SHOW, ""),
    "COLUMNS 1": ({"COLUMNS": "1"}, LIST, ""),
    "COLUMNS negative": ({"COLUMNS": "-5"}, LIST, ""),
    "COLUMNS no number": ({"COLUMNS": "wide"}, LIST, ""),
    "COLUMNS huge": ({"COLUMNS": "100000"}, LIST, ""),
    "LINES 0": ({"LINES": "0"}, LIST, ""),
    "color forced": ({"FORCE_COLOR": "1"}, LIST, ""),
    "no color": ({"NO_COLOR": "1"}, LIST, ""),
    "TMPDIR that is not there": ({"TMPDIR": "/nowhere"}, LIST, ""),
    "TMPDIR without rights": ({"TMPDIR": "/proc"}, LIST, ""),
    "TZ nonsense": ({"TZ": "Mars/Olympus"}, LIST, ""),
    "no PATH": ({"PATH": ""}, DOCTOR, ""),
    "proxies": ({"http_proxy": "nonsense", "https_proxy": "x"}, LIST, ""),
    "offline said oddly": ({"MEAL_BAYES_OFFLINE": "maybe"}, LIST, ""),
    "data folder is a file": ({"MEAL_BAYES_DATA_DIR": str(SAMPLE)}, DOCTOR, ""),
    "stdin closed": ({}, LIST, "<&-"),
    "nobody to answer": ({}, (*ASK, "--learn"), "<&-"),
    "stderr closed": ({}, LIST, "2>&-"),
    "stdin and stderr closed": ({}, ASK, "<&- 2>&-"),
    "stderr full": ({}, ASK, "2>/dev/full"),
}
BAD = {
    "stdout closed": ({}, LIST, ">&-", 1, "output is closed"),
    "stdout closed, ask": ({}, ASK, ">&-", 1, "output is closed"),
    "all closed but stderr": ({}, LIST, "<&- >&-", 1, "output is closed"),
    "stdout full": ({}, LIST, ">/dev/full", 1, "No space left on device"),
    "stdout full, json": ({}, (*LIST, "--json"), ">/dev/full", 1, "No space left on device"),
    "cache is a file": (
        {
            "MEAL_BAYES_DATA_DIR": str(SAMPLE),
            "MEAL_BAYES_DATA_URL": "/nowhere",
            "MEAL_BAYES_OFFLINE": None,
        },
        ("data", "fetch", "roc36"),
        "",
        1,
        "MEAL_BAYES_DATA_DIR",
    ),
    "mirror that is not there": (
        {"MEAL_BAYES_DATA_URL": "/nowhere", "MEAL_BAYES_OFFLINE": None},
        ("data", "fetch", "roc36"),
        "",
        1,
        "set MEAL_BAYES_DATA_URL",
    ),
    "logs in /proc": ({}, (*ASK, "--logs", "/proc/logs"), "", None, "cannot be written"),
    "report into /proc": (
        {},
        ("report", str(SAMPLE), "-o", "/proc/a.html"),
        "",
        1,
        "/proc cannot be written",
    ),
    "no such mode": ({}, ("fly",), "", 2, "No such command"),
}


def shell(folder, variables, arguments, redirections, before=""):
    """Run a command line in a shell, which can close streams."""
    paths = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    given = {
        "PYTHONPATH": paths,
        "MEAL_BAYES_OFFLINE": "1",
        "MEAL_BAYES_DATA_DIR": str(folder / "c"),
    }
    merged = {**os.environ, **given, **variables}
    environment = {name: value for name, value in merged.items() if value is not None}
    script = f'{before} exec "$0" -m meal_bayes "$@" {redirections}'
    return subprocess.run(
        ["/bin/sh", "-c", script, sys.executable, *arguments],
        cwd=folder,
        env=environment,
        capture_output=True,
        check=False,
        timeout=300,
    )


def cases(table):
    """List the names of a table."""
    assert set(table) & QUICK
    return [pytest.param(name, marks=[pytest.mark.long] * (name not in QUICK)) for name in table]


@pytest.mark.parametrize("name", cases(GOOD))
def test_it_works_all_the_same(name, tmp_path):
    done = shell(tmp_path, *GOOD[name])
    assert (done.returncode, b"Traceback" in done.stderr) == (0, False), done.stderr
    assert done.stdout
    assert b"error" not in done.stderr.lower()


@pytest.mark.parametrize("name", cases(BAD))
def test_it_ends_with_one_line(name, tmp_path):
    *given, code, told = BAD[name]
    done = shell(tmp_path, *given)
    assert done.returncode in ((1, 2) if code is None else (code,)), done.stderr
    lines = done.stderr.decode().splitlines()
    assert [line for line in lines if not line.startswith("preparing")] == lines[-1:]
    assert lines[-1].startswith("error: ")
    assert told in lines[-1]


def test_a_folder_whose_name_is_no_text_can_be_worked_in(tmp_path):
    folder = Path(os.fsdecode(os.fsencode(tmp_path) + b"/caf\xe9"))
    folder.mkdir()
    assert shell(folder, {}, ASK, "").returncode == 0
    named = shell(folder.parent, {}, ("log", "check", os.fsdecode(b"caf\xe9")), "")
    assert named.returncode == 2
    assert b"is not UTF-8 text" in named.stderr


def test_a_folder_that_is_gone_is_told(tmp_path):
    gone = tmp_path / "gone"
    done = shell(tmp_path, {}, ASK, "", f"mkdir {gone} && cd {gone} && rmdir {gone} &&")
    assert done.returncode in (1, 2)
    _, error, said = done.stderr.partition(b"error: ")  # the interpreter may complain before
    assert error
    assert b"Traceback" not in said


@pytest.mark.long
@pytest.mark.parametrize(
    ("target", "before"),
    [
        ("a.rrd", "ulimit -f 8;"),
        ("/proc/a.rrd", ""),
        ("/proc/no/a.rrd", ""),
    ],
)
def test_a_recording_that_cannot_be_written_is_told(target, before, tmp_path):
    done = shell(tmp_path, {}, ("view", str(SAMPLE), "--save", target), "", before)
    assert done.returncode in (1, 2)
    assert done.stderr.startswith(b"error: ")
    assert done.stderr.count(b"\n") == 1
