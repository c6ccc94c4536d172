"""Options mean the same everywhere; values that none takes are told in a line, before any work."""

import itertools
import json

import click
import pytest

from meal_bayes.cli import main
from meal_bayes.cli.console import print_table

OFFLINE = ("run", "offline")
ONLINE = ("run", "online")
ASK = ("ask", "heavy", "--object", "heavy_blue_beans")
WHOLE = [
    *((OFFLINE, name) for name in ("--attributes", "--trials", "--seed", "--jobs")),
    (ONLINE, "--repeats"),
    (("posterior",), "--levels"),
    (("view", "a.mcap"), "--trial"),
]
NO_WHOLE = ("", "x", "1.5", "-1", "9" * 20)
FINITE = [(OFFLINE, "--reward"), (ONLINE, "--alpha")]
NO_FINITE = ("", "x", "nan", "inf", "-1", "0x10")
NO_SPLIT = ("", "a b c", "0 1 1", "-1 1 1", "1.5 1 1")
CASES = [
    *((*pair, value) for pair, value in itertools.product(WHOLE, NO_WHOLE)),
    *((*pair, value) for pair, value in itertools.product(FINITE, NO_FINITE)),
    *((ONLINE, "--split", value) for value in NO_SPLIT),
    (OFFLINE, "--percepts", "x"),
    *((OFFLINE, "--agent", value) for value in ("", ",,")),
    (ASK, "--agent", "bayes,"),
    *((OFFLINE, "--dataset", value) for value in ("", "none.toml")),
    *((ASK, "--dataset", value) for value in ("a\0b", "\udcff.npz", "n" * 5000, ".", "\x1b[2J")),
]


@pytest.mark.quick(21)
@pytest.mark.parametrize(
    ("command", "option", "value"),
    CASES,
    ids=[f"{' '.join(c[:2])} {option} {ascii(value)[:20]}" for c, option, value in CASES],
)
def test_a_bad_value_is_told_in_one_line(fails, command, option, value, tmp_path):
    told = fails(*command, option, *(value.split() if " " in value else [value]))
    assert told.removesuffix("\n").isprintable()
    assert len(told) < 3000
    assert list(tmp_path.iterdir()) == []


def test_the_range_is_told(fails):
    assert "0<x<=1000000" in fails(*OFFLINE, "--reward", "1e100")
    assert "1<=x<=1024" in fails(*OFFLINE, "--jobs", "0")


OWN = ("--dataset", "kitchen.toml", "--root", ".")
COMMANDS = [
    ("ask", "Is it red?", "--object", "red_mug", "--agent", "greedy"),
    ("run", "offline", "--trials", "4", "--attributes", "1", "--agent", "greedy"),
    ("posterior", "--draws", "20", "--chains", "2"),
    ("export", "out.pomdp", "--query", "red"),
    ("memory", "show"),
]
IDS = [" ".join(command[:2]) for command in COMMANDS]


@pytest.mark.parametrize(
    "command",
    [
        pytest.param(words, id=name, marks=[pytest.mark.long] * (words[0] == "posterior"))
        for words, name in zip(COMMANDS, IDS, strict=True)
    ],
)
def test_a_domain_with_recordings_is_a_data_set(run, kitchen, command):
    own = OWN[:2] if command[0] == "memory" else OWN  # it reads no recordings
    result = run(*command, *own)
    assert result.exit_code == 0, result.stderr
    if command[0] != "memory":
        (cached,) = (kitchen / "cache" / "percepts").glob("kitchen-default-*.npz")
        before = cached.stat().st_mtime_ns
        again = run(*command, *OWN)
        assert again.exit_code == 0
        assert cached.stat().st_mtime_ns == before  # computed once


def test_a_table_serves_as_its_recordings_do(run, kitchen):
    assert run("data", "percepts", *OWN, "--out", "made.npz").exit_code == 0
    first, second = (
        json.loads(run(*COMMANDS[1], *options, "--json").stdout)["rows"][0]
        for options in (OWN, ("--dataset", "made.npz"))
    )
    assert {**first, "seconds": 0} == {**second, "seconds": 0}


@pytest.mark.parametrize("command", COMMANDS[:4], ids=IDS[:4])
@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--dataset", "kitchen.toml"), "the folder of its CSV files"),
        (("--dataset", "roc36", "--root", "."), "leave root out"),
        (("--dataset", "kitchen.npz", "--root", "."), "is already a percept table"),
    ],
)
def test_what_does_not_go_together_is_told(fails, table, command, options, message):
    assert message in fails(*command, *options)


def value_options(command, words=()):
    """Yield each option that takes a value, behind the words of its command."""
    for name, inner in getattr(command, "commands", {}).items():
        yield from value_options(inner, (*words, name))
    for parameter in command.params:
        if isinstance(parameter, click.Option) and not (parameter.is_flag or parameter.count):
            yield (*words, max(parameter.opts, key=len))


@pytest.mark.quick(15)
@pytest.mark.parametrize("words", list(value_options(main)), ids=" ".join)
def test_an_empty_word_is_no_value(fails, words, tmp_path):
    *command, option = words
    for given in ([option, ""], [option, "  "], [f"{option}="]):
        assert f"{option} is empty" in fails(*command, *given)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", [["ask"], ["report"], ["log", "show"]])
def test_an_empty_word_is_no_question_and_no_file(fails, command):
    assert f"what follows {command[-1]} is empty" in fails(*command, "")


def test_two_forms_of_yes_or_no_are_not_one(fails):
    for options in itertools.permutations(("--yes-no", "--yes-no-balanced")):
        assert "give one" in fails(*OFFLINE, *options)


@pytest.mark.parametrize("columns", [1, 20, 21, 33, 40, 79])
@pytest.mark.parametrize("narrow", [False, True])
def test_a_narrow_window_hides_no_number(monkeypatch, capsys, columns, narrow):
    monkeypatch.setenv("COLUMNS", str(columns))
    heads = ("agent", "accuracy", "reward a trial", "cost")
    rows = [
        ("predefined_plus", f"{n}.{n}{n}{n} [0.{n}93, 1.000]", f"{n}65.4", "22.6") for n in "123"
    ]
    print_table(heads, rows, narrow=narrow)
    shown = capsys.readouterr().out
    for cell in itertools.chain.from_iterable(rows):
        assert all(word in shown for word in cell.split())
