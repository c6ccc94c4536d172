"""A trial as text: every outcome has its own, on every terminal, which no name commands."""

import dataclasses
import html
import io
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from meal_bayes.cli.console import note, output, print_facts
from meal_bayes.cli.narration import print_answer, print_trial
from meal_bayes.domain import Query, load_domain
from meal_bayes.evaluation.report import write_report
from meal_bayes.learner import ask
from meal_bayes.momdp import build_momdp, initial_belief, with_joint_prior
from meal_bayes.planners import unvalued
from meal_bayes.trial_log import Logs, write_trials
from meal_bayes.trials import Step
from meal_bayes.trials.text import outcome_text, percept_labels, together_text
from meal_bayes.viewer.labels import explain_decision, narrate
from meal_bayes.viewer.recorder import Clock


def console(width=80):
    return Console(file=io.StringIO(), width=width, markup=False)


def printed(terminal):
    return terminal.file.getvalue()


@pytest.fixture
def momdp():
    domain = load_domain("toy")
    rows = np.tile([[0.9, 0.1], [0.2, 0.8]], (2, 3, 1, 1))
    return build_momdp(domain, Query(("red", "heavy")), rows, limit=2)


def step(momdp, action, x, next_x, observation=None, seen=0):
    belief = initial_belief(momdp)
    counts = belief.percept_counts.copy()
    counts[:, action, 0] = seen
    after = replace(belief, x=next_x, percept_counts=counts)
    return Step(x, unvalued(momdp, action), next_x, observation, 1.0, -1.0, after)


def test_a_joint_prior_is_told(momdp):
    assert together_text(momdp) == ""
    joint = with_joint_prior(momdp, [0.25, 0.4, 0.35, 0.0])
    assert together_text(joint) == "both red and heavy 0.0 %, if independent 14.0 %"
    even = with_joint_prior(momdp, [0.25, 0.25, 0.25, 0.25])
    assert together_text(even) == ""


def test_every_outcome_has_its_words(momdp):
    """States by their labels, by their names where they have none."""
    look, lift, reinit = range(3)
    yes = np.array([1, 0], np.int8)
    unnamed = replace(momdp, x_labels=())
    for problem, table, hand in ((momdp, "on the table", "in hand"), (unnamed, "x0", "x1")):
        for expected, (action, x, next_x, *percept) in (
            (f"succeeded, {table} → {table}", (look, 0, 0, yes, 1)),
            (f"failed, {table} → {table}; nothing perceived", (lift, 0, 0)),
            (f"{table} → {table}, but no recording is left to replay", (look, 0, 0, None, 2)),
            (f"succeeded, {hand} → {table}; it shows nothing", (reinit, 1, 0)),
            (f"failed, {hand} → {hand}", (reinit, 1, 1)),
        ):
            assert outcome_text(problem, step(problem, action, x, next_x, *percept)) == expected
    assert percept_labels(momdp, look, yes) == ["yes", "no"]


def test_a_percept_without_information_says_nothing(momdp):
    rows = np.array(momdp.confusion)
    rows[1, 0] = 0.5  # of heavy, look tells nothing
    silent = replace(momdp, confusion=rows)
    assert percept_labels(silent, 0, np.array([1, 0])) == ["yes", "says nothing"]
    assert percept_labels(silent, 1, np.array([1, 0])) == ["yes", "no"]


@pytest.mark.parametrize(
    ("levels", "percept", "words"),
    [
        (4, [3, 0], "surely red"),
        (4, [1, 1], "none of them"),
        (4, [0, 1], "surely not red"),
        (8, [5, 2], "red (level 5)"),
        (8, [1, 3], "not red (level 1)"),
    ],
)
def test_a_group_is_spoken_of_at_every_number_of_levels(levels, percept, words):
    domain = replace(load_domain("toy"), groups={"kind": ("red", "heavy")})
    likely_if_true = np.arange(1, levels + 1) / np.arange(1, levels + 1).sum()
    rows = np.tile([likely_if_true[::-1], likely_if_true], (2, 3, 1, 1))
    momdp = build_momdp(domain, Query(("red", "heavy"), ((0, 1),), ("kind",)), rows, limit=2)
    assert percept_labels(momdp, 0, np.array(percept)) == [words]


@pytest.mark.parametrize("agent", ["greedy", "random"])
def test_a_trial_fits_in_80_columns(agent):
    trial = ask("heavy, beans", dataset="roc36", object="heavy_blue_beans", agent=agent)
    terminal = console()
    print_trial(terminal, trial)
    print_answer(terminal, trial)
    text = printed(terminal)
    assert text.count("answer ") == 2
    assert ("compares nothing" in text) == (agent != "greedy")
    assert "\N{FULL BLOCK}" * 15 + "\N{LIGHT SHADE}" * 15 + "  50.0 %" in text
    assert max(map(len, text.splitlines())) <= 80


def test_labels_are_dim_and_what_they_say_is_not():
    trial = ask("heavy, beans", dataset="roc36", object="heavy_blue_beans", agent="greedy")
    terminal = Console(file=io.StringIO(), width=80, markup=False, record=True)
    print_trial(terminal, trial)
    dim = []
    said = []
    for segment in terminal._record_buffer:
        is_dim = segment.style is not None and segment.style.dim
        (dim if is_dim else said).append(segment.text.strip())
    assert sum(map(len, dim)) < (sum(map(len, dim)) + sum(map(len, said))) / 3
    bright = " ".join(said)
    for words in (
        "heavy, beans",
        "right",
        f"reward {trial.reward:.1f}",
        "succeeded, at rest",
        ">99.9 %",
    ):
        assert words in bright


@pytest.mark.long
def test_every_surface_has_the_same_words_for_percepts(tmp_path):
    trial = ask("heavy, blue", dataset="roc36", object="heavy_blue_beans", agent="greedy")
    blind = replace(trial, momdp=replace(trial.momdp, confusion=np.full_like(
        trial.momdp.confusion, 1 / trial.momdp.levels)))  # fmt: skip
    for shown in (trial, blind):
        terminal = console()
        print_trial(terminal, shown)
        write_trials(tmp_path / "a.mcap", [shown], header={})
        write_report(Logs(tmp_path), tmp_path / "a.html")
        page = html.unescape((tmp_path / "a.html").read_text())
        viewer = "".join(map(narrate, Clock().frames(0, shown)))
        for step in shown.steps[:-1]:
            if step.observation is None:
                continue
            words = percept_labels(shown.momdp, step.decision.action, step.observation)
            assert f"heavy: {words[0]}, blue: {words[1]}" in printed(terminal)
            assert ", ".join(words) in shown._repr_html_()
            assert all(f">{word}, " in page for word in words)
            assert f"|{words[0]}|" in viewer
        (tmp_path / "a.mcap").unlink()
    assert ">says nothing, " in page


def test_certainty_is_never_claimed_and_a_trial_without_a_report_is_printed():
    trial = ask("heavy", dataset="roc36", object="heavy_blue_beans", agent="predefined_plus")
    assert trial.last_belief.positive[0] > 0.9995
    terminal = console()
    print_answer(terminal, trial)
    print_trial(terminal, replace(trial, report=None))
    assert ">99.9 %" in printed(terminal)
    assert "100.0" not in printed(terminal)
    assert "I do not know" in printed(terminal)
    assert printed(terminal).count("verdict") == 1


def test_long_facts_wrap_beside_their_label():
    terminal = console(width=40)
    print_facts(terminal, {"label": "word " * 20, "other": "one\ntwo"})
    lines = printed(terminal).splitlines()
    assert max(map(len, lines)) <= 40
    assert lines[1].startswith(" " * 13 + "word")
    assert lines[-1] == " " * 13 + "two"


def test_how_far_a_decision_may_be_from_the_best_is_shown_where_it_is_known():
    trial = ask("heavy", dataset="roc36", object="heavy_blue_beans", agent="greedy")
    first = trial.steps[0]
    bounded = replace(first, decision=replace(first.decision, gap=1.25))
    for shown, number in ((trial, 0), (replace(trial, steps=(bounded, *trial.steps[1:])), 1)):
        terminal = console()
        print_trial(terminal, shown)
        assert printed(terminal).count("at most 1.2 below the best") == number
        texts = map(explain_decision, Clock().frames(0, shown))
        assert sum("at most 1.2 below the best" in text for text in texts) == number
        assert shown.to_frame()["gap"].notna().sum() == number


ESCAPE = "\x1b]0;owned\x07\x9b31m\N{RIGHT-TO-LEFT OVERRIDE}"
SHOWN = "\N{SYMBOL FOR ESCAPE}]0;owned"  # rich takes the bell out


def safe(text):
    return all(sign.isprintable() or sign == "\n" for sign in text)


@pytest.fixture
def strange(table):
    """A trial whose object's name turns text round, and whose agent's has control characters."""
    name = "red_mug\N{RIGHT-TO-LEFT OVERRIDE}"
    made = dataclasses.replace(table, objects=(name, *table.objects[1:]))
    return replace(ask("red", dataset=made, object=name, agent="greedy"), agent=f"a{ESCAPE}")


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
    console.file = io.StringIO()
    console._force_terminal = True
    console._color_system = None
    print_trial(console, strange)
    text = console.file.getvalue()
    assert "\x1b]0;owned" not in text
    assert "\N{RIGHT-TO-LEFT OVERRIDE}" not in text


def test_notes_are_shown(capsys):
    note(f"warning: {ESCAPE}")
    shown = capsys.readouterr().err
    assert safe(shown)
    assert SHOWN in shown
