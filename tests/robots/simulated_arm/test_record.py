"""Recordings: whole where the physics allows, ragged where an object slips again and again."""

from importlib import import_module

import numpy as np
import pytest

from meal_bayes.domain import load_domain
from meal_bayes.errors import RobotError


@pytest.fixture(scope="module")
def room(sim):
    return import_module("meal_bayes.experiments.simulated")


@pytest.fixture(scope="module")
def made(room):
    return [room.record_object(number, recordings=2, seed=8) for number in range(2)]


def test_a_recording_holds_every_context_of_the_domain(room, sim, made):
    data = room.to_dataset(load_domain("simulated_arm"), made)
    assert data.objects == ("object_000", "object_001")
    assert data.recordings == 2
    senses = [bool(kind.modalities) for kind in data.domain.behaviors]
    assert (data.recording_counts[:, senses] == 2).all()
    for (behavior, _), values in data.features.items():
        assert values.shape == (2, 2, 3 if behavior == "look" else 10)
        assert np.isfinite(values).all()
    truth = sim.attributes_of(made[1].parameters)
    assert data.labels[1].tolist() == [truth[name] for name in data.domain.attributes]


def test_what_happened_counts_every_execution(made):
    happened = made[0].happened + made[1].happened
    assert happened["ready", "look", "ready"] == 4
    assert happened["lifted", "shake", "lifted"] == 4
    assert happened["grasped", "lift", "lifted"] >= 8  # before hold, and after lower


def test_an_object_that_always_slips_is_ragged_and_everything_else_is_there(room, make_object):
    slippery = make_object(shell_mass=0.4, friction=0.25)
    one = room.record_object(0, recordings=1, seed=8, alter=lambda _: slippery)
    contexts = set(one.recordings[0])
    assert not {context for context in contexts if context[0] == "shake"}
    failed = {key: n for key, n in one.happened.items() if key[1] == "shake"}
    assert sum(failed.values()) == room.ATTEMPTS
    assert {behavior for behavior, _ in contexts} == set(room.ORDER) - {"shake"}
    other = room.record_object(1, recordings=1, seed=8)
    data = room.to_dataset(load_domain("simulated_arm"), [one, other])
    shake = data.domain.behavior_index("shake")
    assert data.recording_counts[:, shake].tolist() == [0, 1]


def test_a_fault_starts_the_object_anew_and_is_counted(room, sim, monkeypatch):
    execute, broken = sim.SimulatedArm.execute, []

    def breaking(arm, behavior):
        if behavior == "push" and not broken:
            broken.append(behavior)
            raise RobotError("the object fell off the table")
        return execute(arm, behavior)

    monkeypatch.setattr(sim.SimulatedArm, "execute", breaking)
    one = room.record_object(0, recordings=1, seed=8)
    assert one.happened["ready", "push", room.FAULT] == 1
    assert ("push", "flow") in one.recordings[0]
