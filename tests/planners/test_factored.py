"""Bounds that must hold for every policy, problems whose optimum is known, and what is refused."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from meal_bayes.domain import Query, load_domain
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import (
    ITRS,
    MOMDP,
    build_momdp,
    initial_belief,
    report_value,
    shape_reward,
)
from meal_bayes.planners import POMCP, Greedy, History
from meal_bayes.planners.factored.bound import restrict, upper_bound
from meal_bayes.planners.factored.grid import (
    expectation,
    make_axis,
    make_room,
    make_table,
    percepts_on,
    refine,
    telling,
    value_after,
)
from meal_bayes.planners.factored.policy import Factored
from meal_bayes.planners.rollout import simulate

RNG = np.random.default_rng(0)  # nothing in the solver is random


def solve(momdp, points=3_000, **settings):
    return Factored(points, **settings).solve(momdp, RNG)


def log_odds(chance):
    with np.errstate(divide="ignore"):
        return np.log(chance) - np.log1p(-np.asarray(chance))


def any_momdp(seed):
    """Draw a problem: diagram, failures, forks, rows, shaping, how reports are paid, and exits."""
    rng = np.random.default_rng(seed)
    n, e, x = int(rng.integers(1, 4)), int(rng.integers(1, 4)), int(rng.integers(2, 5))
    levels = int(rng.choice([2, 4])) if n < 3 else 2
    legal = rng.random((x, e)) < 0.7
    legal[-1] = False
    transition, informative = np.zeros((e, x, x)), np.zeros((e, x, x))
    for b, here in product(range(e), range(x)):
        transition[b, here, -1] = 1.0
        if legal[here, b]:
            fails = 0.5 * rng.random() * (rng.random() < 0.6)
            transition[b, here] = [*(1 - fails) * rng.dirichlet(np.full(x - 1, 0.4)), 0.0]
            informative[b, here, :-1] = rng.random(x - 1) < 0.8
            moved = transition[b, here, here]
            transition[b, here, here] += fails
            informative[b, here, here] *= moved / max(transition[b, here, here], 1e-300)
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
        informative=informative,
        legal=legal,
        confusion=confusion,
        precision=np.full((n, e, 2), np.inf),
        prior=prior,
        kinds=np.tile(np.eye(2), (n, 1, 1)),
        cost=rng.uniform(0.2, 5.0, e),
        correct=float(rng.choice([10, 100, 500])),
        incorrect=float(rng.choice([-500, -100, -10, 0])),
        bonus=rng.uniform(-3, 3, (n, e, 2)) * (rng.random() < 0.35) * (discount < 1),
        limit=np.full(e, np.inf),
        discount=discount,
        abstain=bool(rng.random() < 0.5),
        additive=bool(rng.random() < 0.4),
    )


def attainable(momdp, x, b, depth):
    """Value of the best plan of so many executions, by the definition: never above the optimum."""
    best = float(momdp.report_reward(np.maximum(b, 1 - b)))
    if momdp.abstain and not momdp.legal[x].all():
        best = max(best, -float(momdp.cost[~momdp.legal[x]].min()))
    attributes = np.arange(len(b))
    for e in np.flatnonzero(momdp.legal[x]) if depth else ():
        rows = momdp.confusion[:, e]
        idle = momdp.transition[e, x, x] * (1 - momdp.informative[e, x, x])
        if idle >= 1:  # to wait is no choice
            continue
        pay = (1 - b) * momdp.bonus[:, e, 0] + b * momdp.bonus[:, e, 1]
        value = float(pay.sum() - momdp.cost[e])
        for target in np.flatnonzero(momdp.transition[e, x]):
            p = momdp.transition[e, x, target]
            senses = momdp.informative[e, x, target]
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


class TestTheBound:
    @pytest.mark.parametrize("seed", range(50))
    def test_no_plan_is_worth_more(self, seed):
        """At the start and at other beliefs, however coarse the grid."""
        momdp, rng = any_momdp(seed), np.random.default_rng(seed)
        policy = solve(momdp, points=int(rng.choice([600, 1_500])))
        room, depth = 1e-6 * (momdp.correct - momdp.incorrect) + 1e-9, depth_for(momdp)
        start = attainable(momdp, momdp.start, momdp.prior, depth)
        assert policy.upper_bound >= start - room
        assert upper_bound(momdp, size=1 + seed % 3, points=600) >= start - room
        moves = telling(momdp).any(axis=1)
        for _ in range(2):
            x = int(rng.integers(momdp.terminal))
            b = np.where(moves, 1 / (1 + np.exp(-rng.normal(0, 3, len(moves)))), momdp.prior)
            value = attainable(momdp, x, b, depth)
            assert policy.value_at(x, log_odds(b)) >= value - room

    @pytest.mark.parametrize("additive", [False, True])
    @pytest.mark.parametrize("seed", range(3))
    def test_it_is_tight(self, small, seed, additive):
        """With half of everything lost at each step, nine steps ahead are the optimum."""
        n = 1 + seed % 2
        momdp = small.toy(seed, n, 2, finite=False, discount=0.5, additive=additive, abstain=True)
        momdp = replace(momdp, transition=without_failures(momdp), cost=[0.3, 0.7, 0.1])
        best = attainable(momdp, momdp.start, momdp.prior, 9 if n == 1 else 4)
        lost = 0.5 ** (9 if n == 1 else 4) * (momdp.correct - best)
        bound = solve(momdp, points=20_000, tolerance=1e-5).upper_bound
        assert best - 1e-6 <= bound <= best + lost + 0.02

    def test_it_is_tight_where_percepts_may_fail_to_come(self):
        """One behavior to and fro, half of the time without a percept."""
        momdp = replace(to_and_fro(1), prior=[0.5], discount=0.5)
        momdp = replace(momdp, informative=0.4 * momdp.informative)
        best = attainable(momdp, 0, momdp.prior, 8)
        bound = solve(momdp, points=20_000, tolerance=1e-5).upper_bound
        assert best - 1e-6 <= bound <= best + 0.5**8 * (momdp.correct - best) + 0.02

    @pytest.mark.parametrize("additive", [False, True])
    def test_what_pays_is_done_for_ever(self, additive):
        """Failures cost and pay as well; percepts tell nothing, so that the pay is expected."""
        momdp = to_and_fro(2)
        transition = momdp.transition.copy()
        transition[0, 0, :2] = transition[0, 1, 1::-1] = [0.3, 0.7]
        momdp = replace(
            momdp,
            transition=transition,
            confusion=np.full((2, 1, 2, 2), 0.5),
            bonus=[[[3.0, -1.0]], [[-2.0, 5.0]]],
            additive=additive,
        )
        pay = 0.8 * 3 - 0.2 - 0.1 * 2 + 0.9 * 5 - momdp.cost[0]
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

    @pytest.mark.parametrize("n", [1, 2])
    def test_no_policy_is_worth_more(self, small, n):
        momdp = small.noisy_roc36(n)
        bound = solve(momdp).upper_bound
        for solver in (Greedy(), POMCP(0)):
            done = simulate(momdp, solver.solve(momdp, RNG), 60, np.random.default_rng(n))
            assert done.value <= bound + 5 * done.value_se

    def test_percepts_that_run_out_only_lower_the_value(self, small):
        for seed in range(3):
            momdp = small.toy(seed, 2, 2, finite=False, limit=2, abstain=bool(seed % 2))
            optimum = small.expectimax(momdp)
            best = optimum.value(momdp.start, optimum.nothing_seen())
            assert solve(momdp).upper_bound >= best - 1e-6

    def test_undiscounted(self, small):
        momdp = small.toy(4, 1, 2, finite=False, discount=1.0)
        found = solve(momdp, tolerance=1e-5).upper_bound
        assert attainable(momdp, momdp.start, momdp.prior, 5) <= found < momdp.correct
        nearly = solve(replace(momdp, discount=1 - 1e-6), tolerance=1e-5).upper_bound
        assert found == pytest.approx(nearly, abs=0.02)


def to_and_fro(n):
    """Make a problem of two x and one behavior between them."""
    transition = np.array([[[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]])
    return MOMDP(
        query=Query(tuple("ab"[:n])),
        x_names=("left", "right", "term"),
        behavior_names=("cross",),
        start=0,
        transition=transition,
        informative=(transition > 0).astype(float),
        legal=np.array([[True], [True], [False]]),
        confusion=np.array([[[[0.8, 0.2], [0.3, 0.7]]]] * n),
        precision=np.full((n, 1, 2), np.inf),
        prior=np.array([0.2, 0.9])[:n],
        kinds=np.tile(np.eye(2), (n, 1, 1)),
        cost=np.array([0.5]),
        correct=20.0,
        incorrect=-20.0,
        bonus=np.zeros((n, 1, 2)),
        limit=np.full(1, np.inf),
        discount=0.9,
    )


def without_failures(momdp):
    """Make every behavior succeed."""
    transition, states = momdp.transition.copy(), np.arange(len(momdp.x_names))
    for e in range(momdp.n_behaviors):
        for x in states[momdp.legal[:, e]]:
            fails = transition[e, x, x] * (1 - momdp.informative[e, x, x])
            if 0 < fails < 1:
                transition[e, x, x] -= fails
                transition[e, x] /= transition[e, x].sum()
    return transition


class TestPartsOfAQuery:
    def test_of_all_or_nothing(self, small):
        """Fewer attributes are easier; two of the three bound A3 better than a coarse grid."""
        momdp = small.noisy_roc36(3)
        bounds = [upper_bound(momdp, size=size, points=8_000) for size in (1, 2, 3)]
        assert bounds[0] > bounds[1] + 20
        assert bounds[1] >= bounds[2] > 238
        assert bounds[1] < 243

    def test_of_an_additive_query(self, small):
        """Two attributes by one behavior each: blocks of one bound both, both at once are less."""
        momdp = small.momdp("toy", small.rates, additive=True, correct=40.0, incorrect=-40.0)
        parts, whole = upper_bound(momdp, size=1), upper_bound(momdp, size=2)
        alone = [solve(restrict(momdp, [i]), 50_000).upper_bound for i in range(2)]
        assert parts == pytest.approx(np.mean(alone), abs=1e-3)
        assert parts >= whole >= attainable(momdp, momdp.start, momdp.prior, 3)

    def test_attributes_that_nothing_tells_of_need_no_axis(self, small):
        """All they do is to be guessed: r+ shrinks by the chance of that."""
        rates = {"red": {"look": (0.8, 0.25)}, "heavy": {}}
        momdp = small.momdp("toy", rates, prior=[0.5, 0.3])
        policy = solve(momdp)
        assert policy.table.size.tolist()[1] == 1
        gap = momdp.correct - momdp.incorrect
        reduced = small.momdp("toy", {"red": rates["red"]}, correct=momdp.incorrect + 0.7 * gap)
        assert policy.upper_bound == pytest.approx(solve(reduced).upper_bound, abs=0.05)
        assert upper_bound(momdp, size=1) == pytest.approx(policy.upper_bound, abs=0.05)

    def test_twenty_attributes(self, small):
        """Mixed in one query: told of and not, more than any grid could hold."""
        momdp = small.ispy32(20, (0.95, 0.05))
        hopeless = replace(
            momdp, confusion=np.where(np.arange(20)[:, None, None, None] < 5, 0.5, momdp.confusion)
        )
        assert upper_bound(hopeless, size=2) < upper_bound(momdp, size=2) <= momdp.correct
        additive = upper_bound(replace(momdp, additive=True), size=2, points=3_000)
        assert momdp.incorrect < additive <= momdp.correct

    @pytest.mark.parametrize("seed", range(4))
    def test_of_finite_precision(self, small, seed):
        """Percepts that repeat themselves tell less than fresh ones."""
        momdp = small.toy(seed, 1 + seed % 2, 2, finite=False, limit=3, discount=0.95)
        momdp = replace(momdp, precision=np.full_like(momdp.precision, 0.5 + seed))
        optimum = small.expectimax(momdp)
        best = optimum.value(momdp.start, optimum.nothing_seen())
        bound = upper_bound(momdp)
        assert best <= bound + 1e-6
        assert bound == upper_bound(replace(momdp, precision=np.full_like(momdp.precision, np.inf)))

    def test_shaping_of_the_other_attributes_counts(self, small):
        momdp = small.toy(3, 2, 2, finite=False, discount=0.8)
        bonus = np.random.default_rng(3).uniform(-2, 2, (2, 3, 2))
        for additive in (False, True):
            shaped = replace(momdp, bonus=bonus, additive=additive)
            best = attainable(shaped, shaped.start, shaped.prior, 3)
            assert best <= upper_bound(shaped, size=1) + 1e-6
            assert best <= upper_bound(shaped, size=2) + 1e-6


class TestThePolicy:
    @pytest.mark.parametrize("seed", range(3))
    @pytest.mark.parametrize("limit", [1, 3])
    def test_it_is_near_the_optimum_where_percepts_run_out(self, small, seed, limit):
        """What has run out is planned without; what may run out is not foreseen."""
        momdp = small.toy(seed, 1 + seed % 2, 2, finite=False, limit=limit)
        optimum = small.expectimax(momdp)
        best = optimum.value(momdp.start, optimum.nothing_seen())
        value = optimum.of_policy(solve(momdp), 0)
        assert best - 0.05 * (momdp.correct - momdp.incorrect) <= value <= best + 1e-9

    @pytest.mark.statistical
    @pytest.mark.parametrize(("n", "floor"), [(1, 434), (2, 372), (3, 200)])
    def test_worth_on_the_noisy_robot(self, small, n, floor):
        """Known: 441.4, 387.2, 239.4. SARSOP's of 60 s are worth 441, 386, 109."""
        momdp = small.noisy_roc36(n)
        policy = solve(momdp, 20_000)
        done = simulate(momdp, policy, 100, np.random.default_rng(n))
        assert floor < done.value <= policy.upper_bound + 5 * done.value_se
        assert done.simulations == 0

    def test_a_decision_shows_its_values(self, small):
        momdp = small.noisy_roc36(2)
        momdp, belief = replace(momdp, abstain=False), initial_belief(momdp)
        decision = solve(momdp).decide(History(belief), RNG)
        legal = momdp.legal[momdp.start]
        assert np.isnan(decision.values[:-1][~legal]).all()
        assert decision.action == int(np.nanargmax(decision.values))
        assert decision.values[-1] == report_value(momdp, belief)
        assert (decision.value_se[~np.isnan(decision.values)] == 0).all()
        assert decision.visits.sum() == 0

    def test_it_ends_a_hopeless_trial(self, small):
        """By the cheapest illegal behavior where it may, else by guessing."""
        rates = {name: {"look": (0.51, 0.49)} for name in ("red", "heavy")}
        momdp = small.momdp("toy", rates, abstain=True)
        start = History(initial_belief(momdp))
        action = solve(momdp).decide(start, RNG).action
        assert not momdp.legal[momdp.start, action]
        momdp = replace(momdp, abstain=False, incorrect=0.0)
        assert solve(momdp).decide(start, RNG).action >= momdp.n_behaviors

    @pytest.mark.parametrize("odds", [[np.inf, -np.inf], [900.0, -900.0]])
    def test_certain_beliefs_report(self, small, toy, odds):
        policy = solve(toy)
        decision = policy.decide(History(small.believing(toy, odds)), RNG)
        assert decision.action == toy.n_behaviors + 0b10
        assert policy.value_at(0, odds) == pytest.approx(toy.correct, abs=1e-3)

    def test_sure_priors_and_deciding_percepts(self, small):
        momdp = small.momdp("toy", {"red": {"look": (1.0, 0.0)}, "heavy": {}}, prior=[0.5, 1.0])
        policy = solve(momdp)
        assert policy.table.size[1] == 1
        once = -momdp.cost[0] + momdp.discount * momdp.correct  # look does not fail
        assert policy.upper_bound == pytest.approx(once, abs=0.01)
        assert policy.decide(History(initial_belief(momdp)), RNG).action == 0

    def test_equal_problems_equal_policies(self, small):
        momdp = small.noisy_roc36(2)
        one, other = solve(momdp), solve(momdp)
        assert (one.table.value == other.table.value).all()
        start = History(initial_belief(momdp))
        assert (one.decide(start, RNG).values == other.decide(start, RNG).values)[-1]

    def test_shaping_attracts(self, small):
        """ITRS: what pays to explore is explored first."""
        momdp = small.momdp("toy", small.rates, discount=0.9)
        domain = load_domain("toy")
        itrs = ITRS(alpha=30.0, beta=0.0, delta=1.0)
        shaped = shape_reward(momdp, np.zeros((2, 3)), itrs, domain=domain)
        plain, paid = solve(momdp), solve(shaped)
        assert paid.upper_bound > plain.upper_bound
        start = History(initial_belief(momdp))
        sure = History(small.believing(momdp, [9.0, 9.0]))
        assert plain.decide(sure, RNG).action >= momdp.n_behaviors
        assert paid.decide(start, RNG).action < momdp.n_behaviors
        assert paid.decide(sure, RNG).action < momdp.n_behaviors


class TestTheGrid:
    @pytest.fixture
    def momdp(self):
        rng, domain = np.random.default_rng(2), load_domain("toy")
        confusion = rng.dirichlet(np.ones(4), (2, 3, 2))
        confusion[0, 1, 1] = confusion[0, 1, 0]  # lift tells nothing of the first
        return build_momdp(domain, Query(domain.attributes), confusion, prior=[0.3, 0.6])

    @pytest.fixture
    def table(self, momdp):
        axes = [make_axis(momdp, i, 1 + i) for i in range(2)]
        size = (momdp.terminal, len(axes[0]) * len(axes[1]))
        values = np.random.default_rng(3).normal(size=size)
        return make_table(axes, telling(momdp), values)

    def test_axes(self, momdp):
        axis = make_axis(momdp, 0, 3)
        assert (np.diff(axis) > 0).all()
        assert {0.0, 0.5, 1.0} <= set(axis)
        assert np.abs(axis - 0.3).min() < 1e-12
        assert set(make_axis(momdp, 0, 2)) <= set(axis)

    def test_expectations_are_those_over_every_percept(self, momdp, table):
        """Axis by axis, and looking ahead, as by the sum over all 16 percept vectors."""
        percepts = [percepts_on(momdp, i, axis) for i, axis in enumerate(table.axes)]
        room, x = make_room(table, 4), 1
        for e in range(2):
            found = expectation(table, percepts, e, table.value[x])
            for point in range(0, len(found), 7):
                b = table.beliefs[point]
                expected = sum(p * bilinear(table, x, after) for p, after in possible(momdp, e, b))
                assert found[point] == pytest.approx(expected)
                ahead = value_after(table, momdp.confusion, x, e, b, room)
                assert ahead == pytest.approx(expected)

    def test_values_between_points(self, momdp, table):
        room = make_room(table, 4)
        for b in np.random.default_rng(4).random((20, 2)):
            found = value_after(table, momdp.confusion, 0, -1, b, room)
            assert found == pytest.approx(bilinear(table, 0, b))

    def test_finer_axes_keep_the_values(self, momdp, table):
        finer = refine(table, 0, make_axis(momdp, 0, 3))
        room = make_room(table, 4)
        for b in np.random.default_rng(5).random((20, 2)):
            one, other = (value_after(t, momdp.confusion, 1, -1, b, room) for t in (table, finer))
            assert one == pytest.approx(other)


def possible(momdp, e, b):
    """All percept vectors: probability and belief afterwards."""
    attributes = np.arange(len(b))
    for z in product(range(momdp.levels), repeat=len(b)):
        joint = b * momdp.confusion[attributes, e, 1, z]
        each = joint + (1 - b) * momdp.confusion[attributes, e, 0, z]
        yield float(each.prod()), joint / each


def bilinear(table, x, b):
    """Interpolate in two attributes, written out."""
    grid, (first, second) = table.value[x].reshape(table.size), table.axes
    columns = [np.interp(b[1], second, row) for row in grid]
    return float(np.interp(b[0], first, columns))


class TestRefusals:
    def test_percepts_that_depend_on_each_other(self, small):
        dispersed = small.toy(0, 1, 2, finite=True)
        with pytest.raises(SettingsError, match=r"infinite precision.*POMCP"):
            solve(dispersed)
        with pytest.raises(SettingsError, match="differs between the truths"):
            upper_bound(dispersed)
        with pytest.raises(SettingsError, match="one kind"):
            solve(small.toy(0, 1, 2, finite=False, kinds=2))
        with pytest.raises(SettingsError):
            upper_bound(small.toy(0, 1, 2, finite=False, kinds=2))

    def test_more_attributes_than_points(self, small):
        with pytest.raises(SettingsError, match=r"POMCP"):
            solve(small.ispy32(12), 50_000)

    def test_rewards_without_end(self, small):
        momdp = small.toy(0, 1, 2, finite=False, discount=1.0)
        with pytest.raises(SettingsError, match="without end"):
            solve(replace(momdp, bonus=np.full((1, 3, 2), 50.0)))

    @pytest.mark.parametrize("settings", [{"points": 0}, {"tolerance": 0.0}])
    def test_settings(self, settings):
        with pytest.raises(SettingsError, match="Factored needs"):
            Factored(**settings)

    def test_an_empty_part(self, toy):
        with pytest.raises(SettingsError, match="one attribute or more"):
            upper_bound(toy, size=0)


def test_weak_percepts_promise_no_more_than_the_bound(small):
    """The smooth estimate rose seven seconds above it, and a look that tells nothing was best."""
    rates = {"red": {"look": (0.2, 0.2), "lift": (1 / 3, 0.25)}}
    options = {"correct": 300.0, "incorrect": -300.0, "abstain": True, "limit": 3}
    for prior, value in ((0.5, 24.46), (0.44137931, 38.0)):  # iterated on a grid of 2801 points
        momdp = small.momdp("toy", rates, prior=prior, **options)
        policy = Factored().solve(momdp, None)
        decision = policy.decide(small.start(momdp), None)
        assert decision.action == 1
        assert np.nanmax(decision.values) == pytest.approx(value, abs=0.1)
        assert np.nanmax(decision.values) <= policy.upper_bound + 1e-4
