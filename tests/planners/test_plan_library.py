"""Plans are walks of the diagram, their values lower bounds, and hardly any is missing."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.domain import load_domain
from meal_bayes.momdp import Objective
from meal_bayes.planners.compiled import compile_momdp
from meal_bayes.planners.open_loop.library import plan_library
from meal_bayes.planners.open_loop.values import evaluate_plans, plan_scratch

DOMAINS = ["toy", "roc36", "roc36_published", "ispy32", "cy101"]


def made(momdp):
    """Compiled MOMDP and its plans."""
    problem = compile_momdp(momdp)
    return problem, plan_library(momdp, problem)


def values_at(problem, plans, x, weight, seen=None):
    """Best plan value by first behavior, (E,)."""
    scratch = plan_scratch(problem.percepts, plans)
    if seen is not None:
        scratch.counts[:], scratch.total[:] = seen, np.sum(seen, axis=2)[0]
    evaluate_plans(problem, plans, x, weight, scratch, -np.inf, False)
    return scratch.value


@pytest.mark.parametrize("name", DOMAINS)
@pytest.mark.parametrize("precision", [5.0, np.inf])
@pytest.mark.parametrize(
    ("n", "options"), [(1, {}), (2, {}), (1, {"own_classes": 2}), (1, {"shared": 3})]
)
def test_every_legal_behavior_has_a_plan(small, name, precision, n, options):
    rng = np.random.default_rng(4)
    momdp = small.random(name, n, 2, rng, precision=precision, limit=5, **options)
    problem, plans = made(momdp)
    for x in range(momdp.terminal):
        values = values_at(problem, plans, x, small.weights(momdp, np.zeros(n)))
        np.testing.assert_array_equal(np.isfinite(values), problem.dynamics.step["legal"][x])


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"mistaken": 0.1},
        {"own_classes": 3},
        {"shared": 3},
        {"objective": Objective(abstain=True)},
    ],
)
@pytest.mark.parametrize(
    ("n", "levels", "finite"), [(1, 2, False), (2, 2, False), (2, 2, True), (1, 4, True)]
)
def test_plan_values_are_lower_bounds(small, n, levels, finite, options):
    momdp = small.toy(n + levels, n, levels, finite=finite, limit=2, **options)
    optimum = small.expectimax(momdp)
    optimum.value(momdp.start, optimum.nothing_seen())
    problem, plans = made(momdp)
    reached = list(optimum.known)
    assert {x for x, _ in reached} == {0, 1}
    for x, seen in reached:
        belief = optimum.belief(x, seen)
        values = values_at(problem, plans, x, np.exp(belief.log_prob), belief.percept_counts)
        assert values.max() <= optimum.value(x, seen) + 1e-9
        if levels == 2 and seen == optimum.nothing_seen():  # of graded percepts, plans use a half
            loss = optimum.value(x, seen) - max(values.max(), optimum.stop(x, seen))
            assert loss < 4.0  # of 200 between right and wrong; with one plan an x 7 to 23


def test_what_cannot_be_undone_is_never_planned(small):
    """A thing in the hand stays there: no plan presses it then."""
    effects = [
        {"from": "table", "do": "press", "to": "table"},
        {"from": "table", "do": "lift", "to": "hand", "probability": 0.9},
        {"from": "hand", "do": "shake", "to": "hand"},
    ]
    domain = load_domain({
        "name": "one way", "attributes": ["full"], "report_reward": 60.0,
        "behaviors": [
            {"name": name, "cost": 2.0, "modalities": ["force"]}
            for name in ("press", "lift", "shake")
        ],
        "diagram": {"states": ["table", "hand"], "start": "table", "effects": effects},
    })  # fmt: skip
    momdp = small.momdp(domain, {"full": {"press": (0.7, 0.3), "shake": (0.8, 0.2)}})
    _, plans = made(replace(momdp, bonus=np.array([[[900.0, 900.0], [90.0, 90.0], [0.0, 0.0]]])))
    for x, (start, end) in enumerate(itertools.pairwise(plans.first)):
        assert momdp.legal[x, plans.plan["action"][start:end]].all()
