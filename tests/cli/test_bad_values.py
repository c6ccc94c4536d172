"""Values that no option takes: each is told in one line, before any work."""

import itertools
from pathlib import Path

import pytest

from meal_bayes.errors import SettingsError
from meal_bayes.experiments import OfflineConfig, OnlineConfig

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


@pytest.mark.parametrize("key", ["report_reward = 1e100", "legal_budget = []"])
def test_settings_of_a_domain_have_ranges_too(fails, key, kitchen):
    table = kitchen / "kitchen.toml"
    lines = [line for line in table.read_text().splitlines() if key[:9] not in line]
    table.write_text("\n".join([key, *lines]))
    told = fails("data", "percepts", "--dataset", table, "--root", kitchen, "--out", "a.npz")
    assert key.partition(" ")[0] in told
    assert not Path("a.npz").exists()


@pytest.mark.parametrize("value", [-1.0, 1e100, float("inf"), float("nan")])
def test_the_library_has_the_same_ranges(value):
    for make in (OfflineConfig, OnlineConfig):
        with pytest.raises(SettingsError, match="reward is"):
            make("roc36", reward=value)
    with pytest.raises(SettingsError, match="alpha is"):
        OnlineConfig("roc36", alpha=value)
