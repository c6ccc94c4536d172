"""The policy of factored value iteration: near the optimum, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from planner_bound import upper_bound

from meal_bayes.domain import load_domain
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import ITRS, Objective, initial_belief, shape_reward
from meal_bayes.planners import History
from meal_bayes.planners.factored.policy import Factored
from meal_bayes.planners.rollout import simulate

RNG = np.random.default_rng(0)  # nothing in the solver is random


def solve(momdp, points=3_000, **settings):
    return Factored(points, **settings).solve(momdp, RNG)


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
        itrs = ITRS(alpha=30.0, beta=0.0, delta=1.0)
        shaped = shape_reward(momdp, np.zeros((2, 3)), itrs, domain=domain)
        plain, paid = solve(momdp), solve(shaped)
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
        with pytest.raises(SettingsError, match="without end"):
            solve(replace(momdp, bonus=np.full((1, 3, 2), 50.0)))

    @pytest.mark.parametrize("settings", [{"points": 0}, {"tolerance": 0.0}])
    def test_settings(self, settings):
        with pytest.raises(SettingsError, match="Factored needs"):
            Factored(**settings)


def test_weak_percepts_promise_no_more_than_the_bound(small):
    """The smooth estimate rose seven seconds above it, and a look that tells nothing was best."""
    rates = {"red": {"look": (0.2, 0.2), "lift": (1 / 3, 0.25)}}
    options = {"limit": 3, "objective": Objective(correct=300.0, incorrect=-300.0, abstain=True)}
    for prior, value in ((0.5, 24.46), (0.44137931, 38.0)):  # iterated on a grid of 2801 points
        momdp = small.momdp("toy", rates, prior=prior, **options)
        policy = Factored().solve(momdp, None)
        decision = policy.decide(small.start(momdp), None)
        assert decision.action == 1
        assert np.nanmax(decision.values) == pytest.approx(value, abs=0.1)
        assert np.nanmax(decision.values) <= policy.upper_bound + 1e-4
