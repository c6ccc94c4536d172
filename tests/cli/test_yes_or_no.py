"""Yes or no on the command line."""

import json

import pytest

from meal_bayes.trial_log import Logs


def test_the_command_line_says_yes_or_no(run, tmp_path):
    words = ("ask", "--yes-no", "heavy or rice", "--object", "heavy_blue_beans")
    logs = ("--agent", "olfc", "--logs", str(tmp_path))
    assert "yes (" in run(*words, *logs).stdout
    values = json.loads(run(*words, *logs, "--json").stdout)["trial"]
    assert values["report"] == {"heavy or rice": True}
    assert values["probability"] > 0.5


def test_rates_of_answers_that_never_were_right_are_none(run, tmp_path):
    words = ("run", "offline", "--agent", "prior", "--trials", "1", "--yes-no", "--json")
    result = json.loads(run(*words, "--logs", str(tmp_path)).stdout)
    assert None in result["rates"]["prior"].values()


PAYOFFS = (10.0, -20.0, 30.0, -40.0)  # of a right and a wrong yes, a right and a wrong no


@pytest.mark.quick(2)
@pytest.mark.parametrize("kind", ["--yes-no", "--yes-no-balanced"])
@pytest.mark.parametrize("attributes", [1, 2])
def test_a_run_pays_what_yes_and_no_earn(run, kind, attributes):
    words = ("run", "offline", "--agent", "prior", "--trials", "12", kind, "--json")
    size = ("--attributes", str(attributes))
    done = run(*words, *size, "--payoffs", *map(str, PAYOFFS))
    facts = json.loads(done.stdout)
    assert facts["config"]["payoffs"] == list(PAYOFFS)
    paid = set()
    for trial in Logs(facts["log"]).trials():
        place = 2 * (not trial.report[0]) + (not trial.success)
        assert trial.reward == PAYOFFS[place]  # it touches nothing
        paid.add(trial.reward)
    assert len(paid) > 1
    others = json.loads(run(*words, *size).stdout)
    assert others["log"] != facts["log"]


def test_payoffs_without_yes_and_no_are_refused_in_a_line(fails):
    words = ("run", "offline", "--agent", "prior", "--trials", "1", "--payoffs")
    told = fails(*words, *map(str, PAYOFFS))
    assert "--yes-no" in told
    assert "wrong answer must not earn more" in fails(*words, "1", "2", "3", "4", "--yes-no")
