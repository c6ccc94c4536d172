import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.stats import entropy

from meal_bayes.domain import Query, load_domain
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import (
    ITRS,
    build_momdp,
    flatten,
    observation_entropy,
    percept_probabilities,
    shape_reward,
)

ISPY32 = load_domain("ispy32")
E = len(ISPY32.behaviors)
QUERY = Query(("heavy", "yellow"))
WEIGHTS = ITRS(alpha=6, beta=30, delta=100)

tables = hnp.arrays(float, (2, E, 2, 2), elements=st.floats(0.01, 1.0)).map(
    lambda a: a / a.sum(axis=-1, keepdims=True)
)


@given(tables, hnp.arrays(float, (2, E), elements=st.floats(0.0, 1.0)))
def test_shaped_reward_is_equation_11(confusion, experience):
    momdp = build_momdp(ISPY32, QUERY, confusion)
    shaped = flatten(shape_reward(momdp, experience, WEIGHTS, domain=ISPY32))
    plain = flatten(momdp)
    difference = (shaped.reward - plain.reward)[:-1].reshape(momdp.terminal, 4, -1)  # (X-1,Y,A)
    for e, behavior in enumerate(ISPY32.behaviors):
        bits = entropy(percept_probabilities(momdp, e), base=2, axis=1)  # (Y,)
        bonus = 6 * bits - 30 * experience[:, e].mean()
        for x in range(momdp.terminal):
            explores = bool(behavior.modalities) and momdp.legal[x, e]
            np.testing.assert_allclose(difference[x, :, e], bonus * explores, atol=1e-9)
    assert not difference[:, :, E:].any()


def test_ask_and_reinit_are_not_shaped():
    confusion = np.full((2, E, 2, 2), 0.5)
    shaped = shape_reward(
        build_momdp(ISPY32, QUERY, confusion), np.ones((2, E)), WEIGHTS, domain=ISPY32
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
    found = observation_entropy(build_momdp(ISPY32, QUERY, rows, latent_classes=latent_classes))
    np.testing.assert_allclose(found, expected)


def test_wrong_settings_are_refused():
    momdp = build_momdp(ISPY32, QUERY, np.full((2, E, 2, 2), 0.5))
    with pytest.raises(SettingsError, match="alpha >= 0"):
        ITRS(-1, 0, 1)
    with pytest.raises(SettingsError, match="delta > 0"):
        ITRS(1, 0, 0)
    with pytest.raises(SettingsError, match=rf"expected numbers >= 0 of shape \(2, {E}\)"):
        shape_reward(momdp, np.zeros(E), WEIGHTS, domain=ISPY32)
    with pytest.raises(SettingsError, match="not built from the domain 'roc36'"):
        shape_reward(momdp, np.zeros((2, E)), WEIGHTS, domain=load_domain("roc36"))
