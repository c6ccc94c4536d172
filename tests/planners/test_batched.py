"""Values of many problems of one attribute: against the optimum, and what must be true of them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from meal_bayes.domain import Query, load_domain
from meal_bayes.momdp import Objective, build_momdp, initial_belief
from meal_bayes.planners import Factored, History, batched_value_iteration

TOY = load_domain("toy")
rate = st.floats(0.02, 0.98)
pairs = st.tuples(rate, rate).map(sorted)  # Pr(yes | false) <= Pr(yes | true)
chance = st.floats(0.02, 0.98)


def problem(rates=None, prior=0.5, domain=TOY, **options):
    e = len(domain.behaviors)
    yes = np.full((e, 2), 0.5) if rates is None else np.asarray(rates)
    confusion = np.stack([1 - yes, yes], axis=-1)[None]
    return build_momdp(domain, Query(domain.attributes[:1]), confusion, prior=prior, **options)


def optimum(momdp):
    policy = Factored(points=4_000).solve(momdp, np.random.default_rng(0))
    decision = policy.decide(History(initial_belief(momdp)), np.random.default_rng(0))
    return np.nanmax(decision.values)


def random_rates(domain, rng, size):
    yes = np.sort(rng.uniform(0.02, 0.98, (size, len(domain.behaviors), 2)), axis=-1)
    yes[:, [not behavior.senses for behavior in domain.behaviors]] = 0.5
    return yes


@pytest.mark.parametrize(
    ("name", "abstain"), [("toy", False), ("toy", True), ("ispy32", True), ("cy101", False)]
)
def test_values_are_those_of_the_exact_planner(name, abstain):
    domain, rng = load_domain(name), np.random.default_rng(4)
    rates, prior = random_rates(domain, rng, 6), rng.uniform(0.1, 0.9, 6)
    scale = 2 * domain.report_reward
    values = batched_value_iteration(
        problem(domain=domain, objective=Objective(abstain=abstain)), rates, prior
    )
    for value, own, p in zip(values, rates, prior, strict=True):
        best = optimum(problem(own, p, domain=domain, objective=Objective(abstain=abstain)))
        assert best - 0.002 * scale <= value <= best + 0.02 * scale  # it errs upwards


@given(st.lists(pairs, min_size=3, max_size=3), chance)
def test_values_are_between_reporting_at_once_and_knowing(rates, prior):
    (value,) = batched_value_iteration(problem(), np.array([rates]), np.array([prior]))
    assert 100 * (2 * max(prior, 1 - prior) - 1) - 0.2 <= value <= 100  # the grid rounds 0.1 %


@given(st.lists(pairs, min_size=3, max_size=3), chance, st.integers(0, 1), st.floats(0, 0.3))
def test_better_percepts_are_worth_no_less(rates, prior, e, step):
    better = np.array(rates)
    better[e] = np.clip(better[e] + step * np.array([-1, 1]), 0.01, 0.99)
    both = np.stack([rates, better])
    plain, improved = batched_value_iteration(problem(), both, np.full(2, prior))
    assert improved >= plain - 0.5  # 0.25 % of r+ - r-, interpolation
