"""The program as a whole: quick to start, quiet to end, every failure one line; `doctor`."""

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import click
import pytest

import meal_bayes
from meal_bayes import untrusted
from meal_bayes.agents import AGENTS
from meal_bayes.cli import main, options
from meal_bayes.cli.program import Program

ASK = ("ask", "heavy", "--object", "heavy_blue_beans", "--agent", "greedy")


def test_help_loads_no_numeric_library():
    code = (
        "import sys\nfrom meal_bayes.cli import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit:\n    pass\n"
        "print(sorted({'numpy', 'scipy', 'numba', 'mcap', 'sklearn'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
    assert (options.LARGEST, options.NAME_LIMIT) == (untrusted.LARGEST, untrusted.NAME_LIMIT)


def commands(group, path=()):
    for name, command in group.commands.items():
        yield (*path, name), command
        if isinstance(command, click.Group):
            yield from commands(command, (*path, name))


def test_every_command_has_help_and_short_helps_fit_in_their_line(run):
    for path, command in [((), main), *commands(main)]:
        lines = run(*path, "--help").stdout.splitlines()
        assert " ".join(path) in lines[0]
        assert max(map(len, lines)) <= 80
        if isinstance(command, click.Group):
            assert "..." not in run(*path).stdout.split("Commands:")[1]


@pytest.mark.long
@pytest.mark.parametrize("words", [(), ("log",), ("run", "offline")])
def test_help_is_there_where_docstrings_are_not(words):
    """`python -OO` takes docstrings away."""
    helps = [
        subprocess.run(
            [sys.executable, *flags, "-m", "meal_bayes", *words, "--help"],
            capture_output=True, text=True, check=True,
        ).stdout
        for flags in ([], ["-OO"])
    ]  # fmt: skip
    assert helps[0] == helps[1]
    assert len(helps[0].splitlines()) > 10


def test_help_names_the_agents_that_exist():
    shown = re.findall(r"\w+", f"{options.AGENTS} {options.ONLINE_AGENTS}")
    assert set(shown) - {"or"} == set(AGENTS)


def test_version(run):
    assert run("--version").stdout == f"meal-bayes {meal_bayes.__version__}\n"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("run", "offlin"), "No such command 'offlin'"),
        (("ask", "heavy"), "Missing option '--object'"),
        (("run", "offline", "--percepts", "mod"), "'mod' is not one of 'recorded', 'model'"),
    ],
)
def test_usage_errors_point_to_the_help(fails, arguments, message):
    told = fails(*arguments)
    assert message in told
    assert "Try: " in told
    assert told.endswith(" --help\n")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((*ASK, "--dataset", "toy"), "give the path of its TOML"),
        ((*ASK, "--dataset", "none.npz"), "No file none.npz"),
        (("run", "offline", "--agent", "greedy,greedy"), "listed twice"),
        (("run", "offline", "--attributes", "11"), "give a number from 1 to 10"),
        (("data", "fetch", "rock36"), "did you mean 'roc36'"),
        (("log", "info", "none.mcap"), "no log none.mcap"),
    ],
)
def test_bad_input_is_told_with_the_way_out(fails, arguments, message):
    assert message in fails(*arguments)


def test_what_nobody_foresaw_is_not_hidden():
    @click.group(cls=Program)
    def broken() -> None:
        pass

    @broken.command()
    def now() -> None:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        broken(["now"])


@pytest.mark.long
def test_a_reader_that_goes_away_ends_it_quietly(start):
    with start("data", "list", "cy101") as process:
        process.stdout.close()
        told = process.stderr.read()
    assert process.returncode == 130
    assert told == ""


@pytest.mark.long
def test_ctrl_c_ends_it_quietly_and_says_how_to_go_on(start, tmp_path, eventually):
    process = start("run", "offline", "--trials", "20000", "--agent", "random_legal", "--jobs", "1")
    eventually(lambda: list(tmp_path.rglob("unit-0000.mcap")), "no first unit")
    os.killpg(process.pid, signal.SIGINT)
    out, told = process.communicate(timeout=600)
    assert process.returncode == 130
    assert out == ""
    assert "trials are kept; the same command goes on from there" in told
    assert "Traceback" not in told


def test_the_module_is_the_command(start):
    assert "Start with: meal-bayes demo" in start("--help").communicate(timeout=600)[0]


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


@pytest.mark.long
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


PARTS = {"package", "system", "versions", "cache", "data", "viewer"}


def test_it_fits_on_a_screen_and_json_holds_the_same(run):
    lines = run("doctor").stdout.splitlines()
    assert len(lines) <= 40
    assert {line[2:12].strip() for line in lines} >= PARTS
    assert "meal-bayes 0." in lines[0]
    facts = json.loads(run("doctor", "--json").stdout)
    assert set(facts) == PARTS
    assert not any(text.startswith("broken") for text in facts.values())


def test_a_broken_part_is_told_and_hides_no_other(run, monkeypatch):
    monkeypatch.setattr("meal_bayes.viewer.window.viewer_program", lambda: 1 / 0)
    facts = json.loads(run("doctor", "--json").stdout)
    assert facts["viewer"].startswith("broken: ZeroDivisionError")
    assert facts["system"].startswith("Python 3")


def test_the_shell_completes_commands_and_options():
    """As docs/how-to/command-line.md says."""
    words = {"COMP_WORDS": "meal-bayes run offline --attr", "COMP_CWORD": "3"}
    for start, expected in ((words, "--attributes"), ({"COMP_WORDS": "meal-bayes f"}, "find")):
        setting = {"COMP_CWORD": "1", **start, "_MEAL_BAYES_COMPLETE": "bash_complete"}
        code = "import sys; sys.argv[0] = 'meal-bayes'; from meal_bayes.cli import main; main()"
        done = subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, **setting},
            capture_output=True,
            text=True,
            check=True,
        )
        assert done.stdout.split() == [f"plain,{expected}"]


MODULES = {  # what a module of the user's executes, and how the fault is told
    "1 / 0": "ZeroDivisionError: division by zero (",
    "raise SystemExit(7)": "SystemExit: 7 (",
    "raise KeyError('x')": "KeyError: 'x' (",
    "raise ValueError": "raised ValueError (",
    "raise RuntimeError('a\\n  b\\x1b[2J')": "RuntimeError: a b",
    "def (": "SyntaxError: invalid syntax (faulty_module.py, line 1)",
    "import json\njson.loads('{')": "faulty_module.py, line 2)",
    "def __getattr__(name):\n    raise OSError(name)": "OSError: value (",
    "x = 1": "Unknown name in faulty_module 'value'",
}


@pytest.mark.parametrize("code", MODULES)
@pytest.mark.parametrize(
    "words",
    [
        (*ASK[:-1], "{}"),
        ("run", "offline", "--agent", "{}"),
        ("run", "online", "--agent", "{}"),
        ("find", "heavy", "--objects", "a", "--agent", "{}"),
        ("data", "percepts", "--dataset", "roc36", "--classifier", "{}"),
        ("data", "import", "bag", "--domain", "toy", "--markers", "/m", "--out", "o", "--feature",
         "f={}"),
    ],
    ids=lambda words: " ".join(words[:2]),
)  # fmt: skip
def test_a_module_that_raises_is_one_line(words, code, fails, tmp_path, monkeypatch):
    (tmp_path / "faulty_module.py").write_text(code)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "faulty_module", raising=False)
    told = fails(*(word.format("faulty_module:value") for word in words))
    assert MODULES[code] in told
    assert told.count("\n") == 1


def test_a_warning_of_the_package_is_one_line(kitchen):
    """The place in the package's code that warns tells a user of the command line nothing."""
    look = kitchen / "look_color.csv"
    whole = look.read_text()
    (kitchen / "look_depth.csv").write_text(whole)
    head, first, *rest = whole.splitlines()
    name, number, *cells = first.split(",")
    look.write_text("\n".join([head, ",".join([name, number, *("" for _ in cells)]), *rest]))
    domain = kitchen / "kitchen.toml"
    domain.write_text(domain.read_text().replace('["color"]', '["color", "depth"]'))
    done = subprocess.run(
        [sys.executable, "-m", "meal_bayes", "data", "list", domain.name, "--root", "."],
        cwd=kitchen, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stderr.startswith("warning: Recordings of look are left out, as color is missing")
    assert done.stderr.count("\n") == 1
