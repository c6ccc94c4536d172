"""--dataset means the same everywhere: a name, a domain with its recordings, or a table."""

import json

import pytest

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
    result = run(*command, *OWN, "--json")
    assert result.exit_code == 0, result.stderr
    if command[0] != "memory":
        (kept,) = (kitchen / "cache" / "percepts").glob("kitchen-default-*.npz")
        before = kept.stat().st_mtime_ns
        again = run(*command, *OWN, "--json")
        assert again.exit_code == 0
        assert kept.stat().st_mtime_ns == before  # computed once


def test_a_table_serves_as_its_recordings_do(run, kitchen):
    assert run("data", "percepts", *OWN, "--out", "made.npz").exit_code == 0
    first, second = (
        json.loads(run(*COMMANDS[1], *own, "--json").stdout)["rows"][0]
        for own in (OWN, ("--dataset", "made.npz"))
    )
    assert {**first, "seconds": 0} == {**second, "seconds": 0}


@pytest.mark.parametrize("command", COMMANDS[:4], ids=IDS[:4])
@pytest.mark.parametrize(
    ("own", "message"),
    [
        (("--dataset", "kitchen.toml"), "the folder of its CSV files"),
        (("--dataset", "roc36", "--root", "."), "leave root out"),
        (("--dataset", "kitchen.npz", "--root", "."), "is a percept table already"),
    ],
)
def test_what_does_not_go_together_is_told(fails, table, command, own, message):
    assert message in fails(*command, *own)
