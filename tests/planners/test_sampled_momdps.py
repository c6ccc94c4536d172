"""The search acts on MOMDPs sampled from the posterior: their percepts, values and rows."""

import itertools

import numpy as np
import pytest
from scipy.stats import chisquare

from meal_bayes.momdp import Transition, initial_belief, update_belief
from meal_bayes.momdp.observation import predictive
from meal_bayes.planners.compiled import compile_momdp
from meal_bayes.planners.kernels import entry_kernel
from meal_bayes.planners.pomcp.tree import KEPT, draw_object, draw_percept, make_sampled

DRAWS = 100_000


@entry_kernel
def draw_percepts(percepts, sampled, behaviors, rng, out):
    """Draw what so many sampled MOMDPs show along a sequence of behaviors -> out (D,T,N)."""
    for d in range(out.shape[0]):
        draw_object(percepts, sampled, rng)
        for t in range(behaviors.shape[0]):
            draw_percept(percepts, sampled, behaviors[t], out[d, t], rng)


def sequence_probabilities(momdp, belief, behaviors):
    """Pr(percept levels) of every sequence, from the predictive: (N, K^T)."""
    out = []
    for i, log_prob in enumerate(belief.log_prob):
        for levels in itertools.product(range(momdp.levels), repeat=len(behaviors)):
            counts, prob = belief.percept_counts[i].astype(float), np.exp(log_prob)  # a copy; (C,)
            for e, z in zip(behaviors, levels, strict=True):
                mean, s = momdp.confusion[i, e, :, z], momdp.precision[i, e]
                prob = prob * predictive(mean, s, counts[e, z], counts[e].sum())
                counts[e, z] += 1
            out.append(prob.sum())
    return np.reshape(out, (len(momdp.query), -1))


@pytest.mark.statistical
@pytest.mark.parametrize("precision", [1.0, 5.0, np.inf])
@pytest.mark.parametrize("options", [{}, {"shared": 3}])
@pytest.mark.parametrize("behaviors", [(0, 0, 0), (0, 1, 0)])
def test_sampled_momdps_show_what_the_predictive_says(small, precision, options, behaviors):
    """To depth 3, after two percepts of the trial; attributes independently of each other."""
    rng = np.random.default_rng(8)
    momdp = small.random("toy", 2, 2, rng, precision=precision, **options)
    belief = initial_belief(momdp)
    for e, levels in ((0, [1, 0]), (1, [1, 1])):
        belief = update_belief(belief, momdp, Transition(e, 0, np.array(levels)))
    counts = belief.percept_counts.astype(float)
    sampled = make_sampled(compile_momdp(momdp).percepts, np.exp(belief.log_prob), counts)
    shown = np.zeros((DRAWS, 3, 2), np.int64)
    draw_percepts(compile_momdp(momdp).percepts, sampled, np.array(behaviors), rng, shown)
    cells = np.ravel_multi_index(tuple(shown.transpose(1, 2, 0).reshape(6, -1)), (2,) * 6)
    one, other = sequence_probabilities(momdp, belief, behaviors)
    joint = np.einsum("abc,def->adbecf", one.reshape(2, 2, 2), other.reshape(2, 2, 2)).ravel()
    assert joint.sum() == pytest.approx(1.0)
    test = chisquare(np.bincount(cells, minlength=64), DRAWS * joint)
    assert test.pvalue > 0.01


def root_values(small, momdp, simulations, **settings):
    """Value of the best action by each backup."""
    decisions = [
        small.search(momdp, simulations, always=True, backup=backup, **settings)
        for backup in ("expected", "sampled")
    ]
    assert [decision.simulations for decision in decisions] == [simulations] * 2
    return [small.best_value(decision) for decision in decisions]


@pytest.mark.statistical
def test_both_backups_reach_one_value_at_finite_precision(small):
    momdp = small.momdp("toy", small.rates, 3.0, limit=2)
    optimum = small.expectimax(momdp)
    best = optimum.value(momdp.start, optimum.nothing_seen())
    for value in root_values(small, momdp, 100_000):
        assert value == pytest.approx(best, abs=0.01 * momdp.correct)


@pytest.mark.parametrize("precision", [5.0, np.inf])
@pytest.mark.parametrize("backup", ["expected", "sampled"])
def test_a_decision_keeps_rows_of_sampled_momdps(small, precision, backup):
    momdp = small.momdp("toy", small.rates, precision, limit=3)
    decision = small.search(momdp, 100, backup=backup)
    assert decision.action < momdp.n_behaviors
    rows = decision.sampled_rows
    assert rows.shape == (KEPT, 2, momdp.levels)
    np.testing.assert_allclose(rows.sum(axis=2), 1.0)
    for i in range(2):
        classes = momdp.confusion[i, decision.action]
        found = {tuple(row) for row in rows[:, i]}
        if np.isinf(precision):
            assert found <= set(map(tuple, classes))
        else:
            assert len(found) == KEPT  # each MOMDP has an object of its own
            assert not found & set(map(tuple, classes))
