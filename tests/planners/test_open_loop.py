import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meal_bayes.domain import Query, load_domain
from meal_bayes.momdp import build_momdp
from meal_bayes.planners.compiled import compile_momdp
from meal_bayes.planners.leaf import (
    OUTCOMES,
    SPAN,
    Beliefs,
    Plans,
    open_loop_values,
    room_for,
    tabulate_errors,
)
from meal_bayes.planners.open_loop import moves_of, plans_for

DOMAINS = ["toy", "roc36", "roc36_published", "ispy32", "cy101"]
NO_TABLE = np.zeros((0, 0, 0))
TABLE_ERROR = 0.025  # the tables' interpolation, per attribute


def random_momdp(name, n, levels, rng, *, precision=np.inf, **options):
    domain = load_domain(name)
    confusion = rng.dirichlet(np.ones(levels), (n, len(domain.behaviors), 2))
    return build_momdp(domain, Query(domain.attributes[:n]), confusion, precision, **options)


def values_at(problem, plans, x, told, seen=None, felt=None):
    """Best plan value by first behavior, (E,)."""
    n, n_behaviors, _, levels = problem.confusion.shape
    seen = np.zeros((n, n_behaviors, levels)) if seen is None else np.asarray(seen, dtype=float)
    felt = np.zeros(n) if felt is None else felt
    yes, total = seen[..., levels // 2 :].sum(axis=2), seen[0].sum(axis=1)
    out, scratch = np.empty((1, n_behaviors)), np.empty((4, OUTCOMES))
    beliefs = Beliefs(np.array([told], dtype=float), np.array([felt], dtype=float))
    open_loop_values(problem, plans, x, beliefs, 0, yes, total, scratch, out)
    return out[0]


def table_of(problem, plans, odds):
    """Errors of every plan and attribute at these log-odds, (J,N,G)."""
    n = problem.confusion.shape[0]
    points = np.repeat(np.asarray(odds, dtype=float)[:, None], n, axis=1)
    errors = np.empty((len(plans.action), n, len(points)))
    grid = Beliefs(points, np.zeros_like(points))
    tabulate_errors(problem, plans, grid, room_for(problem), errors)
    return errors


def one_plan(problem, uses, errors=NO_TABLE):
    """Plan that costs nothing and gathers these percepts."""
    size, n_behaviors = problem.legal.shape
    return Plans(
        first=np.minimum(np.arange(size + 1), 1),
        action=np.zeros(1, dtype=np.int64),
        cost=np.zeros(1),
        discount=np.ones(1),
        uses=np.array([uses], dtype=np.int64),
        weight=np.zeros((1, n_behaviors)),
        errors=errors,
    )


def kernel_error(momdp, uses, told, seen=None, felt=0.0):
    """Bayes error after a plan, from the value of the plan that costs nothing."""
    problem = compile_momdp(momdp)
    value = values_at(problem, one_plan(problem, uses), 0, [told], seen, [felt])[0]
    return 1 - (value - momdp.incorrect) / (momdp.correct - momdp.incorrect)


def brute_error(momdp, uses, told, seen=None, felt=0.0, *, cut=False):
    """E min(b, 1-b) over every sequence of percepts, from the definition of the model.

    Joint of truth v and seeming value w; answers are drawn from the urn of v, all else of w.
    """
    e_of = [e for e, k in enumerate(uses) for _ in range(k)]
    rows, precision, share = momdp.confusion[0], momdp.precision[0], momdp.misperception[0]
    before = np.zeros(rows.shape[::2]) if seen is None else np.array(seen[0], dtype=float)
    if cut:
        half = momdp.levels // 2
        rows, before = (
            np.stack([a[..., :half].sum(axis=-1), a[..., half:].sum(axis=-1)], axis=-1)
            for a in (rows, before)
        )
    is_v, seems = ([1 / (1 + np.exp(x)), 1 / (1 + np.exp(-x))] for x in (told, felt))
    start = np.array(
        [[is_v[v] * (share if v != w else 1 - share) * seems[w] for w in (0, 1)] for v in (0, 1)]
    )
    start /= start.sum()
    error = 0.0
    for percepts in itertools.product(range(rows.shape[-1]), repeat=len(e_of)):
        joint, count = start.copy(), before.copy()
        for e, z in zip(e_of, percepts, strict=True):
            s, p = precision[e], rows[e, :, z]  # (2,) each
            known = np.isinf(s)
            finite = np.where(known, 1.0, s)
            urn = np.where(known, p, (finite * p + count[e, z]) / (finite + count[e].sum()))
            joint *= urn[:, None] if momdp.direct[e] else urn[None]
            count[e, z] += 1
        error += joint.sum(axis=1).min()
    return error


@st.composite
def gatherings(draw, levels=2, most=5):
    """A `toy` problem of one attribute with percepts seen, a plan's percepts, and evidence."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    confusion = rng.dirichlet(np.ones(levels), (1, 3, 2))
    kinds = draw(st.lists(st.booleans(), min_size=6, max_size=6))
    precision = np.where(np.reshape(kinds, (1, 3, 2)), np.inf, rng.gamma(1.0, 8.0, (1, 3, 2)))
    share = draw(st.just(0.0) | st.floats(1e-6, 0.4))
    momdp = build_momdp(
        load_domain("toy"), Query(("red",)), confusion, precision + 1e-3, misperception=share
    )
    momdp = replace(momdp, direct=np.array([False, draw(st.booleans()), False]))
    uses = draw(
        st.lists(st.integers(0, 3), min_size=2, max_size=2).filter(lambda u: sum(u) <= most)
    )
    seen = np.zeros((1, 3, levels), dtype=int)
    seen[0, :2] = rng.integers(0, 3, (2, levels)) * draw(st.booleans())
    felt = draw(st.floats(-6, 6)) if share else 0.0
    return momdp, [*uses, 0], draw(st.floats(-6, 6)), seen, felt


@given(gatherings())
@settings(deadline=None, max_examples=150)
def test_error_is_exact(case):
    assert kernel_error(*case) == pytest.approx(brute_error(*case), abs=1e-10)


@given(gatherings(levels=4, most=3))
@settings(deadline=None, max_examples=60)
def test_cutting_levels_to_yes_and_no_can_only_raise_the_error(case):
    found = kernel_error(*case)
    assert found == pytest.approx(brute_error(*case, cut=True), abs=1e-10)
    assert found >= brute_error(*case) - 1e-12


def test_percepts_beyond_the_limit_tell_nothing():
    rng = np.random.default_rng(1)
    momdp = random_momdp("toy", 1, 2, rng, precision=4.0, limit=[3, 2, np.inf])
    seen = np.array([[[1, 1], [0, 2], [0, 0]]])
    found = kernel_error(momdp, [5, 5, 0], 0.3, seen)
    assert found == pytest.approx(brute_error(momdp, [1, 0, 0], 0.3, seen), abs=1e-12)


def test_too_many_outcomes_leave_percepts_out():
    rng = np.random.default_rng(2)
    momdp = random_momdp("cy101", 1, 2, rng)
    full = kernel_error(momdp, [3, 3, 3, 3, 1, 0, 0, 0, 0, 0, 0], 0.0)
    more = kernel_error(momdp, [3, 3, 3, 3, 1, 3, 3, 3, 3, 3, 0], 0.0)
    assert full == more  # 4^4 * 2 = 512 outcomes are the most
    assert 0 < full < kernel_error(momdp, [3, 3, 3, 0, 0, 0, 0, 0, 0, 0, 0], 0.0)


@pytest.mark.parametrize("precision", [5.0, np.inf])
def test_certain_beliefs_have_no_error(small, precision):
    momdp = small.momdp("toy", small.rates, precision)
    problem = compile_momdp(momdp)
    plan = one_plan(problem, [1, 2, 0])
    tables = [NO_TABLE]
    if np.isinf(precision):
        tables.append(table_of(problem, plan, np.linspace(-SPAN, SPAN, 9)))
    for table in tables:
        for log_odds in ([np.inf, -np.inf], [40.0, -800.0]):
            value = values_at(problem, plan._replace(errors=table), 0, log_odds)[0]
            assert value == pytest.approx(momdp.correct)


@pytest.mark.parametrize("name", DOMAINS)
@pytest.mark.parametrize("levels", [2, 4])
def test_tables_are_close_to_exact(name, levels):
    rng = np.random.default_rng(3)
    momdp = random_momdp(name, 2, levels, rng)
    problem = compile_momdp(momdp)
    plans = plans_for(problem)
    grid = np.linspace(-SPAN, SPAN, plans.errors.shape[2])
    odds = np.concatenate([rng.uniform(-12, 12, 150), rng.choice(grid, 20)])
    exact = table_of(problem, plans, odds)
    for i in range(2):
        table = np.array([np.interp(odds, grid, row) for row in plans.errors[:, i]])
        assert np.abs(table - exact[:, i]).max() <= TABLE_ERROR
        np.testing.assert_allclose(table[:, 150:], exact[:, i, 150:], atol=1e-12)
    for log_odds in rng.uniform(-20, 20, (30, 2)):
        for x in range(len(momdp.x_names) - 1):
            tabled = values_at(problem, plans, x, log_odds)
            slow = values_at(problem, plans._replace(errors=NO_TABLE), x, log_odds)
            some = np.isfinite(slow)
            gap = np.abs(tabled[some] - slow[some]) / (momdp.correct - momdp.incorrect)
            assert gap.max(initial=0.0) <= 2 * TABLE_ERROR


@pytest.mark.parametrize("name", DOMAINS)
@pytest.mark.parametrize("precision", [5.0, np.inf])
@pytest.mark.parametrize("n", [1, 2])
def test_every_legal_behavior_has_a_plan(name, precision, n):
    momdp = random_momdp(name, n, 2, np.random.default_rng(4), precision=precision, limit=5)
    problem = compile_momdp(momdp)
    plans = plans_for(problem)
    assert (plans.errors.size > 0) == np.isinf(precision)
    for x in range(momdp.terminal):
        values = values_at(problem, plans, x, np.zeros(n))
        np.testing.assert_array_equal(np.isfinite(values), problem.legal[x])


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
        walks = {account(problem, x, p) for p, _ in toy_paths(problem, x, (3, 3)) if p}
        found = set(library(plans, x))
        assert found
        assert found <= walks


@pytest.mark.parametrize("seed", range(3))
def test_the_library_holds_nearly_the_best_plan(small, seed):
    momdp = small.toy(seed, 2, 2, finite=True, limit=3)
    problem = compile_momdp(momdp)
    plans = plans_for(problem)
    walks = [account(problem, 0, path) for path, _ in toy_paths(problem, 0, (3, 3)) if path]
    every = plans._replace(
        first=np.array([0, len(walks), len(walks), len(walks)]),
        action=np.array([w[0] for w in walks]),
        cost=np.array([w[1] for w in walks]),
        discount=np.array([w[2] for w in walks]),
        uses=np.array([w[3] for w in walks]),
        weight=np.zeros((len(walks), 3)),
    )
    for log_odds in np.random.default_rng(seed).uniform(-3, 3, (20, 2)):
        best = values_at(problem, every, 0, log_odds).max()
        ours = values_at(problem, plans, 0, log_odds).max()
        certain = np.prod(1 / (1 + np.exp(-np.abs(log_odds))))
        stop = momdp.incorrect + (momdp.correct - momdp.incorrect) * certain
        assert ours <= best + 1e-6
        assert max(ours, stop) >= max(best, stop) - 2.0  # of 200 between right and wrong


@pytest.mark.parametrize("share", [0.0, 0.1])
@pytest.mark.parametrize(
    ("n", "levels", "finite"), [(1, 2, False), (2, 2, False), (2, 2, True), (1, 4, True)]
)
def test_plan_values_are_lower_bounds(small, n, levels, finite, share):
    momdp = small.toy(n + levels, n, levels, finite=finite, limit=2, misperception=share)
    optimum = small.expectimax(momdp)
    optimum.value(momdp.start, optimum.nothing_seen())
    problem = compile_momdp(momdp)
    plans = plans_for(problem)
    exact = plans._replace(errors=NO_TABLE)
    reached = list(optimum.reached())
    assert {x for x, _ in reached} == {0, 1}
    for x, seen in reached:
        belief = optimum.belief(x, seen)
        best = optimum.value(x, seen)
        state = belief.told, belief.seen, belief.felt
        assert values_at(problem, exact, x, *state).max() <= best + 1e-9
        tabled = values_at(problem, plans, x, *state).max()
        assert tabled <= best + n * TABLE_ERROR * (momdp.correct - momdp.incorrect)


def test_shaping_is_paid_for_what_can_be_perceived(toy):
    problem = compile_momdp(toy)
    bonus = np.zeros((2, 3, 2))
    bonus[:, 1] = [[1.0, 3.0], [0.0, 2.0]]
    shaped = problem._replace(bonus=bonus, shaped=True)
    plans = one_plan(problem, [0, 4, 0])._replace(weight=np.array([[0.0, 5.0, 0.0]]))
    plain = values_at(problem, plans, 0, [0.0, 0.0])[0]
    # 3 of the 4 percepts are within the limit; Pr(true) = .5 each: 2 + 1 a percept, weight 5.
    assert values_at(shaped, plans, 0, [0.0, 0.0])[0] == pytest.approx(plain + 0.75 * 5 * 3)


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
