from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.domain import Behavior, Domain, Effect, Query, TransitionDiagram, load_domain
from meal_bayes.momdp import Objective, build_momdp, initial_belief
from meal_bayes.planners.compiled import class_prior, compile_momdp, dynamics_of

FORK = Domain(
    name="fork",
    attributes=("heavy",),
    behaviors=(Behavior("lift", 2.0, ("haptics",)), Behavior("nod", 1.0), Behavior("rest", 1.0)),
    diagram=TransitionDiagram(
        states=("x0", "x1", "x2", "term"),
        start="x0",
        effects=(
            Effect("x0", "lift", "x1", 0.5),
            Effect("x0", "lift", "x2", 0.3, senses=False),  # and .2 nothing
            Effect("x1", "lift", "x0", 0.4),
            Effect("x1", "lift", "x1", 0.5),  # a loop that may fail
            Effect("x2", "rest", "x0"),
            Effect("*", "nod", "*"),  # does nothing at all
        ),
    ),
)


def behavior(momdp, name):
    return momdp.behavior_names.index(name)


def branches(dynamics, x, e):
    """Set of (probability, next x, with a percept?)."""
    return {(round(p, 12), to, senses) for p, to, senses in dynamics.outcomes(x, e)}


def test_failures_of_a_move_are_summed_out(small):
    # c = 4.5 s, p = .95: c' = c / (1 - g (1 - p)), g' = g p / (1 - g (1 - p)).
    momdp = small.momdp("roc36", {"heavy": {}})
    dynamics, grasp = dynamics_of(momdp), behavior(momdp, "grasp")
    assert dynamics.step["cost"][1, grasp] == pytest.approx(4.7344, abs=5e-5)
    assert dynamics.step["discount"][1, grasp] == pytest.approx(0.9895, abs=5e-5)
    assert dynamics.step["bonus_scale"][1, grasp] == pytest.approx(4.7344 / 4.5, abs=2e-5)
    assert branches(dynamics, 1, grasp) == {(1.0, 2, True)}


def test_failures_of_a_loop_are_summed_out(small):
    momdp = small.momdp("ispy32", {"heavy": {}})
    dynamics, press = dynamics_of(momdp), behavior(momdp, "press")
    assert dynamics.step["cost"][1, press] == pytest.approx(22 / (1 - 0.99 * 0.05))
    assert dynamics.step["discount"][1, press] == pytest.approx(0.99 * 0.95 / (1 - 0.99 * 0.05))
    assert branches(dynamics, 1, press) == {(1.0, 1, True)}


def test_what_never_fails_keeps_cost_and_discount(small):
    momdp = small.momdp("roc36", {"heavy": {}})
    dynamics, look = dynamics_of(momdp), behavior(momdp, "look")
    assert (dynamics.step["cost"][0, look], dynamics.step["discount"][0, look]) == (
        0.5,
        0.99,
    )


def test_moves_without_percept_are_silent_branches(small):
    momdp = small.momdp("roc36", {"heavy": {}})
    dynamics, reinit = dynamics_of(momdp), behavior(momdp, "reinit")
    assert branches(dynamics, 5, reinit) == {(1.0, 0, False)}
    assert dynamics.step["cost"][5, reinit] == pytest.approx(10 / (1 - 0.99 * 0.05))


def test_without_discount_a_failure_costs_a_repetition(small):
    momdp = small.momdp("roc36", {"heavy": {}}, objective=Objective(discount=1.0))
    dynamics, grasp = dynamics_of(momdp), behavior(momdp, "grasp")
    assert dynamics.step["cost"][1, grasp] == pytest.approx(4.5 / 0.95)
    np.testing.assert_allclose(dynamics.step["discount"][dynamics.step["legal"]], 1.0)


def test_published_shakes_are_repeated_until_the_object_falls(small):
    momdp = small.momdp("roc36_published", {"heavy": {}}, objective=Objective(abstain=True))
    dynamics, shake = dynamics_of(momdp), behavior(momdp, "shake")
    assert branches(dynamics, 4, shake) == {(1.0, 5, True)}
    assert dynamics.step["cost"][4, shake] == pytest.approx(3.8 / (1 - 0.99 * 0.95))
    assert dynamics.step["discount"][4, shake] == pytest.approx(0.99 * 0.05 / (1 - 0.99 * 0.95))
    crush, hold, tap = (behavior(momdp, name) for name in ("crush", "hold", "tap"))
    for x in range(6):
        assert branches(dynamics, x, crush) == {(1.0, x, True)}
    assert dynamics.step["cost"][3, hold] == pytest.approx(1.0 / (1 - 0.99 * 0.01))
    assert dynamics.step["cost"][1, tap] == pytest.approx(4.2 / (1 - 0.99 * 0.10))


def test_where_illegal_changes_nothing_none_abstains(small):
    momdp = small.momdp("roc36_published", {"heavy": {}}, objective=Objective(abstain=True))
    assert np.isneginf(dynamics_of(momdp).exit_value[:6]).all()


def test_abstaining_costs_nothing(small):
    rates = {"heavy": {}}
    dynamics = dynamics_of(small.momdp("roc36", rates, objective=Objective(abstain=True)))
    assert not dynamics.exit_value.any()
    assert np.isneginf(dynamics_of(small.momdp("roc36", rates)).exit_value).all()


def test_each_outcome_is_a_branch(small):
    momdp = small.momdp(FORK, {"heavy": {}})
    dynamics = dynamics_of(momdp)
    assert branches(dynamics, 0, 0) == {(0.625, 1, True), (0.375, 2, False)}
    assert dynamics.step["cost"][0, 0] == pytest.approx(2 / (1 - 0.99 * 0.2))
    assert dynamics.step["discount"][0, 0] == pytest.approx(0.99 * 0.8 / (1 - 0.99 * 0.2))
    p = round(0.4 / 0.9, 12)
    assert branches(dynamics, 1, 0) == {(p, 0, True), (round(1 - p, 12), 1, True)}
    assert dynamics.step["cost"][1, 0] == pytest.approx(2 / (1 - 0.99 * 0.1))


def test_what_never_does_anything_is_not_legal(small):
    momdp = small.momdp(FORK, {"heavy": {}})
    assert momdp.legal[:3, 1].all()
    dynamics = dynamics_of(momdp)
    assert not dynamics.step["legal"][:, 1].any()
    assert dynamics.step["legal"][2, 2]


@pytest.mark.parametrize("name", ["toy", "roc36", "roc36_published", "ispy32", "cy101"])
def test_outcomes_are_distributions(small, name):
    domain = load_domain(name)
    dynamics = dynamics_of(small.momdp(domain, {domain.attributes[0]: {}}))
    np.testing.assert_array_equal(dynamics.step["legal"], domain.transitions().legal)
    np.testing.assert_allclose(dynamics.branch["p"].sum(axis=2), dynamics.step["legal"])
    assert (dynamics.step["cost"] >= 0).all()
    discount = dynamics.step["discount"][dynamics.step["legal"]]
    assert ((discount > 0) & (discount <= 0.99 + 1e-12)).all()


@pytest.mark.parametrize("options", [{"own_classes": 2}, {"shared": 3}])
def test_latent_classes_and_their_prior(small, options):
    momdp = small.toy(2, 2, 2, finite=False, **options)
    percepts = compile_momdp(momdp).percepts
    np.testing.assert_allclose(class_prior(momdp), np.exp(initial_belief(momdp).log_prob))
    np.testing.assert_array_equal(percepts.classes, momdp.latent_classes)
    np.testing.assert_allclose(percepts.truth, np.exp(momdp.log_truth))
    assert percepts.class_is_truth == momdp.class_is_truth
    sure = class_prior(replace(momdp, prior=[0.0, 1.0]))
    assert (sure > 0).all()  # plans are made for beliefs that percepts can still move
    np.testing.assert_allclose(sure.sum(axis=1), 1.0)


def test_dynamics_are_compiled_once_for_momdps_that_share_them(small):
    one = compile_momdp(small.momdp("roc36", {"heavy": {"lift_slow": (0.9, 0.1)}}))
    other = compile_momdp(small.momdp("roc36", {"blue": {}, "beans": {}}, 7.0))
    assert one.dynamics is other.dynamics
    for options in ({"objective": Objective(discount=0.9)}, {"objective": Objective(abstain=True)}):
        unlike = compile_momdp(small.momdp("roc36", {"heavy": {}}, **options))
        assert unlike.dynamics is not one.dynamics


def test_shaping_pays_for_percepts_within_the_limit(small):
    momdp = small.momdp("toy", {"red": {}}, limit=[5, 1, np.inf])
    problem = compile_momdp(momdp)
    assert not problem.shaped
    np.testing.assert_array_equal(problem.paid, [5, 1, np.inf])
    np.testing.assert_array_equal(compile_momdp(momdp, 2.0).paid, [2, 1, 2])
    assert compile_momdp(replace(momdp, bonus=np.ones((1, 3, 2)))).shaped


def test_rows_without_information_are_not_planned_with(small):
    problem = compile_momdp(small.momdp("toy", {"red": {"look": (0.6, 0.5)}, "heavy": {}}))
    informative = problem.percepts.informative
    np.testing.assert_array_equal(informative, [[True, False, False], [False] * 3])


def test_information_on_the_latent_class_is_planned_with():
    """Look says nothing of the truth, but whether lift is to be believed."""
    honest, mistaken = [[0.9, 0.1], [0.9, 0.1]], [[0.1, 0.9], [0.1, 0.9]]
    lift = [[0.9, 0.1], [0.1, 0.9], [0.1, 0.9], [0.9, 0.1]]
    look = [honest[0], mistaken[0], honest[1], mistaken[1]]
    rows = np.array([[look, lift, [[0.5, 0.5]] * 4]])
    latent_classes = [[[0.5, 0.5, 0.0, 0.0], [0.0, 0.0, 0.5, 0.5]]]
    momdp = build_momdp(load_domain("toy"), Query(("red",)), rows, latent_classes=latent_classes)
    assert np.ptp(momdp.rows[0, :2], axis=1).max() == pytest.approx(0.0)
    informative = compile_momdp(momdp).percepts.informative
    np.testing.assert_array_equal(informative, [[True, True, False]])
