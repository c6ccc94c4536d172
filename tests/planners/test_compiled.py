import numpy as np
import pytest

from meal_bayes.domain import Behavior, Domain, Effect, Query, TransitionDiagram, load_domain
from meal_bayes.momdp import Objective, build_momdp
from meal_bayes.planners.compiled import compile_momdp, dynamics_of

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


def test_each_outcome_is_a_branch(small):
    momdp = small.momdp(FORK, {"heavy": {}})
    dynamics = dynamics_of(momdp)
    assert branches(dynamics, 0, 0) == {(0.625, 1, True), (0.375, 2, False)}
    assert dynamics.step["cost"][0, 0] == pytest.approx(2 / (1 - 0.99 * 0.2))
    assert dynamics.step["discount"][0, 0] == pytest.approx(0.99 * 0.8 / (1 - 0.99 * 0.2))
    p = round(0.4 / 0.9, 12)
    assert branches(dynamics, 1, 0) == {(p, 0, True), (round(1 - p, 12), 1, True)}
    assert dynamics.step["cost"][1, 0] == pytest.approx(2 / (1 - 0.99 * 0.1))


@pytest.mark.parametrize("name", ["toy", "roc36", "roc36_published", "ispy32", "cy101"])
def test_outcomes_are_distributions(small, name):
    domain = load_domain(name)
    dynamics = dynamics_of(small.momdp(domain, {domain.attributes[0]: {}}))
    np.testing.assert_array_equal(dynamics.step["legal"], domain.transitions().legal)
    np.testing.assert_allclose(dynamics.branch["p"].sum(axis=2), dynamics.step["legal"])
    assert (dynamics.step["cost"] >= 0).all()
    discount = dynamics.step["discount"][dynamics.step["legal"]]
    assert ((discount > 0) & (discount <= 0.99 + 1e-12)).all()


def test_dynamics_are_compiled_once_for_momdps_that_share_them(small):
    one = compile_momdp(small.momdp("roc36", {"heavy": {"lift_slow": (0.9, 0.1)}}))
    other = compile_momdp(small.momdp("roc36", {"blue": {}, "beans": {}}, 7.0))
    assert one.dynamics is other.dynamics
    for options in ({"objective": Objective(discount=0.9)}, {"objective": Objective(abstain=True)}):
        unlike = compile_momdp(small.momdp("roc36", {"heavy": {}}, **options))
        assert unlike.dynamics is not one.dynamics


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
