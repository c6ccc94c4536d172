"""Nothing is searched where nothing can be decided; bounds of a decision enclose the optimum."""

import numpy as np
import pytest

from meal_bayes.momdp import Objective
from meal_bayes.planners import POMCP, Factored, History, OpenLoop


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("points", [0, 5_000])
def test_one_behavior_that_is_worth_it_needs_no_search(small, n, points):
    momdp = small.noisy_roc36(n)
    assert momdp.legal[momdp.start].sum() == 1
    decision = small.search(momdp, 300, points=points)
    searched = small.search(momdp, 3000, always=True, points=points)
    assert (decision.simulations, searched.simulations) == (0, 3000)
    assert decision.action == searched.action
    assert np.nanmax(decision.values) <= np.nanmax(searched.values) + 1e-9


@pytest.mark.parametrize("seeds", [[0], pytest.param([1, 2, 3], marks=pytest.mark.long)])
@pytest.mark.parametrize(
    "options", [{}, {"own_classes": 2}, {"shared": 3}, {"objective": Objective(abstain=True)}]
)
def test_what_is_certain_is_better_than_ending_for_certain(small, options, seeds):
    found = 0
    for seed in seeds:
        momdp = small.toy(seed, 2, 2, finite=True, limit=2, **options)
        optimum = small.expectimax(momdp)
        optimum.value(momdp.start, optimum.nothing_seen())
        for x, seen in list(optimum.known):
            history = History(optimum.belief(x, seen))
            decision = small.search(momdp, 1, history=history)
            if decision.simulations == 0 and decision.action < momdp.n_behaviors:
                found += 1
                edge = optimum.edge(x, seen, decision.action, optimum.value)
                assert optimum.stop(x, seen) < decision.values[decision.action] <= edge + 1e-9
    assert found > 0


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


def test_a_budget_of_simulations_is_used_up(small):
    """However few outcomes an expansion has, the tree is large enough."""
    for n in (1, 2, 3):
        decision = small.search(small.noisy_roc36(n), 30, always=True, points=1_000)
        assert decision.simulations == 30


@pytest.mark.parametrize("seed", range(6))
def test_plan_gap_and_upper_bound_enclose_each_other(small, seed):
    momdp = small.toy(seed, 1 + seed % 2, 2, finite=False, objective=Objective(abstain=True))
    rng, start = np.random.default_rng(0), small.start(momdp)
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
