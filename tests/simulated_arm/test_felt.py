"""Parameters of an object cause its attributes, what is felt of it, and what is recorded."""

from collections import Counter
from importlib import import_module

import numpy as np
import pytest

from meal_bayes.domain import load_domain
from meal_bayes.errors import RobotError

GRAVITY = 9.81  # m/s²


@pytest.fixture
def noiseless(sim, monkeypatch):
    """Silence the sensors, so that the physics alone is seen."""
    silent = dict.fromkeys(sim.sensors.NOISE, (0.0, 0.0))
    monkeypatch.setattr(sim.sensors, "NOISE", silent)
    monkeypatch.setattr(sim.sensors, "PIXEL_NOISE", 0.0)


@pytest.mark.usefixtures("noiseless")
@pytest.mark.parametrize("mass", [0.10, 0.25, 0.40])
def test_holding_feels_the_weight(feel, make_object, mass):
    felt = feel(make_object(shell_mass=mass), "grasp", "lift", "hold")["force"]
    assert felt == pytest.approx(np.full(10, mass * GRAVITY), abs=0.02)


@pytest.mark.usefixtures("noiseless")
def test_the_load_cell_weighs_what_was_dropped(feel, make_object):
    felt = feel(make_object(shell_mass=0.2), "grasp", "lift", "drop")["load"]
    assert felt[-1] == pytest.approx(0.2 * GRAVITY, abs=0.05)
    assert felt.max() > 2 * felt[-1]  # the impact


@pytest.mark.usefixtures("noiseless")
def test_walls_and_lid_give_as_their_springs_say(feel, make_object):
    stiff = make_object(stiffness=12000.0)
    soft = make_object(stiffness=2000.0)
    depths = [feel(thing, "press")["depth"][-1] for thing in (stiff, soft)]
    assert depths[1] - depths[0] == pytest.approx(8 / 2000 - 8 / 12000, rel=0.3)  # 8 N
    widths = [feel(thing, "grasp")["fingers"][-1] for thing in (stiff, soft)]
    assert widths[0] - widths[1] > 2 * (12 / 2400 - 12 / 12000) * 0.8  # 12 N, both sides


@pytest.mark.usefixtures("noiseless")
def test_a_slippery_object_slides_farther_whatever_its_mass(feel, make_object):
    slid = {
        (friction, mass): feel(make_object(friction=friction, shell_mass=mass), "push")["flow"][-1]
        for friction in (0.3, 0.9)
        for mass in (0.12, 0.26)
    }
    assert min(slid[0.3, 0.12], slid[0.3, 0.26]) > 1.5 * max(slid[0.9, 0.12], slid[0.9, 0.26])


@pytest.mark.usefixtures("noiseless")
def test_the_camera_sees_color_and_height(feel, make_object):
    low = feel(make_object(height=0.08, rgb=(0.8, 0.1, 0.1)), "look")
    tall = feel(make_object(height=0.13, rgb=(0.1, 0.1, 0.8)), "look")
    assert low["color"].argmax() == 0
    assert tall["color"].argmax() == 2
    assert tall["shape"][0] > low["shape"][0] + 5


@pytest.mark.long
@pytest.mark.usefixtures("noiseless")
@pytest.mark.parametrize(
    "content", [{"content": "few large balls", "n_balls": 2},
                {"content": "many small balls", "n_balls": 10}],
)  # fmt: skip
def test_shaking_alone_tells_what_rattles_from_a_slab_of_equal_mass(feel, make_object, content):
    loose = make_object(shell_mass=0.15, content_mass=0.1, **content)
    fixed = make_object(shell_mass=0.15, content_mass=0.1, content="slab")
    way = ("grasp", "lift", "hold")
    holds = [feel(thing, *way)["force"] for thing in (loose, fixed)]
    assert holds[0] == pytest.approx(holds[1], abs=0.02)
    shakes = [feel(thing, *way, "shake")["vibro"] for thing in (loose, fixed)]
    assert shakes[0].mean() > 1.5 * shakes[1].mean()


def test_sensors_err_by_their_stated_noise(sim):
    rng = np.random.default_rng(4)
    silence = np.zeros((400, len(sim.physics.CHANNELS)))
    errors = [sim.sensors.sense(silence, rng) for _ in range(400)]
    for name, (white, bias) in sim.sensors.NOISE.items():
        values = np.array([error[name] for error in errors])
        assert values.std(axis=1).mean() == pytest.approx(white, rel=0.05)
        whole = np.hypot(bias, white / 20)
        assert values.mean(axis=1).std() == pytest.approx(whole, rel=0.12)


def test_equal_names_draw_equal_objects(sim):
    assert sim.draw_object(3, "new", 1) == sim.draw_object(3, "new", 1)
    drawn = {sim.draw_object(seed, "new", n) for seed in range(3) for n in range(3)}
    assert len(drawn) == 9


def test_every_attribute_of_the_domain_is_told_and_both_values_are_common(sim):
    domain = load_domain(sim.arm.DOMAIN)
    truths = [sim.attributes_of(sim.draw_object(0, "count", n)) for n in range(300)]
    assert all(tuple(truth) == domain.attributes for truth in truths)
    positive = Counter(name for truth in truths for name, value in truth.items() if value)
    assert all(0.2 < positive[name] / 300 < 0.8 for name in domain.attributes), positive


@pytest.mark.parametrize(
    ("attribute", "said", "otherwise"),
    [
        ("heavy", {"shell_mass": 0.23}, {"shell_mass": 0.21}),
        ("heavy", {"content_mass": 0.08}, {"content_mass": 0.06}),
        ("soft", {"stiffness": 3900.0}, {"stiffness": 4100.0}),
        ("slippery", {"friction": 0.49}, {"friction": 0.51}),
        ("full", {"content": "slab"}, {"content": "nothing"}),
        ("rattles", {"content": "few large balls"}, {"content": "slab"}),
        ("tall", {"height": 0.106}, {"height": 0.104}),
        ("blue", {"color": "blue"}, {"color": "red"}),
    ],
)
def test_an_attribute_follows_from_its_threshold(sim, make_object, attribute, said, otherwise):
    assert sim.attributes_of(make_object(**said))[attribute]
    assert not sim.attributes_of(make_object(**otherwise))[attribute]


@pytest.fixture(scope="module")
def room(sim):
    return import_module("simulated_arm.recordings")


@pytest.fixture(scope="module")
def made(room):
    return [room.record_object(number, recordings=2, seed=8) for number in range(2)]


@pytest.mark.long
def test_a_recording_holds_every_context_of_the_domain(room, sim, made):
    data = room.to_dataset(load_domain(sim.arm.DOMAIN), made)
    assert data.objects == ("object_000", "object_001")
    assert data.recordings == 2
    senses = [bool(kind.modalities) for kind in data.domain.behaviors]
    assert (data.recording_counts[:, senses] == 2).all()
    for (behavior, _), values in data.features.items():
        assert values.shape == (2, 2, 3 if behavior == "look" else 10)
        assert np.isfinite(values).all()
    truth = sim.attributes_of(made[1].parameters)
    assert data.labels[1].tolist() == [truth[name] for name in data.domain.attributes]


@pytest.mark.long
def test_what_happened_counts_every_execution(made):
    happened = made[0].happened + made[1].happened
    assert happened["ready", "look", "ready"] == 4
    assert happened["lifted", "shake", "lifted"] == 4
    assert happened["grasped", "lift", "lifted"] >= 8  # before hold, and after lower


@pytest.mark.long
def test_an_object_that_always_slips_is_ragged_and_everything_else_is_there(room, make_object):
    slippery = make_object(shell_mass=0.4, friction=0.25)
    slips = room.record_object(0, recordings=1, seed=8, alter=lambda _: slippery)
    contexts = set(slips.recordings[0])
    assert not {context for context in contexts if context[0] == "shake"}
    failed = {key: n for key, n in slips.happened.items() if key[1] == "shake"}
    assert sum(failed.values()) == room.ATTEMPTS
    assert {behavior for behavior, _ in contexts} == set(room.ORDER) - {"shake"}
    fine = room.record_object(1, recordings=1, seed=8)
    data = room.to_dataset(load_domain(room.DOMAIN), [slips, fine])
    shake = data.domain.behavior_index("shake")
    assert data.recording_counts[:, shake].tolist() == [0, 1]


def test_a_fault_starts_the_object_anew_and_is_counted(room, sim, monkeypatch):
    execute = sim.SimulatedArm.execute
    broken = []

    def breaking(arm, behavior):
        if behavior == "push" and not broken:
            broken.append(behavior)
            raise RobotError("the object fell off the table")
        return execute(arm, behavior)

    monkeypatch.setattr(sim.SimulatedArm, "execute", breaking)
    record = room.record_object(0, recordings=1, seed=8)
    assert record.happened["ready", "push", room.FAULT] == 1
    assert ("push", "flow") in record.recordings[0]
