from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.domain import Query, load_domain
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import (
    Transition,
    build_momdp,
    flatten,
    initial_belief,
    percept_probabilities,
    update_belief,
    write_pomdp,
)


@pytest.mark.parametrize(
    ("name", "n", "levels", "states", "observations"),
    [
        ("ispy32", 2, 2, 25, 5), ("ispy32", 3, 2, 49, 9), ("roc36", 2, 4, 25, 17),
        ("roc36_published", 3, 2, 49, 9), ("cy101", 1, 2, 11, 3), ("cy101", 2, 2, 21, 5),
    ],
)  # fmt: skip
def test_sizes_and_distributions(momdp_of, name, n, levels, states, observations):
    momdp = momdp_of(name, n, levels)
    flat = flatten(momdp)
    assert len(flat.state_names) == len(set(flat.state_names)) == states == momdp.n_states
    assert len(flat.observation_names) == observations
    assert len(flat.action_names) == momdp.n_actions
    for rows in (flat.transition, flat.observation):
        assert (rows >= 0).all()
        np.testing.assert_allclose(rows.sum(axis=-1), 1.0)
    assert flat.start.sum() == pytest.approx(1.0)
    assert (flat.start > 0).sum() == 2**n


@pytest.mark.parametrize("name", ["toy", "ispy32", "roc36_published"])
@pytest.mark.parametrize("levels", [2, 4])
def test_the_dense_filter_is_the_factored_filter(momdp_of, name, levels):
    momdp = momdp_of(name, 2, levels)
    flat, rng = flatten(momdp), np.random.default_rng(1)
    for _ in range(30):
        belief, dense, truth = initial_belief(momdp), flat.start, rng.integers(4)
        while belief.x != momdp.terminal and belief.percept_counts.sum() < 10:
            action = int(rng.choice(np.flatnonzero(momdp.legal[belief.x])))
            next_x = int(rng.choice(momdp.terminal + 1, p=momdp.transition[action, belief.x]))
            comes = rng.random() < momdp.observation_probability[action, belief.x, next_x]
            z = rng.choice(levels**2, p=percept_probabilities(momdp, action)[truth])
            percept = np.array(divmod(z, levels), dtype=np.int8) if comes else None
            z = z if comes else -1
            belief = update_belief(belief, momdp, Transition(action, next_x, percept))
            joint = dense[:, None] * flat.transition[action] * flat.observation[action, :, :, z]
            # x is observed: only states of the next x stay possible.
            at_next = np.zeros(momdp.n_states)
            at_next[next_x * 4 : min(next_x * 4 + 4, momdp.n_states)] = 1.0
            dense = joint.sum(axis=0) * at_next
            dense /= dense.sum()
            if next_x != momdp.terminal:
                np.testing.assert_allclose(dense[next_x * 4 : next_x * 4 + 4], belief.joint)


def test_rewards_are_equation_4(momdp_of):
    momdp = momdp_of("toy", 2)
    flat, e = flatten(momdp), momdp.n_behaviors
    legal = np.repeat(momdp.legal[:-1], 4, axis=0)
    costs = np.where(legal, [-1.0, -5.0, -2.0], [-102.0, -106.0, -103.0])  # below every report
    np.testing.assert_array_equal(flat.reward[:-1, :e], costs)
    for state in range(8):
        expected = np.where(np.arange(4) == state % 4, 100.0, -100.0)
        np.testing.assert_array_equal(flat.reward[state, e:], expected)
    assert not flat.reward[-1].any()
    np.testing.assert_array_equal(flat.transition[e:, :, -1], 1.0)


def test_abstaining_is_the_last_action_and_worth_nothing(momdp_of):
    momdp = replace(momdp_of("toy", 2), abstain=True)
    flat = flatten(momdp)
    assert flat.action_names[-1] == "abstain"
    assert not flat.reward[:, -1].any()
    assert (flat.transition[-1, :, -1] == 1).all()


def test_what_does_not_fit_is_refused(momdp_of, tmp_path):
    with pytest.raises(SettingsError, match="precision=inf"):
        write_pomdp(momdp_of("toy", 1, precision=4.0), tmp_path / "a.pomdp")
    with pytest.raises(SettingsError, match="5 attributes"):
        flatten(momdp_of("ispy32", 5))
    with pytest.raises(SettingsError, match="precision=inf"):
        flatten(momdp_of("toy", 1, precision=4.0))
    latent_classes = np.full((1, 2, 4), 0.25)
    rows = np.full((1, 3, 4, 2), 0.5)
    with pytest.raises(SettingsError, match="latent_classes"):
        flatten(
            build_momdp(load_domain("toy"), Query(("red",)), rows, latent_classes=latent_classes)
        )
