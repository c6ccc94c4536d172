"""One conformance suite for all robots, then what is particular to each."""

from collections import Counter

import numpy as np
import pytest

from meal_bayes.datasets import Dataset, make_synthetic
from meal_bayes.domain import TERMINAL, Domain, load_domain
from meal_bayes.robots import OutcomeChecker
from meal_bayes.robots.recorded import RecordedRobot
from meal_bayes.robots.robot import Execution

RECORDINGS = 4
OBJECTS = 6


def dataset_of(domain: Domain) -> Dataset:
    rng = np.random.default_rng(0)
    return make_synthetic(domain, objects=OBJECTS, recordings=RECORDINGS, rng=rng)


class CheckedRobot:
    """A robot behind its checker."""

    def __init__(self, robot: RecordedRobot, domain: Domain, *, object_index: int) -> None:
        self.robot = robot
        self.names = domain.behavior_names
        self.terminal = len(domain.diagram.states) - 1
        self.checker = OutcomeChecker(domain, object_index=object_index)

    def start(self) -> int:
        return self.checker.start(self.robot.start())

    def execute(self, behavior: int) -> Execution:
        outcome = self.robot.execute(self.names[behavior])
        if outcome.state == TERMINAL:  # of an illegal behavior, which no trial commands
            return Execution(self.terminal)
        return self.checker.execute(behavior, outcome)


def looked_up(domain, seed, failure_seed=0, o=1, **options):
    order = np.random.default_rng(seed)
    failures = np.random.default_rng(failure_seed)
    robot = RecordedRobot(domain, o, RECORDINGS, order, failures, **options)
    return CheckedRobot(robot, domain, object_index=o)


def recorded(domain, *seeds):
    return looked_up(domain, *seeds, dataset=dataset_of(domain))


def repeating(domain, *seeds):
    return looked_up(domain, *seeds, repeats=True)


MAKERS = [recorded, looked_up, repeating]


def run(robot: CheckedRobot, behaviors: list[int]) -> list[Execution]:
    robot.start()
    return [robot.execute(behavior) for behavior in behaviors]


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
def test_moves_only_where_the_diagram_leads(make, name):
    domain = load_domain(name)
    arrays = domain.diagram.compile(domain.behavior_names)
    robot = make(domain, 1, 3)
    choose = np.random.default_rng(2)
    for _ in range(60):
        x = robot.start()
        assert domain.diagram.states[x] == domain.diagram.start
        for _ in range(20):
            behavior = int(choose.integers(len(domain.behaviors)))
            execution = robot.execute(behavior)
            assert arrays.transition[behavior, x, execution.next_x] > 0
            if execution.instance is not None:
                kind = domain.behaviors[behavior]
                assert kind.senses
                assert execution.instance.behavior == kind.name
                assert arrays.observation_probability[behavior, x, execution.next_x] > 0
            x = execution.next_x


@pytest.mark.parametrize("make", MAKERS)
def test_after_the_end_nothing_happens(make):
    robot = make(load_domain("toy"), 1, 5)
    ended = run(robot, [2, 0, 1, 2])  # reinit is illegal in x0
    assert [execution.next_x for execution in ended] == [2] * 4
    assert all(execution.instance is None for execution in ended)


@pytest.mark.parametrize("make", MAKERS)
def test_seeds_name_the_trial(make):
    domain = load_domain("cy101")
    plan = [0, 1, 2, 3, 3, 4, 4, 5, 10] * 3
    trials = [run(make(domain, 7, seed), plan) for seed in (8, 8, *range(9, 15))]
    seen = [str([(e.next_x, felt(e)) for e in trial]) for trial in trials]
    assert seen[0] == seen[1]
    assert len(set(seen[1:])) > 1


@pytest.mark.parametrize("make", MAKERS)
def test_failures_of_an_execution_do_not_depend_on_the_others(make):
    domain = load_domain("toy")
    lift, look, reinit = (domain.behavior_index(name) for name in ("lift", "look", "reinit"))

    def lifts(looks_between: int) -> list[tuple[object, ...]]:
        robot = make(domain, 11, 12, 2)
        results = []
        robot.start()
        for _ in range(50):
            execution = robot.execute(lift)
            results.append((execution.next_x, felt(execution)))
            if execution.next_x == 1:
                robot.execute(reinit)
            for _ in range(looks_between):
                robot.execute(look)
        return results

    alone = lifts(0)
    assert {x for x, _ in alone} == {0, 1}  # some failed
    assert lifts(1) == alone
    assert lifts(3) == alone


@pytest.mark.statistical
def test_failures_have_the_diagram_s_frequency():
    domain = load_domain("roc36")
    n = 1500
    robot = repeating(domain, 13, 14)
    look = domain.behavior_index("look")
    grasp = domain.behavior_index("grasp")
    successes = 0
    for _ in range(n):
        robot.start()
        assert robot.execute(look).instance is not None  # look never fails
        execution = robot.execute(grasp)
        assert (execution.next_x == 2) == (execution.instance is not None)
        successes += execution.next_x == 2
    assert_frequency(successes, n, 0.95)


def test_each_recording_comes_once_and_then_none():
    domain = load_domain("ispy32")
    robot = recorded(domain, 19, 20)
    press = domain.behavior_index("press")
    for _ in range(2):
        trial = run(robot, [0, *[press] * 30])
        got = [e.instance.recording for e in trial[1:] if e.instance is not None]
        assert sorted(got) == list(range(RECORDINGS))
        assert all(e.next_x == 1 for e in trial[1:])


def test_failed_execution_uses_no_recording():
    domain = load_domain("ispy32")
    press = domain.behavior_index("press")
    for seed in range(200):
        trial = run(looked_up(domain, seed, seed), [0, *[press] * (RECORDINGS + 1)])
        got = [e.instance for e in trial[1:]]
        failed = [i for i, instance in enumerate(got[:RECORDINGS]) if instance is None]
        if len(failed) == 1 and got[-1] is not None:
            assert sum(instance is not None for instance in got) == RECORDINGS
            return
    pytest.fail("no trial with exactly one failure among 200")


def test_order_of_recordings_is_fair_and_repeats_never_run_out():
    domain = load_domain("toy")
    robot = looked_up(domain, 21, 22)
    trials = [run(robot, [0])[0] for _ in range(2000)], run(repeating(domain, 23, 24), [0] * 2000)
    for executions in trials:
        drawn = Counter(e.instance.recording for e in executions if e.instance is not None)
        assert drawn.total() == 2000
        for recording in range(RECORDINGS):
            assert_frequency(drawn[recording], 2000, 1 / RECORDINGS)


def test_recorded_features_are_those_of_the_data_set():
    domain = load_domain("roc36")
    dataset = dataset_of(domain)
    robot = looked_up(domain, 25, 26, 3, dataset=dataset)
    for execution in run(robot, [0, 1, 2, 3, 4]):
        instance = execution.instance
        assert instance is not None
        assert instance.object_index == 3
        assert instance.features is not None
        for modality, values in instance.features.items():
            expected = dataset.features[instance.behavior, modality][3, instance.recording]
            np.testing.assert_array_equal(values, expected)


@pytest.mark.parametrize("make", MAKERS)
def test_a_person_s_answer_has_no_features(make):
    domain = load_domain("ispy32")
    ask = domain.behavior_index("ask")
    for execution in run(make(domain, 27, 28), [ask] * 10):
        assert execution.next_x == 0
        assert execution.instance is not None
        assert execution.instance.features is None
        assert execution.instance.recording == -1


def test_a_given_order_says_what_comes_next():
    domain = load_domain("toy")
    order = [[0, 2, 1], [0], [0]]
    look = domain.behavior_index("look")
    robot = RecordedRobot(domain, 4, 3, order, np.random.default_rng(1))
    body = CheckedRobot(robot, domain, object_index=4)
    for _ in range(2):
        shown = [execution.instance for execution in run(body, [look] * 4)]
        assert [i and (i.object_index, i.recording) for i in shown] == [
            (4, 1), (4, 2), (4, 0), None
        ]  # fmt: skip
    assert order == [[0, 2, 1], [0], [0]]


def test_ragged_recordings_run_out_one_by_one():
    domain = load_domain("toy")
    rng = np.random.default_rng(1)
    body = CheckedRobot(RecordedRobot(domain, 0, [2, 0, 0], rng, rng), domain, object_index=0)
    shown = [execution.instance for execution in run(body, [0, 0, 0, 1])]
    assert sorted(i.recording for i in shown if i is not None) == [0, 1]
    assert shown[2:] == [None, None]
