"""The search against exact solutions, and what it cannot do without."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from rollout import simulate

from meal_bayes.domain import Behavior, Domain, Effect, TransitionDiagram
from meal_bayes.momdp import Objective, Transition, initial_belief, report_value, update_belief
from meal_bayes.planners import POMCP, History
from meal_bayes.planners.search import policy as pomcp

PROBLEMS = {
    "independent": {"seed": 0, "n": 2, "levels": 2, "finite": False, "limit": 3},
    "dispersed": {"seed": 1, "n": 2, "levels": 2, "finite": True, "limit": 2},
    "four levels": {"seed": 2, "n": 1, "levels": 4, "finite": False, "limit": 3},
    "four levels, dispersed": {"seed": 3, "n": 1, "levels": 4, "finite": True, "limit": 2},
    "misperceived": {"seed": 0, "n": 2, "levels": 2, "finite": True, "limit": 2}
    | {"mistaken": [0.05, 0.2]},
    "six classes": {"seed": 4, "n": 2, "levels": 2, "finite": False, "limit": 2, "own_classes": 3},
    "shared classes": {"seed": 4, "n": 2, "levels": 2, "finite": True, "limit": 2, "shared": 3},
}


@pytest.mark.parametrize(("lasts", "simulations"), [(5.0, 1), (0.01, 60)])
def test_a_budget_of_time_buys_one_simulation_at_least(lasts, simulations, monkeypatch):
    now = 0.0

    def grow(several):
        nonlocal now
        now += several * lasts
        return several

    monkeypatch.setattr(pomcp.time, "thread_time", lambda: now)
    made, first = pomcp._simulate(grow, 1.0)
    assert simulations <= made <= max(1, 1.0 / lasts)
    assert first == lasts


class TestAgainstTheOptimum:
    @pytest.fixture(scope="class")
    @staticmethod
    def solved(small):
        """Make problems with their exact solutions, each once."""

        @cache
        def make(problem, **options):
            momdp = small.toy(**PROBLEMS[problem], **options)
            optimum = small.expectimax(momdp)
            return momdp, optimum, optimum.value(momdp.start, optimum.nothing_seen())

        return make

    @pytest.mark.quick(3)
    @pytest.mark.parametrize("abstain", [False, True])
    @pytest.mark.parametrize("problem", PROBLEMS)
    @pytest.mark.parametrize("simulations", [30, 300, 3000])
    def test_the_value_approaches_it_from_below(self, small, solved, problem, abstain, simulations):
        momdp, _, best = solved(problem, objective=Objective(abstain=abstain))
        value = small.best_value(small.search(momdp, simulations))
        assert value <= best + 1e-9
        assert value >= best - 55 / np.sqrt(simulations)  # of 200 between right and wrong

    @pytest.mark.quick(3)
    @pytest.mark.parametrize("problem", PROBLEMS)
    def test_without_discount(self, small, solved, problem):
        momdp, _, best = solved(problem, objective=Objective(discount=1.0))
        value = small.best_value(small.search(momdp, 3000))
        assert best - 3.0 <= value <= best + 1e-9

    def test_shaping(self, small):
        bonus = np.zeros((2, 3, 2))
        bonus[:, :2] = np.random.default_rng(5).uniform(-1, 6, (2, 2, 2))
        momdp = replace(small.toy(5, 2, 2, finite=True, limit=2, mistaken=0.1), bonus=bonus)
        optimum = small.expectimax(momdp)
        best = optimum.value(momdp.start, optimum.nothing_seen())
        plain = small.expectimax(replace(momdp, bonus=0 * bonus))
        assert best > plain.value(momdp.start, plain.nothing_seen()) + 5
        assert best - 2.0 <= small.best_value(small.search(momdp, 3000)) <= best + 1e-9

    @pytest.mark.long
    def test_several_outcomes(self, small):
        """A lift may drop the object, which is then out of reach: branches of different x."""
        diagram = TransitionDiagram(
            states=("x0", "x1", "x2", "term"),
            start="x0",
            effects=(
                Effect("x0", "look", "x0"),
                Effect("x0", "lift", "x1", 0.5),
                Effect("x0", "lift", "x2", 0.3, senses=False),
                Effect("x1", "weigh", "x1", 0.8),
            ),
        )
        acts = (("look", 1.0), ("lift", 2.0), ("weigh", 3.0))
        behaviors = tuple(Behavior(name, cost, ("felt",)) for name, cost in acts)
        domain = Domain("dropping", ("red", "heavy"), behaviors, diagram, report_reward=100.0)
        rates = {"red": {"look": (0.9, 0.3)}, "heavy": {"lift": (0.6, 0.4), "weigh": (0.9, 0.1)}}
        momdp = small.momdp(domain, rates, 20.0, limit=3)
        optimum = small.expectimax(momdp)
        best = optimum.value(0, optimum.nothing_seen())
        assert small.best_value(small.search(momdp, 3000)) == pytest.approx(best, abs=1.0)

    @pytest.mark.quick(2)
    @pytest.mark.parametrize("problem", PROBLEMS)
    def test_its_policy_is_worth_at_most_the_optimum_and_nearly_that(self, solved, problem):
        momdp, optimum, best = solved(problem)
        policy = POMCP(300).solve(momdp, np.random.default_rng(0))
        worth = optimum.of_policy(policy, 0)
        assert best - 1.5 <= worth <= best + 1e-9

    @pytest.mark.long
    @pytest.mark.statistical
    def test_more_simulations_lose_less(self, solved):
        """Exact worth of the policies, the mean loss over the problems."""
        losses = []
        for simulations in (0, 10, 100):
            loss = []
            for problem in PROBLEMS:
                momdp, optimum, best = solved(problem)
                policy = POMCP(simulations).solve(momdp, np.random.default_rng(0))
                loss.append(best - optimum.of_policy(policy, 0))
            losses.append(np.mean(loss))
        assert (np.diff(losses) <= 0.05).all(), losses
        assert losses[0] > 2 * losses[-1]
        assert losses[-1] < 0.5


class TestWithoutThese:
    """The three things without which the search fails on these problems."""

    @pytest.mark.parametrize("n", [1, 3, 81])
    def test_all_reports_are_one_action(self, small, n):
        momdp = small.ispy32(n)
        decision = small.search(momdp, 20)
        assert decision.values.shape == (momdp.n_behaviors + 1,)
        assert {edge.action for edge in decision.tree} <= set(range(momdp.n_behaviors))

    def test_ending_has_its_exact_value(self, small, toy):
        history = History(
            update_belief(initial_belief(toy), toy, Transition(0, 0, np.array([1, 0])))
        )
        for simulations in (0, 50):
            decision = small.search(toy, simulations, history=history)
            assert decision.values[-1] == pytest.approx(report_value(toy, history.belief))
            assert decision.value_se[-1] == 0.0

    def test_nodes_carry_the_exact_belief(self, small):
        """After the one percept there is, ending is all that is left: the value is exact."""
        for levels in (2, 4):
            momdp = small.toy(7, 2, levels, finite=True, limit=[1, 0, 0])
            belief = initial_belief(momdp)
            value = 0.0
            for z in np.ndindex(levels, levels):
                after = update_belief(belief, momdp, Transition(0, 0, np.array(z)))
                p = 1.0
                for i, b in enumerate(belief.positive):
                    row = momdp.confusion[i, 0, :, z[i]]
                    p *= (1 - b) * row[0] + b * row[1]
                value += p * report_value(momdp, after)
            decision = small.search(momdp, 30)
            assert decision.values[0] == pytest.approx(-1 + 0.99 * value, abs=1e-9)

    def test_no_history_is_too_unlikely(self, small, toy):
        """Particles would have died of such percepts."""
        momdp = replace(toy, limit=np.full(3, np.inf))
        history = History(initial_belief(momdp))
        for number in range(60):
            percept = np.array([number % 2, 1 - number % 2])
            belief = update_belief(history.belief, momdp, Transition(0, 0, percept))
            history = History(belief)
        decision = small.search(momdp, 100, history=history)
        assert decision.simulations == 100
        assert decision.values[-1] == pytest.approx(report_value(momdp, history.belief))

    @pytest.mark.parametrize(
        ("n", "floor", "optimum", "bound"), [(1, 435, 441.25, 441.4), (2, 370, 387.2, 387.7)]
    )
    def test_values_lie_between_known_bounds(self, small, n, floor, optimum, bound):
        """Upper bounds by factored value iteration; SARSOP closes A1 at 441.3, PBVI A2 at 387.2."""
        momdp = small.noisy_roc36(n)
        plans = small.search(momdp, 3000, always=True, points=0)
        assert floor < small.best_value(plans) < bound
        tables = small.search(momdp, 300, always=True)
        assert optimum < small.best_value(tables) < bound + 1.0

    @pytest.mark.long
    def test_three_noisy_attributes(self, small):
        momdp = small.noisy_roc36(3)
        bound = 239.9  # by factored value iteration
        searches = [small.search(momdp, k, always=True, points=0) for k in (0, 100, 1000)]
        values = [small.best_value(decision) for decision in searches]
        assert 150 < values[0] < values[1] < values[2] < bound  # from the best plan up
        assert values[2] - values[0] > 10
        tables = small.search(momdp, 30, always=True)
        assert small.best_value(tables) == pytest.approx(bound, abs=1.0)

    @pytest.mark.statistical
    @pytest.mark.parametrize(
        ("n", "floor"),
        [(1, 425), *(pytest.param(*more, marks=pytest.mark.long) for more in ((2, 360), (3, 185)))],
    )
    def test_value_on_the_noisy_robot(self, small, n, floor):
        """SARSOP: 441, 386, 99 in 5 s; textbook POMCP 237, -49, -278."""
        momdp = small.noisy_roc36(n)
        for solver in (POMCP(30), POMCP(30, points=0)):
            policy = solver.solve(momdp, np.random.default_rng(0))
            assert simulate(momdp, policy, 60, np.random.default_rng(1)).value > floor
