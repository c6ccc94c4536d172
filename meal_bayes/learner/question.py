"""Reading of questions into tasks, options of trials, and their checks."""

import re
import secrets
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.agents import Agent, LearningBonus
from meal_bayes.arrays import check_whole, check_yes_no, plain, real_vector
from meal_bayes.datasets import PerceptTable, object_index
from meal_bayes.domain import TERMINAL, Domain, Query, read_question, unknown
from meal_bayes.errors import LogError, SettingsError
from meal_bayes.learner.experience import Experience, Objects, unnamed
from meal_bayes.planners.solver import MAX_STEPS
from meal_bayes.robots import Robot
from meal_bayes.robots.robot import state_index
from meal_bayes.seeds import Key
from meal_bayes.trial_log.folder import LIVE
from meal_bayes.trials import Step, Task, Trial
from meal_bayes.trials.session import Limits
from meal_bayes.untrusted import name_fault

Question = str | Sequence[str] | Query | Task
NO_TABLE = "Give a robot, or fit a percept table (build_percept_table) to replay its objects."
NO_CLASSIFIERS = (
    "A percept table holds no classifiers for a robot's sensors; fit recordings (load_dataset), or "
    "ask about an object of the table."
)
IDLE = (
    "The agent {!r} answered without touching anything: it has learned nothing about what was "
    "asked, so it expects no behavior to be worth its cost, and it does not explore in order to "
    "learn. Give the learner recordings, or labels of objects that the robot has perceived, or use "
    "the agent 'bayes', which explores without any data."
)
LOST = ""  # in place of a state: the last trial was broken off, perhaps during a behavior
# A key by `QuestionCounts.next_key`.
_COUNTED = re.compile(r"(?P<test>test )?(?P<number>[0-9]{1,18})$")


@dataclass(frozen=True, slots=True)
class TrialOptions:
    """Options of a trial; `Learner.ask` and `Learner.begin` describe them."""

    truth: Mapping[str, bool] | ArrayLike | None = None
    learn: bool = True
    limit: ArrayLike = np.inf  # (E,) largest number of percepts of each behavior
    max_steps: int = MAX_STEPS
    max_cost: float | None = None
    on_step: Callable[[Step], None] | None = None
    commanded: bool = False
    beside: Objects = ()  # objects of the table whose labels are unknown, too, as in `find`
    seed: int | None = None  # seed of random draws; the learner's by default

    def __post_init__(self) -> None:
        Limits(self.max_steps, self.max_cost)  # which checks them
        check_yes_no("learn", self.learn)
        check_yes_no("commanded", self.commanded)
        if self.seed is not None:
            check_whole("seed", self.seed)
        if not (self.on_step is None or callable(self.on_step)):
            raise SettingsError(f"on_step is {self.on_step!r:.60}; give a function of a step.")

    def begun(self, state: str | None) -> dict[str, object]:
        """Return the options that a log stores, with the state, so that a trial can be resumed."""
        return {
            "state": state,
            "learn": self.learn,
            "max_steps": int(self.max_steps),
            "max_cost": None if self.max_cost is None else float(self.max_cost),
            "commanded": self.commanded,
            "seed": None if self.seed is None else int(self.seed),
        }


@dataclass(slots=True)
class QuestionCounts:
    """Numbers of questions with robots; tests are counted separately, so they change no stream."""

    lessons: int = 0
    tests: int = 0

    def next_key(self, *, learn: bool) -> str | int:
        """Return the name of the random streams of the next question."""
        return self.lessons if learn else f"test {self.tests}"

    def count(self, *, learn: bool, key: str | int | None = None) -> dict[str, str | int]:
        """Count a question, whose streams may have a key; return the entry for its log."""
        number = self.next_key(learn=learn)
        if learn:
            self.lessons += 1
        else:
            self.tests += 1
        if key is None:
            return {}
        self._skip(key)
        return {"asked": number}

    def count_resumed(self, header: Mapping[str, object]) -> None:
        """Count a question from before a restart, so that no later one uses its streams again."""
        self._skip(header.get("asked"))
        key = header.get("streams")
        if isinstance(key, list) and len(key) > 2 and key[1] == LIVE:
            self._skip(key[2])

    def _skip(self, key: object) -> None:
        """Prevent later questions from using a key, if it has the form of a counted key."""
        counted = _COUNTED.match(str(key))
        if counted is None:
            return
        questions = int(counted["number"]) + 1
        if counted["test"]:
            self.tests = max(self.tests, questions)
        else:
            self.lessons = max(self.lessons, questions)


def read_task(
    domain: Domain,
    table: PerceptTable | None,
    question: Question,
    object_name: str | None,
    *,
    key: str | int | None,
    answer: str = "values",
    payoffs: Sequence[float] | None = None,
) -> tuple[Task, Key]:
    """Read a question into a task; return it with the key of its random streams.

    The key of a task with a robot contains a random identity, which is unique over all sessions; so
    does the name of an object that was not named. Random draws depend on `key` instead.
    """
    if isinstance(question, Task | Query) and (answer != "values" or payoffs is not None):
        raise SettingsError(
            "A Query or a Task already contains the kind of answer and the payoffs; leave out "
            "answer= and payoffs=."
        )
    if isinstance(question, Task):
        if object_name not in (None, question.object_name):
            raise SettingsError(
                f"The task is about {question.object_name!r}, not about {object_name!r}; "
                "leave out the object's name."
            )
        return question, question.key
    key = plain(key)
    if not isinstance(key, str | int | None):
        raise SettingsError(f"key is {key!r:.60}; give text or a whole number.")
    if isinstance(key, str) and (fault := name_fault(key)):
        raise SettingsError(f"The key {key!a:.60} {fault}; give another.")
    query = question
    if not isinstance(query, Query):
        query = read_question(query, domain, answer, payoffs)
    text = question if isinstance(question, str) else query.text
    if table is not None:
        if object_name is None:
            raise SettingsError(NO_CLASSIFIERS)
        o = object_index(table.objects, object_name)
        named = () if key is None else ("key", key)
        replayed: Key = (table.domain.data, "ask", object_name, *query.attributes, *named)
        return Task(text, query, o, object_name, replayed), replayed
    identity = secrets.token_hex(8)
    name = unnamed(identity) if object_name is None else object_name
    drawn = f"object {key}" if object_name is None else object_name
    task = Task(text, query, -1, name, (domain.data, LIVE, identity, *query.attributes))
    return task, (domain.data, LIVE, 0 if key is None else key, drawn, *query.attributes)


def asked_again(task: Task) -> Task:
    """Return a task with a robot as another trial, whose key has a new identity."""
    if task.key[1:2] != (LIVE,):  # that of an experiment, which chooses its keys
        return task
    return replace(task, key=(task.key[0], LIVE, secrets.token_hex(8), *task.key[3:]))


def start_again(start: str, left: str | None) -> str:
    """Return the state in which a trial begins if none is given: the domain's start state.

    Raises
    ------
    SettingsError
        If the last trial left the robot in another state, or in an unknown one.
    """
    if left == LOST:
        raise SettingsError(
            "The last trial was broken off while a behavior may have been in progress, so the "
            f"state of the robot is not known. Bring the robot to {start!r} and give begin(..., "
            f"state={start!r}), or give its present state. ask() with a robot calls the robot's "
            "start() instead."
        )
    if left not in (None, start):
        raise SettingsError(
            f"The last trial left the robot in state {left!r}, but a trial begins in {start!r} by "
            f"default. Call begin(..., state={left!r}) if the robot is still there, or "
            f"begin(..., state={start!r}) after you have brought it there. ask() with a robot "
            "calls the robot's start() instead."
        )
    return start


def check_domain(domain: Domain, trial: Trial) -> None:
    """Raise `SettingsError` if a trial has other behaviors or attributes than the domain."""
    for name in trial.task.query.attributes:
        if name not in domain.attributes:
            says = unknown("attribute", name, domain.attributes)
            raise SettingsError(
                f"The trial {trial.task.name!r} belongs to another domain. {says} Load the domain "
                "of that trial, or add the attribute (add_attribute)."
            )
    theirs = trial.momdp.behavior_names
    ours = domain.behavior_names
    if theirs != ours:
        raise SettingsError(
            f"The trial {trial.task.name!r} has the behaviors {', '.join(theirs)}; this learner's "
            f"domain has {', '.join(ours)}. Load the domain of that trial."
        )


def check_resumed(trial: Trial, record: Experience, agent: Agent) -> None:
    """Raise an error if a trial cannot continue with a domain and an agent."""
    check_domain(record.domain, trial)
    end = "Load the learner that began it, or end it by give_up()."
    states = trial.momdp.x_names
    if tuple(states) != tuple(record.domain.diagram.states):
        raise LogError(
            f"The trial {trial.task.name!r} has the states {', '.join(states)}; this learner's "
            f"domain has {', '.join(record.domain.diagram.states)}. {end}"
        )
    if trial.momdp.levels != agent.levels:
        raise LogError(
            f"The trial {trial.task.name!r} has percepts of {trial.momdp.levels} levels, but those "
            f"of this learner's agent have {agent.levels}. {end}"
        )


def is_idle(trial: Trial, agent: Agent) -> bool:
    """Return whether an agent answered at once because it has learned nothing and does not explore.

    Agents with a `LearningBonus` explore what they do not know. The bonus of the paper is only for
    percepts with high entropy.
    """
    if isinstance(agent.exploration, LearningBonus) or len(trial.steps) != 1:
        return False
    counts = trial.counts
    nothing = counts is not None and not counts.any()
    # Without values, the agent did not compare behaviors with the answer.
    valued = np.isfinite(trial.steps[0].decision.values).any()
    return bool(nothing and valued and trial.report is not None)


def start_of(trial: Trial, start: str, state: str | None) -> str:
    """Return the first state of an interrupted trial, if the robot is in the last state of its log.

    The robot may have been moved since the interruption. A trial without steps began in `start`. If
    the trial has an answer already, no behavior follows, and the robot may be in any state.

    Raises
    ------
    SettingsError
        If `state` is None and there are several states.
    RobotError
        If the state is not possible.
    LogError
        If the robot is not in the last state of the log.
    """
    states = trial.momdp.x_names
    end = start
    if trial.steps:
        start = states[trial.steps[0].x]
        end = states[trial.steps[-1].next_x]
    if end == TERMINAL:
        return start
    if state is None:
        if len(states) > 2:  # and "term"
            raise SettingsError(
                f"The log ends with the robot in {end!r}, but the robot may have moved since then. "
                f"If it is still there, call resume(state={end!r})."
            )
        return start
    state_index(states, state, "resume(state=)")
    if state != end:
        raise LogError(
            f"The log ends with the robot in {end!r}, but it is now in {state!r}. Bring it to "
            f"{end!r} and resume again, or end the trial by give_up(), and ask again."
        )
    return start


def robot_or_name(
    robot: Robot | str | None, object_name: str | None
) -> tuple[Robot | None, str | None]:
    """Return the robot and the object's name; for a replay, a name can replace the robot."""
    if isinstance(robot, str):
        if object_name not in (None, robot):
            raise SettingsError(f"Two objects are named, {robot!r} and {object_name!r}; give one.")
        return None, robot
    return checked_robot(robot), object_name


def checked_robot(robot: Any) -> Robot | None:
    """Return a robot, or None without one; raise `SettingsError` for anything else."""
    acts = hasattr(robot, "start") and hasattr(robot, "execute")
    if isinstance(robot, type) or not (robot is None or acts):
        raise SettingsError(
            f"A robot is an object with start() and execute(behavior); found {robot!r:.60}."
        )
    return robot  # type: ignore[no-any-return]


def implied(report: NDArray[np.bool_], *, right: bool) -> NDArray[np.int8]:
    """Return the labels (N,) that a verdict on a report (N,) implies; -1 unknown.

    A wrong report about several attributes implies no label, because any of them may be wrong
    (Sect. 7.3).
    """
    said = real_vector("report", report) != 0
    if right:
        return np.asarray(said, np.int8)
    labels = 1 - said if len(said) == 1 else np.full(len(said), -1)
    return np.asarray(labels, np.int8)
