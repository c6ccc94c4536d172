"""What exploring is worth: it follows the payoffs, and which attributes people ask about."""

from dataclasses import replace

import numpy as np
import pytest

from meal_bayes import Learner, Outcome
from meal_bayes.agents.exploration import expected_shares
from meal_bayes.domain import Payoffs, domain_from_table


def domain_of(attributes, **costs):
    """Return a domain with behaviors that perceive and change no state."""
    return domain_from_table(
        {
            "name": "still",
            "attributes": attributes,
            "behaviors": [
                {"name": name, "cost": cost, "modalities": ["m"]} for name, cost in costs.items()
            ],
            "diagram": {
                "states": ["s"],
                "start": "s",
                "effects": [{"from": "s", "do": name, "to": "s"} for name in costs],
            },
        }
    )


def paid(question="a", *, payoffs=None, of_domain=None, reward=60.0, unit=1.0, answer="values"):
    """Return the bonus (E,) of the first trial of a robot."""
    domain = domain_of(["a", "b"], look=2.0, feel=8.0)
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


class Senses:
    """A robot whose camera tells whether an object is `a0`."""

    def __init__(self, truth, rng):
        self.truth = truth
        self.rng = rng
        self.looks = 0

    def start(self):
        return "s"

    def execute(self, behavior):
        self.looks += 1
        return Outcome("s", {"m": np.array([2.5 * self.truth, 0.0]) + self.rng.normal(size=2)})


def many(attributes):
    domain = domain_of([f"a{number}" for number in range(attributes)], look=2.0)
    return Learner(domain, reward=100.0, logs=None)


def looks(attributes, trials, seed, *, told):
    """Return in how many of the last five trials a robot looked that is asked about one of them."""
    learner = many(attributes)
    rng = np.random.default_rng(seed)
    numbers = []
    for _ in range(trials):
        truth = rng.random(attributes) < 0.4
        robot = Senses(bool(truth[0]), rng)
        trial = learner.ask("a0", robot)
        learner.tell(trial, {f"a{number}": bool(truth[number]) for number in range(told)})
        numbers.append(robot.looks)
    return np.count_nonzero(numbers[-5:])


@pytest.mark.parametrize(("attributes", "told"), [(1, 1), (20, 1), (20, 20), (60, 1)])
def test_a_robot_that_is_asked_about_one_attribute_learns_it(attributes, told):
    assert looks(attributes, 25, seed=0, told=told) >= 3


def test_what_was_asked_counts_after_a_restart_and_in_part(tmp_path):
    """The bonus of a question does not depend on whether the robot was saved before."""
    learner = many(12)
    for _ in range(4):
        learner.tell(learner.ask("a0, a3", Senses(False, np.random.default_rng(0))), {"a0": False})
    learner.save(tmp_path / "robot.learner")
    again = Learner.load(tmp_path / "robot.learner", logs=None)
    paid = {}
    for question in ("a0", "a3", "a5"):
        bonuses = []
        for robot in (learner, again):
            with robot.begin(question, "cup", state="s", learn=True) as session:
                bonuses.append(session.trial.momdp.bonus.sum())
        np.testing.assert_array_equal(*bonuses)
        paid[question] = bonuses[0]
    assert paid["a3"] > 1.5 * paid["a5"]


@pytest.mark.parametrize("seed", range(8))
def test_shares_follow_what_is_asked(seed):
    """They add up to one, keep the order of the numbers, and approach the relative frequencies."""
    rng = np.random.default_rng(seed)
    p = int(rng.integers(2, 61))
    true = rng.dirichlet(np.full(p, 10 ** rng.uniform(-1, 1)))
    counts = rng.multinomial(rng.integers(0, 50), true)
    of_each = expected_shares(counts)
    assert of_each.sum() == pytest.approx(1)
    assert (np.diff(of_each[np.argsort(counts)]) >= -1e-12).all()
    more = rng.multinomial(1_000_000, true)
    np.testing.assert_allclose(expected_shares(more), more / more.sum(), atol=1e-3)
    np.testing.assert_allclose(expected_shares(np.zeros(p, int)), 1 / p)
