"""What a decision of the search holds, who may abstain, large queries, compiled or not."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields

import numpy as np
import pytest

from meal_bayes.domain import Query, load_domain
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import Objective, build_momdp, initial_belief
from meal_bayes.planners import POMCP, History


def same(one, other):
    return all(
        np.array_equal(a, b, equal_nan=True) if isinstance(a, np.ndarray) else a == b
        for a, b in ((getattr(one, f.name), getattr(other, f.name)) for f in fields(one))
    )


def hopeless(n, *, abstain=False):
    """Build a query of ROC36 of which no behavior tells anything."""
    domain = load_domain("roc36")
    confusion = np.full((n, len(domain.behaviors), 2, 2), 0.5)
    query = Query(domain.attributes[:n])
    goal = Objective(discount=1.0, abstain=abstain)
    return build_momdp(domain, query, confusion, objective=goal)


def test_equal_seeds_decide_alike(small, toy):
    for momdp in (toy, small.ispy32(8, limit=5), small.toy(9, 2, 4, finite=True)):
        one, other = small.search(momdp, 60, 3), small.search(momdp, 60, 3)
        assert same(one, other)
    assert len({small.search(toy, 60, seed).tree for seed in range(8)}) > 1


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("simulations", [0, 40])
def test_only_who_may_abstains(small, n, simulations):
    answer = small.search(hopeless(n), simulations)
    assert answer.action == 12  # the report of the belief's most probable values
    assert answer.values[-1] == pytest.approx(-500 + 1000 / 2**n)
    # A table's bound, rounded up, would look before it leaves, at the same price.
    ending = small.search(hopeless(n, abstain=True), simulations, points=0)
    if n == 1:  # a coin costs nothing
        assert ending.action == 12
    else:
        assert ending.action == hopeless(n).abstention
        assert ending.values[-1] == 0.0


def test_known_attributes_cost_a_query_nothing(small):
    """80 certain attributes beside an open one: the problem of the open one."""
    prior = np.array([0.5, *[1.0] * 80])
    wide, narrow = (small.search(small.ispy32(n, prior=prior[:n], limit=5), 0) for n in (81, 1))
    assert wide.action == narrow.action == 0
    assert wide.values[-1] == narrow.values[-1] == 0.0
    assert small.best_value(wide) == pytest.approx(small.best_value(narrow), rel=1e-9)


def test_a_full_tree_ends_the_search(small, toy):
    decision = small.search(toy, 5000, capacity=300)
    assert 0 < decision.simulations < 5000
    assert decision.visits.sum() == decision.simulations


def test_visits_and_the_logged_tree(small, toy):
    decision = small.search(toy, 400)
    assert decision.visits.sum() == decision.simulations == 400
    first = [edge for edge in decision.tree if edge.level == 1]
    second = [edge for edge in decision.tree if edge.level == 2]
    assert decision.tree == (*first, *second)
    for edge in first:
        assert (edge.parent, edge.observation) == (-1, ())
        assert edge.visits == decision.visits[edge.action]
        assert edge.value == decision.values[edge.action]
    assert 0 < len(second) <= 40
    for edge in second:
        assert edge.visits <= first[edge.parent].visits
        assert len(edge.observation) == 2  # look and lift always give a percept, in the end
    assert [e.visits for e in second] == sorted((e.visits for e in second), reverse=True)


@pytest.mark.parametrize("wrong", [{"simulations": -1}, {"exploration": -0.1}, {"capacity": 0}])
def test_settings_are_checked(wrong):
    with pytest.raises(SettingsError, match="POMCP needs"):
        POMCP(**wrong)


def test_threads_decide_alike(small):
    momdp = small.noisy_roc36(2)
    policy = POMCP(200).solve(momdp, np.random.default_rng(0))

    def decide(seed):
        return policy.decide(History(initial_belief(momdp)), np.random.default_rng(seed))

    alone = [decide(seed) for seed in range(24)]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(decide, range(24)))
    assert all(map(same, alone, together))
