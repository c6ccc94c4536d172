"""Rules that two rooms share: what a percept counts, which levels say yes, what a table stores."""

from types import SimpleNamespace

import numpy as np
import pytest

from meal_bayes.arrays import _array_fields, lowest_yes, no_and_yes_of, yes_of
from meal_bayes.datasets.percepts import BIN_COUNT, STORED, PerceptTable, detected_levels
from meal_bayes.domain import load_domain
from meal_bayes.momdp import observation
from meal_bayes.planners.plans import bayes_error
from meal_bayes.posterior import ConfusionPosterior, grid


def test_percepts_of_a_new_object_count_as_those_of_learned_ones() -> None:
    rng = np.random.default_rng(5)
    counts = rng.integers(0, 6, (3, 2, 2, 4))
    dispersion = rng.uniform(0.1, 50.0, (3, 2, 2))
    posterior = ConfusionPosterior(np.zeros(counts.shape), np.ones(counts.shape), dispersion)
    after = posterior.update(counts).concentration - 1.0
    n = counts.sum(axis=-1, keepdims=True)
    learned = grid.worth_of_percept(n.astype(float), dispersion[..., None]) * counts
    np.testing.assert_allclose(after, learned, rtol=1e-12)


def test_a_table_in_memory_holds_what_its_file_does() -> None:
    fields = {name: np.dtype(kind) for name, kind in _array_fields(PerceptTable)}
    assert fields["log_odds"] == STORED
    assert fields["training_bins"] == BIN_COUNT


@pytest.mark.parametrize("levels", [2, 4, 8])
def test_all_take_the_same_levels_for_yes(levels, monkeypatch) -> None:
    rng = np.random.default_rng(levels)
    rows = rng.dirichlet(np.ones(levels))
    # The kernel of plans, in Python: Pr(one percept says yes).
    monkeypatch.setattr(bayes_error, "predictive", observation.predictive)
    monkeypatch.setattr(bayes_error, "_lowest_yes", lowest_yes)
    percepts = SimpleNamespace(rows=rows[None, None, None], precision=np.full((1, 1, 1), np.inf))
    evidence = bayes_error.Evidence(np.zeros((1, 1, levels)), np.zeros(1))
    scratch = SimpleNamespace(evidence=evidence, bins=np.zeros((1, 2)))
    bayes_error._count_yes.py_func(percepts, (0, 0, 0), 1, scratch)
    np.testing.assert_allclose(scratch.bins[0], no_and_yes_of(rows))
    # What a detector says in words.
    toy = load_domain("toy")
    for sure in (-1.0, -0.5, 0.5, 1.0):
        level = detected_levels({toy.attributes[0]: sure}, toy, levels)[0]
        assert yes_of(np.eye(levels)[level]) == (sure > 0)
