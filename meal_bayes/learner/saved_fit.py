"""What an agent made of the record, in a learner's file: the fields of an `Online`, checked."""

from dataclasses import fields
from typing import Any

import numpy as np

from meal_bayes.agents import Agent
from meal_bayes.arrays import Rows
from meal_bayes.learner.experience import Experience
from meal_bayes.learner.online import Online
from meal_bayes.learner.refit import classify
from meal_bayes.learner.saved_experience import check_limits
from meal_bayes.learner.settings import LearnerSettings

State = dict[str, Any]  # by field

_ELSEWHERE = ("record", "agent", "settings", "policies", "plan_libraries")
_FIELDS = tuple(field.name for field in fields(Online) if field.name not in _ELSEWHERE)
_GROWING = ("levels", "counted_labels")


def state_of(fit: Online, *, with_perception: bool) -> State:
    """Return the fields of what an agent made of the record.

    Classifiers of one's own are left out, as they cannot be written.
    """
    state = {name: getattr(fit, name) for name in _FIELDS}
    return state if with_perception else {**state, "perception": None}


def fit_of(experience: Experience, agent: Agent, settings: LearnerSettings, state: State) -> Online:
    """Return what an agent made of the record; a `ValueError` where it is another's."""
    _check_state(state, experience, agent)
    state = dict(state)
    for name in _GROWING:
        rows = Rows(np.int8, len(experience.domain.attributes))
        rows.extend(state[name])
        state[name] = rows
    if settings.classifier is not None:
        used = state["labels_at_refit"]
        state["perception"] = classify(experience, agent, settings, used, state["sizes"])[2]
    return Online(experience, agent, settings, **state)


def _check_state(state: State, experience: Experience, agent: Agent) -> None:
    """Raise a `ValueError` where arrays do not fit the record or its domain."""
    domain = experience.domain
    p = len(domain.attributes)
    e = len(domain.behaviors)
    for name in ("knowledge", "knowledge_at_refit"):
        _check_shape(name, state[name].posterior.counts, (p, e, 2, agent.levels))
    # Of the first instances, or objects: others may have come since.
    limits = {"labels_at_refit": 2, "levels": agent.levels, "counted_labels": 2}
    for name, end in limits.items():
        _check_shape(name, state[name], (min(len(state[name]), len(experience.instances)), p))
        check_limits(name, state[name], (-1, end))
    cells = state["trained_cells"]
    _check_shape("trained_cells", cells, (min(len(cells), len(experience.objects)), e, p))
    for name in ("percepts", "percepts_at_refit"):
        _check_shape(name, state[name], (p, e, 2, 2))
        if not (state[name] >= 0).all():
            raise ValueError(f"{name} are not all 0 or more")
    _check_shape("experience_at_refit", state["experience_at_refit"], (2, p, e))
    _check_shape("sizes", state["sizes"], (len(domain.contexts),))


def _check_shape(name: str, values: Any, expected: tuple[int, ...]) -> None:
    if values.shape != expected:
        raise ValueError(f"{name} has shape {values.shape}, expected {expected}")
