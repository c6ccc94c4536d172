"""Yes or no: every planner against brute force, and one attribute as it was."""

from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.domain import Event, Payoffs, Query, load_domain
from meal_bayes.momdp import (
    answer_value,
    build_momdp,
    expected_reward,
    flatten,
    initial_belief,
    write_pomdpx,
)
from meal_bayes.planners import POMCP, History, OpenLoop
from meal_bayes.planners.plans.values import plan_values
from meal_bayes.planners.table.policy import Factored

DEAR_MISS = Payoffs(100.0, -100.0, 100.0, -1000.0)
SYMMETRIC = Payoffs(100.0, -100.0, 100.0, -100.0)
EVENTS = {
    "and": Event((True, True)),
    "and not": Event((True, False)),
    "or": Event((False, False), complement=True),
    "or not": Event((True, False), complement=True),
}
PROBLEMS = {
    "known rows": {"seed": 1, "levels": 2, "finite": False, "limit": 2},
    "own rows": {"seed": 2, "levels": 2, "finite": True, "limit": 2},
    "four levels": {"seed": 3, "levels": 4, "finite": True, "limit": 1},
    "classes": {"seed": 4, "levels": 2, "finite": False, "limit": 2, "own_classes": 3},
    "shared classes": {"seed": 4, "levels": 2, "finite": True, "limit": 2, "shared": 3},
}


def asked(momdp, event, payoffs):
    """Ask a problem's attributes for yes or no."""
    query = Query(momdp.query.attributes, event=event)
    extremes = {"correct": max(payoffs), "incorrect": min(payoffs)}
    return replace(momdp, query=query, payoffs=payoffs, **extremes)


@pytest.mark.quick(3)
@pytest.mark.parametrize("event", EVENTS)
@pytest.mark.parametrize("problem", PROBLEMS)
def test_planners_against_the_optimum(problem, event, small):
    payoffs = DEAR_MISS if (len(problem) + len(event)) % 2 else SYMMETRIC
    momdp = asked(small.toy(n=2, **PROBLEMS[problem]), EVENTS[event], payoffs)
    optimum = small.expectimax(momdp)
    best = optimum.value(momdp.start, optimum.nothing_seen())
    belief = initial_belief(momdp)
    assert answer_value(momdp, belief) == pytest.approx(
        optimum.stop(momdp.start, optimum.nothing_seen())
    )
    plans = OpenLoop().solve(momdp, np.random.default_rng(0))
    lower = plan_values(plans.model, plans.plans, belief).scratch.value.max()
    assert lower <= best + 1e-9
    worth = optimum.of_policy(plans, 0)
    # thresholds are improved one at a time, so that what is left of a plan may seem worth less
    slack = 0.005 * (momdp.correct - momdp.incorrect)
    assert max(lower, answer_value(momdp, belief)) - slack <= worth <= best + 1e-9
    search = POMCP(300).solve(momdp, np.random.default_rng(0))
    assert optimum.of_policy(search, 0) >= best - 0.02 * (momdp.correct - momdp.incorrect)


@pytest.mark.quick(3)
@pytest.mark.parametrize("event", EVENTS)
@pytest.mark.parametrize("seed", range(4))
def test_the_bound_holds_and_is_near(event, seed, small):
    momdp = small.toy(seed=seed, n=2, levels=2, finite=False, limit=3)
    momdp = asked(momdp, EVENTS[event], DEAR_MISS if seed % 2 else SYMMETRIC)
    optimum = small.expectimax(momdp)
    best = optimum.value(momdp.start, optimum.nothing_seen())
    free = replace(momdp, limit=np.full(momdp.n_behaviors, np.inf))
    policy = Factored().solve(free, np.random.default_rng(0))
    assert policy.upper_bound >= best - 1e-6
    belief = initial_belief(free)
    plans = OpenLoop().solve(free, np.random.default_rng(0))
    lower = plan_values(plans.model, plans.plans, belief).scratch.value.max()
    assert max(lower, answer_value(free, belief)) <= policy.upper_bound + 1e-6


def test_one_attribute_is_the_same_problem_to_the_bit():
    domain = load_domain("toy")
    rows = np.random.default_rng(0).dirichlet([2, 2], (1, 3, 2))
    values = build_momdp(domain, Query(("red",)), rows)
    payoffs = Payoffs(100.0, -100.0, 100.0, -100.0)
    event = build_momdp(domain, Query(("red",), payoffs=payoffs), rows)
    assert event.reports.event is None
    for solver in (OpenLoop(), POMCP(50)):
        decisions = [
            solver.solve(momdp, np.random.default_rng(0)).decide(
                History(initial_belief(momdp)), np.random.default_rng(1)
            )
            for momdp in (values, event)
        ]
        np.testing.assert_array_equal(decisions[0].values, decisions[1].values)


def test_payoffs_of_one_attribute_are_those_of_its_event():
    domain = load_domain("toy")
    rows = np.random.default_rng(0).dirichlet([2, 2], (1, 3, 2))
    values = build_momdp(domain, Query(("red",), payoffs=DEAR_MISS), rows)
    event = build_momdp(domain, Query(("red",), event=Event((True,)), payoffs=DEAR_MISS), rows)
    assert values.n_actions == event.n_actions == 5
    a, b = (
        OpenLoop()
        .solve(momdp, np.random.default_rng(0))
        .decide(History(initial_belief(momdp)), np.random.default_rng(1))
        for momdp in (values, event)
    )
    np.testing.assert_array_equal(a.values, b.values)


def test_a_dear_miss_is_answered_with_yes():
    momdp = asked(
        build_momdp(load_domain("toy"), Query(("red", "heavy")), np.full((2, 3, 2, 2), 0.5)),
        Event((True, True)), DEAR_MISS,
    )  # fmt: skip
    belief = initial_belief(momdp)  # Pr(yes) = 1/4: no is right more often, yes is worth more
    rewards = [expected_reward(momdp, belief, np.array([answer])) for answer in (False, True)]
    assert rewards == pytest.approx([-175.0, -50.0])
    plans = OpenLoop().solve(momdp, np.random.default_rng(0))
    decision = plans.decide(History(belief), np.random.default_rng(0))
    assert momdp.reported(decision.action).tolist() == [True]


@pytest.mark.parametrize("event", EVENTS)
def test_files_and_flat_problems_pay_yes_and_no(event, tmp_path):
    rows = np.full((2, 3, 2, 2), 0.5)
    momdp = build_momdp(load_domain("toy"), Query(("red", "heavy")), rows)
    momdp = asked(momdp, EVENTS[event], DEAR_MISS)
    flat = flatten(momdp)
    assert flat.action_names[3:] == ("report no", "report yes")
    for y, values in enumerate(momdp.query.values):
        holds = (values == EVENTS[event].allowed).all() != EVENTS[event].complement
        no_and_yes = (DEAR_MISS.wrong_no, DEAR_MISS.right_yes)
        if not holds:
            no_and_yes = (DEAR_MISS.right_no, DEAR_MISS.wrong_yes)
        assert tuple(flat.reward[y, 3:]) == no_and_yes
    write_pomdpx(momdp, tmp_path / "asked.pomdpx")
    assert "ayes" in (tmp_path / "asked.pomdpx").read_text(encoding="utf-8")
