"""Large diagrams: the library of plans keeps to its budget, and loses little by it."""

import numpy as np
import pytest
from costs import problem

from meal_bayes import initial_belief
from meal_bayes.planners import POMCP
from meal_bayes.planners.plans import candidates, library, paths
from meal_bayes.planners.plans.values import plan_values


def plans_of(momdp):
    """Return the policy of a problem, and the values (E,) of its best plans by first behavior."""
    policy = POMCP(points=0).solve(momdp, np.random.default_rng(0))
    belief = initial_belief(momdp)
    return policy, np.array(plan_values(policy.model, policy.plans, belief).scratch.value)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(4))
def test_few_plans_are_worth_what_all_are(seed, monkeypatch):
    momdp = problem(24, 24, seed)
    _, values = plans_of(momdp)
    monkeypatch.setattr(paths, "_diagrams", {})
    monkeypatch.setattr(candidates, "_SIMPLE_PLANS", 10**6)
    monkeypatch.setattr(library, "_GROWN", 10**6)
    _, all_values = plans_of(momdp)
    assert values.max() > 0.99 * all_values.max()


@pytest.mark.long
def test_every_behavior_of_a_large_robot_begins_a_plan(monkeypatch):
    momdp = problem(60, 60, 0)
    sizes = list[int]()
    cheapest = candidates.cheapest

    def counted(found):
        sizes.append(len(found.x))
        return cheapest(found)

    monkeypatch.setattr(candidates, "cheapest", counted)
    monkeypatch.setattr(library, "cheapest", counted)
    policy, _ = plans_of(momdp)
    plans = policy.plans
    useful = policy.model.dynamics.step["legal"]  # of the legal ones, those that do anything
    assert max(sizes) < 60_000  # all simple plans of two behaviors would be 1.3 million
    for x in range(60):
        begun = set(plans.plan["action"][slice(*plans.first[x : x + 2])].tolist())
        assert begun == set(np.flatnonzero(useful[x]).tolist())
