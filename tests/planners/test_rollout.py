"""Simulated episodes estimate the exact value of a policy, of whatever class objects are."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from rollout import simulate

from meal_bayes.domain import Behavior, Domain, Effect, TransitionDiagram
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import MOMDP, Objective, best_report
from meal_bayes.planners import Decision, unvalued
from meal_bayes.planners.momdp_arrays import dynamics_of

EPISODES = 500
PROBLEMS = {
    "independent": {"seed": 0, "n": 2, "levels": 2, "finite": False, "limit": 3},
    "dispersed": {"seed": 1, "n": 2, "levels": 2, "finite": True, "limit": 3},
    "four levels, dispersed": {"seed": 3, "n": 1, "levels": 4, "finite": True, "limit": 2},
    "mistaken": {"seed": 0, "n": 2, "levels": 2, "finite": True, "limit": 2, "mistaken": 0.2},
    "six classes": {"seed": 4, "n": 2, "levels": 2, "finite": False, "limit": 2, "own_classes": 3},
    "shared classes": {"seed": 4, "n": 2, "levels": 2, "finite": True, "limit": 2, "shared": 3},
    "without discount": {"seed": 7, "n": 1, "levels": 2, "finite": True, "limit": 3}
    | {"objective": Objective(discount=1.0)},
}


class Gather:
    """Looks and lifts, as often as told in turn, then reports; or abstains."""

    def __init__(self, momdp, looks, *, leaves=False):
        self.momdp = momdp
        self.looks = looks
        self.leaves = leaves

    def decide(self, history, rng):
        belief = history.belief
        looked = belief.percept_counts[0, 0].sum()
        lifted = belief.percept_counts[0, 1].sum()
        action = best_report(self.momdp, belief)
        if looked < self.looks:
            action = 0
        elif not lifted:
            action = 1 if belief.x == 0 else action
        elif self.leaves and belief.entropy > 0.9:
            action = self.momdp.abstention
        return Decision(action, np.full(4, np.nan), np.full(4, np.nan), np.zeros(4), (), 7)


def run(momdp, policy, episodes=EPISODES, seed=0, **options):
    return simulate(momdp, policy, episodes, np.random.default_rng(seed), **options)


def near(estimate, se, exact, sigma=4.0):
    return abs(estimate - exact) <= sigma * se


@pytest.mark.quick(2)
@pytest.mark.statistical
@pytest.mark.parametrize("problem", PROBLEMS)
def test_the_estimate_is_unbiased(small, problem):
    momdp = small.toy(**PROBLEMS[problem])
    policy = Gather(momdp, 2)
    exact = small.expectimax(momdp).of_policy(policy, 0)
    rollout = run(momdp, policy)
    assert 0 < rollout.value_se < 3
    assert near(rollout.value, rollout.value_se, exact)


def test_who_abstains_pays_for_what_he_does_and_gets_no_reward(small):
    momdp = small.toy(**PROBLEMS["independent"], objective=Objective(abstain=True))
    rollout = run(momdp, Gather(momdp, 1, leaves=True), 200)
    left = rollout.abstained
    assert 0 < left.sum() < 200
    assert not rollout.success[left].any()
    assert not rollout.certainty[left].any()
    assert (rollout.returns[left] < 0).all()
    # look, then lift (5 s, it may fail): discounted by the step.
    lifts = np.round((rollout.cost[left] - 1.0) / 5.0).astype(int)
    assert (lifts >= 1).all()
    np.testing.assert_allclose(rollout.cost[left], 1.0 + 5.0 * lifts)
    steps = [1 + 5 * sum(0.99**t for t in range(1, k + 1)) for k in lifts]
    np.testing.assert_allclose(rollout.returns[left], -np.array(steps))


def test_what_is_not_legal_is_refused(small):
    momdp = small.momdp("roc36_published", {"heavy": {}})
    grasp = momdp.behavior_names.index("grasp")  # illegal at the start

    class Stubborn:
        def decide(self, history, rng):
            return Decision(grasp, *[np.zeros(momdp.n_behaviors + 1)] * 3)

    with pytest.raises(SettingsError, match="commands 'grasp'"):
        run(momdp, Stubborn(), 3, max_steps=4)


@pytest.mark.statistical
def test_branches_and_silence(small):
    """A lift that drops the object is not perceived."""
    effects = (
        Effect("x0", "look", "x0", 0.5),
        Effect("x0", "lift", "x1", 0.6),
        Effect("x0", "lift", "x2", 0.4, senses=False),
    )
    diagram = TransitionDiagram(("x0", "x1", "x2", "term"), "x0", effects)
    acts = (Behavior("look", 1.0, ("color",)), Behavior("lift", 2.0, ("haptics",)))
    domain = Domain("dropping", ("red",), acts, diagram, report_reward=100.0)
    momdp = small.momdp(domain, {"red": {"look": (0.8, 0.3), "lift": (0.9, 0.2)}})
    silent = []

    class Lift:
        def decide(self, history, rng):
            if not history.actions:
                return Decision(1, *[np.zeros(3)] * 3)
            silent.append((history.moved[-1], history.perceived[-1]))
            return Decision(best_report(momdp, history.belief), *[np.zeros(3)] * 3)

    rollout = run(momdp, Lift())
    assert set(silent) == {(1, True), (2, False)}
    dropped = np.mean([x == 2 for x, _ in silent])
    assert near(dropped, np.sqrt(0.24 / EPISODES), 0.4)
    exact = -2 + 0.99 * (0.6 * (-100 + 200 * 0.85))  # a coin is worth 0
    assert near(rollout.value, rollout.value_se, exact)


def test_what_a_failure_costs_is_planned_as_it_is_charged(small, monkeypatch):
    """One place says it: halve it there, and plans and trials agree."""
    monkeypatch.setattr(MOMDP, "_outcome_costs", lambda momdp: (momdp.cost, momdp.cost / 2))
    effects = (Effect("x0", "look", "x0", 0.4), Effect("x0", "lift", "x0"))
    diagram = TransitionDiagram(("x0", "term"), "x0", effects)
    acts = (Behavior("look", 6.0, ("color",)), Behavior("lift", 2.0, ("haptics",)))
    domain = Domain("failing", ("red",), acts, diagram, report_reward=100.0)
    momdp = small.momdp(domain, {"red": {"look": (0.8, 0.3), "lift": (0.9, 0.2)}})
    momdp = replace(momdp, discount=1.0)

    class LookOnce:
        def decide(self, history, rng):
            looked = any(history.perceived)
            return unvalued(momdp, best_report(momdp, history.belief) if looked else 0)

    planned = float(dynamics_of(momdp).step["cost"][0, 0])
    assert planned == pytest.approx(6.0 + 1.5 * 3.0)  # .6 / .4 failures for one that succeeds
    charged = run(momdp, LookOnce()).cost
    assert set(charged) <= {6.0 + 3.0 * failures for failures in range(100)}
    assert near(charged.mean(), charged.std() / np.sqrt(EPISODES), planned)


@pytest.mark.parametrize("decision", [None, 0, "look"])
def test_a_policy_that_decides_nothing_is_told(toy, decision):
    """As in a trial, by the same boundary."""
    policy = SimpleNamespace(decide=lambda history, rng: decision)
    with pytest.raises(SettingsError, match="expected a Decision"):
        run(toy, policy, 2)


def test_the_environment_does_not_know_the_policys_draws(toy):
    """Whatever a policy draws, it meets the same objects and percepts."""

    class Drawing(Gather):
        def decide(self, history, rng):
            rng.random(5)
            return super().decide(history, rng)

    first = run(toy, Gather(toy, 2), 40)
    second = run(toy, Drawing(toy, 2), 40)
    np.testing.assert_array_equal(first.returns, second.returns)


@pytest.mark.parametrize("episodes", [-1, 0, 1])
def test_too_few_episodes_are_told(toy, episodes):
    with pytest.raises(SettingsError, match=f"episodes is {episodes};"):
        run(toy, Gather(toy, 1), episodes)
