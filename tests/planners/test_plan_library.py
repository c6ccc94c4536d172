"""Plans are walks of the diagram, their errors exact, their values lower bounds."""

from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.domain import load_domain
from meal_bayes.planners.compiled import compile_momdp
from meal_bayes.planners.open_loop.library import moves_of, no_plans, plans_for
from meal_bayes.planners.open_loop.values import (
    Plans,
    open_loop_values,
    plan_values,
    remember,
    room_for,
)

DOMAINS = ["toy", "roc36", "roc36_published", "ispy32", "cy101"]
MOST = 15  # percepts of one behavior that are planned with
COARSE = 0.02  # by how much errors read off the tables may be too high


def noted(problem, plans, seen):
    work = room_for(problem, plans)
    n, e, _, k = problem.confusion.shape
    remember(work, np.zeros((n, e, k)) if seen is None else np.asarray(seen, dtype=float))
    return work


def values_at(problem, plans, x, weight, seen=None):
    """Best plan value by first behavior, (E,)."""
    out = np.empty((1, problem.legal.shape[1]))
    open_loop_values(problem, plans, x, weight[None], 0, noted(problem, plans, seen), out)
    return out[0]


def outcomes_of(problem, uses, i):
    """Pr(yes-percepts | kind) of all that a plan (E,) may perceive of an attribute, (C,M)."""
    joint = np.ones((problem.prior.shape[1], 1))
    for e in np.flatnonzero(uses * problem.informative[i]):
        k = int(min(uses[e], problem.limit[e], MOST))
        counts = problem.fresh[i, e, :, k, : k + 1]
        joint = (joint[:, :, None] * counts[:, None]).reshape(len(joint), -1)
    return joint


def exact_values(problem, plans, x, weights):
    """Value (B,J) of every plan from x at beliefs (B,N,C) before any percept; no shaping."""
    out = np.empty((len(weights), plans.first[x + 1] - plans.first[x]))
    for row, j in enumerate(range(plans.first[x], plans.first[x + 1])):
        right = np.empty(weights.shape[:2])
        for i in range(right.shape[1]):
            joint = weights[:, i, :, None] * outcomes_of(problem, plans.uses[j], i)  # (B,C,M)
            truth = problem.share[i] @ joint  # (B,2,M)
            right[:, i] = 1 - truth.min(axis=1).sum(axis=1)
        share = right.mean(axis=1) if problem.additive else right.prod(axis=1)
        gained = problem.incorrect + (problem.correct - problem.incorrect) * share
        out[:, row] = plans.discount[j] * gained - plans.cost[j]
    return out


def by_behavior(problem, plans, x, values):
    """Best of the plans' values by first behavior, (E,)."""
    out = np.full(problem.legal.shape[1], -np.inf)
    np.maximum.at(out, plans.action[plans.first[x] : plans.first[x + 1]], values)
    return out


def one_plan(problem, uses):
    """Plan that costs nothing and gathers these percepts."""
    size, n_behaviors = problem.legal.shape
    n, kinds = problem.prior.shape
    return Plans(
        first=np.minimum(np.arange(size + 1), 1),
        action=np.zeros(1, dtype=np.int64),
        cost=np.zeros(1),
        discount=np.ones(1),
        uses=np.array([uses], dtype=np.int64),
        weight=np.zeros((1, n_behaviors)),
        rule=np.zeros((1, n), dtype=np.int64),
        errs=np.zeros((3, 1, kinds)),
    )


@pytest.mark.parametrize("options", [{}, {"kinds": 2}, {"shared": 3}])
@pytest.mark.parametrize("precision", [3.0, np.inf])
def test_merging_outcomes_raises_the_error_a_little(small, options, precision):
    """More joint outcomes than are held: 4^9, against all of them."""
    rng = np.random.default_rng(2)
    momdp = small.random("cy101", 1, 2, rng, precision=precision, **options)
    weight, uses = small.weights(momdp, [0.3]), [3] * 9 + [0] * 2
    problem = compile_momdp(momdp)
    joint = weight[0, :, None] * outcomes_of(problem, np.array(uses), 0)
    exact = (problem.share[0] @ joint).min(axis=0).sum()
    found = small.error(problem, uses, weight)
    assert exact - 1e-12 <= found <= exact + COARSE
    assert found < small.error(problem, [3, 3, 3, 1, 0, 0, 0, 0, 0, 0, 0], weight)


@pytest.mark.parametrize("precision", [5.0, np.inf])
def test_certain_beliefs_have_no_error(small, precision):
    momdp = small.momdp("toy", small.rates, precision)
    problem = compile_momdp(momdp)
    plans = plans_for(problem)
    for log_odds in ([np.inf, -np.inf], [40.0, -800.0]):
        weight = np.exp(small.believing(momdp, log_odds).weight)
        values = exact_values(problem, plans, 0, weight[None])[0]
        ends = problem.correct * plans.discount - plans.cost
        np.testing.assert_allclose(values, ends[: len(values)])
        tabled = values_at(problem, plans, 0, weight)
        np.testing.assert_allclose(tabled, by_behavior(problem, plans, 0, values))


@pytest.mark.parametrize("name", DOMAINS)
@pytest.mark.parametrize(
    ("levels", "options"), [(2, {}), (4, {}), (2, {"kinds": 2}), (2, {"shared": 3})]
)
@pytest.mark.parametrize("precision", [5.0, np.inf])
def test_tables_are_close_to_exact_and_never_above(small, name, levels, options, precision):
    rng = np.random.default_rng(3)
    momdp = small.random(name, 2, levels, rng, precision=precision, **options)
    problem = compile_momdp(momdp)
    plans = plans_for(problem)
    odds = [*rng.uniform(-6, 6, (5, 2)), [20.0, -0.3]]
    weights = np.array([small.weights(momdp, each) for each in odds])
    weights *= rng.gamma(3.0, 1.0, weights.shape)
    weights /= weights.sum(axis=2, keepdims=True)
    for x in range(momdp.terminal):
        for weight, values in zip(weights, exact_values(problem, plans, x, weights), strict=True):
            tabled = values_at(problem, plans, x, weight)
            exact = by_behavior(problem, plans, x, values)
            some = np.isfinite(exact)
            np.testing.assert_array_equal(np.isfinite(tabled), some)
            gap = (exact[some] - tabled[some]) / (momdp.correct - momdp.incorrect)
            assert gap.min(initial=0.0) >= -1e-9
            assert gap.max(initial=0.0) <= (4 if options else 2) * COARSE


@pytest.mark.parametrize("additive", [False, True])
def test_values_of_single_plans(small, additive):
    """What competes in the making of a library: each plan that is the best so far has its value."""
    momdp = small.random("roc36", 2, 2, np.random.default_rng(6), additive=additive)
    problem = compile_momdp(momdp)
    plans, weight = plans_for(problem), small.weights(momdp, [0.4, -1.0])
    values = np.empty((1, int(np.diff(plans.first).max())))
    plan_values(problem, plans, 0, weight[None], room_for(problem, plans), values)
    exact = exact_values(problem, plans, 0, weight[None])[0]
    best = values[0, : len(exact)].argmax()
    assert exact[best] - 2 * COARSE * 1000 <= values[0, best] <= exact[best] + 1e-9
    assert exact[best] >= exact.max() - 2 * COARSE * 1000


@pytest.mark.parametrize("name", DOMAINS)
@pytest.mark.parametrize("precision", [5.0, np.inf])
@pytest.mark.parametrize(
    ("n", "options"), [(1, {}), (2, {}), (1, {"kinds": 2}), (1, {"shared": 3})]
)
def test_every_legal_behavior_has_a_plan(small, name, precision, n, options):
    rng = np.random.default_rng(4)
    momdp = small.random(name, n, 2, rng, precision=precision, limit=5, **options)
    problem = compile_momdp(momdp)
    plans = plans_for(problem)
    for x in range(momdp.terminal):
        values = values_at(problem, plans, x, small.weights(momdp, np.zeros(n)))
        np.testing.assert_array_equal(np.isfinite(values), problem.legal[x])


def test_an_empty_library(small):
    problem = compile_momdp(small.momdp("roc36", {"heavy": {}}))
    assert not no_plans(problem).first.any()


def toy_paths(problem, x, uses_left):
    """All open-loop plans of `toy` from x that gather at most so many percepts: (path, x after)."""
    yield (), x
    for a in np.flatnonzero(problem.legal[x]):
        if a < 2 and not uses_left[a]:
            continue
        left = tuple(u - (a == e) for e, u in enumerate(uses_left))
        for path, end in toy_paths(problem, int(problem.branch_x[x, a, 0]), left):
            yield (int(a), *path), end


def account(problem, x, path):
    """(first behavior, cost, discount, uses) of a plan, term by term."""
    cost, discount, uses = 0.0, 1.0, [0, 0, 0]
    for a in path:
        cost += discount * problem.cost[x, a]
        discount *= problem.discount[x, a]
        uses[a] += a < 2
        x = int(problem.branch_x[x, a, 0])
    return path[0], round(cost, 9), round(discount, 9), tuple(uses)


def library(plans, x):
    for j in range(plans.first[x], plans.first[x + 1]):
        uses = tuple(map(int, plans.uses[j]))
        yield int(plans.action[j]), round(plans.cost[j], 9), round(plans.discount[j], 9), uses


@pytest.mark.parametrize("seed", range(3))
def test_plans_are_walks_of_the_diagram(small, seed):
    problem = compile_momdp(small.toy(seed, 2, 2, finite=False, limit=3))
    plans = plans_for(problem)
    for x in range(2):
        walks = {account(problem, x, p) for p, _ in toy_paths(problem, x, (4, 4)) if p}
        found = set(library(plans, x))
        assert found
        assert found <= walks


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("options", [{}, {"kinds": 2}, {"shared": 3}, {"additive": True}])
def test_the_library_holds_nearly_the_best_plan(small, seed, options):
    momdp = small.toy(seed, 2, 2, finite=True, limit=3, **options)
    problem = compile_momdp(momdp)
    plans = plans_for(problem)
    paths = (path for path, _ in toy_paths(problem, 0, (3, 3)) if path)
    walks = sorted({account(problem, 0, path) for path in paths})
    every = plans._replace(
        first=np.array([0, len(walks), len(walks), len(walks)]),
        action=np.array([w[0] for w in walks]),
        cost=np.array([w[1] for w in walks]),
        discount=np.array([w[2] for w in walks]),
        uses=np.array([w[3] for w in walks]),
        weight=np.zeros((len(walks), 3)),
    )
    odds = np.random.default_rng(seed).uniform(-3, 3, (20, 2))
    weights = np.array([small.weights(momdp, each) for each in odds])
    best = exact_values(problem, every, 0, weights).max(axis=1)
    ours = exact_values(problem, plans, 0, weights).max(axis=1)
    true = (weights * problem.share[:, 1]).sum(axis=2)
    stop = momdp.report_reward(np.maximum(true, 1 - true))
    assert (ours <= best + 1e-6).all()
    lost = np.maximum(best, stop) - np.maximum(ours, stop)
    assert (lost <= 2.0).all()  # of 200 between right and wrong


@pytest.mark.parametrize(
    "options",
    [{}, {"mistaken": 0.1}, {"kinds": 3}, {"shared": 3}, {"additive": True}, {"abstain": True}],
)
@pytest.mark.parametrize(
    ("n", "levels", "finite"), [(1, 2, False), (2, 2, False), (2, 2, True), (1, 4, True)]
)
def test_plan_values_are_lower_bounds(small, n, levels, finite, options):
    momdp = small.toy(n + levels, n, levels, finite=finite, limit=2, **options)
    optimum = small.expectimax(momdp)
    optimum.value(momdp.start, optimum.nothing_seen())
    problem = compile_momdp(momdp)
    plans = plans_for(problem)
    reached = list(optimum.reached())
    assert {x for x, _ in reached} == {0, 1}
    for x, seen in reached:
        belief = optimum.belief(x, seen)
        values = values_at(problem, plans, x, np.exp(belief.weight), belief.seen)
        assert values.max() <= optimum.value(x, seen) + 1e-9


def test_shaping_is_paid_for_what_can_be_perceived(small, toy):
    problem = compile_momdp(toy)
    bonus = np.zeros((2, 3, 2))
    bonus[:, 1] = [[1.0, 3.0], [0.0, 2.0]]
    shaped = problem._replace(bonus=bonus, shaped=True)
    plans = one_plan(problem, [0, 4, 0])._replace(weight=np.array([[0.0, 5.0, 0.0]]))
    even = small.weights(toy, [0.0, 0.0])
    plain = values_at(problem, plans, 0, even)[0]
    # 3 of the 4 percepts are within the limit; Pr(true) = .5 each: 2 + 1 a percept, weight 5.
    assert values_at(shaped, plans, 0, even)[0] == pytest.approx(plain + 0.75 * 5 * 3)


@pytest.mark.parametrize("name", DOMAINS)
def test_ways_to_a_percept_are_cheapest(small, name):
    problem = compile_momdp(small.momdp(name, {load_domain(name).attributes[0]: {}}))
    macros = moves_of(problem).macros
    price = np.full(problem.legal.shape, np.inf)  # undiscounted, by relaxation
    for _ in range(problem.legal.shape[0]):
        for x, a in np.argwhere(problem.legal):
            after = problem.branch_x[x, a, 0]
            if problem.branch_sense[x, a, 0]:
                price[x, a] = problem.cost[x, a]
            other = problem.cost[x, a] + price[after]
            price[x] = np.minimum(price[x], other)
    np.testing.assert_array_equal(macros.first >= 0, np.isfinite(price))
    reached = macros.first >= 0
    assert (macros.cost[reached] <= price[reached] + 1e-9).all()  # discounted, so never dearer
    assert (macros.cost[reached] >= price[reached] * 0.9).all()
    for x, e in np.argwhere(reached):
        assert problem.legal[x, macros.first[x, e]]
        assert macros.uses[x, e, e] >= 1


def test_moves_are_made_once_for_a_diagram(small):
    one = compile_momdp(small.momdp("roc36", {"heavy": {"lift_slow": (0.9, 0.1)}}))
    other = compile_momdp(small.momdp("roc36", {"blue": {}, "beans": {}}, 7.0))
    assert moves_of(one) is moves_of(other)
    dearer = compile_momdp(small.momdp("roc36", {"heavy": {}}, discount=0.9))
    assert moves_of(dearer) is not moves_of(one)


@pytest.mark.parametrize("prior", [0.0, 1.0, [0.0, 0.5]])
def test_sure_priors_of_shared_kinds_have_plans(small, prior):
    """No percept moves them; every plan is worth its report, less what it costs."""
    momdp = small.toy(1, 2, 2, finite=True, shared=3)
    problem = compile_momdp(replace(momdp, prior=np.broadcast_to(prior, 2)))
    plans = plans_for(problem)
    values = values_at(problem, plans, 0, problem.prior)
    exact = exact_values(problem, plans, 0, problem.prior[None])[0]
    np.testing.assert_allclose(values, by_behavior(problem, plans, 0, exact), atol=2.0)
    assert (values <= by_behavior(problem, plans, 0, exact) + 1e-9).all()
