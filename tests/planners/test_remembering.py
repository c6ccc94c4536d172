"""Remembered decisions are those of the place and the percepts, whatever trial comes first."""

import itertools

import numpy as np
import pytest

from meal_bayes.momdp import Transition, initial_belief, update_belief
from meal_bayes.planners import POMCP, Decision, History, Remembering


@pytest.fixture(scope="module")
def beliefs(toy):
    """Beliefs at the start, after a look of two kinds, and lifted."""
    start = initial_belief(toy)
    look = update_belief(start, toy, Transition(0, 0, np.array([1, 0], np.int8)))
    other = update_belief(start, toy, Transition(0, 0, np.array([0, 0], np.int8)))
    return start, look, other, start.at(1)


def test_decisions_are_made_once_for_a_place_and_percepts(toy, beliefs):
    class Counting:
        calls = 0

        def decide(self, history, rng):
            self.calls += 1
            nothing = np.zeros(toy.n_behaviors + 1)
            return Decision(self.calls, nothing, nothing, nothing)

    inner = Counting()
    policy, (start, look, *_) = Remembering(inner), beliefs
    trial = [*beliefs, start, look]
    assert [policy.decide(History(b), None).action for b in trial] == [1, 2, 3, 4, 1, 2]
    assert inner.calls == 4


def test_decisions_are_equal_whatever_trial_comes_first(toy, beliefs):
    made = set()
    for seed, order in enumerate(itertools.permutations(range(4))):
        policy = Remembering(POMCP(20).solve(toy, np.random.default_rng(seed)))
        rng, found = np.random.default_rng(seed), [None] * 4
        for place in order:
            decision = policy.decide(History(beliefs[place]), rng)
            values = decision.values[~np.isnan(decision.values)]
            found[place] = decision.action, decision.tree, tuple(values), tuple(decision.visits)
        made.add(tuple(found))
    assert len(made) == 1
