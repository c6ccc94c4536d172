"""Values that no option takes: each is told in one line, before any work."""

import itertools

import pytest

OFFLINE, ONLINE = ("run", "offline"), ("run", "online")
ASK = ("ask", "heavy", "--object", "heavy_blue_beans")
EXPORT = ("export", "a.pomdp", "--query", "heavy")
WHOLE = [
    *((OFFLINE, name) for name in ("--attributes", "--trials", "--seed", "--jobs")),
    (ONLINE, "--repeats"),
    (("posterior",), "--levels"),
    (("view", "a.mcap"), "--trial"),
]
NO_WHOLE = ("", "x", "1.5", "-1", "9" * 20)
FINITE = [(OFFLINE, "--reward"), (ONLINE, "--alpha"), (ONLINE, "--error"), (EXPORT, "--discount")]
NO_FINITE = ("", "x", "nan", "inf", "-1", "0x10")
NO_SPLIT = ("", "33", "1/2", "a/b/c", "0/1/1", "-1/1/1", "1.5/1/1")
NO_CHANCE = ("", "grasp", "=0.5", "grasp=", "grasp=x", "grasp=nan", "grasp=1.5", "grasp=0")
CASES = [
    *((*pair, value) for pair, value in itertools.product(WHOLE, NO_WHOLE)),
    *((*pair, value) for pair, value in itertools.product(FINITE, NO_FINITE)),
    *((ONLINE, "--split", value) for value in NO_SPLIT),
    *((ONLINE, "--success", value) for value in NO_CHANCE),
    (OFFLINE, "--percepts", "x"),
    *((OFFLINE, "--agent", value) for value in ("", ",,")),
    (ASK, "--agent", "bayes,"),
    *((OFFLINE, "--dataset", value) for value in ("", "none.toml")),
    *((ASK, "--dataset", value) for value in ("a\0b", "\udcff.npz", "n" * 5000, ".", "\x1b[2J")),
]


@pytest.mark.parametrize(
    ("command", "option", "value"),
    CASES,
    ids=[f"{' '.join(c[:2])} {option} {ascii(value)[:20]}" for c, option, value in CASES],
)
def test_a_bad_value_is_told_in_one_line(fails, command, option, value, tmp_path):
    told = fails(*command, option, value)
    assert told.removesuffix("\n").isprintable()
    assert len(told) < 3000
    assert list(tmp_path.iterdir()) == []


def test_the_range_is_told(fails):
    assert "0<x<=1000000" in fails(*OFFLINE, "--reward", "1e100")
    assert "1<=x<=1024" in fails(*OFFLINE, "--jobs", "0")
