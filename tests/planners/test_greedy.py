import math
from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.momdp import Transition, initial_belief, update_belief
from meal_bayes.planners import Greedy, History
from meal_bayes.planners.greedy import information_gain


def entropy(*probabilities):
    return -sum(p * math.log2(p) for p in probabilities if p > 0)


def gain(b, tpr, fpr):
    """Mutual information of one yes/no percept and one attribute, bits."""
    yes = b * tpr + (1 - b) * fpr
    return entropy(yes, 1 - yes) - b * entropy(tpr, 1 - tpr) - (1 - b) * entropy(fpr, 1 - fpr)


def decide(momdp, history):
    rng = np.random.default_rng(0)
    return Greedy().solve(momdp, rng).decide(history, rng)


def test_information_gain_by_hand(small):
    rates = {"red": {"look": (0.8, 0.25)}, "heavy": {"look": (0.55, 0.4), "lift": (0.9, 0.2)}}
    momdp = small.momdp("toy", rates, prior=[0.5, 0.3])
    found = information_gain(momdp, initial_belief(momdp))
    look = gain(0.5, 0.8, 0.25) + gain(0.3, 0.55, 0.4)
    np.testing.assert_allclose(found, [look, gain(0.3, 0.9, 0.2), 0.0], atol=1e-12)


def test_dispersed_rows_are_less_informative_the_second_time(small):
    momdp = small.momdp("toy", {"red": {"look": (0.8, 0.25)}}, 3.0)
    belief = update_belief(initial_belief(momdp), momdp, Transition(0, 0, np.array([1])))
    b = float(belief.positive[0])
    rates = [(3.0 * p + 1) / 4 for p in (0.8, 0.25)]  # one yes seen: (s c + 1) / (s + 1)
    assert information_gain(momdp, belief)[0] == pytest.approx(gain(b, *rates))
    independent = small.momdp("toy", {"red": {"look": (0.8, 0.25)}})
    assert information_gain(momdp, belief)[0] < information_gain(independent, belief)[0]


def test_the_most_bits_per_second_win(small):
    """Look: few bits for 1 s; lift: more, but for 5 s folded with its failures."""
    momdp = small.momdp("toy", {"red": {"look": (0.8, 0.2), "lift": (0.95, 0.05)}})
    look, lift = gain(0.5, 0.8, 0.2), gain(0.5, 0.95, 0.05)
    price = 5 / (1 - 0.99 * 0.1)
    assert look / 1 > lift / price
    decision = decide(momdp, small.start(momdp))
    assert decision.action == 0
    # A bit is worth what the present error costs, 200 * .5 s, over the entropy, 1 bit.
    np.testing.assert_allclose(
        decision.values, [100 * look - 1, 100 * lift - price, np.nan, 0.0], atol=1e-9
    )
    assert decide(replace(momdp, cost=[3.0, 5.0, 2.0]), small.start(momdp)).action == 1


def test_what_is_out_of_reach_is_priced_with_the_way_to_it(small):
    momdp = small.momdp("toy", {"red": {"look": (0.8, 0.2)}})
    lifted = initial_belief(momdp).at(1)
    decision = decide(momdp, History(lifted))
    assert momdp.behavior_names[decision.action] == "reinit"
    expected = 100 * gain(0.5, 0.8, 0.2) - (2 + 0.99 * 1)
    assert decision.values[2] == pytest.approx(expected)
    assert np.isnan(decision.values[:2]).all()


def test_bits_that_cost_too_much_are_not_bought(small):
    momdp = small.momdp("toy", {"red": {"look": (0.8, 0.2)}}, prior=0.999)
    decision = decide(momdp, small.start(momdp))
    assert decision.action == momdp.n_behaviors + 1
    assert decision.values[-1] == pytest.approx(100 * (2 * 0.999 - 1))
    cheap = replace(momdp, cost=[1e-6, 5.0, 2.0])
    assert decide(cheap, small.start(cheap)).action == 0
