"""Trials end where nothing is to decide or to learn; bounds of a decision enclose the optimum."""

from dataclasses import replace

import numpy as np
import pytest
from rollout import simulate

from meal_bayes.momdp import Objective
from meal_bayes.planners import POMCP, Factored, Greedy, History, OpenLoop


@pytest.mark.parametrize("n", [1, 2, pytest.param(3, marks=pytest.mark.long)])
@pytest.mark.parametrize("points", [0, 5_000])
def test_one_behavior_that_is_worth_it_needs_no_search(small, n, points):
    momdp = small.noisy_roc36(n)
    assert momdp.legal[momdp.start].sum() == 1
    decision = small.search(momdp, 300, points=points)
    searched = small.search(momdp, 3000, always=True, points=points)
    assert (decision.simulations, searched.simulations) == (0, 3000)
    assert decision.action == searched.action
    assert np.nanmax(decision.values) <= np.nanmax(searched.values) + 1e-9


@pytest.mark.quick(1)
@pytest.mark.parametrize("seeds", [[0], pytest.param([1, 2, 3], marks=pytest.mark.long)])
@pytest.mark.parametrize(
    "options",
    [{}, *(pytest.param(options, marks=pytest.mark.long) for options in (
        {"own_classes": 2}, {"shared": 3}, {"objective": Objective(abstain=True)}))],
)  # fmt: skip
def test_what_is_certain_is_better_than_ending_for_certain(small, options, seeds):
    cases = 0
    for seed in seeds:
        momdp = small.toy(seed, 2, 2, finite=True, limit=2, **options)
        optimum = small.expectimax(momdp)
        optimum.value(momdp.start, optimum.nothing_seen())
        for x, seen in list(optimum.known):
            history = History(optimum.belief(x, seen))
            decision = small.search(momdp, 1, history=history)
            if decision.simulations == 0 and decision.action < momdp.n_behaviors:
                cases += 1
                edge = optimum.edge(x, seen, decision.action, optimum.value)
                assert optimum.stop(x, seen) < decision.values[decision.action] <= edge + 1e-9
    assert cases > 0


@pytest.mark.parametrize(
    "odds",
    [
        [9.0, -9.0],
        *(pytest.param(odds, marks=pytest.mark.long) for odds in ([12.0, 12.0], [-8.0, 10.0])),
    ],
)
def test_bounds_end_a_trial_without_a_search(small, odds):
    momdp = small.noisy_roc36(2)
    for x in range(momdp.terminal):
        history = History(small.believing(momdp, odds, x))
        decision = small.search(momdp, 100, history=history)
        searched = small.search(momdp, 100, history=history, always=True)
        assert decision.simulations == 0
        assert decision.action == searched.action >= momdp.n_behaviors


@pytest.mark.parametrize("n", [1, 2, pytest.param(3, marks=pytest.mark.long)])
def test_a_budget_of_simulations_is_used_up(small, n):
    """However few outcomes an expansion has, the tree is large enough."""
    decision = small.search(small.noisy_roc36(n), 30, always=True, points=1_000)
    assert decision.simulations == 30


@pytest.mark.parametrize("seed", range(6))
def test_plan_gap_and_upper_bound_enclose_each_other(small, seed):
    momdp = small.toy(seed, 1 + seed % 2, 2, finite=False, objective=Objective(abstain=True))
    rng = np.random.default_rng(0)
    start = small.start(momdp)
    upper = Factored().solve(momdp, rng).upper_bound
    plan = np.nanmax(OpenLoop().solve(momdp, rng).decide(start, rng).values)
    decision = POMCP(20).solve(momdp, rng).decide(start, rng)
    assert plan <= upper + 1e-6
    assert decision.gap is not None
    assert decision.gap >= 0.0
    assert decision.gap >= np.nanmax(decision.values) - plan - 1.0  # the table errs by less
    assert plan - 1e-6 <= np.nanmax(decision.values) <= upper + 1.0


def test_no_gap_is_claimed_where_no_bound_is_certified(small):
    assert small.search(small.momdp("toy", small.rates, 5.0), 20).gap is None


ENDLESS = {"percepts tell less and less", "independent percepts"}  # trials are as long as may be
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


@pytest.mark.long
@pytest.mark.statistical
@pytest.mark.parametrize("name", PROBLEMS)
@pytest.mark.parametrize("free", [(0,), (0, 1, 2)])
def test_free_behaviors_are_worth_what_nearly_free_ones_are(small, name, free):
    """The same objects and random numbers, so that the values are compared pair by pair."""
    rates = {"red": {"look": (0.8, 0.25)}, "heavy": {"look": (0.55, 0.4), "lift": (0.85, 0.2)}}
    cheap = small.momdp("toy", rates, **PROBLEMS[name])
    cost = cheap.cost.copy()
    episodes = 20 if name in ENDLESS else 60
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
