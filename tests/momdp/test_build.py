"""A MOMDP is made of what is learned, shaped by what is new, and refused where it is none."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.stats import entropy

from meal_bayes.domain import Query, load_domain
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import (
    Objective,
    add_itrs_bonus,
    build_momdp,
    flatten,
    observation_entropy,
    percept_probabilities,
)


def uninformed(name, n, levels=2, **options):
    domain = load_domain(name)
    confusion = np.full((n, len(domain.behaviors), 2, levels), 1 / levels)
    return build_momdp(domain, Query(domain.attributes[:n]), confusion, **options)


def test_rewards_are_the_domains_unless_told():
    assert (uninformed("cy101", 1).correct, uninformed("cy101", 1).incorrect) == (300.0, -300.0)
    momdp = uninformed("cy101", 1, objective=Objective(correct=10, incorrect=-20))
    assert (momdp.correct, momdp.incorrect) == (10, -20)


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("levels", [2, 4])
def test_ask_answers_each_attribute_right_with_the_stated_accuracy(n, levels):
    momdp = uninformed("ispy32", n, levels, precision=3.0, limit=5)
    ask = momdp.behavior_names.index("ask")
    rows = momdp.confusion[:, ask]  # (N,2,K)
    np.testing.assert_allclose(rows[:, 0, 0], 0.7)
    np.testing.assert_allclose(rows[:, 1, -1], 0.7)
    np.testing.assert_allclose(rows.sum(axis=-1), 1.0)
    assert np.isinf(momdp.precision[:, ask]).all()
    assert np.isinf(momdp.limit[ask])
    look = momdp.behavior_names.index("look")
    assert (momdp.precision[:, look] == 3.0).all()
    assert momdp.limit[look] == 5


def test_latent_classes_are_split_where_someone_answers():
    """An answer tells of the truth, other percepts of the latent class alone."""
    domain = load_domain("ispy32")
    rng = np.random.default_rng(0)
    rows = rng.dirichlet(np.ones(2), (2, len(domain.behaviors), 3))
    latent_classes = rng.dirichlet(np.ones(3), (2, 2))
    query = Query(domain.attributes[:2])
    momdp = build_momdp(domain, query, rows, 4.0, latent_classes=latent_classes)
    assert momdp.n_classes == 6
    assert momdp.precision.shape == (*rows.shape[:2], 6)
    np.testing.assert_array_equal(
        momdp.latent_classes[:, 0], np.hstack([latent_classes[:, 0], np.zeros((2, 3))])
    )
    np.testing.assert_array_equal(
        momdp.latent_classes[:, 1], np.hstack([np.zeros((2, 3)), latent_classes[:, 1]])
    )
    look, ask = (momdp.behavior_names.index(name) for name in ("look", "ask"))
    np.testing.assert_array_equal(momdp.confusion[:, look], np.tile(rows[:, look], (1, 2, 1)))
    answers = [[0.7, 0.3]] * 3 + [[0.3, 0.7]] * 3  # whatever its class
    np.testing.assert_allclose(momdp.confusion[:, ask], [answers] * 2)
    assert np.isinf(momdp.precision[:, ask]).all()
    for i, v in np.ndindex(2, 2):
        mean = sum(latent_classes[i, v, j] * rows[i, look, j] for j in range(3))
        np.testing.assert_allclose(momdp.rows[i, look, v], mean)
    np.testing.assert_array_equal(uninformed("ispy32", 2).latent_classes, [np.eye(2)] * 2)
    again = build_momdp(
        domain, query, momdp.confusion, momdp.precision, latent_classes=momdp.latent_classes
    )
    np.testing.assert_array_equal(again.confusion, momdp.confusion)  # split already


def test_a_kind_that_the_prior_rules_out_keeps_its_truth():
    momdp = uninformed("toy", 2, prior=[0.0, 1.0])
    assert momdp.class_is_truth
    np.testing.assert_array_equal(np.exp(momdp.log_truth), [np.eye(2)] * 2)


@pytest.mark.parametrize(
    ("latent_classes", "says"),
    [
        (np.full((2, 2, 4), 0.4), "Rows of MOMDP.latent_classes must be >= 0 and sum to 1"),
        (np.full((1, 2, 4), 0.25), r"latent_classes has shape \(1, 2, 4\); expected \(2,2,C\)"),
        (
            np.tile(np.eye(2), (2, 1, 1)),
            r"\(2, 3, 4, 2\); expected \(2 queried, 3 behaviors, 2 latent classes",
        ),
    ],
)
def test_wrong_latent_classes_are_refused(latent_classes, says):
    with pytest.raises(SettingsError, match=says):
        build_momdp(
            load_domain("toy"),
            Query(("red", "heavy")),
            np.full((2, 3, 4, 2), 0.5),
            latent_classes=latent_classes,
        )


def test_arrays_cannot_be_written_to():
    momdp = uninformed("toy", 1)
    with pytest.raises(ValueError, match="read-only"):
        momdp.confusion[0] = 0.5


@pytest.mark.parametrize(
    ("confusion", "says"),
    [
        (np.full((2, 3, 2, 2), 0.4), "confusion must be >= 0 and sum to 1"),
        (np.full((2, 3, 2, 2), np.nan), "confusion must be >= 0"),
        (np.full((1, 3, 2, 2), 0.5), r"confusion has shape \(1, 3, 2, 2\); expected \(2 queried"),
    ],
)
def test_confusion_that_is_none_is_refused(confusion, says):
    with pytest.raises(SettingsError, match=says):
        build_momdp(load_domain("toy"), Query(("red", "heavy")), confusion)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("prior", 1.5), ("prior", np.nan), ("observation_probability", 1.5), ("precision", 0.0),
        ("limit", -1.0), ("limit", np.nan), ("cost", np.inf), ("cost", -1.0), ("bonus", np.inf),
        ("correct", np.inf), ("incorrect", np.nan), ("discount", 0.0),
    ],
)  # fmt: skip
def test_numbers_out_of_range_are_refused(name, value):
    momdp = uninformed("toy", 2)
    with pytest.raises(SettingsError, match=rf"MOMDP\.{name} must"):
        replace(momdp, **{name: np.full_like(getattr(momdp, name), value)})


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"objective": Objective(correct=-9, incorrect=9)}, "correct >= incorrect"),
        ({"levels": 3}, "an even number"),
    ],
)
def test_settings_that_do_not_fit_are_refused(options, says):
    with pytest.raises(SettingsError, match=says):
        uninformed("toy", 2, **options)


ISPY32 = load_domain("ispy32")
E = len(ISPY32.behaviors)
QUERY = Query(("heavy", "yellow"))
WEIGHTS = 6, 30  # alpha, beta

tables = hnp.arrays(float, (2, E, 2, 2), elements=st.floats(0.01, 1.0)).map(
    lambda a: a / a.sum(axis=-1, keepdims=True)
)


@given(tables, hnp.arrays(float, (2, E), elements=st.floats(0.0, 1.0)))
def test_shaped_reward_is_equation_11_for_a_percept(confusion, experience):
    """Of an execution it is expected: Pr(a percept comes) times it."""
    momdp = build_momdp(ISPY32, QUERY, confusion)
    shaped = flatten(add_itrs_bonus(momdp, experience, *WEIGHTS, domain=ISPY32))
    plain = flatten(momdp)
    comes = (momdp.transition * momdp.observation_probability).sum(axis=2)  # (E,X)
    difference = (shaped.reward - plain.reward)[:-1].reshape(momdp.terminal, 4, -1)  # (X-1,Y,A)
    for e, behavior in enumerate(ISPY32.behaviors):
        bits = entropy(percept_probabilities(momdp, e), base=2, axis=1)  # (Y,)
        bonus = 6 * bits - 30 * experience[:, e].mean()
        for x in range(momdp.terminal):
            explores = bool(behavior.modalities) and momdp.legal[x, e]
            paid = comes[e, x] * bonus * explores
            np.testing.assert_allclose(difference[x, :, e], paid, atol=1e-9)
    assert not difference[:, :, E:].any()


def test_ask_and_reinit_are_not_shaped():
    confusion = np.full((2, E, 2, 2), 0.5)
    shaped = add_itrs_bonus(
        build_momdp(ISPY32, QUERY, confusion), np.ones((2, E)), *WEIGHTS, domain=ISPY32
    )
    for name in ("ask", "reinit"):
        assert not shaped.bonus[:, ISPY32.behavior_index(name)].any()
    np.testing.assert_allclose(shaped.bonus[:, ISPY32.behavior_index("look")].sum(axis=0), 12 - 30)


def test_levels_are_summed_to_yes_and_no():
    four = np.tile([[0.4, 0.2, 0.3, 0.1], [0.1, 0.1, 0.3, 0.5]], (2, E, 1, 1))
    two = np.tile([[0.6, 0.4], [0.2, 0.8]], (2, E, 1, 1))
    expected = observation_entropy(build_momdp(ISPY32, QUERY, two))
    np.testing.assert_allclose(observation_entropy(build_momdp(ISPY32, QUERY, four)), expected)


def test_latent_classes_are_mixed():
    latent_classes = [[[0.9, 0.1, 0.0, 0.0], [0.0, 0.0, 0.5, 0.5]]] * 2
    rows = np.tile([[0.8, 0.2], [0.3, 0.7], [0.1, 0.9], [0.6, 0.4]], (2, E, 1, 1))
    mean = np.tile([[0.75, 0.25], [0.35, 0.65]], (2, E, 1, 1))
    expected = observation_entropy(build_momdp(ISPY32, QUERY, mean))
    entropy = observation_entropy(build_momdp(ISPY32, QUERY, rows, latent_classes=latent_classes))
    np.testing.assert_allclose(entropy, expected)
