"""Groups: the values of one variable, against brute force over all joint values."""

import itertools

import numpy as np
import pytest
from numpy.testing import assert_allclose

from meal_bayes.domain import Query, load_domain
from meal_bayes.errors import ImpossibleObservation, QueryError
from meal_bayes.momdp import (
    Transition,
    build_momdp,
    flatten,
    initial_belief,
    report_value,
    update_belief,
)
from meal_bayes.momdp.belief import next_percept
from meal_bayes.momdp.observation import predictive

LEVELS = 4
CLASSES = 3


def problem(size, rng, *, alone=1, exact=False):
    """Build a MOMDP of attributes on their own and of one group, with latent classes."""
    domain = load_domain("toy")
    n = alone + size
    names = tuple(f"p{i}" for i in range(n))
    e = len(domain.behaviors)
    group = tuple(rng.permutation(n)[:size].tolist())
    if exact:
        rows = rng.dirichlet(np.ones(LEVELS), (n, e, 2))
        options = {}
    else:
        rows = rng.dirichlet(np.ones(LEVELS), (n, e, CLASSES))
        options = {
            "precision": rng.uniform(1, 9, (n, e, CLASSES)),
            "latent_classes": rng.dirichlet(np.ones(CLASSES), (n, 2)),
        }
    return build_momdp(domain, Query(names, (group,)), rows, prior=rng.random(n), **options)


def brute_force(momdp, percepts):
    """Compute Pr(y | percepts) over all 2^N joint values, of which groups allow some."""
    n = len(momdp.query)
    joint = {}
    grouped = {i for group in momdp.query.groups for i in group}
    for y in itertools.product((0, 1), repeat=n):
        if any(sum(y[i] for i in group) != 1 for group in momdp.query.groups):
            continue
        prob = 1.0
        for i, truth in enumerate(y):
            prob *= momdp.prior[i] if truth else 1 if i in grouped else 1 - momdp.prior[i]
            power = 1 - 1 / len(momdp.query.groups[0]) if i in grouped else 1
            prob *= likelihood(momdp, i, truth, percepts) ** power
        joint[y] = prob
    return {y: prob / sum(joint.values()) for y, prob in joint.items()}


def likelihood(momdp, i, truth, percepts):
    """Compute Pr(percepts | truth) of an attribute, summed over its latent classes."""
    total = 0.0
    for c, weight in enumerate(momdp.latent_classes[i, truth]):
        prob = weight
        counts = np.zeros((momdp.n_behaviors, momdp.levels))
        for e, levels in percepts:
            z = levels[i]
            mean = momdp.confusion[i, e, c, z]
            s = momdp.precision[i, e, c]
            prob *= predictive(mean, s, counts[e, z], counts[e].sum())
            counts[e, z] += 1
        total += prob
    return total


@pytest.mark.parametrize("exact", [False, True])
@pytest.mark.parametrize("size", [2, 3, 4, 5, 6])
def test_belief_is_that_over_all_joint_values(size, exact):
    rng = np.random.default_rng(size)
    momdp = problem(size, rng, exact=exact)
    belief = initial_belief(momdp)
    percepts = []
    for _ in range(8):
        expected = brute_force(momdp, percepts)
        values = [tuple(row) for row in momdp.query.values.astype(int).tolist()]
        assert sorted(values) == sorted(expected)
        joint = np.array([expected[y] for y in values])
        assert_allclose(belief.joint, joint, rtol=0, atol=1e-12)
        assert_allclose(belief.positive, joint @ np.array(values), rtol=0, atol=1e-12)
        assert_allclose(belief.certainty, joint.max(), rtol=0, atol=1e-12)
        assert_allclose(belief.entropy, -(joint * np.log2(joint)).sum(), atol=1e-9)
        assert tuple(belief.best_report.astype(int)) == values[joint.argmax()]
        gap = momdp.correct - momdp.incorrect
        assert_allclose(report_value(momdp, belief), momdp.incorrect + gap * joint.max())
        ahead = next_percept(momdp, belief)  # (N,E,2,K)
        assert_allclose(ahead.sum(axis=3)[:, :, 1].T, [belief.positive] * momdp.n_behaviors)
        levels = rng.integers(LEVELS, size=len(momdp.query))
        action = int(rng.integers(momdp.n_behaviors))
        percepts.append((action, levels))
        belief = update_belief(belief, momdp, Transition(action, 0, levels))


def test_the_percept_of_the_second_of_two_values_is_that_of_the_first():
    """Their classifiers decide the same: asked as a group or as one attribute, belief is one."""
    domain = load_domain("toy")
    rows = np.full((2, 3, 2, 2), 0.5)
    rows[0, 0] = [[0.8, 0.2], [0.3, 0.7]]
    rows[1, 0] = rows[0, 0, ::-1, ::-1]
    group = build_momdp(domain, Query(("empty", "full"), ((0, 1),)), rows, prior=[0.4, 0.6])
    alone = build_momdp(domain, Query(("empty",)), rows[:1], prior=0.4)
    joint = initial_belief(group)
    single = initial_belief(alone)
    for z in (1, 1, 0):
        joint = update_belief(joint, group, Transition(0, 0, np.array([z, 1 - z])))
        single = update_belief(single, alone, Transition(0, 0, np.array([z])))
        assert_allclose(joint.positive, [single.positive[0], 1 - single.positive[0]])


def test_a_group_has_as_many_reports_as_values():
    momdp = problem(4, np.random.default_rng(0), alone=2)
    assert momdp.n_actions == momdp.n_behaviors + 2 * 2 * 4
    for y, row in enumerate(momdp.query.values):
        assert momdp.query.index_of(row) == y
        assert momdp.query.values_of(y).tolist() == row.tolist()
        assert row[list(momdp.query.groups[0])].sum() == 1
    with pytest.raises(QueryError, match="exactly one"):
        momdp.query.index_of([True] * 6)


def test_a_flat_problem_has_the_states_of_the_group():
    momdp = problem(3, np.random.default_rng(1), exact=True)
    flat = flatten(momdp)
    assert len(flat.state_names) == momdp.n_states == momdp.terminal * 6 + 1
    assert_allclose(
        flat.start[: 6 * momdp.terminal].reshape(-1, 6)[momdp.start], initial_belief(momdp).joint
    )
    assert_allclose(flat.observation.sum(axis=-1), 1.0)


def test_percepts_that_rule_out_every_value_are_impossible():
    domain = load_domain("toy")
    rows = np.tile(np.eye(2), (2, len(domain.behaviors), 1, 1))  # percepts never err
    momdp = build_momdp(domain, Query(("empty", "full"), ((0, 1),)), rows)
    with pytest.raises(ImpossibleObservation, match="every value"):
        update_belief(initial_belief(momdp), momdp, Transition(0, 0, np.array([0, 0], np.int8)))
