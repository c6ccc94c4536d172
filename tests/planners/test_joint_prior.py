"""Plans under a joint prior: sampled values against exact ones, and who refuses."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rollout import simulate

from meal_bayes.domain import Event, Query, domain_from_table
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import (
    Objective,
    build_momdp,
    initial_belief,
    report_value,
    with_joint_prior,
)
from meal_bayes.planners import POMCP, Greedy, History, OpenLoop
from meal_bayes.planners.table.policy import Factored

LEVELS = 2
DOMAIN = domain_from_table({
    "name": "one_look", "attributes": ["a", "b", "c"], "report_reward": 100.0,
    "behaviors": [{"name": "look", "cost": 1.0, "modalities": ["camera"]}],
    "diagram": {
        "states": ["x0"], "start": "x0", "effects": [{"from": "x0", "do": "look", "to": "x0"}],
    },
})  # fmt: skip


def problem(rows, joint, event=None):
    n = len(rows)
    query = Query(DOMAIN.attributes[:n], event=event)
    undiscounted = Objective(discount=1.0)
    momdp = build_momdp(DOMAIN, query, rows[:, None], limit=1, objective=undiscounted)
    return with_joint_prior(momdp, joint)


def worth_of_looking(momdp):
    """Compute the exact value of one percept and the best report after it."""
    values = momdp.query.values.astype(int)
    attributes = np.arange(len(momdp.query))
    rewards = momdp.reports.rewards()
    total = -1.0
    for levels in itertools.product(range(LEVELS), repeat=len(attributes)):
        rows = momdp.confusion[attributes, 0, values, levels].prod(axis=1)
        total += (momdp.joint * rows @ rewards).max()
    return total


@given(st.integers(0, 2**32), st.integers(2, 3), st.booleans())
def test_plans_are_worth_what_they_are_over_all_values(seed, n, yes_or_no):
    rng = np.random.default_rng(seed)
    rows = rng.dirichlet(np.ones(LEVELS), (n, 2))
    event = Event(tuple((rng.random(n) < 0.5).tolist()), bool(rng.integers(2)))
    momdp = problem(rows, rng.dirichlet(np.full(2**n, 0.5)), event if yes_or_no else None)
    belief = initial_belief(momdp)
    exact = worth_of_looking(momdp)
    valued = [
        solver.solve(momdp, rng).decide(History(belief), np.random.default_rng(number)).values[0]
        for solver in (OpenLoop(), POMCP())
        for number in range(8)
    ]
    valued = np.array(valued)[~np.isnan(valued)]
    if exact > report_value(momdp, belief) + 1e-9 and len(valued):
        spread = max(valued.std(), 1.0)
        assert abs(valued.mean() - exact) < 5 * spread / np.sqrt(len(valued)) + 1e-9


def test_a_percept_of_one_attribute_is_worth_its_look_for_the_other():
    """One tells all of `a` and nothing of `b`, which is its opposite."""
    sure = np.array([np.eye(2), np.full((2, 2), 0.5)])
    opposite = problem(sure, [0.0, 0.5, 0.5, 0.0])
    for solver in (OpenLoop(), POMCP()):
        policy = solver.solve(opposite, np.random.default_rng(0))
        decision = policy.decide(History(initial_belief(opposite)), np.random.default_rng(0))
        assert decision.action == 0
        assert decision.values[0] == pytest.approx(99.0)
        played = simulate(opposite, policy, 20, np.random.default_rng(1))
        assert played.success.all()
        np.testing.assert_allclose(played.returns, 99.0)


def test_greedy_reports_what_a_joint_prior_allows():
    unsure = np.full((2, 2, 2), 0.5)
    momdp = problem(unsure, [0.1, 0.45, 0.45, 0.0])
    decision = (
        Greedy()
        .solve(momdp, np.random.default_rng(0))
        .decide(History(initial_belief(momdp)), np.random.default_rng(0))
    )
    assert momdp.reported(decision.action).sum() == 1


def test_factored_value_iteration_says_what_else_plans():
    momdp = problem(np.full((2, 2, 2), 0.5), [0.3, 0.3, 0.4, 0.0])
    with pytest.raises(SettingsError, match="plan with POMCP or OpenLoop"):
        Factored().solve(momdp, np.random.default_rng(0))
