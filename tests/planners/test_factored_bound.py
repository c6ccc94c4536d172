"""Bounds must hold for every policy, and be tight where the optimum is known."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from planner_bound import upper_bound

from meal_bayes.domain import Query
from meal_bayes.momdp import MOMDP, Objective, initial_belief
from meal_bayes.planners import History
from meal_bayes.planners.jit import NO_BEHAVIOR
from meal_bayes.planners.table.grid import informative_pairs, make_reader, value_after
from meal_bayes.planners.table.policy import Factored

RNG = np.random.default_rng(0)  # nothing in the solver is random


def solve(momdp, points=3_000, **settings):
    return Factored(points, **settings).solve(momdp, RNG)


def any_momdp(seed):
    """Draw a problem: diagram, failures, forks, rows, shaping, how reports are paid, and exits."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 4))
    e = int(rng.integers(1, 4))
    x = int(rng.integers(2, 5))
    levels = int(rng.choice([2, 4])) if n < 3 else 2
    legal = rng.random((x, e)) < 0.7
    legal[-1] = False
    transition = np.zeros((e, x, x))
    observation_probability = np.zeros((e, x, x))
    for b, at in product(range(e), range(x)):
        transition[b, at, -1] = 1.0
        if legal[at, b]:
            fails = 0.5 * rng.random() * (rng.random() < 0.6)
            transition[b, at] = [*(1 - fails) * rng.dirichlet(np.full(x - 1, 0.4)), 0.0]
            observation_probability[b, at, :-1] = rng.random(x - 1) < 0.8
            moved = transition[b, at, at]
            transition[b, at, at] += fails
            observation_probability[b, at, at] *= moved / max(transition[b, at, at], 1e-300)
    confusion = rng.dirichlet(np.full(levels, rng.choice([0.3, 1.0, 3.0])), (n, e, 2))
    dull = rng.random((n, e)) < 0.25
    confusion[dull, 1] = confusion[dull, 0]
    prior = rng.uniform(0.1, 0.9, n)
    prior[0] = rng.choice([prior[0], 0.5, 1.0], p=[0.6, 0.3, 0.1])
    discount = float(rng.choice([0.5, 0.8, 0.95, 0.99, 1.0]))
    return MOMDP(
        query=Query(tuple("abc"[:n])),
        x_names=(*(f"x{i}" for i in range(x - 1)), "term"),
        behavior_names=tuple(f"b{i}" for i in range(e)),
        start=int(rng.integers(x - 1)),
        transition=transition,
        observation_probability=observation_probability,
        legal=legal,
        confusion=confusion,
        precision=np.full((n, e, 2), np.inf),
        prior=prior,
        latent_classes=np.tile(np.eye(2), (n, 1, 1)),
        cost=rng.uniform(0.2, 5.0, e),
        correct=float(rng.choice([10, 100, 500])),
        incorrect=float(rng.choice([-500, -100, -10, 0])),
        bonus=rng.uniform(-3, 3, (n, e, 2)) * (rng.random() < 0.35) * (discount < 1),
        bonus_limit=np.full(e, np.inf),
        limit=np.full(e, np.inf),
        discount=discount,
        abstain=bool(rng.random() < 0.5),
    )


def attainable(momdp, x, b, depth):
    """Value of the best plan of so many executions, by the definition: never above the optimum."""
    best = float(momdp.reports.of_right(np.maximum(b, 1 - b)))
    best = max(best, 0.0) if momdp.abstain else best
    attributes = np.arange(len(b))
    for e in np.flatnonzero(momdp.legal[x]) if depth else ():
        rows = momdp.confusion[:, e]
        idle = momdp.transition[e, x, x] * (1 - momdp.observation_probability[e, x, x])
        if idle >= 1:  # to wait is no choice
            continue
        pay = (1 - b) * momdp.bonus[:, e, 0] + b * momdp.bonus[:, e, 1]
        comes = momdp.transition[e, x] @ momdp.observation_probability[e, x]
        value = float(comes * pay.sum() - momdp.cost[e])
        for target in np.flatnonzero(momdp.transition[e, x]):
            p = momdp.transition[e, x, target]
            senses = momdp.observation_probability[e, x, target]
            if senses < 1:
                after = attainable(momdp, target, b, depth - 1)
                value += momdp.discount * p * (1 - senses) * after
            for z in product(range(momdp.levels), repeat=len(b) if senses else 0):
                if not z:
                    continue
                joint = b * rows[attributes, 1, z]
                each = joint + (1 - b) * rows[attributes, 0, z]
                if each.prod() > 1e-12:
                    after = attainable(momdp, target, joint / each, depth - 1)
                    value += momdp.discount * p * senses * each.prod() * after
        best = max(best, value)
    return best


def depth_for(momdp, work=2_000):
    targets = (momdp.transition[:, :, :-1] > 0).sum(axis=(0, 2)).max()
    outcomes = max(2, targets * (momdp.levels ** len(momdp.query) + 1))
    return max(1, int(np.log(work) / np.log(outcomes)))


def bound_at(policy, x, b):
    """Value of the table of bounds; marginals that no percept moves count as prior."""
    reader = make_reader(policy.bound, policy.model.percepts.rows, policy.moves)
    return value_after(reader, x, NO_BEHAVIOR, b)


class TestTheBound:
    @pytest.mark.quick(14)
    @pytest.mark.parametrize("seed", range(50))
    def test_no_plan_is_worth_more(self, seed):
        """At the start and at other beliefs, however coarse the grid."""
        momdp = any_momdp(seed)
        rng = np.random.default_rng(seed)
        policy = solve(momdp, points=int(rng.choice([600, 1_500])))
        room = 1e-6 * (momdp.correct - momdp.incorrect) + 1e-9
        depth = depth_for(momdp)
        start = attainable(momdp, momdp.start, momdp.prior, depth)
        assert policy.upper_bound >= start - room
        assert upper_bound(momdp, size=1 + seed % 3, points=600) >= start - room
        moves = informative_pairs(momdp).any(axis=1)
        for _ in range(2):
            x = int(rng.integers(momdp.terminal))
            b = np.where(moves, 1 / (1 + np.exp(-rng.normal(0, 3, len(moves)))), momdp.prior)
            value = attainable(momdp, x, b, depth)
            assert bound_at(policy, x, b) >= value - room

    def test_it_is_tight_where_percepts_may_fail_to_come(self):
        """One behavior to and fro, half of the time without a percept."""
        momdp = replace(to_and_fro(1), prior=[0.5], discount=0.5)
        momdp = replace(momdp, observation_probability=0.4 * momdp.observation_probability)
        best = attainable(momdp, 0, momdp.prior, 8)
        bound = solve(momdp, points=20_000, tolerance=1e-5).upper_bound
        assert best - 1e-6 <= bound <= best + 0.5**8 * (momdp.correct - best) + 0.02

    def test_what_pays_is_done_for_ever(self):
        """Failures cost and pay nothing; percepts tell nothing, so that the pay is expected."""
        momdp = to_and_fro(2)
        transition = momdp.transition.copy()
        transition[0, 0, :2] = transition[0, 1, 1::-1] = [0.3, 0.7]
        momdp = replace(
            momdp,
            transition=transition,
            confusion=np.full((2, 1, 2, 2), 0.5),
            bonus=[[[3.0, -1.0]], [[-2.0, 5.0]]],
        )
        comes = (transition[0, 0] * momdp.observation_probability[0, 0]).sum()
        pay = comes * (0.8 * 3 - 0.2 - 0.1 * 2 + 0.9 * 5) - momdp.cost[0]
        worth = pay / (1 - momdp.discount)
        policy = solve(momdp)
        decision = policy.decide(History(initial_belief(momdp)), RNG)
        assert policy.upper_bound == pytest.approx(worth, abs=0.2)
        assert decision.values[0] == pytest.approx(worth, abs=0.2)
        assert decision.action == 0
        telling_too = replace(momdp, confusion=to_and_fro(2).confusion)
        for size in (1, 2):
            assert upper_bound(telling_too, size=size) >= worth - 1e-6

    @pytest.mark.parametrize(
        ("n", "points", "floor", "roof"),
        [
            (1, 50, 441.298, 443.0),
            (1, 10_000, 441.298, 441.35),
            (2, 500, 387.0, 395.0),
            (2, 20_000, 387.0, 387.7),
            (3, 5_000, 238.0, 265.0),
            (3, 50_000, 238.0, 243.0),
        ],
    )
    def test_known_models(self, small, n, points, floor, roof):
        """Floors: SARSOP's lower bound of A1 (it closes at 441.30), values of policies for others.

        SARSOP's own upper bounds after 60 s are 441.30, 433 and 457.
        """
        assert floor <= solve(small.noisy_roc36(n), points).upper_bound <= roof

    def test_percepts_that_run_out_only_lower_the_value(self, small):
        for seed in range(3):
            momdp = small.toy(
                seed, 2, 2, finite=False, limit=2, objective=Objective(abstain=bool(seed % 2))
            )
            optimum = small.expectimax(momdp)
            best = optimum.value(momdp.start, optimum.nothing_seen())
            assert solve(momdp).upper_bound >= best - 1e-6

    def test_undiscounted(self, small):
        momdp = small.toy(4, 1, 2, finite=False, objective=Objective(discount=1.0))
        bound = solve(momdp, tolerance=1e-5).upper_bound
        assert attainable(momdp, momdp.start, momdp.prior, 5) <= bound < momdp.correct
        nearly = solve(replace(momdp, discount=1 - 1e-6), tolerance=1e-5).upper_bound
        assert bound == pytest.approx(nearly, abs=0.02)


def to_and_fro(n):
    """Make a problem of two x and one behavior between them."""
    transition = np.array([[[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]])
    return MOMDP(
        query=Query(tuple("ab"[:n])),
        x_names=("left", "right", "term"),
        behavior_names=("cross",),
        start=0,
        transition=transition,
        observation_probability=(transition > 0).astype(float),
        legal=np.array([[True], [True], [False]]),
        confusion=np.array([[[[0.8, 0.2], [0.3, 0.7]]]] * n),
        precision=np.full((n, 1, 2), np.inf),
        prior=np.array([0.2, 0.9])[:n],
        latent_classes=np.tile(np.eye(2), (n, 1, 1)),
        cost=np.array([0.5]),
        correct=20.0,
        incorrect=-20.0,
        bonus=np.zeros((n, 1, 2)),
        bonus_limit=np.full(1, np.inf),
        limit=np.full(1, np.inf),
        discount=0.9,
    )


class TestPartsOfAQuery:
    def test_attributes_without_informative_behaviors_need_no_axis(self, small):
        """All they do is to be guessed: r+ shrinks by the chance of that."""
        rates = {"red": {"look": (0.8, 0.25)}, "heavy": {}}
        momdp = small.momdp("toy", rates, prior=[0.5, 0.3])
        policy = solve(momdp)
        assert policy.bound.size.tolist()[1] == 1
        gap = momdp.correct - momdp.incorrect
        reduced = small.momdp(
            "toy", {"red": rates["red"]}, objective=Objective(correct=momdp.incorrect + 0.7 * gap)
        )
        assert policy.upper_bound == pytest.approx(solve(reduced).upper_bound, abs=0.05)
        assert upper_bound(momdp, size=1) == pytest.approx(policy.upper_bound, abs=0.05)

    @pytest.mark.quick(2)
    @pytest.mark.parametrize("seed", range(4))
    def test_of_finite_precision(self, small, seed):
        """Percepts that repeat themselves tell less than fresh ones."""
        momdp = small.toy(
            seed, 1 + seed % 2, 2, finite=False, limit=3, objective=Objective(discount=0.95)
        )
        momdp = replace(momdp, precision=np.full_like(momdp.precision, 0.5 + seed))
        optimum = small.expectimax(momdp)
        best = optimum.value(momdp.start, optimum.nothing_seen())
        bound = upper_bound(momdp, points=2_000)
        assert best <= bound + 1e-6
        known = replace(momdp, precision=np.full_like(momdp.precision, np.inf))
        assert bound == upper_bound(known, points=2_000)
