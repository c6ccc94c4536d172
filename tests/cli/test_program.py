"""The program as a whole: quick to start, quiet to end, every failure one line that teaches."""

import os
import re
import signal
import subprocess
import sys

import click
import pytest

import meal_bayes
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


def test_help_names_the_agents_that_exist():
    shown = re.findall(r"\w+", f"{options.AGENTS} {options.ONLINE_AGENTS}")
    assert set(shown) - {"or"} == set(AGENTS)


def test_version(run):
    assert run("--version").stdout == f"meal-bayes {meal_bayes.__version__}\n"


@pytest.mark.parametrize(
    ("arguments", "found"),
    [
        (("run", "offlin"), "No such command 'offlin'"),
        (("ask", "heavy"), "Missing option '--object'"),
        (("run", "offline", "--percepts", "mod"), "'mod' is not one of 'recorded', 'model'"),
    ],
)
def test_usage_errors_point_to_the_help(fails, arguments, found):
    told = fails(*arguments)
    assert found in told
    assert "Try: " in told
    assert told.endswith(" --help\n")


@pytest.mark.parametrize(
    ("arguments", "found"),
    [
        (("ask", "heavy", "--object", "heavy_blue_bean"), "did you mean 'heavy_blue_beans'"),
        (("ask", "heavvy", "--object", "heavy_blue_beans"), "did you mean 'heavy'"),
        ((*ASK[:-1], "greedo"), "did you mean 'greedy'"),
        ((*ASK, "--dataset", "toy"), "give the path of its TOML"),
        ((*ASK, "--dataset", "none.npz"), "No file none.npz"),
        (("run", "offline", "--agent", "greedy,greedy"), "named twice"),
        (("run", "offline", "--attributes", "11"), "give a number from 1 to 10"),
        (("data", "fetch", "rock36"), "did you mean 'roc36'"),
        (("log", "info", "none.mcap"), "no log none.mcap"),
    ],
)
def test_bad_input_is_told_with_the_way_out(fails, arguments, found):
    assert found in fails(*arguments)


def test_what_nobody_foresaw_is_not_hidden():
    @click.group(cls=Program)
    def broken() -> None:
        pass

    @broken.command()
    def now() -> None:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        broken(["now"])


def test_a_reader_that_goes_away_ends_it_quietly(start):
    with start("data", "list", "cy101") as process:
        process.stdout.close()
        told = process.stderr.read()
    assert process.returncode == 130
    assert told == ""


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
