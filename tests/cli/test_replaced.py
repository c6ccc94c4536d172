"""A command that writes a file says when one was there: it replaces it, or leaves it."""

from pathlib import Path

import click
import pytest

from meal_bayes.cli import main
from meal_bayes.files import write_whole

LOGGED = Path("logs")
WORDS = {  # of each option or argument that names a file to write
    "report out": ("report", LOGGED, "-o", "new.html"),
    "view save": ("view", LOGGED, "--save", "new.rrd"),
    "view screenshot": ("view", LOGGED, "--screenshot", "new.png"),
    "log show picture": ("log", "show", LOGGED, "--picture", "new.svg"),
    "export file": ("export", "--query", "red", "--dataset", "kitchen.npz", "new.pomdp"),
    "data percepts out": ("data", "percepts", "--out", "new.npz", "--dataset"),
}
KEPT = "log recover out"  # which refuses, as `test_log.py` shows
NEEDS = {"view screenshot": "vulkan", "data percepts out": "own_data"}
ELSEWHERE = {"data import labels", "data show out"}  # an input; needs a bag, see `test_bags.py`
LONG = {"view screenshot"}


def outputs(command, path=()):
    """Yield what names a file to write, of a command and those in it."""
    for parameter in command.params:
        kind = parameter.type
        if isinstance(kind, click.Path) and kind.file_okay and not (kind.dir_okay or kind.exists):
            yield " ".join((*path, parameter.name))
    if isinstance(command, click.Group):
        for name, inner in command.commands.items():
            yield from outputs(inner, (*path, name))


def test_every_output_is_tested():
    assert {*outputs(main)} - ELSEWHERE == {*WORDS, KEPT}


@pytest.mark.parametrize(
    "output", [pytest.param(name, marks=[pytest.mark.long] * (name in LONG)) for name in WORDS]
)
@pytest.mark.usefixtures("table")
def test_a_file_that_is_replaced_is_named(run, request, output):
    words = list(WORDS[output])
    needed = NEEDS.get(output)
    value = request.getfixturevalue(needed) if needed else None
    if needed == "own_data":
        words += [value, "--root", value.parent]
    (new,) = (word for word in words if str(word).startswith("new"))
    asked = ("Is it red?", "--dataset", "kitchen.npz", "--object", "red_mug", "--agent", "greedy")
    run("ask", *asked, "--logs", LOGGED)
    first = run(*words)
    assert first.exit_code == 0, first.stderr
    assert "is replaced" not in first.stderr
    Path(new).write_text("mine", encoding="utf-8")
    again = run(*words)
    assert again.exit_code == 0, again.stderr
    assert again.stderr.count(f"{new} was there, and is replaced\n") == 1
    assert Path(new).read_bytes() != b"mine"


def test_programs_find_it_in_the_log(tmp_path, caplog):
    """What is expected there, as a learner's own file, is none of it."""
    caplog.set_level("INFO", "meal_bayes.files")
    for expected in (False, True):
        write_whole(tmp_path / "file", "text", expected=expected)
    assert not caplog.messages
    write_whole(tmp_path / "file", "text")
    assert caplog.messages == [f"{tmp_path / 'file'} was there, and is replaced"]
