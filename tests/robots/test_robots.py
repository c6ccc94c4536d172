"""One conformance suite for all robots, then what is particular to each."""

from collections import Counter
from collections.abc import Callable

import numpy as np
import pytest

from meal_bayes.datasets import Dataset, make_synthetic, make_synthetic_model
from meal_bayes.domain import Domain, load_domain
from meal_bayes.errors import SettingsError
from meal_bayes.robots import Execution, RecordedRobot, Robot, SimulatedRobot

RECORDINGS = 4
OBJECTS = 6


def dataset_of(domain: Domain) -> Dataset:
    rng = np.random.default_rng(0)
    return make_synthetic(domain, objects=OBJECTS, recordings=RECORDINGS, rng=rng)


def recorded(domain: Domain, seed: int) -> Robot:
    return RecordedRobot(domain, RECORDINGS, np.random.default_rng(seed), dataset_of(domain))


def looked_up(domain: Domain, seed: int) -> Robot:
    return RecordedRobot(domain, RECORDINGS, np.random.default_rng(seed))


def repeating(domain: Domain, seed: int) -> Robot:
    return RecordedRobot(domain, RECORDINGS, np.random.default_rng(seed), repeats=True)


def simulated(domain: Domain, seed: int) -> Robot:
    rng = np.random.default_rng(0)
    return SimulatedRobot(make_synthetic_model(domain, objects=OBJECTS, rng=rng))


MAKERS = [recorded, looked_up, repeating, simulated]
Maker = Callable[[Domain, int], Robot]


def run(robot: Robot, behaviors: list[int], seed: int, object_index: int = 1) -> list[Execution]:
    robot.start(object_index)
    rng = np.random.default_rng(seed)
    return [robot.execute(behavior, rng) for behavior in behaviors]


def assert_frequency(hits: int, n: int, p: float, sigma: float = 5.0) -> None:
    assert abs(hits / n - p) <= sigma * np.sqrt(p * (1 - p) / n)


def felt(execution: Execution) -> tuple[object, ...] | None:
    """Return all that an instance holds, to compare."""
    instance = execution.instance
    if instance is None:
        return None
    features = instance.features or {}
    values = {modality: array.tolist() for modality, array in features.items()}
    return instance.object_index, instance.behavior, instance.recording, values


@pytest.mark.parametrize("make", MAKERS)
@pytest.mark.parametrize("name", ["toy", "roc36", "roc36_published", "ispy32", "cy101"])
def test_moves_only_where_the_diagram_leads(make: Maker, name: str) -> None:
    domain = load_domain(name)
    arrays, robot = domain.transitions(), make(domain, 1)
    choose, rng = np.random.default_rng(2), np.random.default_rng(3)
    for _ in range(60):
        x = robot.start(int(choose.integers(OBJECTS)))
        assert domain.diagram.states[x] == domain.diagram.start
        for _ in range(20):
            behavior = int(choose.integers(len(domain.behaviors)))
            execution = robot.execute(behavior, rng)
            assert arrays.transition[behavior, x, execution.next_x] > 0
            if execution.instance is not None:
                kind = domain.behaviors[behavior]
                assert kind.senses
                assert execution.instance.behavior == kind.name
                assert arrays.informative[behavior, x, execution.next_x] > 0
            x = execution.next_x


@pytest.mark.parametrize("make", MAKERS)
def test_after_the_end_nothing_happens(make: Maker) -> None:
    robot = make(load_domain("toy"), 1)
    ended = run(robot, [2, 0, 1, 2], 5)  # reinit is illegal in x0
    assert [execution.next_x for execution in ended] == [2] * 4
    assert all(execution.instance is None for execution in ended)


@pytest.mark.parametrize("make", MAKERS)
def test_seeds_name_the_trial(make: Maker) -> None:
    domain, plan = load_domain("cy101"), [0, 1, 2, 3, 3, 4, 4, 5, 10] * 3
    trials = [run(make(domain, 7), plan, seed) for seed in (8, 8, *range(9, 15))]
    seen = [str([(e.next_x, felt(e)) for e in trial]) for trial in trials]
    assert seen[0] == seen[1]
    assert len(set(seen[1:])) > 1


@pytest.mark.parametrize("make", MAKERS)
def test_luck_of_an_execution_does_not_depend_on_the_others(make: Maker) -> None:
    domain = load_domain("toy")
    lift, look, reinit = (domain.behavior_index(name) for name in ("lift", "look", "reinit"))

    def lifts(looks_between: int) -> list[tuple[object, ...]]:
        robot = make(domain, 11)
        robot.start(2)
        rng, results = np.random.default_rng(12), []
        for _ in range(50):
            execution = robot.execute(lift, rng)
            results.append((execution.next_x, felt(execution)))
            if execution.next_x == 1:
                robot.execute(reinit, rng)
            for _ in range(looks_between):
                robot.execute(look, rng)
        return results

    alone = lifts(0)
    assert {x for x, _ in alone} == {0, 1}  # some failed
    assert lifts(1) == alone
    assert lifts(3) == alone


@pytest.mark.statistical
@pytest.mark.parametrize("make", [repeating, simulated])
def test_failures_have_the_diagram_s_frequency(make: Maker) -> None:
    domain, n = load_domain("roc36"), 1500
    robot, rng = make(domain, 13), np.random.default_rng(14)
    look, grasp = domain.behavior_index("look"), domain.behavior_index("grasp")
    successes = 0
    for _ in range(n):
        robot.start(0)
        assert robot.execute(look, rng).instance is not None  # look never fails
        execution = robot.execute(grasp, rng)
        assert (execution.next_x == 2) == (execution.instance is not None)
        successes += execution.next_x == 2
    assert_frequency(successes, n, 0.95)


@pytest.mark.statistical
def test_loops_that_fail_give_no_percept() -> None:
    domain, n = load_domain("ispy32"), 3000
    robot, rng = repeating(domain, 15), np.random.default_rng(16)
    robot.start(0)
    robot.execute(domain.behavior_index("look"), rng)
    press = domain.behavior_index("press")
    percepts = 0
    for _ in range(n):
        execution = robot.execute(press, rng)
        assert execution.next_x == 1
        percepts += execution.instance is not None
    assert_frequency(percepts, n, 0.95)


@pytest.mark.statistical
def test_published_shakes_are_felt_only_when_the_object_falls() -> None:
    domain, n = load_domain("roc36_published"), 3000
    robot, rng = repeating(domain, 17), np.random.default_rng(18)
    plan = [domain.behavior_index(name) for name in ("look", "grasp", "lift_slow", "hold")]
    shake, falls, shaken = domain.behavior_index("shake"), 0, 0
    for _ in range(n):
        robot.start(0)
        if [robot.execute(behavior, rng).next_x for behavior in plan][-1] != 4:
            continue
        execution = robot.execute(shake, rng)
        assert (execution.next_x == 5) == (execution.instance is not None)
        falls += execution.next_x == 5
        shaken += 1
    assert_frequency(falls, shaken, 0.05)


def test_each_recording_comes_once_and_then_none() -> None:
    domain = load_domain("ispy32")
    robot, press = recorded(domain, 19), domain.behavior_index("press")
    trial = run(robot, [0, *[press] * 30], 20)
    got = [e.instance.recording for e in trial[1:] if e.instance is not None]
    assert sorted(got) == list(range(RECORDINGS))
    assert all(e.next_x == 1 for e in trial[1:])
    again = run(robot, [0, *[press] * 30], 20)
    assert sorted(
        e.instance.recording for e in again[1:] if e.instance is not None
    ) == list(range(RECORDINGS))  # fmt: skip


def test_failed_execution_uses_no_recording() -> None:
    domain = load_domain("ispy32")
    press = domain.behavior_index("press")
    for seed in range(200):
        trial = run(looked_up(domain, seed), [0, *[press] * (RECORDINGS + 1)], seed)
        got = [e.instance for e in trial[1:]]
        failed = [i for i, instance in enumerate(got[:RECORDINGS]) if instance is None]
        if len(failed) == 1 and got[-1] is not None:
            assert sum(instance is not None for instance in got) == RECORDINGS
            return
    pytest.fail("no trial with exactly one failure among 200")


def test_order_of_recordings_varies_and_is_fair() -> None:
    domain = load_domain("toy")
    robot, rng = looked_up(domain, 21), np.random.default_rng(22)
    first: Counter[int] = Counter()
    for _ in range(2000):
        robot.start(0)
        instance = robot.execute(0, rng).instance
        assert instance is not None
        first[instance.recording] += 1
    for recording in range(RECORDINGS):
        assert_frequency(first[recording], 2000, 1 / RECORDINGS)


def test_repeats_never_run_out_and_are_fair() -> None:
    trial = run(repeating(load_domain("toy"), 23), [0] * 2000, 24)
    drawn = Counter(e.instance.recording for e in trial if e.instance is not None)
    assert drawn.total() == 2000
    for recording in range(RECORDINGS):
        assert_frequency(drawn[recording], 2000, 1 / RECORDINGS)


def test_recorded_features_are_those_of_the_data_set() -> None:
    domain = load_domain("roc36")
    dataset = dataset_of(domain)
    robot = RecordedRobot(domain, RECORDINGS, np.random.default_rng(25), dataset)
    for execution in run(robot, [0, 1, 2, 3, 4], 26, object_index=3):
        instance = execution.instance
        assert instance is not None
        assert instance.object_index == 3
        assert instance.features is not None
        for modality, values in instance.features.items():
            expected = dataset.features[instance.behavior, modality][3, instance.recording]
            np.testing.assert_array_equal(values, expected)


@pytest.mark.parametrize("make", MAKERS)
def test_a_person_s_answer_has_no_features(make: Maker) -> None:
    domain = load_domain("ispy32")
    ask = domain.behavior_index("ask")
    for execution in run(make(domain, 27), [ask] * 10, 28):
        assert execution.next_x == 0
        assert execution.instance is not None
        assert execution.instance.features is None
        assert execution.instance.recording == -1


def test_simulated_instances_are_fresh() -> None:
    trial = run(simulated(load_domain("toy"), 0), [0] * 30, 29)
    values = {str(felt(execution)) for execution in trial}
    assert len(values) == 30
    assert [e.instance.recording for e in trial if e.instance is not None] == list(range(30))


@pytest.mark.parametrize("make", MAKERS)
def test_mistakes_are_told(make: Maker) -> None:
    domain, rng = load_domain("toy"), np.random.default_rng(30)
    with pytest.raises(SettingsError, match="call start"):
        make(domain, 0).execute(0, rng)
    robot = make(domain, 0)
    robot.start(0)
    for behavior in (-1, 3):
        with pytest.raises(SettingsError, match="expected 0 to 2"):
            robot.execute(behavior, rng)
    with pytest.raises(SettingsError, match="Object -1"):
        robot.start(-1)


def test_object_beyond_the_data_set() -> None:
    for make in (recorded, simulated):
        with pytest.raises(SettingsError, match=f"Object {OBJECTS}"):
            make(load_domain("toy"), 0).start(OBJECTS)


@pytest.mark.parametrize("recordings", [0, RECORDINGS + 1])
def test_recordings_out_of_range(recordings: int) -> None:
    domain = load_domain("toy")
    with pytest.raises(SettingsError, match=f"expected 1 to {RECORDINGS}"):
        RecordedRobot(domain, recordings, np.random.default_rng(0), dataset_of(domain))
    with pytest.raises(SettingsError, match="expected 1 or more"):
        RecordedRobot(domain, 0, np.random.default_rng(0))


def test_a_supply_says_what_comes_next() -> None:
    domain, asked = load_domain("toy"), list[int]()
    look = domain.behavior_index("look")

    def supply(object_index: int) -> list[list[int]]:
        asked.append(object_index)
        return [[0, 2, 1], [0], [0]]

    robot = RecordedRobot(domain, 3, supply)
    rng = np.random.default_rng(1)
    for o in (4, 7):
        robot.start(o)
        shown = [robot.execute(look, rng).instance for _ in range(4)]
        assert [i and (i.object_index, i.recording) for i in shown] == [
            (o, 1),
            (o, 2),
            (o, 0),
            None,
        ]
    assert asked == [4, 7]
