"""How far labels are trusted: exact sums, and what contradictions change."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import integrate

from meal_bayes.domain import Query
from meal_bayes.learner import Learner
from meal_bayes.learner.trust import learn_trust, prob_true, told_prior

NUMBERS = st.lists(st.tuples(st.integers(0, 3), st.integers(0, 3)), min_size=1, max_size=4)


@settings(max_examples=25)
@given(numbers=NUMBERS)
def test_the_grid_agrees_with_the_integral(numbers):
    """Of the first object's truth, over t in [.5, 1] and the truths of all objects."""
    yes, no = np.array(numbers).T[:, :, None]

    def density(t):
        product = t**98
        for n1, n0 in numbers:
            product *= t**n1 * (1 - t) ** n0 + t**n0 * (1 - t) ** n1
        return product

    n1, n0 = numbers[0]
    options = {"epsabs": 0.0, "epsrel": 1e-10, "limit": 200}
    norm, _ = integrate.quad(density, 0.5, 1, **options)
    true, _ = integrate.quad(
        lambda t: density(t) / (1 + ((1 - t) / t) ** (n1 - n0)), 0.5, 1, **options
    )
    chance = prob_true(learn_trust(yes, no), yes[0] - no[0])[0]
    assert np.isnan(chance) if n1 == n0 else chance == pytest.approx(true / norm, abs=1e-6)


def test_a_single_label_is_believed_until_others_contradict_each_other(make):
    learner = Learner(make.kitchen, agent="bayes_memory", logs=None)
    query = Query(("red", "full"))

    def believed(name):
        return told_prior(learner.experience, query, name)

    assert believed("mug") is None
    learner.tell("mug", {"red": True})
    assert believed("mug")[0] == pytest.approx(0.99, abs=1e-6)
    assert np.isnan(believed("mug")[1])
    for n in range(6):  # a person, and the one who is asked in a trial, say opposite things
        learner.tell(f"cup {n}", {"red": True, "full": False})
        trial = learner.ask("red", make.arm(seed=n), object_name=f"cup {n}")
        learner.tell(trial, {"red": False, "full": False})
    assert believed("mug")[0] < 0.96
    assert believed("cup 0")[1] < 0.001  # twice not full
    learner.tell("mug", {"full": True})
    assert believed("mug")[1] > 0.99  # nobody contradicts what is said of "full"
