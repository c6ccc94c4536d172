"""The hierarchical model of outcomes, on trials that it could have drawn itself."""

import numpy as np
import pytest

from meal_bayes.errors import SettingsError
from meal_bayes.evaluation.outcome_model import Cells, compare_outcomes, plot_effects
from meal_bayes.trials import TrialOutcomes

OBJECTS = 24


def simulated(rng, *, lead=0.0, agents=3, trials=150):
    """Draw trials of agents on the same tasks; the last one leads on the logistic scale."""
    agent, task = np.divmod(np.arange(agents * trials), trials)
    thing = rng.integers(OBJECTS, size=trials)[task]
    asked = rng.integers(6, size=(trials, 1))[task]
    shift = lead * (agent == agents - 1)
    objects, pairs = rng.normal(size=OBJECTS), 0.4 * rng.normal(size=(agents, OBJECTS))
    eta = 0.8 + shift + objects[thing] + pairs[agent, thing]
    right = rng.random(len(eta)) < 1 / (1 + np.exp(-eta))
    cost = 20 - 5 * shift + 3 * objects[thing] + 6 * rng.normal(size=len(eta))
    nothing = np.zeros((len(eta), 0), int)
    return TrialOutcomes(
        behaviors=(), agent=np.array([f"agent {a}" for a in agent], object),
        key=task.astype(str), object_index=thing, object_name=thing.astype(str),
        attribute=asked.astype(str), truth=np.ones((len(eta), 1)), report=right[:, None],
        positive=np.full((len(eta), 1), 0.5), cost=cost, reward=cost, ended=np.full(len(eta), ""),
        steps=np.zeros(len(eta)), executed=nothing, failed=nothing,
    )  # fmt: skip


def test_cells_keep_the_sums_of_trials():
    outcomes = simulated(np.random.default_rng(0))
    cells = Cells.of(outcomes, "success")
    assert cells.trials.sum() == len(outcomes)
    assert cells.total.sum() == outcomes.success.sum()
    assert len(cells.trials) < len(outcomes)
    assert set(cells.terms) == {"agent", "object", "attribute", "agent object"}
    first = cells.terms["agent"] == 0
    assert cells.trials[first].sum() == (outcomes.agent == cells.agents[0]).sum()


@pytest.mark.long
@pytest.mark.parametrize("measure", ["success", "cost"])
def test_a_leader_is_found_and_an_equal_one_is_not(measure):
    outcomes = simulated(np.random.default_rng(1), lead=1.2)
    equal, ahead = compare_outcomes(outcomes, measure=measure, draws=300)
    assert ahead.ahead > 0.95
    assert ahead.equivalent < 0.2
    assert 0.02 < equal.ahead < 0.98
    assert abs(ahead.effect) < abs(ahead.plain) * 1.2
    assert plot_effects([equal, ahead]).get_xlabel() == f"{measure} less agent 0's"


def test_what_cannot_be_compared_is_refused():
    outcomes = simulated(np.random.default_rng(2))
    with pytest.raises(SettingsError, match="two or more"):
        compare_outcomes(outcomes.of_agent("agent 0"))
    with pytest.raises(SettingsError, match="reference 'nobody'"):
        compare_outcomes(outcomes, reference="nobody")
    with pytest.raises(SettingsError, match="Unknown measure 'luck'"):
        compare_outcomes(outcomes, measure="luck")
