"""Every field of an agent acts, with a robot and on a percept table alike."""

import dataclasses

import numpy as np
import pytest

from meal_bayes.agents import Agent, NoBonus, load_agent
from meal_bayes.datasets import load_percepts
from meal_bayes.learner import Learner
from meal_bayes.planners import Predefined


def tables(knowledge, columns):
    """An observation model of one's own: all percepts are fair coins."""
    shape = (len(columns), len(knowledge.domain.behaviors), 2)
    return np.full((*shape, 4), 0.25), np.full(shape, 9.0), None


CHANGES = {
    "name": "another", "solver": lambda domain, query: Predefined(domain.behavior_names[1:2]),
    "object_level": False, "shared_trait": False, "base_rates": False, "levels": 2,
    "abstain": False, "discount": 0.9, "observation_model": tables, "exploration": NoBonus(),
    "memory": True, "whiten": False, "trained_by": load_agent("morc"),
}  # fmt: skip


def trials_of(dataset, make, agent):
    """Two trials about one object, labeled in between."""
    learner = make.learner(dataset, agent)
    first = learner.ask("red", make.arm(), object_name="mug", key="a")
    learner.tell(first, {"red": True, "full": True})
    learner.refit()
    return first, learner.ask("full", make.arm(), object_name="mug", key="b")


def replays_of(table, agent):
    """The same with an object of a percept table."""
    learner = Learner("roc36", agent=agent, logs=None).fit(table)
    name = table.objects[0]
    learner.tell(name, {"heavy": False, "blue": False})
    return [learner.ask(q, name, learn=True, max_steps=3) for q in ("heavy", "blue")]


def signature(trials):
    """What the trials depend on."""
    return [
        (
            trial.agent, trial.momdp.rows.tobytes(), trial.momdp.precision.tobytes(),
            trial.momdp.prior.tobytes(), trial.momdp.bonus.tobytes(), trial.momdp.discount,
            trial.momdp.n_actions, [step.decision.action for step in trial.steps],
        )
        for trial in trials
    ]  # fmt: skip


def test_no_field_is_forgotten_here():
    assert set(CHANGES) == {field.name for field in dataclasses.fields(Agent)}


@pytest.mark.parametrize("field", sorted(CHANGES))
def test_with_a_robot(dataset, make, field):
    ours = load_agent("bayes")
    changed = dataclasses.replace(ours, **{field: CHANGES[field]})
    one, other, again = (
        signature(trials_of(dataset, make, agent)) for agent in (ours, changed, ours)
    )
    assert one == again != other


@pytest.mark.parametrize("field", sorted(set(CHANGES) - {"whiten"}))
def test_on_a_percept_table_whose_classifiers_are_fitted(field):
    ours, table = load_agent("bayes"), load_percepts("roc36")
    changed = dataclasses.replace(ours, **{field: CHANGES[field]})
    one, other = (signature(replays_of(table, agent)) for agent in (ours, changed))
    assert one != other
