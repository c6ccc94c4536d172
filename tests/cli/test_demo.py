"""The demo tells a trial on the real percepts, and what to do next."""

import shlex

import pytest
from click.testing import CliRunner

from meal_bayes.cli import main


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """Return what the demo prints in a terminal of 80 columns, and its folder."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("demo")
        patch.chdir(folder)
        patch.setenv("COLUMNS", "80")
        result = CliRunner().invoke(main, ["demo"])
    assert result.exit_code == 0, result.output
    return result.stdout, folder


def test_it_tells_every_part_of_a_trial(told):
    text, _ = told
    assert "\x1b" not in text
    assert max(map(len, text[: text.index("what next")].splitlines())) <= 80
    for part in (
        "Is it heavy, and does it hold beans?", "heavy_blue_beans", "before any behavior",
        "1  look", "expected reward", "report now", "failed, x", "nothing perceived",
        "percept    heavy: ", "answer     heavy, beans", "verdict    right",
    ):  # fmt: skip
        assert part in text
    assert text.count("  belief ") == text.count("  outcome ") + 1


def test_what_comes_next_works(told, run, monkeypatch):
    text, folder = told
    monkeypatch.chdir(folder)
    commands = [line.strip() for line in text.splitlines() if line.startswith("  meal-bayes ")]
    assert len(commands) == 3
    show, ask, many = (shlex.split(command)[1:] for command in commands)
    shown = run(*show)
    assert shown.exit_code == 0
    assert text[text.index("before any") : text.index("what next")].strip() in shown.stdout
    assert run(*ask, "--agent", "greedy").exit_code == 0
    few = ["2" if word == "100" else word.replace("bayes", "greedy") for word in many]
    assert run(*few).exit_code == 0
