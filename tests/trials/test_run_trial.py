"""The inner loop of Algorithms 1 and 2, with scripted robots, percepts and policies."""

import hashlib
from collections.abc import Iterator, Sequence

import numpy as np
import pytest

from meal_bayes.domain import Query, load_domain
from meal_bayes.errors import QueryError, SettingsError
from meal_bayes.momdp import Objective, Transition, build_momdp, initial_belief, update_belief
from meal_bayes.planners import unvalued
from meal_bayes.robots import Outcome, OutcomeChecker
from meal_bayes.seeds import stream
from meal_bayes.trials import Session, Task, run_trial, truth_of


class Script:
    """Policy: the named behaviors in order, then a report; keeps what it was shown."""

    def __init__(self, momdp, *actions, report=None):
        self.momdp = momdp
        self.actions = list(actions)
        self.report = report
        self.histories = []

    def decide(self, history, rng):
        self.histories.append(history)
        if self.actions:
            return unvalued(self.momdp, self.momdp.behavior_names.index(self.actions.pop(0)))
        values = history.belief.best_report if self.report is None else self.report
        return unvalued(self.momdp, self.momdp.n_behaviors + self.momdp.query.index_of(values))


class ScriptedRobot:
    """Goes through these x; percepts come where it says so."""

    def __init__(self, states: Sequence[str], *outcomes: tuple[int, bool]):
        self.states = states
        self.outcomes: Iterator[tuple[int, bool]] = iter(outcomes)
        self.started = 0

    def start(self):
        self.started += 1
        return self.states[0]

    def execute(self, behavior):
        next_x, perceived = next(self.outcomes)
        return Outcome(self.states[next_x], recording=0 if perceived else None)


class ScriptedPercepts:
    def __init__(self, *percepts: Sequence[int]):
        self.percepts = iter(percepts)

    def observe(self, instance, query, rng):
        return np.array(next(self.percepts), dtype=np.int8)


def momdp_of(name="toy", attributes=("red", "heavy"), mistaken=0.0, **options):
    domain = load_domain(name)
    rows = np.array([[0.8, 0.2], [0.3, 0.7]])
    if mistaken:  # the classes are what an object seems to be
        share = [[1 - mistaken, mistaken], [mistaken, 1 - mistaken]]
        options["latent_classes"] = np.broadcast_to(share, (len(attributes), 2, 2))
    confusion = np.tile(rows, (len(attributes), len(domain.behaviors), 1, 1))
    return build_momdp(domain, Query(attributes), confusion, **options)


def trial_of(momdp, policy, outcomes=(), percepts=(), *, truth=(True, False), **options):
    task = Task("a task", momdp.query, 5, "object 5", ("test", 5))
    robot = ScriptedRobot(momdp.x_names, *outcomes)
    eyes = ScriptedPercepts(*percepts)
    domain = load_domain("toy" if "lift" in momdp.behavior_names else "roc36_published")
    session = Session(
        task, momdp, policy, OutcomeChecker(domain), eyes, agent="script", truth=truth, **options
    )
    trial = run_trial(session, robot)
    assert robot.started == 1
    return trial


LIFTED = [(0, True), (0, False), (1, True), (0, False), (0, True)]  # one lift fails
PERCEPTS = [[1, 0], [1, 1], [1, 0]]
ACTIONS = ("look", "lift", "lift", "reinit", "look")


class TestAWholeTrial:
    @pytest.fixture(scope="class")
    @staticmethod
    def trial():
        momdp = momdp_of(mistaken=0.02, precision=9.0)
        return trial_of(momdp, Script(momdp, *ACTIONS), LIFTED, PERCEPTS)

    def test_costs_are_paid_for_every_execution(self, trial):
        """Eq. 4 and 6: t_a for every behavior, failed or not, and nothing for the report."""
        assert [step.cost for step in trial.steps] == [1, 5, 5, 2, 1, 0]
        assert [step.reward for step in trial.steps] == [-1, -5, -5, -2, -1, 100]
        assert trial.cost == 14
        assert trial.reward == 86

    def test_it_ends_with_the_report(self, trial):
        """Eq. 5."""
        np.testing.assert_array_equal(trial.report, [True, False])
        assert trial.success
        last = trial.steps[-1]
        assert (last.x, last.next_x, last.observation) == (0, trial.momdp.terminal, None)

    def test_steps_join(self, trial):
        assert [step.x for step in trial.steps] == [0, 0, 0, 1, 0, 0]
        assert [step.next_x for step in trial.steps] == [0, 0, 1, 0, 0, 2]
        names = [trial.momdp.action_name(step.decision.action) for step in trial.steps]
        assert names == [*ACTIONS, "report red, not heavy"]

    def test_beliefs_are_the_filter_s(self, trial):
        belief = initial_belief(trial.momdp)
        percepts = iter(PERCEPTS)
        np.testing.assert_array_equal(trial.first_belief.log_odds, belief.log_odds)
        for step, (next_x, perceived) in zip(trial.steps, LIFTED, strict=False):
            percept = np.array(next(percepts)) if perceived else None
            if percept is None:
                assert step.observation is None
            else:
                np.testing.assert_array_equal(step.observation, percept)
            transition = Transition(step.decision.action, next_x, percept)
            belief = update_belief(belief, trial.momdp, transition)
            assert step.belief.x == next_x
            np.testing.assert_array_equal(step.belief.log_odds, belief.log_odds)
            np.testing.assert_array_equal(step.belief.percept_counts, belief.percept_counts)
        np.testing.assert_array_equal(trial.last_belief.log_odds, belief.log_odds)
        assert trial.last_belief.x == trial.momdp.terminal

    def test_same_policy_sees_the_same_history(self, trial):
        momdp = trial.momdp
        policy = Script(momdp, *ACTIONS)
        told = []
        again = trial_of(momdp, policy, LIFTED, PERCEPTS, on_step=told.append)
        assert len(told) == len(again.steps) == 6
        assert all(first is second for first, second in zip(told, again.steps, strict=True))
        for k, history in enumerate(policy.histories):
            before = again.steps[:k]
            assert history.actions == tuple(step.decision.action for step in before)
            assert history.moved == tuple(step.next_x for step in before)
            assert history.perceived == tuple(step.observation is not None for step in before)
            assert history.cost == sum(step.cost for step in before)
            belief = before[-1].belief if before else again.first_belief
            np.testing.assert_array_equal(history.belief.log_odds, belief.log_odds)


@pytest.mark.parametrize(
    ("report", "right"), [((1, 0), True), ((0, 0), False), ((1, 1), False), ((0, 1), False)]
)
def test_reports_are_right_in_every_attribute_or_wrong(report, right):
    momdp = momdp_of(objective=Objective(correct=300.0, incorrect=-200.0))
    trial = trial_of(momdp, Script(momdp, report=report))
    assert trial.success == right
    assert trial.reward == (300.0 if right else -200.0)
    assert trial.cost == 0
    np.testing.assert_array_equal(trial.report, np.array(report, dtype=bool))


class Command:
    """Looks, and then commands an action whatever it is."""

    def __init__(self, momdp, action):
        self.momdp = momdp
        self.action = action

    def decide(self, history, rng):
        return unvalued(self.momdp, self.action if history.actions else 0)


@pytest.mark.parametrize("truth", [(True, False), None])
def test_not_knowing_ends_the_trial_without_a_report(truth):
    momdp = momdp_of(objective=Objective(abstain=True))
    policy = Command(momdp, momdp.abstention)
    trial = trial_of(momdp, policy, [(0, True)], [[1, 1]], truth=truth)
    assert trial.report is None
    assert trial.success is (None if truth is None else False)
    assert (trial.cost, trial.reward) == (1, -1)  # the look's
    assert [momdp.action_name(step.decision.action) for step in trial.steps] == ["look", "abstain"]


@pytest.mark.parametrize(
    ("action", "message"),
    [
        (2, "commands 'reinit' in 'x0', where only .*'look', 'lift'.* are legal"),
        (-1, "commands action -1; expected 0 to 6"),
        (7, "commands action 7; expected 0 to 6"),  # abstaining, of an agent that may not
        (99, "commands action 99; expected 0 to 6"),
    ],
)
def test_no_command_that_is_not_legal_reaches_the_robot(action, message):
    momdp = momdp_of()
    with pytest.raises(SettingsError, match=message):  # its next outcome would be StopIteration
        trial_of(momdp, Command(momdp, action), [(0, True)], [[1, 1]])


@pytest.mark.parametrize(
    ("options", "most"), [({"max_steps": 0}, 0), ({"max_steps": 7}, 7), ({}, 100)]
)
def test_endless_policies_report_after_the_last_step(options, most):
    momdp = momdp_of()
    policy = Script(momdp, *["look"] * 1000)
    outcomes = [(0, True)] * 1000
    percepts = [[1, 0]] * 1000
    trial = trial_of(momdp, policy, outcomes, percepts, **options)
    assert len(trial.steps) == most + 1
    assert trial.cost == most
    np.testing.assert_array_equal(trial.report, trial.last_belief.best_report)


def test_reports_after_the_last_step_are_not_replaced():
    momdp = momdp_of()
    policy = Script(momdp, "look", report=(0, 1))  # not the most probable values
    trial = trial_of(momdp, policy, [(0, True)], [[1, 0]], max_steps=1)
    np.testing.assert_array_equal(trial.report, [False, True])


class TestTruth:
    @pytest.mark.parametrize(
        ("labels", "expected"),
        [
            (None, [-1, -1]),
            ({}, [-1, -1]),
            ({"heavy": True}, [-1, 1]),
            ({"red": False, "heavy": None}, [0, -1]),
            ({"soft": True, "heavy": 0}, [-1, 0]),  # soft is not asked
            ([True, False], [1, 0]),
            (np.array([0, -1]), [0, -1]),
        ],
    )
    def test_it_may_be_known_in_part(self, labels, expected):
        truth = truth_of(Query(("red", "heavy")), labels)
        assert truth.tolist() == expected
        assert truth.dtype == np.int8

    @pytest.mark.parametrize("wrong", [{"red": "False"}, {"red": 257}, [True], [2, 0], "ab"])
    def test_mistakes_are_told(self, wrong):
        with pytest.raises(QueryError):
            truth_of(Query(("red", "heavy")), wrong)


def test_streams_are_named_by_the_task_and_the_planner_s_by_the_agent_too():
    task = Task("a task", Query(("red",)), 0, "object", ("toy", 3))
    other = Task("another", Query(("red",)), 0, "object", ("toy", 4))

    def draws(seed, task, agent):
        checker = OutcomeChecker(load_domain("toy"))
        session = Session(
            task, momdp_of(), None, checker, ScriptedPercepts(), agent=agent, seed=seed
        )
        return [session.streams.of(*name).random() for name in (("percepts",), ("planner", agent))]

    numbers = draws(1, task, "bayes")
    assert draws(1, task, "bayes") == numbers
    assert draws(1, task, "morc")[:1] == numbers[:1]
    assert draws(1, task, "morc")[1] != numbers[1]
    for changed in (draws(2, task, "bayes"), draws(1, other, "bayes")):
        assert not set(changed) & set(numbers)
    assert len(set(numbers)) == 2


@pytest.mark.parametrize("root", [0, 7, 2**32 - 1, 2**32, 2**127 + 5, 2**128, 2**200])
def test_the_name_of_a_stream_is_the_spawn_key_of_its_seed(root):
    names = (hashlib.blake2b(name, digest_size=8) for name in (b"text:robot", b"number:3"))
    key = np.frombuffer(b"".join(name.digest() for name in names), "<u4")
    spawned = np.random.PCG64(np.random.SeedSequence(root, spawn_key=key))
    assert stream(root, "robot", np.int64(3)).bit_generator.state == spawned.state


@pytest.mark.parametrize("root", [-1, 1.5])
def test_what_is_no_seed_is_refused(root):
    with pytest.raises((TypeError, ValueError)):
        stream(root, "robot")
