"""What is believed does not depend on the order or the names of what was told, nor on units."""

from dataclasses import replace

import numpy as np
import pytest

from meal_bayes import Learner, Outcome, load_agent
from meal_bayes.domain import domain_from_table
from meal_bayes.momdp import Transition, initial_belief, update_belief
from meal_bayes.planners import OpenLoop, Predefined

SCRIPT = replace(
    load_agent("bayes_no_bonus"),
    name="script",
    solver=lambda domain, query: Predefined(domain.behavior_names),
)


def domain_of(attributes="abc", behaviors=("look", "feel"), *, unit=1.0):
    return domain_from_table(
        {
            "name": "senses",
            "attributes": list(attributes),
            "report_reward": 60.0 * unit,
            "behaviors": [
                {"name": name, "cost": {"look": 2.0, "feel": 8.0}[name] * unit, "modalities": ["m"]}
                for name in behaviors
            ],
            "diagram": {
                "states": ["s"],
                "start": "s",
                "effects": [{"from": "s", "do": name, "to": "s"} for name in behaviors],
            },
        }
    )


def objects_of(seed, number=9, attributes="abc"):
    """Return names of objects, their labels, and what a detector says of them by behavior."""
    rng = np.random.default_rng(seed)
    objects = []
    for index in range(number):
        labels = {name: bool(rng.random() < 0.4) for name in attributes}
        said = {
            behavior: {
                name: bool(rng.random() < (0.85 if labels[name] else 0.2)) for name in labels
            }
            for behavior in ("look", "feel")
        }
        objects.append((f"cup {index}", labels, said))
    return objects


class Robot:
    def __init__(self, said):
        self.said = said
        self.executed = []

    def start(self):
        return "s"

    def execute(self, behavior):
        self.executed.append(behavior)
        return Outcome("s", percepts=self.said[behavior])


def met(objects, domain=None, *, asked="a", tells=True):
    learner = Learner(domain or domain_of(), agent=SCRIPT, logs=None)
    for name, labels, said in objects:
        trial = learner.ask(asked, Robot(said), object_name=name)
        if tells:
            learner.tell(trial, labels)
    return learner


def knowledge_of(learner):
    return learner.refit().knowledge()


def assert_alike(one, other, attributes=(0, 1, 2), behaviors=(0, 1)):
    """Compare two kinds of knowledge, the second of other orders of attributes and behaviors."""
    pairs = np.ix_(attributes, behaviors)
    np.testing.assert_allclose(other.base_rates[list(attributes)], one.base_rates, rtol=1e-9)
    np.testing.assert_allclose(other.posterior.mean[pairs], one.posterior.mean, atol=1e-6)
    np.testing.assert_allclose(other.posterior.dispersion[pairs], one.posterior.dispersion, 1e-5)
    assert other.trait.sd == pytest.approx(one.trait.sd, rel=1e-5)


def test_neither_order_nor_names_play_a_part():
    objects = objects_of(0, 6)
    known = knowledge_of(met(objects))
    assert_alike(known, knowledge_of(met(objects[::-1])))
    later = met(objects, tells=False)
    for name, labels, _ in objects[::-1]:  # one label at a time, by the object's name
        for attribute in "cab":
            later.tell(name, {attribute: labels[attribute]})
    assert_alike(known, knowledge_of(later))
    assert_alike(
        known, knowledge_of(met(objects, domain_of("cab", ("feel", "look")))), (1, 2, 0), (1, 0)
    )


def test_yes_and_no_may_be_exchanged_everywhere():
    """Rows of a detector are those of the opposite truth and level; base rates lean to no."""
    objects = objects_of(0)
    swapped = [
        (
            name,
            {key: not value for key, value in labels.items()},
            {e: {key: not value for key, value in of.items()} for e, of in said.items()},
        )
        for name, labels, said in objects
    ]
    one = knowledge_of(met(objects)).posterior
    other = knowledge_of(met(swapped)).posterior
    np.testing.assert_allclose(other.mean[:, :, ::-1, ::-1], one.mean, atol=1e-9)
    np.testing.assert_array_equal(other.informative, one.informative)


def test_questions_about_more_attributes_have_the_same_marginals():
    """Nine objects couple no attributes, so that those beside it say nothing of one."""
    learner = met(objects_of(1))
    rng = np.random.default_rng(0)
    alone, beside = learner.problem("b"), learner.problem(["c", "b", "a"])
    assert beside.joint is None
    one, all_three = initial_belief(alone), initial_belief(beside)
    for _ in range(6):
        e = int(rng.integers(2))
        levels = rng.integers(-1, alone.levels, 3).astype(np.int8)
        one = update_belief(one, alone, Transition(e, 0, levels[1:2]))
        all_three = update_belief(all_three, beside, Transition(e, 0, levels))
        np.testing.assert_allclose(all_three.positive[1], one.positive[0], rtol=1e-9)


def test_the_unit_of_costs_and_rewards_plays_no_part():
    """An agent that explores executes the same behaviors if all of them are ten times as large."""
    lives = []
    for unit in (1.0, 10.0):
        agent = replace(load_agent("bayes"), solver=lambda domain, query: OpenLoop())
        learner = Learner(domain_of("ab", unit=unit), agent=agent, logs=None)
        robots = []
        for name, labels, said in objects_of(2, 6, "ab"):
            robots.append(Robot(said))
            learner.tell(learner.ask("a", robots[-1], object_name=name), labels)
        lives.append([robot.executed for robot in robots])
    assert lives[0] == lives[1]
    assert any(lives[0])
