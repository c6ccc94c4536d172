"""The policies that agents are compared with: random, predefined, and greedy for information."""

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.domain import load_domain
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import Transition, best_report, initial_belief, update_belief
from meal_bayes.planners import Greedy, History, Predefined, Random, RandomLegal, Untouched
from meal_bayes.planners.baselines import information_gain

RNG = np.random.default_rng(0)  # of solvers that draw nothing


def played(momdp, steps, cost=0.0):
    """History after (behavior, next x, percept or None)."""
    belief = initial_belief(momdp)
    actions = []
    perceived = []
    moved = []
    for name, next_x, percept in steps:
        action = momdp.behavior_names.index(name)
        observation = None if percept is None else np.array(percept)
        belief = update_belief(belief, momdp, Transition(action, next_x, observation))
        actions.append(action)
        perceived.append(percept is not None)
        moved.append(next_x)
    return History(belief, tuple(actions), tuple(perceived), tuple(moved), cost)


def choice(solver, momdp, history, seed=0):
    """Name of the behavior decided on, or "report"."""
    rng = np.random.default_rng(seed)
    action = solver.solve(momdp, rng).decide(history, rng).action
    if action < momdp.n_behaviors:
        return momdp.behavior_names[action]
    assert action == best_report(momdp, history.belief)
    return "report"


def assert_frequency(hits, n, p, sigma=5.0):
    assert abs(hits / n - p) <= sigma * np.sqrt(p * (1 - p) / n)


@pytest.mark.statistical
@pytest.mark.parametrize(("x", "legal"), [(0, ["look", "lift"]), (1, ["reinit"])])
def test_random_is_uniform_over_reports_and_legal_behaviors(toy, x, legal):
    policy = Random().solve(toy, RNG)
    rng = np.random.default_rng(1)
    n = 6000
    history = History(initial_belief(toy).at(x))
    drawn = Counter(policy.decide(history, rng).action for _ in range(n))
    expected = {toy.behavior_names.index(name) for name in legal} | {3, 4, 5, 6}
    assert set(drawn) == expected
    for action in expected:
        assert_frequency(drawn[action], n, 1 / len(expected))


def test_random_draws_among_more_reports_than_integers(small):
    domain = load_domain("ispy32")
    momdp = small.momdp(domain, {name: {} for name in domain.attributes})
    policy = Random().solve(momdp, RNG)
    rng = np.random.default_rng(2)
    drawn = [policy.decide(small.start(momdp), rng).action for _ in range(50)]
    assert len(set(drawn)) == 50
    ones = np.mean([momdp.query.values_of(a - momdp.n_behaviors) for a in drawn], axis=0)
    assert 0.3 < ones.mean() < 0.7
    assert (ones > 0).all()


@pytest.mark.statistical
def test_random_legal_is_uniform_over_legal_behaviors(small):
    domain = load_domain("ispy32")
    momdp = small.momdp(domain, {"heavy": {}})
    policy = RandomLegal(50.0).solve(momdp, RNG)
    rng = np.random.default_rng(3)
    n = 4000
    history = History(initial_belief(momdp).at(1), cost=49.9)
    drawn = Counter(momdp.behavior_names[policy.decide(history, rng).action] for _ in range(n))
    assert set(drawn) == {"press", "push", "grasp", "ask"}
    for hits in drawn.values():
        assert_frequency(hits, n, 0.25)


@pytest.mark.parametrize(("cost", "ends"), [(0.0, False), (49.9, False), (50.0, True), (70, True)])
def test_random_legal_reports_once_the_budget_is_spent(toy, cost, ends):
    action = choice(RandomLegal(50.0), toy, played(toy, [("look", 0, [1, 0])], cost))
    assert (action == "report") == ends


def test_predefined_takes_each_behavior_once_then_reports(small):
    momdp = small.momdp("roc36", {"heavy": {"lift_slow": (0.9, 0.2)}})
    sequence = ("look", "grasp", "lift_slow")
    steps = [("look", 1, [0]), ("grasp", 2, [1]), ("lift_slow", 3, [1])]
    for done, expected in enumerate([*sequence, "report"]):
        for persistent in (False, True):
            solver = Predefined(sequence, persistent)
            assert choice(solver, momdp, played(momdp, steps[:done])) == expected


def test_predefined_ends_before_what_is_not_legal(small):
    momdp = small.momdp("roc36", {"heavy": {}})
    failed = played(momdp, [("look", 1, [0]), ("grasp", 1, None)])
    assert choice(Predefined(("look", "grasp", "lift_slow")), momdp, failed) == "report"
    assert choice(Predefined(("look", "grasp", "tap")), momdp, failed) == "tap"
    assert choice(Predefined(("grasp",)), momdp, small.start(momdp)) == "report"


def test_predefined_plus_repeats_what_failed(small):
    momdp = small.momdp("roc36", {"heavy": {}})
    plus = Predefined(("look", "grasp", "lift_slow"), persistent=True)
    steps = [("look", 1, [0]), ("grasp", 1, None), ("grasp", 1, None), ("grasp", 2, [1])]
    chosen = [choice(plus, momdp, played(momdp, steps[:k])) for k in range(5)]
    assert chosen == ["look", "grasp", "grasp", "grasp", "lift_slow"]


def test_predefined_plus_goes_on_after_loops_and_moves_without_percept(small):
    loops = small.momdp("ispy32", {"heavy": {}})
    plus = Predefined(("look", "press", "grasp"), persistent=True)
    pressed = [("look", 1, [0]), ("press", 1, [1])]
    assert choice(plus, loops, played(loops, pressed)) == "grasp"
    assert choice(plus, loops, played(loops, [pressed[0], ("press", 1, None)])) == "press"
    toy = small.momdp("toy", small.rates)
    again = Predefined(("lift", "reinit", "look"), persistent=True)
    moved = played(toy, [("lift", 1, [1, 1]), ("reinit", 0, None)])
    assert choice(again, toy, moved) == "look"


@pytest.mark.parametrize("sequence", [(), ("look", "juggle")])
def test_predefined_sequences_are_checked(toy, sequence):
    with pytest.raises(SettingsError, match="predefined"):
        Predefined(sequence).solve(toy, np.random.default_rng(0))


def entropy(*probabilities):
    return -sum(p * math.log2(p) for p in probabilities if p > 0)


def gain(b, tpr, fpr):
    """Mutual information of one yes/no percept and one attribute, bits."""
    yes = b * tpr + (1 - b) * fpr
    return entropy(yes, 1 - yes) - b * entropy(tpr, 1 - tpr) - (1 - b) * entropy(fpr, 1 - fpr)


@pytest.mark.parametrize(
    ("prior", "likeliest"), [([0.9, 0.2], [1, 0]), ([0.3, 0.6], [0, 1]), ([0.1, 0.4], [0, 0])]
)
def test_untouched_reports_the_likeliest_values_at_once(small, prior, likeliest):
    rates = {"red": {"look": (0.9, 0.1)}, "heavy": {"lift": (0.9, 0.1)}}
    momdp = small.momdp("toy", rates, prior=prior)
    history = History(initial_belief(momdp))
    rng = np.random.default_rng(0)
    decision = Untouched().solve(momdp, rng).decide(history, rng)
    assert decision.action == momdp.n_behaviors + momdp.query.index_of(np.array(likeliest, bool))


def decide(momdp, history):
    rng = np.random.default_rng(0)
    return Greedy().solve(momdp, rng).decide(history, rng)


def test_information_gain_by_hand(small):
    rates = {"red": {"look": (0.8, 0.25)}, "heavy": {"look": (0.55, 0.4), "lift": (0.9, 0.2)}}
    momdp = small.momdp("toy", rates, prior=[0.5, 0.3])
    gains = information_gain(momdp, initial_belief(momdp))
    look = gain(0.5, 0.8, 0.25) + gain(0.3, 0.55, 0.4)
    np.testing.assert_allclose(gains, [look, gain(0.3, 0.9, 0.2), 0.0], atol=1e-12)


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
    look = gain(0.5, 0.8, 0.2)
    lift = gain(0.5, 0.95, 0.05)
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
