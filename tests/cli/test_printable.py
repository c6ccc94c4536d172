"""Names that would command the terminal: shown, not sent, wherever they come from."""

import dataclasses
import io

import pytest

from meal_bayes.cli.console import note, output
from meal_bayes.cli.narration import print_trial
from meal_bayes.learner.api import ask
from meal_bayes.trial_log import write_trials

ESCAPE = "\x1b]0;owned\x07\x9b31m\N{RIGHT-TO-LEFT OVERRIDE}"
SHOWN = "\N{SYMBOL FOR ESCAPE}]0;owned"  # rich takes the bell out


def safe(text):
    return all(sign.isprintable() or sign == "\n" for sign in text)


@pytest.fixture
def strange(table):
    """A trial about an object of a strange name."""
    name = f"red_mug{ESCAPE}"
    made = dataclasses.replace(table, objects=(name, *table.objects[1:]))
    return ask("red", dataset=made, object=name, agent="greedy")


def test_a_log_s_names_are_shown(run, strange, tmp_path):
    write_trials(tmp_path / "a.mcap", [strange], header={f"x{ESCAPE}": ESCAPE})
    for command in ("show", "info"):
        result = run("log", command, "a.mcap")
        assert result.exit_code == 0
        assert safe(result.output)
        assert SHOWN in result.stdout


def test_errors_and_paths_are_shown(run, tmp_path):
    (tmp_path / f"a{ESCAPE}.mcap").write_bytes(b"")
    for words in (("log", "check"), ("report",), ("data", "list")):
        result = run(*words, f"a{ESCAPE}.mcap")
        assert result.exit_code in (1, 2)
        assert safe(result.output)
        assert "\N{SYMBOL FOR ESCAPE}" in result.output or "\\x1b" in result.output


def test_the_console_keeps_its_own_styles(strange):
    console = output()
    console.file, console._force_terminal, console._color_system = io.StringIO(), True, None
    print_trial(console, strange)
    text = console.file.getvalue()
    assert "\x1b]0;owned" not in text
    assert "\N{RIGHT-TO-LEFT OVERRIDE}" not in text


def test_notes_are_shown(capsys):
    note(f"warning: {ESCAPE}")
    shown = capsys.readouterr().err
    assert safe(shown)
    assert SHOWN in shown
