"""Large diagrams: the library of plans keeps to its budget, and loses little by it."""

import numpy as np
import pytest

from meal_bayes import build_momdp, initial_belief, load_domain
from meal_bayes.domain import Query
from meal_bayes.planners import POMCP
from meal_bayes.planners.kernel_calls import plan_values
from meal_bayes.planners.open_loop import candidates, library


def problem(behaviors, states, seed):
    """Return a problem of two attributes on a drawn diagram, in which every x is reached."""
    rng = np.random.default_rng([behaviors, states, seed])
    names = [f"b{e}" for e in range(behaviors)]
    effects = [
        {
            "from": f"x{x}",
            "do": name,
            "to": f"x{(x + 1) % states if e == 0 else rng.choice([x, rng.integers(states)])}",
            "probability": float(rng.choice([1.0, 0.95, 0.9])),
        }
        for e, name in enumerate(names)
        for x in range(states)
        if e == 0 or x == e % states or rng.random() < 0.3
    ]
    domain = load_domain(
        {
            "name": "large",
            "attributes": ["a", "b"],
            "report_reward": 500.0,
            "behaviors": [
                {"name": name, "cost": round(float(rng.lognormal(1.0, 0.8)), 2)}
                | ({"modalities": ["m"]} if rng.random() < 0.8 else {})
                for name in names
            ],
            "diagram": {
                "states": [f"x{x}" for x in range(states)],
                "start": "x0",
                "effects": effects,
            },
        }
    )
    apart = rng.beta(1.2, 3.0, (2, behaviors))
    middle = rng.uniform(0.15, 0.85, (2, behaviors))
    yes = np.stack([middle * (1 - apart), middle + apart * (1 - middle)], axis=2).clip(0.03, 0.97)
    return build_momdp(domain, Query(("a", "b")), np.stack([1 - yes, yes], axis=3))


def plans_of(momdp):
    """Return the policy of a problem, and the values (E,) of its best plans by first behavior."""
    policy = POMCP(points=0).solve(momdp, np.random.default_rng(0))
    belief = initial_belief(momdp)
    return policy, np.array(plan_values(policy.model, policy.plans, belief).scratch.value)


@pytest.mark.parametrize("seed", range(4))
def test_few_plans_are_worth_what_all_are(seed, monkeypatch):
    momdp = problem(24, 24, seed)
    _, values = plans_of(momdp)
    monkeypatch.setattr(candidates, "_diagrams", {})
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
