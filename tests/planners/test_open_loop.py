"""Open-loop control where only an object's first percept pays, and plans that are kept."""

from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.domain import load_domain
from meal_bayes.momdp import Transition, initial_belief, update_belief
from meal_bayes.planners import Decision, History, OpenLoop, OpenLoopPolicy, Remembering
from meal_bayes.planners.compiled import compile_momdp
from meal_bayes.planners.open_loop.library import plans_for
from meal_bayes.planners.open_loop.values import open_loop_values, remember, room_for


def with_bonus(momdp, pay):
    """Pay for percepts of each behavior, (E,), whatever the truth."""
    bonus = np.zeros_like(momdp.bonus)
    bonus[0] = np.asarray(pay, float)[:, None]
    return replace(momdp, bonus=bonus)


def values_of(problem, plans, belief):
    """Values (J,) of every plan from x, each as if it were the only one."""
    values = []
    for j in range(plans.first[belief.x], plans.first[belief.x + 1]):
        first = np.array([0] * (belief.x + 1) + [1] * (len(plans.first) - belief.x - 1))
        rows = ("action", "cost", "discount", "uses", "weight", "rule")
        own = {name: getattr(plans, name)[j : j + 1] for name in rows}
        one = plans._replace(first=first, **own)
        work = room_for(problem, one)
        remember(work, belief.seen.astype(float))
        out = np.empty((1, problem.legal.shape[1]))
        open_loop_values(problem, one, belief.x, np.exp(belief.weight)[None], 0, work, out)
        values.append(out[0, plans.action[j]])
    return np.array(values)


def bonuses_of(momdp, pay, paid, belief=None):
    """What a bonus adds to the value of every plan from the start, and the plans' uses (J,E)."""
    shaped = compile_momdp(with_bonus(momdp, pay))
    shaped = shaped._replace(paid=np.minimum(shaped.paid, paid))
    plain, plans = compile_momdp(momdp), plans_for(shaped)
    belief = initial_belief(momdp) if belief is None else belief
    uses = plans.uses[plans.first[belief.x] : plans.first[belief.x + 1]]
    return values_of(shaped, plans, belief) - values_of(plain, plans, belief), uses


@pytest.mark.parametrize("paid", [1, 2, np.inf])
def test_a_bonus_is_paid_for_so_many_percepts_of_a_trial(small, paid):
    momdp = small.momdp("toy", small.rates, limit=5, discount=1.0)
    added, uses = bonuses_of(momdp, [7.0, 0.0, 0.0], paid)
    assert uses[:, 0].max() >= 3
    np.testing.assert_allclose(added, 7.0 * np.minimum(uses[:, 0], paid))


def test_what_was_perceived_in_the_trial_is_not_paid_again(small):
    momdp = small.momdp("toy", small.rates, limit=5, discount=1.0)
    after = update_belief(initial_belief(momdp), momdp, Transition(0, 0, np.array([1, 0], np.int8)))
    added, uses = bonuses_of(momdp, [7.0, 20.0, 0.0], 1, after)
    # Eq. 11 pays executions: a lift that succeeds with 0.9 takes 1 / 0.9 of them.
    np.testing.assert_allclose(added, 20.0 * np.minimum(uses[:, 1], 1) / 0.9)


@pytest.mark.parametrize("prior", [0.5, 0.2])
def test_repaid_decides_as_a_fresh_solve_on_the_same_plans(small, prior):
    momdp = small.momdp("toy", small.rates, limit=4)
    first = OpenLoop(paid=1).solve(with_bonus(momdp, [30.0, 60.0, 0.0]), None)
    now = with_bonus(small.momdp("toy", small.rates, limit=4, prior=prior), [0.0, 40.0, 0.0])
    fresh = OpenLoopPolicy(now, OpenLoop(paid=1).solve(now, None).problem, first.plans)
    repaid, belief = first.repaid(now), initial_belief(now)
    for observation in ([1, 1], [0, 1], [0, 0]):
        expected = fresh.decide(History(belief), None)
        found = repaid.decide(History(belief), None)
        assert found.action == expected.action
        np.testing.assert_allclose(found.values, expected.values)
        belief = update_belief(belief, now, Transition(0, 0, np.array(observation, np.int8)))
    assert first.momdp.bonus[0, 1, 0] == 60.0  # the policy itself is as it was


def test_a_bonus_that_is_worth_its_cost_is_fetched(small):
    rates = {"red": {"look": (0.5, 0.5)}}  # nothing tells of the query
    momdp = small.momdp("toy", rates, limit=4)
    history = History(initial_belief(momdp))
    assert OpenLoop(paid=1).solve(momdp, None).decide(history, None).action >= momdp.n_behaviors
    rich = with_bonus(momdp, [0.0, 50.0, 0.0])
    assert OpenLoop(paid=1).solve(rich, None).decide(history, None).action == 1
    poor = with_bonus(momdp, [0.0, 5.0, 0.0])  # less than lift costs
    assert OpenLoop(paid=1).solve(poor, None).decide(history, None).action >= momdp.n_behaviors


def test_only_what_pays_again_is_done_again(small):
    momdp = with_bonus(small.momdp("toy", {"red": {}}, limit=4), [50.0, 0.0, 0.0])
    after = update_belief(initial_belief(momdp), momdp, Transition(0, 0, np.array([1], np.int8)))
    decide = History(after)
    assert OpenLoop().solve(momdp, None).decide(decide, None).action == 0
    assert OpenLoop(paid=1).solve(momdp, None).decide(decide, None).action >= momdp.n_behaviors


def test_one_plan_fetches_every_bonus(small):
    domain = load_domain("ispy32")
    momdp = small.momdp(domain, {domain.attributes[0]: {}}, limit=4, discount=1.0)
    senses = np.array([bool(behavior.modalities) for behavior in domain.behaviors])
    rich = with_bonus(momdp, 200.0 * senses)
    decision = OpenLoop(paid=1).solve(rich, None).decide(History(initial_belief(rich)), None)
    assert np.nanmax(decision.values) > 200.0 * senses.sum() - 150.0  # a tour's cost, s


def test_decisions_are_remembered_by_place_and_percepts(toy):
    class Counting:
        calls = 0

        def decide(self, history, rng):
            self.calls += 1
            nothing = np.zeros(toy.n_behaviors + 1)
            return Decision(self.calls, nothing, nothing, nothing)

    inner = Counting()
    policy, start = Remembering(inner), initial_belief(toy)
    look = update_belief(start, toy, Transition(0, 0, np.array([1, 0], np.int8)))
    other = update_belief(start, toy, Transition(0, 0, np.array([0, 0], np.int8)))
    beliefs = [start, look, other, start.at(1), start, look]
    assert [policy.decide(History(b), None).action for b in beliefs] == [1, 2, 3, 4, 1, 2]
    assert inner.calls == 4
