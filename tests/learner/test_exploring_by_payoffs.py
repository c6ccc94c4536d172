"""What exploring is worth follows the payoffs of yes and no, as it follows the reward."""

from dataclasses import replace

import numpy as np
import pytest

from meal_bayes import Learner
from meal_bayes.domain import Payoffs, domain_from_table

LOOKS = {
    "name": "looks",
    "attributes": ["a", "b"],
    "behaviors": [
        {"name": "look", "cost": 2.0, "modalities": ["m"]},
        {"name": "feel", "cost": 8.0, "modalities": ["m"]},
    ],
    "diagram": {
        "states": ["s"],
        "start": "s",
        "effects": [{"from": "s", "do": "look", "to": "s"}, {"from": "s", "do": "feel", "to": "s"}],
    },
}


def paid(question="a", *, payoffs=None, of_domain=None, reward=60.0, unit=1.0, answer="values"):
    """Return the bonus (E,) of the first trial of a robot."""
    domain = domain_from_table(LOOKS)
    behaviors = tuple(replace(b, cost=unit * b.cost) for b in domain.behaviors)
    domain = replace(domain, behaviors=behaviors, payoffs=of_domain)
    learner = Learner(domain, reward=unit * reward, payoffs=payoffs, logs=None)
    with learner.begin(question, "cup", answer=answer) as session:
        return session.trial.momdp.bonus.sum(axis=0)[:, 0]


@pytest.mark.parametrize("seed", range(4))
def test_the_bonus_is_that_of_the_payoffs(seed):
    rng = np.random.default_rng(seed)
    reward = float(np.exp(rng.uniform(3, 7)))
    alike = (reward, -reward, reward, -reward)
    expected = paid(reward=reward)
    np.testing.assert_allclose(paid(payoffs=alike), expected, rtol=1e-9)
    np.testing.assert_allclose(paid(of_domain=Payoffs(*alike)), expected, rtol=1e-9)
    right_yes, wrong_yes, right_no, wrong_no = rng.uniform(0, reward, 4)
    payoffs = (right_yes, -wrong_yes, right_no, -wrong_no)
    tenfold = tuple(10 * value for value in payoffs)
    np.testing.assert_allclose(
        paid(payoffs=tenfold, unit=10.0), 10 * paid(payoffs=payoffs), rtol=1e-6, atol=1e-9
    )


def test_values_of_several_attributes_are_paid_by_the_reward():
    payoffs = (6.0, -6.0, 6.0, -6.0)
    by_reward = paid("a, b")
    np.testing.assert_array_equal(paid("a, b", payoffs=payoffs), by_reward)
    np.testing.assert_array_equal(paid("a, b", of_domain=Payoffs(*payoffs)), by_reward)
    assert (paid("a and b", payoffs=payoffs, answer="yes or no") < 0.1 * by_reward).all()


def test_who_may_say_i_do_not_know_is_not_paid_for_answers_that_he_would_not_give():
    """An answer of which only the loss is large is left out, so learning gains no more."""
    assert (paid(payoffs=(60, -6e4, 60, -6e4)) <= paid(payoffs=(60, -600, 60, -600)) * 2).all()
