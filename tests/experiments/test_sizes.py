"""Runs that no machine would bring to their end are refused before anything is allocated."""

import math
import tracemalloc

import pytest
from click.testing import CliRunner

from meal_bayes.cli import main
from meal_bayes.errors import SettingsError
from meal_bayes.experiments import OfflineConfig, OnlineConfig
from meal_bayes.experiments.config import MOST_TRIALS

COUNTS = {
    OfflineConfig: ("attributes", "trials"),
    OnlineConfig: ("attributes", "batches", "trials", "repeats", "horizon"),
}
CASES = [(config, name) for config, names in COUNTS.items() for name in names]


@pytest.mark.quick(15)
@pytest.mark.parametrize("count", [0, -1, 10**9, 2.5, math.nan, math.inf, "5", None, True])
@pytest.mark.parametrize(("config", "name"), CASES)
def test_a_count_is_a_whole_number_within_reason(config, name, count):
    with pytest.raises(SettingsError, match=f"{name} is .*; give a whole number from 1 to"):
        config("roc36", **{name: count})


@pytest.mark.parametrize(
    "ask",
    [
        lambda: OfflineConfig("roc36", agents=("prior", "greedy"), trials=MOST_TRIALS),
        lambda: OnlineConfig("roc36", repeats=MOST_TRIALS),
        lambda: OnlineConfig("roc36", agents=("bayes",), repeats=1000, batches=1000, trials=2),
    ],
)
def test_too_many_trials_are_refused_with_an_estimate(ask):
    tracemalloc.start()
    with pytest.raises(SettingsError, match=r"trials: .* days of a core and .* GB of logs"):
        ask()
    assert tracemalloc.get_traced_memory()[1] < 10_000_000
    tracemalloc.stop()


def test_as_many_as_are_told_can_be_asked():
    assert OfflineConfig("roc36", agents=("prior",), trials=MOST_TRIALS).trials == MOST_TRIALS


@pytest.mark.parametrize(
    "command",
    [("offline", "--trials", "10000000"), ("online", "--repeats", "1000000")],
)
def test_the_command_line_says_so_too(command, tmp_path):
    kind, *options = command
    done = CliRunner().invoke(main, ["run", kind, *options, "--logs", str(tmp_path / "logs")])
    assert done.exit_code == 2
    assert "1,000,000" in done.stderr
    assert not (tmp_path / "logs").exists()
