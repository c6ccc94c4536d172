"""The search's arithmetic on three small trees, worked out by hand and exact to 1e-12.

Each asks for one attribute at even odds, for +100 or -100; a report that is right with probability
p is worth 200 p - 100. Whoever makes the search faster sees here that it is the same search.
"""

from fractions import Fraction

import numpy as np
import pytest

from meal_bayes.domain import Behavior, Domain, Effect, Query, TransitionDiagram
from meal_bayes.momdp import Objective, build_momdp

EXACT = 1e-12


def problem(behaviors, *, success=1.0, limit=1, discount=1.0):
    """Build a query of one attribute; behaviors are (cost, Pr(yes | false), Pr(yes | true))."""
    names = [f"b{i}" for i in range(len(behaviors))]
    effects = tuple(Effect("x0", name, "x0", success) for name in names)
    acts = [Behavior(name, row[0], ("m",)) for name, row in zip(names, behaviors, strict=True)]
    diagram = TransitionDiagram(states=("x0", "term"), start="x0", effects=effects)
    domain = Domain("chain", ("red",), tuple(acts), diagram, report_reward=100.0)
    rows = [[[1.0 - false, false], [1.0 - true, true]] for _, false, true in behaviors]
    objective = Objective(discount=discount)
    return build_momdp(domain, Query(("red",)), np.array([rows]), limit=limit, objective=objective)


def exactly(*values):
    return pytest.approx([float(value) for value in values], abs=EXACT)


def test_two_behaviors_share_the_simulations(small):
    """b0 costs 3 s and is right in 4/5, b1 costs 1 s and is right in 3/5; one percept of each.

    V(4/5) = 200 4/5 - 100 = 60, as b1 then changes no report. So Q(b0) = -3 + 60 = 57.
    After b1 the odds are 3:2, and b0 leaves right 3/5 4/5 + 2/5 4/5 = 4/5: V = 57, Q(b1) = 56.
    Both are worth as much to plans, so the bounds are the same, and simulations change neither.
    UCB1's constant is .06 x 200 = 12. Scores Q + 12 sqrt(ln(n + 1) / (visits + 1)) of b0, b1:
    67.0, 66.0: b0. 65.9, 68.6: b1. 67.0, 66.0: b0. 65.8, 66.8: b1. Two visits each.
    """
    momdp = problem([(3.0, 0.2, 0.8), (1.0, 0.4, 0.6)])
    bounds = small.search(momdp, 0, always=True, points=0)
    assert bounds.values == exactly(57, 56, 0)
    decision = small.search(momdp, 4, always=True, points=0)
    assert decision.values == exactly(57, 56, 0)
    assert decision.visits.tolist() == [2, 2, 0]


def test_failures_are_summed_out(small):
    """A behavior of 3 s, right in 4/5, comes off in half of its executions; discount 9/10.

    cost = 3 / (1 - 9/10 1/2) = 60/11, discount = (9/10 1/2) / (1 - 9/10 1/2) = 9/11,
    Q = -60/11 + 9/11 60 = 480/11, of the plan as of the search, whose simulations all go there.
    """
    half = Fraction(1, 2)
    discount = Fraction(9, 10)
    lasting = 1 - discount * half
    value = -3 / lasting + discount * half / lasting * 60
    assert value == Fraction(480, 11)
    momdp = problem([(3.0, 0.2, 0.8)], success=0.5, discount=0.9)
    for simulations in (0, 3):
        decision = small.search(momdp, simulations, always=True, points=0)
        assert decision.values == exactly(value, 0)
        assert decision.visits.tolist() == [simulations, 0]


def test_looking_again_is_worth_more_than_a_plan(small):
    """A behavior of 10 s says yes of all true objects and of half of the false, at most twice.

    No (1/4) tells all: V = 100. Yes (3/4) leaves true at 2/3, worth 200 2/3 - 100 = 100/3; once
    more, right 2/3 + 1/3 1/2 = 5/6: V(yes) = max(100/3, -10 + 200 5/6 - 100) = 170/3.
    Q = -10 + 1/4 100 + 3/4 170/3 = 115/2. The plan looks twice whatever comes:
    -20 + 200 (1/2 + 1/2 3/4) - 100 = 55, the bound before any simulation.
    """
    again = -10 + 200 * Fraction(5, 6) - 100
    value = -10 + Fraction(1, 4) * 100 + Fraction(3, 4) * again
    assert (again, value) == (Fraction(170, 3), Fraction(115, 2))
    momdp = problem([(10.0, 0.5, 1.0)], limit=2)
    assert small.search(momdp, 0, always=True, points=0).values == exactly(55, 0)
    decision = small.search(momdp, 5, always=True, points=0)
    assert decision.values == exactly(value, 0)
    assert decision.visits.tolist() == [5, 0]
