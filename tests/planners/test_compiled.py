from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import betabinom, binom

from meal_bayes.domain import Behavior, Domain, Effect, Query, TransitionDiagram, load_domain
from meal_bayes.momdp import build_momdp, initial_belief
from meal_bayes.planners.compiled import compile_momdp

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


def branches(problem, x, e):
    """Set of (probability, next x, with a percept?)."""
    return {
        (round(float(problem.branch_p[x, e, k]), 12), int(problem.branch_x[x, e, k]),
         bool(problem.branch_sense[x, e, k]))
        for k in range(problem.branches[x, e])
    }  # fmt: skip


def test_folding_of_a_failing_move(small):
    # c = 4.5 s, p = .95: c' = c / (1 - g (1 - p)), g' = g p / (1 - g (1 - p)).
    momdp = small.momdp("roc36", {"heavy": {}})
    problem, grasp = compile_momdp(momdp), behavior(momdp, "grasp")
    assert problem.cost[1, grasp] == pytest.approx(4.7344, abs=5e-5)
    assert problem.discount[1, grasp] == pytest.approx(0.9895, abs=5e-5)
    assert problem.bonus_scale[1, grasp] == pytest.approx(4.7344 / 4.5, abs=2e-5)
    assert branches(problem, 1, grasp) == {(1.0, 2, True)}


def test_folding_of_a_failing_loop(small):
    momdp = small.momdp("ispy32", {"heavy": {}})
    problem, press = compile_momdp(momdp), behavior(momdp, "press")
    assert problem.cost[1, press] == pytest.approx(22 / (1 - 0.99 * 0.05))
    assert problem.discount[1, press] == pytest.approx(0.99 * 0.95 / (1 - 0.99 * 0.05))
    assert branches(problem, 1, press) == {(1.0, 1, True)}


def test_what_never_fails_is_not_folded(small):
    momdp = small.momdp("roc36", {"heavy": {}})
    problem, look = compile_momdp(momdp), behavior(momdp, "look")
    assert (problem.cost[0, look], problem.discount[0, look]) == (0.5, 0.99)


def test_moves_without_percept(small):
    momdp = small.momdp("roc36", {"heavy": {}})
    problem, reinit = compile_momdp(momdp), behavior(momdp, "reinit")
    assert branches(problem, 5, reinit) == {(1.0, 0, False)}
    assert problem.cost[5, reinit] == pytest.approx(10 / (1 - 0.99 * 0.05))


def test_without_discount_a_failure_costs_a_repetition(small):
    momdp = small.momdp("roc36", {"heavy": {}}, discount=1.0)
    problem, grasp = compile_momdp(momdp), behavior(momdp, "grasp")
    assert problem.cost[1, grasp] == pytest.approx(4.5 / 0.95)
    np.testing.assert_allclose(problem.discount[problem.legal], 1.0)


def test_published_shakes_are_repeated_until_the_object_falls(small):
    momdp = small.momdp("roc36_published", {"heavy": {}}, abstain=True)
    problem, shake = compile_momdp(momdp), behavior(momdp, "shake")
    assert branches(problem, 4, shake) == {(1.0, 5, True)}
    assert problem.cost[4, shake] == pytest.approx(3.8 / (1 - 0.99 * 0.95))
    assert problem.discount[4, shake] == pytest.approx(0.99 * 0.05 / (1 - 0.99 * 0.95))
    crush, hold, tap = (behavior(momdp, name) for name in ("crush", "hold", "tap"))
    for x in range(6):
        assert branches(problem, x, crush) == {(1.0, x, True)}
    assert problem.cost[3, hold] == pytest.approx(1.0 / (1 - 0.99 * 0.01))
    assert problem.cost[1, tap] == pytest.approx(4.2 / (1 - 0.99 * 0.10))


def test_where_illegal_changes_nothing_there_is_no_exit(small):
    momdp = small.momdp("roc36_published", {"heavy": {}}, abstain=True)
    assert np.isneginf(compile_momdp(momdp).exit_value[:6]).all()


def test_the_exit_is_the_cheapest_illegal_behavior(small):
    rates = {"heavy": {}}
    problem = compile_momdp(small.momdp("roc36", rates, abstain=True))
    np.testing.assert_array_equal(problem.exit_value[:6], [-1.0, -0.5, -0.5, -0.5, -0.5, -0.5])
    assert np.isneginf(compile_momdp(small.momdp("roc36", rates)).exit_value).all()


def test_where_everything_is_legal_there_is_no_exit(small):
    everywhere = TransitionDiagram(("x0", "term"), "x0", (Effect("*", "look", "*"),))
    domain = Domain("one", ("red",), (Behavior("look", 1.0, ("color",)),), everywhere)
    assert compile_momdp(small.momdp(domain, {"red": {}}, abstain=True)).exit_value[0] == -np.inf


def test_several_outcomes(small):
    momdp = small.momdp(FORK, {"heavy": {}})
    problem = compile_momdp(momdp)
    assert branches(problem, 0, 0) == {(0.625, 1, True), (0.375, 2, False)}
    assert problem.cost[0, 0] == pytest.approx(2 / (1 - 0.99 * 0.2))
    assert problem.discount[0, 0] == pytest.approx(0.99 * 0.8 / (1 - 0.99 * 0.2))
    p = round(0.4 / 0.9, 12)
    assert branches(problem, 1, 0) == {(p, 0, True), (round(1 - p, 12), 1, True)}
    assert problem.cost[1, 0] == pytest.approx(2 / (1 - 0.99 * 0.1))


def test_what_does_nothing_is_no_choice(small):
    momdp = small.momdp(FORK, {"heavy": {}})
    assert momdp.legal[:3, 1].all()
    problem = compile_momdp(momdp)
    assert not problem.legal[:, 1].any()
    assert problem.legal[2, 2]


@pytest.mark.parametrize("name", ["toy", "roc36", "roc36_published", "ispy32", "cy101"])
def test_outcomes_are_distributions(small, name):
    domain = load_domain(name)
    problem = compile_momdp(small.momdp(domain, {domain.attributes[0]: {}}))
    np.testing.assert_array_equal(problem.legal, domain.transitions().legal)
    np.testing.assert_allclose(problem.branch_p.sum(axis=2), problem.legal)
    assert (problem.cost >= 0).all()
    assert ((problem.discount > 0) & (problem.discount <= 0.99 + 1e-12))[problem.legal].all()


@pytest.mark.parametrize("precision", [3.7, np.inf])
def test_first_counts_are_beta_binomial(small, precision):
    rates = [0.3, 0.9, 0.8, 0.55]  # of the kinds
    rows = np.tile([[1 - p, p] for p in rates], (1, 3, 1, 1))
    momdp = build_momdp(
        load_domain("toy"), Query(("red",)), rows, precision, kinds=np.full((1, 2, 4), 0.25)
    )
    fresh = compile_momdp(momdp).fresh[0, 0]
    for c, yes in enumerate(rates):
        for k in range(fresh.shape[1]):
            urn = betabinom(k, precision * yes, precision * (1 - yes))
            exact = binom(k, yes) if np.isinf(precision) else urn
            np.testing.assert_allclose(fresh[c, k, : k + 1], exact.pmf(range(k + 1)), atol=1e-10)
            assert not fresh[c, k, k + 1 :].any()


@pytest.mark.parametrize("options", [{"kinds": 3}, {"shared": 3}])
def test_affinity_is_that_of_the_truths(small, options):
    """Of several kinds it is the mixtures that overlap."""
    momdp = small.toy(1, 2, 2, finite=True, **options)
    problem = compile_momdp(momdp)
    for i, e, k in np.ndindex(2, 3, problem.affinity.shape[2]):
        yes, s = momdp.confusion[i, e, :, 1], momdp.precision[i, e]
        counts = [
            betabinom(k, w * p, w * (1 - p)).pmf(range(k + 1)) for p, w in zip(yes, s, strict=True)
        ]
        false, true = momdp.kinds[i] @ counts
        expected = np.sqrt(false * true).sum()
        assert np.exp(problem.affinity[i, e, k]) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("options", [{"kinds": 2}, {"shared": 3}])
def test_kinds_and_their_prior(small, options):
    momdp = small.toy(2, 2, 2, finite=False, **options)
    problem = compile_momdp(momdp)
    np.testing.assert_allclose(problem.prior, np.exp(initial_belief(momdp).weight))
    np.testing.assert_array_equal(problem.kinds, momdp.kinds)
    sure = compile_momdp(replace(momdp, prior=[0.0, 1.0]))
    assert (sure.prior > 0).all()  # plans are made for beliefs that percepts can still move


@pytest.mark.parametrize(
    ("precision", "limit", "plain", "exact"),
    [(np.inf, np.inf, True, True), (np.inf, 3, False, True), (5.0, np.inf, False, False)],
)
def test_what_is_known_of_rows(small, precision, limit, plain, exact):
    problem = compile_momdp(small.momdp("ispy32", {"heavy": {}}, precision, limit=limit))
    assert problem.plain == plain
    ask = load_domain("ispy32").behavior_index("ask")
    np.testing.assert_array_equal(
        problem.exact, [exact or e == ask for e in range(len(problem.exact))]
    )


def test_rows_that_say_nothing_are_known(small):
    problem = compile_momdp(small.momdp("toy", {"red": {"look": (0.6, 0.5)}, "heavy": {}}))
    np.testing.assert_array_equal(problem.informative, [[True, False, False], [False] * 3])


def test_what_tells_of_the_kind_is_planned_with():
    """Look says nothing of the truth, but whether lift is to be believed."""
    honest, mistaken = [[0.9, 0.1], [0.9, 0.1]], [[0.1, 0.9], [0.1, 0.9]]
    lift = [[0.9, 0.1], [0.1, 0.9], [0.1, 0.9], [0.9, 0.1]]
    look = [honest[0], mistaken[0], honest[1], mistaken[1]]
    rows = np.array([[look, lift, [[0.5, 0.5]] * 4]])
    kinds = [[[0.5, 0.5, 0.0, 0.0], [0.0, 0.0, 0.5, 0.5]]]
    momdp = build_momdp(load_domain("toy"), Query(("red",)), rows, kinds=kinds)
    assert np.ptp(momdp.rows[0, :2], axis=1).max() == pytest.approx(0.0)
    np.testing.assert_array_equal(compile_momdp(momdp).informative, [[True, True, False]])
