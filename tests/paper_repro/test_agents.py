"""MORC as the paper lets it end a trial, and with rewards of its own."""

from dataclasses import replace

import numpy as np
import pytest

from meal_bayes import read_trials
from meal_bayes.agents import load_agent
from meal_bayes.domain import Query, load_domain
from meal_bayes.momdp import build_momdp
from paper_repro import agents, frame, offline
from paper_repro.statements import RECORDED


def problem(reward=500.0):
    """MOMDP of one attribute on ISPY32, whose percepts say nothing."""
    domain = load_domain("ispy32")
    rows = np.full((1, len(domain.behaviors), 2, 2), 0.5)
    momdp = build_momdp(domain, Query(domain.attributes[:1]), rows)
    return replace(momdp, correct=reward, incorrect=-reward, abstain=True)


def test_giving_up_costs_the_cheapest_illegal_behavior_of_the_state():
    momdp = problem()
    costs = dict(zip(momdp.x_names, agents.decline_costs(momdp).tolist(), strict=True))
    assert costs["x0"] == 1.0  # hold; look is legal there
    assert [costs[x] for x in ("x1", "x2", "x3", "x4", "x5")] == [0.5, 0.5, 0.5, 0.5, 0.5]  # look


def test_planning_weighs_giving_up_by_its_cost():
    seen = []

    class Watching:
        def solve(self, momdp, rng):
            seen.append((momdp.correct, momdp.incorrect))

    rng = np.random.default_rng(0)
    agents.Declining(Watching()).solve(problem(), rng)
    agents.Weighing(Watching(), 2000.0, -500.0).solve(problem(), rng)
    assert seen == [(501.0, -499.0), (2000.0, -500.0)]


@pytest.mark.long
def test_trials_without_a_report_pay_for_how_they_ended(tmp_path):
    """On the log a trial that is given up costs its behaviors; the illegal one comes on top."""
    setting = frame.Setting(quick=True, logs=tmp_path)
    run = offline.run_agent(setting, RECORDED, "ispy32", n=3, agent=agents.DECLINES, trials=12)
    logged = [trial for path in tmp_path.rglob("*.mcap") for trial in read_trials(path)]
    assert len(logged) == len(run) == 12
    fees = run.cost - np.array([trial.cost for trial in logged])
    given_up = np.array([trial.report is None for trial in logged])
    assert given_up.any()
    assert not fees[~given_up].any()
    assert np.isin(fees[given_up].round(9), (0.5, 1.0)).all()
    np.testing.assert_allclose(run.reward + fees, [trial.reward for trial in logged])
    forced = offline.run_agent(setting, RECORDED, "ispy32", n=3, agent=agents.ANSWERS, trials=12)
    assert forced.answered.all()
    assert (forced.key == run.key).all()  # on the same tasks


def test_the_ways_differ_from_morc_in_how_a_trial_ends_alone():
    morc = load_agent("morc")
    for agent in agents.WAYS.values():
        assert replace(agent, name="morc", solver=morc.solver, abstain=True) == morc
    assert agents.weighing(2000.0, -500.0).name == "morc_2000_500"
