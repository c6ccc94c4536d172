"""The grid of marginal beliefs: axes, values between points, expectations, backups."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from meal_bayes.domain import Query, load_domain
from meal_bayes.momdp import build_momdp
from meal_bayes.planners.compiled import compile_momdp
from meal_bayes.planners.factored.grid import (
    informative_pairs,
    make_axis,
    make_scratch,
    make_table,
    refine,
    value_after,
)
from meal_bayes.planners.factored.sweep import (
    Edges,
    make_backups,
    percepts_on,
    sweep,
)


@pytest.fixture
def momdp():
    rng, domain = np.random.default_rng(2), load_domain("toy")
    confusion = rng.dirichlet(np.ones(4), (2, 3, 2))
    confusion[0, 1, 1] = confusion[0, 1, 0]  # lift tells nothing of the first
    return build_momdp(domain, Query(domain.attributes), confusion, prior=[0.3, 0.6])


@pytest.fixture
def table(momdp):
    axes = [make_axis(momdp, i, 1 + i) for i in range(2)]
    size = (momdp.terminal, len(axes[0]) * len(axes[1]))
    values = np.random.default_rng(3).normal(size=size)
    return make_table(axes, values)


def test_axes(momdp):
    axis = make_axis(momdp, 0, 3)
    assert (np.diff(axis) > 0).all()
    assert {0.0, 0.5, 1.0} <= set(axis)
    assert np.abs(axis - 0.3).min() < 1e-12
    assert set(make_axis(momdp, 0, 2)) <= set(axis)


def test_expectations_are_those_over_every_percept(momdp, table):
    """As by the sum over all 16 percept vectors."""
    scratch = make_scratch(table, 4)
    for e, b in product(range(2), beliefs_of(table)[::7]):
        expected = sum(p * bilinear(table, 1, after) for p, after in possible(momdp, e, b))
        assert value_after(
            table, momdp.confusion, informative_pairs(momdp), 1, e, b, scratch
        ) == pytest.approx(expected)


@pytest.mark.parametrize("shaped", [False, True])
@pytest.mark.parametrize("smooth", [False, True])
def test_a_sweep_takes_the_best_of_every_belief(momdp, table, smooth, shaped):
    """Each x by one step ahead of the values so far, and no higher than before if not smooth."""
    if shaped:
        momdp = replace(momdp, bonus=np.random.default_rng(6).uniform(-9, 9, (2, 3, 2)))
    problem, value = compile_momdp(momdp), 500 * table.value  # above and below the best report
    table = table._replace(value=value)
    percepts = tuple(percepts_on(momdp, i, axis) for i, axis in enumerate(table.axes))
    backups = make_backups(momdp, Edges.of(momdp, problem), table, percepts)
    assert backups.reward.flags.c_contiguous  # or a second kernel is compiled
    found, work = value.copy(), np.zeros((4, value.shape[1]))
    sweep(backups, found, work, np.inf, 1, smooth)
    for x in reversed(range(momdp.terminal)):
        best = [one_step_ahead(momdp, problem, table, x, b) for b in beliefs_of(table)]
        value[x] = best if smooth else np.minimum(best, value[x])
        np.testing.assert_allclose(found[x], value[x])


def beliefs_of(table):
    """All points of the grid, (B,N)."""
    return np.array(list(product(*table.axes)))


def one_step_ahead(momdp, problem, table, x, b):
    """Value of the best behavior or ending, by reading the table off."""
    best = max(momdp.report_reward(np.maximum(b, 1 - b)), problem.dynamics.exit_value[x])
    scratch = make_scratch(table, momdp.levels)
    for e in np.flatnonzero(problem.dynamics.step["legal"][x]):
        step = problem.dynamics.step[x, e]
        bonus = (1 - b) @ momdp.bonus[:, e, 0] + b @ momdp.bonus[:, e, 1]
        value = step["bonus_scale"] * bonus - step["cost"]
        for p, to, senses in problem.dynamics.outcomes(x, e):
            after = value_after(
                table,
                momdp.confusion,
                informative_pairs(momdp),
                to,
                e if senses else -1,
                b,
                scratch,
            )
            value += step["discount"] * p * after
        best = max(best, value)
    return best


@pytest.mark.parametrize("attribute", [0, 1])
def test_a_finer_table_keeps_the_layout_that_kernels_are_compiled_for(momdp, attribute):
    axis, finer = (make_axis(momdp, attribute, level) for level in (0, 1))
    table = refine(make_table([axis], np.ones((3, len(axis)))), 0, finer)
    assert table.value.flags.c_contiguous
    assert table.value.shape == (3, len(finer))


def test_values_between_points(momdp, table):
    scratch = make_scratch(table, 4)
    for b in np.random.default_rng(4).random((20, 2)):
        found = value_after(table, momdp.confusion, informative_pairs(momdp), 0, -1, b, scratch)
        assert found == pytest.approx(bilinear(table, 0, b))


def test_finer_axes_keep_the_values(momdp, table):
    finer = refine(table, 0, make_axis(momdp, 0, 3))
    scratch = make_scratch(table, 4)
    for b in np.random.default_rng(5).random((20, 2)):
        one, other = (
            value_after(t, momdp.confusion, informative_pairs(momdp), 1, -1, b, scratch)
            for t in (table, finer)
        )
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
