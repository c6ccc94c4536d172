"""Factored value iteration, of one problem and of many: near the optimum, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from planner_bound import upper_bound
from planner_models import load_reference
from rollout import simulate

from meal_bayes.domain import Query, load_domain
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import Objective, add_itrs_bonus, build_momdp, initial_belief
from meal_bayes.planners import POMCP, Factored, History, batched_value_iteration
from meal_bayes.planners.search import policy as pomcp
from meal_bayes.planners.table import policy as factored
from meal_bayes.planners.table.sweep import sweep

RNG = np.random.default_rng(0)  # nothing in the solver is random


def solve(momdp, points=3_000, **settings):
    return Factored(points, **settings).solve(momdp, RNG)


class TestThePolicy:
    @pytest.mark.quick(3)
    @pytest.mark.parametrize("seed", range(3))
    @pytest.mark.parametrize("limit", [1, 3])
    def test_it_is_near_the_optimum_where_percepts_run_out(self, small, seed, limit):
        """What has run out is planned without; what may run out is not foreseen."""
        momdp = small.toy(seed, 1 + seed % 2, 2, finite=False, limit=limit)
        optimum = small.expectimax(momdp)
        best = optimum.value(momdp.start, optimum.nothing_seen())
        value = optimum.of_policy(solve(momdp), 0)
        assert best - 0.05 * (momdp.correct - momdp.incorrect) <= value <= best + 1e-9

    @pytest.mark.quick(1)
    @pytest.mark.statistical
    @pytest.mark.parametrize(("n", "floor"), [(1, 434), (2, 372), (3, 200)])
    def test_value_on_the_noisy_robot(self, small, n, floor):
        """Known: 441.4, 387.2, 239.4. SARSOP's of 60 s are worth 441, 386, 109."""
        momdp = small.noisy_roc36(n)
        policy = solve(momdp, 5_000)
        done = simulate(momdp, policy, 100, np.random.default_rng(n))
        assert floor < done.value <= policy.upper_bound + 5 * done.value_se
        assert done.simulations == 0

    def test_it_ends_a_hopeless_trial(self, small):
        """It abstains where it may, else it guesses."""
        rates = {name: {"look": (0.51, 0.49)} for name in ("red", "heavy")}
        momdp = small.momdp("toy", rates, objective=Objective(abstain=True))
        start = History(initial_belief(momdp))
        assert solve(momdp).decide(start, RNG).action == momdp.abstention
        momdp = replace(momdp, abstain=False, incorrect=0.0)
        assert solve(momdp).decide(start, RNG).action >= momdp.n_behaviors

    def test_sure_priors_and_deciding_percepts(self, small):
        momdp = small.momdp("toy", {"red": {"look": (1.0, 0.0)}, "heavy": {}}, prior=[0.5, 1.0])
        policy = solve(momdp)
        assert policy.bound.size[1] == 1
        once = -momdp.cost[0] + momdp.discount * momdp.correct  # look does not fail
        assert policy.upper_bound == pytest.approx(once, abs=0.01)
        assert policy.decide(History(initial_belief(momdp)), RNG).action == 0

    def test_shaping_attracts(self, small):
        """ITRS: what pays to explore is explored first."""
        momdp = small.momdp("toy", small.rates, objective=Objective(discount=0.9))
        domain = load_domain("toy")
        shaped = add_itrs_bonus(momdp, np.zeros((2, 3)), 30.0, 0.0, domain=domain)
        plain = solve(momdp)
        paid = solve(shaped)
        assert paid.upper_bound > plain.upper_bound
        start = History(initial_belief(momdp))
        sure = History(small.believing(momdp, [9.0, 9.0]))
        assert plain.decide(sure, RNG).action >= momdp.n_behaviors
        assert paid.decide(start, RNG).action < momdp.n_behaviors
        assert paid.decide(sure, RNG).action < momdp.n_behaviors


class TestRefusals:
    def test_percepts_that_depend_on_each_other(self, small):
        dispersed = small.toy(0, 1, 2, finite=True)
        with pytest.raises(SettingsError, match=r"infinite precision.*POMCP"):
            solve(dispersed)
        with pytest.raises(SettingsError, match="differs between the truths"):
            upper_bound(dispersed)
        with pytest.raises(SettingsError, match="one latent class"):
            solve(small.toy(0, 1, 2, finite=False, own_classes=2))
        with pytest.raises(SettingsError):
            upper_bound(small.toy(0, 1, 2, finite=False, own_classes=2))

    def test_more_attributes_than_points(self, small):
        with pytest.raises(SettingsError, match=r"POMCP"):
            solve(small.ispy32(12), 50_000)

    def test_rewards_without_end(self, small):
        momdp = small.toy(0, 1, 2, finite=False, objective=Objective(discount=1.0))
        with pytest.raises(SettingsError, match="infinite"):
            solve(replace(momdp, bonus=np.full((1, 3, 2), 50.0)))

    @pytest.mark.parametrize("settings", [{"points": 0}, {"tolerance": 0.0}, {"work": 0.0}])
    def test_settings(self, settings):
        with pytest.raises(SettingsError, match="Factored needs"):
            Factored(**settings)


def test_limited_work_keeps_the_bound_and_the_estimate_near_the_optimum(monkeypatch):
    momdp = load_reference()["A3"]
    multiplied = 0

    def counted(backups, value, *rest):
        nonlocal multiplied
        made = sweep(backups, value, *rest)
        multiplied += made * value.shape[1]  # of a point one number at least
        return made

    monkeypatch.setattr(factored, "sweep", counted)
    whole = Factored().solve(momdp, RNG)
    multiplied = 0
    quick = Factored(work=2e8).solve(momdp, RNG)
    assert multiplied < 2e8
    assert quick.upper_bound >= whole.upper_bound - 1e-3
    start = History(initial_belief(momdp))
    values = [np.nanmax(policy.decide(start, RNG).values) for policy in (whole, quick)]
    assert values[1] == pytest.approx(values[0], abs=15.0)  # of rewards of 500


def test_pomcp_plans_without_a_table_that_would_take_too_long(monkeypatch):
    momdp = load_reference()["A3"]
    with pytest.raises(SettingsError, match="work"):
        Factored(work=1e5).solve(momdp, RNG)
    monkeypatch.setattr(pomcp, "_TABLE_WORK", 1e5)
    policy = POMCP(simulations=5).solve(momdp, RNG)
    assert policy.tables is None
    decision = policy.decide(History(initial_belief(momdp)), np.random.default_rng(0))
    assert decision.action < momdp.n_behaviors
    assert decision.gap is None  # without a table there is no upper bound


def test_weak_percepts_promise_no_more_than_the_bound(small):
    """The smooth estimate rose seven seconds above it, and a look that tells nothing was best."""
    rates = {"red": {"look": (0.2, 0.2), "lift": (1 / 3, 0.25)}}
    options = {"limit": 3, "objective": Objective(correct=300.0, incorrect=-300.0, abstain=True)}
    for prior, value in ((0.5, 24.46), (0.44137931, 38.0)):  # iterated on a grid of 2801 points
        momdp = small.momdp("toy", rates, prior=prior, **options)
        policy = Factored().solve(momdp, RNG)
        decision = policy.decide(small.start(momdp), RNG)
        assert decision.action == 1
        assert np.nanmax(decision.values) == pytest.approx(value, abs=0.1)
        assert np.nanmax(decision.values) <= policy.upper_bound + 1e-4


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


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("name", "abstain"), [("toy", False), ("toy", True), ("ispy32", True), ("cy101", False)]
)
def test_values_are_those_of_the_exact_planner(name, abstain):
    domain = load_domain(name)
    rng = np.random.default_rng(4)
    rates = random_rates(domain, rng, 6)
    prior = rng.uniform(0.1, 0.9, 6)
    scale = 2 * domain.report_reward
    values = batched_value_iteration(
        problem(domain=domain, objective=Objective(abstain=abstain)), rates, prior
    )
    for value, rates_of, p in zip(values, rates, prior, strict=True):
        best = optimum(problem(rates_of, p, domain=domain, objective=Objective(abstain=abstain)))
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
