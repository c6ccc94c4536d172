"""Alpha vectors decide as they say, and never what the MOMDP forbids."""

import numpy as np
import pytest

from meal_bayes.domain import Query, load_domain
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import Objective, Transition, build_momdp, initial_belief, update_belief
from meal_bayes.planners import History
from meal_bayes.planners.point_based.alpha_vectors import AlphaVectorPolicy, AlphaVectors

LOOK, LIFT, REINIT = range(3)


def momdp_of(n=1, **options):
    domain = load_domain("toy")
    rows = np.tile([[0.7, 0.3], [0.2, 0.8]], (n, 3, 1, 1))
    return build_momdp(domain, Query(domain.attributes[:n]), rows, **options)


def decide(momdp, belief, vectors, x, action):
    policy = AlphaVectorPolicy(momdp, AlphaVectors(vectors, x, action))
    return policy.decide(History(belief), np.random.default_rng(0))


def test_the_best_vector_of_x_is_taken():
    vectors, x = np.array([[100.0, 500.0], [400.0, 200.0], [900.0, 900.0]]), [0, 0, 1]
    for prior, action in ((0.9, LOOK), (0.1, LIFT)):
        momdp = momdp_of(prior=prior)
        found = decide(momdp, initial_belief(momdp), vectors, x, [LOOK, LIFT, LIFT])
        assert found.action == action
        np.testing.assert_allclose(found.values[:2], vectors[:2] @ [1 - prior, prior])


@pytest.mark.parametrize(
    ("vectors", "x", "action"),
    [([1.0], [0], [0]), ([[1.0]], [0, 0], [0]), ([[1.0]], [0], [0, 1]), (np.ones((0, 2)), [], [])],
)
def test_lengths_that_differ_are_told(vectors, x, action):
    with pytest.raises(SettingsError, match="Alpha vectors of shape"):
        AlphaVectors(vectors, x, action)


def test_the_joint_belief_runs_in_the_querys_bit_order():
    """Value y = 1 is "not red, heavy": the first attribute is the leading bit."""
    momdp = momdp_of(2, prior=[0.1, 0.8])
    belief = initial_belief(momdp)
    vectors = np.array([[0, 900.0, 0, 0], [0, 0, 900.0, 0]])
    decision = decide(momdp, belief, vectors, [0, 0], [LOOK, LIFT])
    np.testing.assert_allclose(decision.values[:2], [900 * 0.9 * 0.8, 900 * 0.1 * 0.2])
    assert decision.action == LOOK
    assert np.isnan(decision.values[REINIT])
    assert np.isnan(decision.value_se[REINIT])


def test_a_report_is_valued_exactly_and_needs_no_vector():
    momdp = momdp_of(2, prior=[0.9, 0.2])
    belief = initial_belief(momdp)
    worth = -100 + 200 * 0.9 * 0.8
    for look, action in ((worth - 1, 3 + 0b10), (worth + 1, LOOK)):
        decision = decide(momdp, belief, [[look] * 4, [999.0] * 4], [0, 0], [LOOK, 3])
        assert decision.action == action  # a report's own vector counts for nothing
        assert decision.values[-1] == pytest.approx(worth)
    policy = AlphaVectorPolicy(momdp, AlphaVectors([[worth + 1] * 4], [0], [LOOK]))
    assert policy.lower_bound == pytest.approx(worth + 1)
    policy = AlphaVectorPolicy(momdp, AlphaVectors([[worth + 1] * 4], [1], [REINIT]))
    assert policy.lower_bound == pytest.approx(worth)


def test_an_x_without_vectors_reports():
    momdp = momdp_of(1, prior=0.8)
    decision = decide(momdp, initial_belief(momdp).at(1), [[50.0, 50.0]], [0], [LOOK])
    assert decision.action == 3 + 1


@pytest.mark.parametrize("abstain", [False, True])
def test_illegal_behaviors_are_never_taken(abstain):
    """At x1: lift and look are not legal there."""
    momdp = momdp_of(1, objective=Objective(abstain=abstain, correct=10.0, incorrect=-30.0))
    belief = initial_belief(momdp).at(1)
    decision = decide(momdp, belief, [[77.0, 77.0], [66.0, 66.0]], [1, 1], [LIFT, LOOK])
    assert decision.action == (momdp.abstention if abstain else momdp.n_behaviors)
    assert decision.values[-1] == (0.0 if abstain else -10.0)


def test_used_up_percepts_end_a_loop():
    momdp = momdp_of(1, limit=2)
    belief = initial_belief(momdp)
    actions = []
    for _ in range(3):
        actions.append(decide(momdp, belief, [[99.9, 99.9]], [0], [LOOK]).action)
        belief = update_belief(belief, momdp, Transition(LOOK, 0, np.array([1], dtype=np.int8)))
    assert actions[:2] == [LOOK, LOOK]
    assert actions[2] >= momdp.n_behaviors


@pytest.mark.parametrize(
    ("vectors", "x", "action", "found"),
    [
        (np.ones((1, 4)), [0], [0], "4 values; 1 attributes have 2"),
        (np.ones((1, 2)), [3], [0], "x from 3 to 3; the MOMDP has 3"),
        (np.ones((1, 2)), [-1], [0], "x from -1"),
        (np.ones((2, 2)), [0, 0], [0, 5], "actions from 0 to 5; the MOMDP has 5"),
    ],
)
def test_vectors_of_another_problem_are_told(vectors, x, action, found):
    with pytest.raises(SettingsError, match=found):
        AlphaVectorPolicy(momdp_of(), AlphaVectors(vectors, x, action))


def test_vectors_at_the_end_are_no_harm():
    """SARSOP writes some for `term` too."""
    momdp = momdp_of()
    alpha = AlphaVectors([[0.0, 0.0], [60.0, 60.0]], [2, 0], [LOOK, LOOK])
    policy = AlphaVectorPolicy(momdp, alpha)
    assert policy.lower_bound == 60.0
