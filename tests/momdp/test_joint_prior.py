"""A joint prior over the asked attributes, against brute force over all values."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from meal_bayes.domain import Event, Query, load_domain
from meal_bayes.errors import ImpossibleObservation, SettingsError
from meal_bayes.momdp import (
    Transition,
    best_answer,
    best_report,
    build_momdp,
    expected_reward,
    flatten,
    initial_belief,
    report_certainty,
    report_value,
    update_belief,
    with_joint_prior,
)
from meal_bayes.momdp.belief import next_percept

LEVELS = 4
SEEDS = st.integers(0, 2**32)


def problem(rng, *, grouped, yes_or_no, zeros):
    """Build a MOMDP of two to four attributes, perhaps three of a group, with a joint prior."""
    domain = load_domain("toy")
    alone = int(rng.integers(1 if grouped else 2, 5 - 2 * grouped))
    n = alone + 3 * grouped
    groups = (tuple(rng.permutation(n)[:3].tolist()),) if grouped else ()
    event = None
    if yes_or_no:
        allowed = rng.random(n) < 0.5
        for group in groups:
            allowed[list(group)] = np.arange(3) == rng.integers(3)
        event = Event(tuple(allowed.tolist()), complement=bool(rng.integers(2)))
    query = Query(tuple(f"p{i}" for i in range(n)), groups, event=event)
    shape = n, len(domain.behaviors), 3
    momdp = build_momdp(
        domain,
        query,
        rng.dirichlet(np.ones(LEVELS), shape),
        rng.choice([2.0, 9.0, np.inf], shape),
        latent_classes=rng.dirichlet(np.ones(3), (n, 2)),
    )
    joint = rng.dirichlet(np.full(query.n_values, 0.7))
    joint[rng.permutation(len(joint))[: zeros * query.n_values // 2]] = 0.0
    return with_joint_prior(momdp, joint / joint.sum())


def likelihood(momdp, i, truth, percepts):
    """Compute Pr(percepts | truth) of an attribute, summed over its latent classes."""
    total = 0.0
    for c in range(momdp.n_classes):
        prob = momdp.latent_classes[i, truth, c]
        counts = np.zeros((momdp.n_behaviors, LEVELS))
        for e, levels in percepts:
            mean = momdp.confusion[i, e, c, levels[i]]
            s = momdp.precision[i, e, c]
            count = counts[e, levels[i]]
            shown = counts[e].sum()
            prob *= mean if np.isinf(s) else (s * mean + count) / (s + shown)
            counts[e, levels[i]] += 1
        total += prob
    return total


def brute_force(momdp, percepts):
    """Compute Pr(values | percepts) (Y,) by Bayes' rule."""
    grouped = {i for group in momdp.query.groups for i in group}
    weights = []
    for prior, y in zip(momdp.joint, momdp.query.values.astype(int), strict=True):
        factors = [
            likelihood(momdp, i, truth, percepts) ** (2 / 3 if i in grouped else 1)
            for i, truth in enumerate(y)
        ]
        weights.append(prior * np.prod(factors))
    return np.array(weights) / sum(weights)


@given(SEEDS, st.booleans(), st.booleans(), st.booleans())
def test_belief_answers_and_their_worth_are_those_over_all_values(seed, grouped, yes_or_no, zeros):
    rng = np.random.default_rng(seed)
    momdp = problem(rng, grouped=grouped, yes_or_no=yes_or_no, zeros=zeros)
    belief = initial_belief(momdp)
    percepts = []
    values = momdp.query.values
    for _ in range(4):
        joint = brute_force(momdp, percepts)
        assert_allclose(belief.joint, joint, atol=1e-12)
        assert_allclose(belief.positive, joint @ values, atol=1e-12)
        assert_allclose(belief.certainty, joint.max())
        assert joint[momdp.query.index_of(belief.best_report)] == pytest.approx(joint.max())
        assert_allclose(
            belief.entropy, -(joint * np.log2(np.where(joint > 0, joint, 1))).sum(), atol=1e-9
        )
        ahead = next_percept(momdp, belief)  # (N,E,2,K)
        assert_allclose(ahead[:, :, 1].sum(axis=2).T, [belief.positive] * momdp.n_behaviors)
        # What each report earns, by the table of rewards of each at each value.
        earned = joint @ momdp.reports.rewards()
        assert_allclose(report_value(momdp, belief), earned.max())
        best = best_report(momdp, belief)
        assert earned[best - momdp.n_behaviors] == pytest.approx(earned.max())
        for number, reward in enumerate(earned):
            report = momdp.query.report_of(number)
            assert_allclose(expected_reward(momdp, belief, report), reward, atol=1e-9)
            right = [(momdp.query.report_truth(y.astype(np.int8)) == report).all() for y in values]
            assert_allclose(report_certainty(momdp, belief, report), joint @ right, atol=1e-12)
        levels = rng.integers(LEVELS, size=len(momdp.query))
        action = int(rng.integers(momdp.n_behaviors))
        percepts.append((action, levels))
        belief = update_belief(belief, momdp, Transition(action, 0, levels))


@given(SEEDS)
def test_a_product_is_what_independent_attributes_believe(seed):
    rng = np.random.default_rng(seed)
    joint = problem(rng, grouped=False, yes_or_no=False, zeros=False)
    plain = dataclasses.replace(joint, joint=None, prior=rng.uniform(0.1, 0.9, len(joint.query)))
    joint = with_joint_prior(plain, initial_belief(plain).joint)
    coupled = initial_belief(joint)
    alone = initial_belief(plain)
    for _ in range(4):
        assert_allclose(coupled.log_odds, alone.log_odds, atol=1e-9)
        assert_allclose(coupled.joint, alone.joint, atol=1e-12)
        assert_allclose(coupled.entropy, alone.entropy)
        transition = Transition(0, 0, rng.integers(LEVELS, size=len(joint.query)))
        coupled = update_belief(coupled, joint, transition)
        alone = update_belief(alone, plain, transition)


@given(SEEDS)
def test_attributes_that_exclude_each_other_are_never_both_reported(seed):
    rng = np.random.default_rng(seed)
    momdp = problem(rng, grouped=False, yes_or_no=False, zeros=False)
    both = momdp.query.values[:, :2].all(axis=1)
    joint = np.where(both, 0.0, momdp.joint)
    momdp = with_joint_prior(momdp, joint / joint.sum())
    belief = initial_belief(momdp)
    for _ in range(6):
        assert not belief.best_report[:2].all()
        assert belief.positive[:2].sum() <= 1.0 + 1e-12
        levels = rng.integers(LEVELS, size=len(momdp.query))
        levels[:2] = LEVELS - 1  # both seem true
        belief = update_belief(belief, momdp, Transition(1, 0, levels))
        assert not momdp.reported(best_answer(momdp, belief))[:2].all()


def test_percepts_that_rule_out_every_value_are_impossible():
    domain = load_domain("toy")
    rows = np.tile(np.eye(2), (2, len(domain.behaviors), 1, 1))  # percepts never err
    momdp = with_joint_prior(build_momdp(domain, Query(("a", "b")), rows), [0.5, 0.3, 0.2, 0.0])
    with pytest.raises(ImpossibleObservation, match="every value"):
        update_belief(initial_belief(momdp), momdp, Transition(0, 0, np.array([1, 1], np.int8)))
    sure = update_belief(initial_belief(momdp), momdp, Transition(0, 0, np.array([0, 1], np.int8)))
    assert_allclose(sure.joint, [0, 1, 0, 0])


def test_a_written_problem_starts_from_the_joint_prior():
    domain = load_domain("toy")
    rows = np.full((2, len(domain.behaviors), 2, 2), 0.5)
    joint = np.array([0.4, 0.1, 0.2, 0.3])
    flat = flatten(with_joint_prior(build_momdp(domain, Query(("a", "b")), rows), joint))
    assert_allclose(flat.start[flat.start > 0], joint)


@pytest.mark.parametrize("joint", [[0.5, 0.5], [0.5, 0.5, 0.5, -0.5], [0.5, 0.5, 0.5, 0.5]])
def test_what_is_no_distribution_over_the_values_is_refused(joint):
    domain = load_domain("toy")
    momdp = build_momdp(domain, Query(("a", "b")), np.full((2, len(domain.behaviors), 2, 2), 0.5))
    with pytest.raises(SettingsError, match="joint"):
        with_joint_prior(momdp, joint)


def test_where_an_event_holds_is_computed_once_for_all_beliefs(monkeypatch):
    """A trial asks it of every belief that a planner compares, and Y doubles with an attribute."""
    momdp = problem(np.random.default_rng(0), grouped=False, yes_or_no=True, zeros=False)
    asked = []
    probability = Event.probability
    monkeypatch.setattr(Event, "probability", lambda *args: asked.append(1) or probability(*args))
    values = {report_value(momdp, initial_belief(momdp)) for _ in range(5)}
    assert len(values) == 1
    assert len(asked) <= 1
