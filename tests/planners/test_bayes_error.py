"""Exact Bayes errors and tables of decision rules, against the definition of the model."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import betabinom, binom

from meal_bayes.domain import Query, load_domain
from meal_bayes.momdp import build_momdp
from meal_bayes.planners.compiled import compile_momdp
from meal_bayes.planners.open_loop.errors import (
    OUTCOMES,
    SPAN,
    THRESHOLDS,
    make_scratch,
    tabulate_errors,
)

COARSE = 0.02  # by how much errors read off the tables may be too high


def brute_error(momdp, counts, weight, seen=None, *, cut=False):
    """E min(b, 1-b) over every sequence of percepts, from the definition of the model."""
    e_of = [e for e, k in enumerate(counts) for _ in range(k)]
    rows, precision = momdp.confusion[0], momdp.precision[0]
    before = np.zeros(rows.shape[::2]) if seen is None else np.array(seen[0], dtype=float)
    if cut:
        half = momdp.levels // 2
        rows, before = (
            np.stack([a[..., :half].sum(axis=-1), a[..., half:].sum(axis=-1)], axis=-1)
            for a in (rows, before)
        )
    error, share = 0.0, np.exp(momdp.log_truth[0])  # (2,C)
    for percepts in itertools.product(range(rows.shape[-1]), repeat=len(e_of)):
        joint, count = weight[0].copy(), before.copy()
        for e, z in zip(e_of, percepts, strict=True):
            s, p = precision[e], rows[e, :, z]  # (C,) each
            known = np.isinf(s)
            finite = np.where(known, 1.0, s)
            joint *= np.where(known, p, (finite * p + count[e, z]) / (finite + count[e].sum()))
            count[e, z] += 1
        error += (share @ joint).min()
    return error


def outcomes(momdp, behaviors):
    """Pr(percepts | latent class) (C,) of every sequence of percepts of the first attribute."""
    for percepts in itertools.product(range(momdp.levels), repeat=len(behaviors)):
        count, joint = np.zeros((momdp.n_behaviors, momdp.levels)), np.ones(momdp.n_classes)
        for e, z in zip(behaviors, percepts, strict=True):
            s, p = momdp.precision[0, e], momdp.confusion[0, e, :, z]
            joint *= (s * p + count[e, z]) / (s + count[e].sum())
            count[e, z] += 1
        yield joint


@st.composite
def gatherings(draw, levels=2, most=5):
    """A `toy` problem of one attribute, a plan's percepts, a belief, and percepts seen.

    Truths may share latent classes. Where they do not, one behavior may be a person, whose answers
    tell of the truth, whatever class the object is of.
    """
    rng, own_classes = (
        np.random.default_rng(draw(st.integers(0, 2**32 - 1))),
        draw(st.integers(1, 3)),
    )
    shares = rng.dirichlet(np.ones(2 * own_classes), (1, 2))
    if not draw(st.booleans()):
        shares *= np.eye(2).repeat(own_classes, axis=1)
        shares /= shares.sum(axis=2, keepdims=True)
    confusion = rng.dirichlet(np.ones(levels), (1, 3, 2 * own_classes))
    if draw(st.booleans()):
        confusion[:, 1] = confusion[:, 1, ::own_classes].repeat(own_classes, axis=1)
    known = draw(st.lists(st.booleans(), min_size=6 * own_classes, max_size=6 * own_classes))
    finite = rng.gamma(1.0, 8.0, (1, 3, 2 * own_classes)) + 1e-3
    precision = np.where(np.reshape(known, finite.shape), np.inf, finite)
    momdp = build_momdp(
        load_domain("toy"),
        Query(("red",)),
        confusion,
        precision,
        prior=rng.uniform(0.2, 0.8),
        latent_classes=shares,
    )
    counts = draw(
        st.lists(st.integers(0, 3), min_size=2, max_size=2).filter(lambda u: sum(u) <= most)
    )
    seen = np.zeros((1, 3, levels), dtype=int)
    seen[0, :2] = rng.integers(0, 3, (2, levels)) * draw(st.booleans())
    odds = np.array([0.0, draw(st.floats(-6, 6))]).repeat(own_classes)
    weight = np.exp(odds) * rng.dirichlet(np.ones(own_classes), 2).reshape(1, -1)
    return momdp, [*counts, 0], weight / weight.sum(), seen


def planned_with(momdp):
    """Behaviors that the planner plans with, (E,)."""
    return compile_momdp(momdp).percepts.informative[0]


@given(gatherings())
def test_error_is_exact(small, case):
    momdp, counts, *rest = case
    counts = np.where(planned_with(momdp), counts, 0)
    assert small.error(compile_momdp(case[0]), *case[1:]) == pytest.approx(
        brute_error(momdp, counts, *rest), abs=1e-10
    )


@given(gatherings(levels=4, most=3))
def test_cutting_levels_to_yes_and_no_can_only_raise_the_error(small, case):
    momdp, counts, *rest = case
    found, told = (
        small.error(compile_momdp(case[0]), *case[1:]),
        np.where(planned_with(momdp), counts, 0),
    )
    assert found == pytest.approx(brute_error(momdp, told, *rest, cut=True), abs=1e-10)
    assert found >= brute_error(*case) - 1e-12


def test_percepts_beyond_the_limit_are_not_informative(small):
    rng = np.random.default_rng(1)
    momdp = small.random("toy", 1, 2, rng, precision=4.0, limit=[3, 2, np.inf])
    seen, weight = np.array([[[1, 1], [0, 2], [0, 0]]]), small.weights(momdp, [0.3])
    found = small.error(compile_momdp(momdp), [5, 5, 0], weight, seen)
    assert found == pytest.approx(brute_error(momdp, [1, 0, 0], weight, seen), abs=1e-12)


@pytest.mark.parametrize("precision", [4.0, np.inf])
def test_of_many_percepts_fifteen_are_planned_with_unless_rows_are_known(small, precision):
    momdp = small.random("toy", 1, 2, np.random.default_rng(3), precision=precision)
    weight = small.weights(momdp, [0.0])
    ten, fifteen, twenty = (
        small.error(compile_momdp(momdp), [k, 0, 0], weight) for k in (10, 15, 20)
    )
    assert twenty <= fifteen <= ten
    assert (twenty == fifteen) == np.isfinite(precision)
    assert ten == pytest.approx(brute_error(momdp, [10, 0, 0], weight), abs=1e-12)


@pytest.mark.parametrize("precision", [3.7, np.inf])
def test_percepts_of_one_behavior_are_counted_by_the_beta_binomial(small, precision):
    rates = [0.3, 0.9, 0.8, 0.55]  # of four classes that truths share
    rows = np.tile([[1 - p, p] for p in rates], (1, 3, 1, 1))
    classes = np.array([[[0.4, 0.1, 0.1, 0.4], [0.1, 0.4, 0.3, 0.2]]])
    momdp = build_momdp(
        load_domain("toy"), Query(("red",)), rows, precision, latent_classes=classes
    )
    weight, share = np.array([[0.2, 0.4, 0.1, 0.3]]), np.exp(momdp.log_truth[0])
    for k in range(15):
        urns = [
            binom(k, p) if np.isinf(precision) else betabinom(k, precision * p, precision * (1 - p))
            for p in rates
        ]
        joint = weight[0][:, None] * np.array([urn.pmf(range(k + 1)) for urn in urns])
        exact = (share @ joint).min(axis=0).sum()
        found = small.error(compile_momdp(momdp), [k, 0, 0], weight)
        assert found == pytest.approx(exact, abs=1e-12)


def table_of(problem, counts):
    """Pr(error | latent class) of the rules of one plan (E,), from the kernel (G,C)."""
    table = np.empty((1, THRESHOLDS, problem.percepts.rows.shape[2]))
    scratch = make_scratch(problem.percepts, 0, 0, OUTCOMES)
    tabulate_errors(problem.percepts, np.array([counts]), np.zeros(1, np.int64), scratch, table)
    return table[0]


@given(gatherings())
def test_no_decision_rule_is_better_than_the_bayes_error(small, case):
    momdp, counts, weight, _ = case
    problem = compile_momdp(momdp)
    table = table_of(problem, counts)
    exact = small.error(problem, counts, weight)
    thresholds = table @ weight[0]
    assert (table >= 0).all()
    assert (table <= 1 + 1e-12).all()
    assert thresholds.min() >= exact - 1e-12
    # Where the class is the truth, the rules next to the log-odds are the best, and nearly exact.
    if momdp.class_is_truth:
        odds = np.log(weight[0, 1] / weight[0, 0])
        cell = int((odds + SPAN) * (THRESHOLDS - 1) / (2 * SPAN))
        assert min(thresholds[cell], thresholds[cell + 1]) == pytest.approx(
            thresholds.min(), abs=1e-12
        )
        assert thresholds.min() <= exact + COARSE


def test_decision_rules_are_exact_at_the_log_odds_that_they_are_made_for(small):
    momdp = small.random("toy", 1, 2, np.random.default_rng(4))
    table = table_of(compile_momdp(momdp), [2, 3, 0])
    for errors, odds in zip(table, np.linspace(-SPAN, SPAN, THRESHOLDS), strict=True):
        weight = small.weights(momdp, [odds])
        exact = brute_error(momdp, [2, 3, 0], weight)
        assert errors @ weight[0] == pytest.approx(exact, abs=1e-12)


def test_a_decision_rule_errs_as_often_as_its_definition_says(small):
    """Say yes where the likelihood ratio outweighs prior log-odds; of three shared classes."""
    momdp = small.toy(2, 1, 2, finite=True, shared=3)
    problem = compile_momdp(momdp)
    assert problem.percepts.informative[0, :2].all()
    table, share = table_of(problem, [2, 1, 0]), np.exp(momdp.log_truth[0])
    given_class = np.array(list(outcomes(momdp, [0, 0, 1])))  # (M,C)
    false, true = given_class @ momdp.latent_classes[0, 0], given_class @ momdp.latent_classes[0, 1]
    for errors, odds in zip(table, np.linspace(-SPAN, SPAN, THRESHOLDS), strict=True):
        yes = (np.log(true / false) + odds > 0)[:, None]
        expected = (given_class * np.where(yes, share[0], share[1])).sum(axis=0)
        np.testing.assert_allclose(errors, expected, atol=1e-12)
