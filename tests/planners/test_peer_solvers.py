"""Planners of other libraries, as the benchmark runs them: they are given the problem as it is."""

import random
from importlib import import_module

import numpy as np
import pytest
from peer_tables import PeerTables, Steps
from planner_models import build_model, momdp_of
from rollout import simulate

from meal_bayes.errors import SettingsError
from meal_bayes.momdp.flat_pomdp import flatten

DRAWS = 1500
SIMULATIONS = 1000  # a decision
PEERS = (
    ("pomdp_py", "PomdpPy", ()),
    ("pomdpplanners", "PomdpPlanners", ("pomcp",)),
    ("pomdpplanners", "PomdpPlanners", ("sparse-pft",)),
)


@pytest.fixture(params=PEERS, ids=["pomdp-py", "pomcp", "sparse-pft"])
def solver(request):
    """A peer with little time."""
    module, name, settings = request.param
    return getattr(request.getfixturevalue(module), name)(*settings, SIMULATIONS)


def behavior(name, source, target, cost, *, informative):
    return {
        "behavior": name, "source": source, "target": target, "success": 1.0, "cost_s": cost,
        "informative": informative, "true_positive_rate": [0.97], "false_positive_rate": [0.03],
    }  # fmt: skip


@pytest.fixture
def small():
    """To lift and to look, then to report: anything else is worth less."""
    return build_model(
        {
            "model": "small", "attributes": ["heavy"], "discount": 0.99,
            "correct": 500, "incorrect": -500,
            "behaviors": [
                behavior("lift", "x0", "x1", 1.0, informative=False),
                behavior("look", "x1", "x1", 2.0, informative=True),
                behavior("drop", "x1", "x0", 30.0, informative=True),
            ],
        }
    )  # fmt: skip


@pytest.mark.statistical
@pytest.mark.parametrize("name", ["A2", "random2-1"])
def test_peers_draw_from_the_problem(name):
    """Where a behavior is legal, and for every answer, as in the dense arrays of the problem."""
    random.seed(1)
    momdp = momdp_of(name)
    tables = PeerTables(momdp)
    flat = flatten(momdp)
    n_y = tables.n_y
    living = tables.end * tables.n_y
    for x in range(tables.end):
        assert tables.allowed[x] == [
            *np.flatnonzero(momdp.legal[x]), *range(momdp.n_behaviors, momdp.n_actions)
        ]  # fmt: skip
        for y, action in np.ndindex(n_y, momdp.n_actions):
            if action not in tables.allowed[x]:
                continue
            state = x * n_y + y
            assert tables.reward[x][y][action] == pytest.approx(flat.reward[state, action])
            counts = np.zeros((living + 1, tables.none + 1))
            for _ in range(DRAWS):
                after = tables.next_x(x, action)
                percept = tables.percept(after, y, action)
                counts[min(after * n_y + y, living), percept] += 1
            expected = flat.transition[action, state, :, None] * flat.observation[action, state]
            error = np.sqrt(expected * (1 - expected) / DRAWS)
            assert (abs(counts / DRAWS - expected) <= 5 * error + 2 / DRAWS).all()


@pytest.mark.quick(1)
@pytest.mark.statistical
@pytest.mark.parametrize("name", ["A2", "random2-3"])
def test_steps_are_drawn_from_the_problem(name):
    random.seed(2)
    momdp = momdp_of(name)
    steps = Steps(momdp)
    n = len(momdp.query)
    rewards = momdp.reports.rewards()
    for x, y in np.ndindex(steps.end, steps.n_y):
        truth = momdp.query.values[y].astype(int)
        for action in steps.allowed[x]:
            drawn = [steps.step(x, y, action) for _ in range(DRAWS)]
            after, percepts, earned = map(np.array, zip(*drawn, strict=True))
            if action >= steps.n_e:
                assert set(after) == {steps.end}
                answer = action - steps.n_e
                right = rewards[y, answer] if answer < steps.n_y else 0.0
                assert earned.tolist() == [right] * DRAWS
                continue
            assert earned == pytest.approx(-momdp.expected_cost()[x, action])
            moves = np.bincount(after, minlength=steps.end + 1) / DRAWS
            assert_frequent(moves, momdp.transition[action, x], DRAWS)
            perceives = percepts != steps.none
            comes = (momdp.transition[action, x] * momdp.observation_probability[action, x]).sum()
            assert_frequent(perceives.mean(), comes, DRAWS)
            for i in range(n):
                rates = momdp.confusion[i, action, :, 1]
                if perceives.any() and rates[0] != rates[1]:
                    yes = percepts[perceives] >> (n - 1 - i) & 1
                    assert_frequent(yes.mean(), rates[truth[i]], perceives.sum())


def assert_frequent(found, expected, draws):
    """Check frequencies by the standard error that they have."""
    error = np.sqrt(expected * (1 - expected) / draws)
    assert (abs(found - expected) <= 5 * error + 2 / draws).all()


@pytest.mark.long
def test_a_peer_solves_what_takes_a_lift_and_a_look(solver, small):
    done = simulate(
        small, solver.solve(small, np.random.default_rng(0)), 20, np.random.default_rng(1)
    )
    assert done.value >= 250
    assert done.simulations == SIMULATIONS * done.decisions


@pytest.mark.long
def test_active_inference_solves_what_takes_a_lift_and_a_look(pymdp, small):
    rng = np.random.default_rng(0)
    solver = import_module("pymdp_solver").Pymdp()
    done = simulate(small, solver.solve(small, rng), 20, np.random.default_rng(1))
    assert done.value >= 250
    with pytest.raises(SettingsError, match="finite precision"):
        solver.solve(momdp_of("A1-precision1"), rng)


@pytest.mark.long
def test_a_peer_decides_the_same_again(solver, small):
    first, second = (
        simulate(small, solver.solve(small, np.random.default_rng(0)), 5, np.random.default_rng(2))
        for _ in range(2)
    )
    assert np.array_equal(first.returns, second.returns)


@pytest.mark.long
def test_what_a_peer_cannot_hold_is_refused(solver):
    with pytest.raises(SettingsError, match="finite precision"):
        solver.solve(momdp_of("A1-precision1"), np.random.default_rng(0))
