"""Behaviors that cost nothing are executed while they tell something, and then the trial ends."""

from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.momdp import Objective
from meal_bayes.planners import POMCP, Factored, Greedy, OpenLoop
from meal_bayes.planners.rollout import simulate

ENDLESS = {"percepts tell less and less", "independent percepts"}  # trials are as long as may be
QUICK = "recordings run out"  # the others are `long`
PROBLEMS = {  # of the toy domain; undiscounted, as `bayes` plans
    "recordings run out": {
        "precision": 8.0,
        "limit": 5,
        "objective": Objective(discount=1.0, abstain=True),
    },
    "rows are known, recordings run out": {"limit": 5, "objective": Objective(discount=1.0)},
    "percepts tell less and less": {
        "precision": 8.0,
        "objective": Objective(discount=1.0, abstain=True),
    },
    "independent percepts": {"objective": Objective(discount=1.0, abstain=True)},
    "discounted": {"objective": Objective(discount=0.99)},
}


def solvers(momdp):
    # Undiscounted, `Factored` goes round where recordings run out: its module says so.
    known = np.isinf(momdp.precision).all() and np.isinf(momdp.limit).all()
    return [POMCP(30), POMCP(30, points=0), OpenLoop(), *([Factored(2_000)] if known else [])]


@pytest.mark.statistical
@pytest.mark.parametrize(
    "name", [pytest.param(k, marks=[pytest.mark.long] * (k != QUICK)) for k in PROBLEMS]
)
@pytest.mark.parametrize("free", [(0,), pytest.param((0, 1, 2), marks=pytest.mark.long)])
def test_free_behaviors_are_worth_what_nearly_free_ones_are(small, name, free):
    """The same objects and random numbers, so that the values are compared pair by pair."""
    rates = {"red": {"look": (0.8, 0.25)}, "heavy": {"look": (0.55, 0.4), "lift": (0.85, 0.2)}}
    cheap = small.momdp("toy", rates, **PROBLEMS[name])
    cost, episodes = cheap.cost.copy(), 20 if name in ENDLESS else 60
    cost[list(free)] = 0.01
    cheap = replace(cheap, cost=cost)
    cost[list(free)] = 0.0
    gratis = replace(cheap, cost=cost)
    for solver in solvers(cheap):
        done = []
        for momdp in (gratis, cheap):
            policy = solver.solve(momdp, np.random.default_rng(0))
            done.append(simulate(momdp, policy, episodes, np.random.default_rng(1)))
        gap = done[0].returns - done[1].returns
        two = 2 * gap.std(ddof=1) / np.sqrt(episodes)
        assert gap.mean() >= -two - 1e-9, solver
        if name != "independent percepts":  # which tell more for ever, and here for nothing
            assert done[0].decisions < 60 * episodes, solver  # of 100 that a trial may have


@pytest.mark.parametrize("settings", [{"precision": 8.0}, {}])
@pytest.mark.parametrize("solver", [POMCP(30), POMCP(30, points=0), OpenLoop(), Greedy()])
def test_what_is_not_informative_is_not_done_again(small, solver, settings):
    """Recordings of the free look have run out, and lift tells nothing."""
    rates = {"red": {"look": (0.8, 0.25)}}
    momdp = small.momdp("toy", rates, limit=2, objective=Objective(discount=1.0), **settings)
    momdp = replace(momdp, cost=np.zeros(3))
    policy = solver.solve(momdp, np.random.default_rng(0))
    done = simulate(momdp, policy, 30, np.random.default_rng(1))
    assert done.decisions <= 30 * 3  # two looks and the report
