"""What a learner needs of a trial: its options, its task, its session, and a record of it."""

import secrets
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.arrays import Levels, check_whole, check_yes_no
from meal_bayes.datasets import Instance, PerceptTable, object_index
from meal_bayes.datasets.detections import detected_levels
from meal_bayes.datasets.percepts import classifier_levels
from meal_bayes.domain import Domain, Query, read_query
from meal_bayes.errors import SettingsError
from meal_bayes.learner.columns import NONE, Context
from meal_bayes.learner.experience import Experience
from meal_bayes.learner.fit import Fit, problem_of, solve
from meal_bayes.learner.held_out import HeldOut
from meal_bayes.learner.online import Online
from meal_bayes.momdp import MOMDP
from meal_bayes.planners import Policy
from meal_bayes.robots import OutcomeChecker, Robot
from meal_bayes.seeds import Key
from meal_bayes.trials import FaultTolerant, Session, Step, Task, Trial
from meal_bayes.trials.session import MAX_STEPS
from meal_bayes.untrusted import name_fault

Question = str | Sequence[str] | Query | Task
NO_CLASSIFIERS = (
    "A percept table holds no classifiers for a robot's sensors; fit recordings (load_dataset), or "
    "name an object of the table."
)


@dataclass(frozen=True, slots=True)
class TrialOptions:
    """How a trial is run; `Learner.ask` and `Learner.begin` say what each means."""

    truth: Mapping[str, bool] | ArrayLike | None = None
    learn: bool = True
    limit: ArrayLike = np.inf  # (E,) percepts of each behavior that the robot can show
    max_steps: int = MAX_STEPS
    max_cost: float | None = None
    on_step: Callable[[Step], None] | None = None
    commanded: bool = False
    abstain: bool = False  # whether it may, whatever its agent and domain say
    seed: int | None = None  # of what is drawn; the learner's by default

    def __post_init__(self) -> None:
        check_yes_no("learn", self.learn)
        check_yes_no("commanded", self.commanded)
        if self.seed is not None:
            check_whole("seed", self.seed)
        if not (self.on_step is None or callable(self.on_step)):
            raise SettingsError(f"on_step is {self.on_step!r:.60}; give a function of a step.")

    def begun(self, state: str | None) -> dict[str, object]:
        """Return what a log says of how a trial was begun, in a state, for who resumes it."""
        return {
            "state": state,
            "learn": self.learn,
            "max_steps": int(self.max_steps),
            "max_cost": None if self.max_cost is None else float(self.max_cost),
            "commanded": self.commanded,
            "seed": None if self.seed is None else int(self.seed),
        }


@dataclass(slots=True)
class Asked:
    """How many questions with robots a learner was asked; tests move no stream of lessons."""

    lessons: int = 0
    tests: int = 0

    def key(self, *, learn: bool) -> str | int:
        """Return what names the random streams of the next question."""
        return self.lessons if learn else f"test {self.tests}"

    def count(self, *, learn: bool) -> None:
        """Count a question."""
        if learn:
            self.lessons += 1
        else:
            self.tests += 1


def robot_or_name(
    robot: Robot | str | None, object_name: str | None
) -> tuple[Robot | None, str | None]:
    """Return a robot, and the object's name, which may stand in the robot's place for a replay."""
    if isinstance(robot, str):
        if object_name not in (None, robot):
            raise SettingsError(f"Objects {robot!r} and {object_name!r} are named; give one.")
        return None, robot
    driver: Any = robot  # users give anything
    acts = hasattr(driver, "start") and hasattr(driver, "execute")
    if isinstance(driver, type) or not (driver is None or acts):
        raise SettingsError(
            f"A robot is an object with start() and execute(behavior); found {driver!r:.60}."
        )
    return driver, object_name


def task_of(
    domain: Domain,
    table: PerceptTable | None,
    question: Question,
    object_name: str | None,
    key: str | int | None,
) -> tuple[Task, Key]:
    """Return the task of a question, and the key of its random streams.

    With a robot the task's own key has an identity that no other trial has, of whatever session,
    nor has an object without a name. What is drawn does not depend on it, but on `key`.
    """
    if isinstance(question, Task):
        if object_name not in (None, question.object_name):
            raise SettingsError(
                f"The task is about {question.object_name!r}, not about {object_name!r}; "
                "leave out the object's name."
            )
        return question, question.key
    if not isinstance(key, str | int | None):
        raise SettingsError(f"key is {key!r:.60}; give a text.")
    if isinstance(key, str) and (fault := name_fault(key)):
        raise SettingsError(f"The key {key!a:.60} {fault}; give another.")
    query = question if isinstance(question, Query) else read_query(question, domain)
    text = question if isinstance(question, str) else query.text
    if table is not None:
        if object_name is None:
            raise SettingsError(NO_CLASSIFIERS)
        o = object_index(table.objects, object_name)
        named = () if key is None else ("key", key)
        replayed: Key = (table.domain.data, "ask", object_name, *query.attributes, *named)
        return Task(text, query, o, object_name, replayed), replayed
    identity = secrets.token_hex(8)
    name = f"object {identity}" if object_name is None else object_name
    drawn = f"object {key}" if object_name is None else object_name
    task = Task(text, query, -1, name, (domain.data, "live", identity, *query.attributes))
    return task, (domain.data, "live", 0 if key is None else key, drawn, *query.attributes)


def session_of(
    fit: Fit,
    task: Task,
    key: Key,
    options: TrialOptions,
    *,
    lock: AbstractContextManager[Any],
    on_end: Callable[[Trial], None],
) -> Session:
    """Return the session of a task whose random streams `key` names; replays teach nothing."""
    domain = fit.record.domain
    learn = options.learn and isinstance(fit, Online)
    if isinstance(fit, Online):
        task = replace(task, learn=learn)
    with lock:
        momdp, policy = plan_of(fit, task, key, options, explore=learn)
        if learn:
            fit.record.trial(task.key)  # it is the learner's own from now on
    truth = options.truth
    if isinstance(truth, Mapping):
        truth = domain.labels(truth)[domain.columns(task.query.attributes)]
    perceiver = fit.perceiver
    on_step = options.on_step
    sizes: dict[Context, int] = {}
    if isinstance(fit, Online):
        perceiver = recorder = RecordingPerceiver(fit, task, momdp, lock, on_step)
        on_step = recorder.record if learn else on_step
        sizes = fit.expected_sizes
    checker = OutcomeChecker(fit.knowledge.domain, object_index=task.object_index, sizes=sizes)
    return Session(
        task,
        momdp,
        policy,
        checker,
        perceiver,
        agent=fit.agent.name,
        seed=fit.settings.seed if options.seed is None else options.seed,
        key=key,
        truth=fit.truth(task.query) if truth is None else truth,
        counts=fit.knowledge.posterior.counts[domain.columns(task.query.attributes)],
        max_steps=options.max_steps,
        max_cost=options.max_cost,
        on_step=on_step,
        on_end=on_end if learn else None,
    )


def plan_of(
    fit: Fit, task: Task, key: Key, options: TrialOptions, *, explore: bool
) -> tuple[MOMDP, Policy | None]:
    """Return the problem of a task and who decides; None where somebody commands."""
    if options.commanded:
        if isinstance(fit, HeldOut) and np.isinf(options.limit).all():
            momdp = fit.problem(task)
        else:
            momdp = problem_of(fit, task, options.limit)
        allows = options.abstain and not momdp.abstain
        return replace(momdp, abstain=True) if allows else momdp, None
    momdp, policy = fit.plan(task, key, limit=options.limit, explore=explore)
    if task.object_index < 0:  # recordings run out, the sensors of a robot fail
        domain = fit.record.domain
        usual = domain.diagram.compile(domain.behavior_names).transition
        policy = FaultTolerant(momdp, policy, partial(solve, fit, task, key), usual)
    return momdp, policy


class RecordingPerceiver:
    """A perceiver that records the executions of a trial, with all that was perceived."""

    def __init__(
        self,
        fit: Online,
        task: Task,
        momdp: MOMDP,
        lock: AbstractContextManager[Any],
        on_step: Callable[[Step], None] | None,
    ) -> None:
        self._fit = fit
        self._task = task
        self._momdp = momdp
        self._lock = lock
        self._on_step = on_step
        self._last: tuple[Instance, NDArray[np.int8]] | None = None
        number = fit.record.trials.get(task.key, -1)
        recorded = fit.record.executions.values["trial"] == number
        self._known = int(recorded.sum())  # before a restart

    def observe(self, instance: Instance, query: Query, rng: np.random.Generator) -> Levels | None:
        """Return percept levels of the queried attributes, (N,); None where there are none.

        An attribute of which a behavior has never shown anything is shown at even odds; that
        tells nothing, and is not counted.
        """
        fit = self._fit
        domain = fit.record.domain
        spec = domain.behaviors[domain.behavior_index(instance.behavior)]
        if spec.answer_accuracy is None:
            levels = fit.perceive(instance)
        else:
            levels = fit.perception.observe(instance, Query(domain.attributes), rng)
        self._last = instance, levels
        if fit.settings.drawn is not None:  # of the learned tables, not those that came
            return fit.perceiver.observe(instance, query, rng)
        if (levels < 0).all():
            return None
        columns = np.array(domain.columns(query.attributes))
        missing = columns[levels[columns] < 0]
        counts = fit.knowledge.posterior.counts[missing, domain.behavior_index(spec.name)]
        if counts.any():
            return None
        even = classifier_levels(np.zeros(1), fit.agent.levels)[0]
        return np.asarray(np.where(levels < 0, even, levels)[columns], np.int8)

    def record(self, step: Step) -> None:
        """Record an executed step; what was recorded before a restart is not recorded again."""
        last, self._last = self._last, None
        if last is None and step.sensed is not None:  # before a restart, by the same classifiers
            last = step.sensed, self._fit.perceive(step.sensed)
        if self._known:
            self._known -= 1
        else:
            with self._lock:
                record_step(self._fit.record, self._task, self._momdp, step, last)
        if self._on_step is not None:
            self._on_step(step)


def implied(report: NDArray[np.bool_], *, right: bool) -> NDArray[np.int8]:
    """Return the labels (N,) that a verdict on a report (N,) implies; -1 unknown.

    A wrong report of several attributes implies none, as any of them may be wrong (Sect. 7.3).
    """
    if right:
        return report.astype(np.int8)
    return (~report).astype(np.int8) if len(report) == 1 else np.full(len(report), -1, np.int8)


def check_behaviors(record: Experience, trial: Trial) -> None:
    """Refuse a trial of other behaviors than a record's."""
    theirs = trial.momdp.behavior_names
    ours = record.domain.behavior_names
    if theirs != ours:
        raise SettingsError(
            f"The trial {trial.task.name!r} has the behaviors {', '.join(theirs)}; this learner's "
            f"domain has {', '.join(ours)}. Load the domain of that trial."
        )


def record_step(
    record: Experience,
    task: Task,
    momdp: MOMDP,
    step: Step,
    perceived: tuple[Instance, NDArray[np.int8]] | None = None,
) -> None:
    """Record a step, with what was sensed and the levels (P,) where these are known; no report.

    A step that only shows the queried attributes' percepts is recorded with these.
    """
    domain = record.domain
    e = step.decision.action
    if e >= momdp.n_behaviors:
        return
    instance, levels = perceived or (None, None)
    if instance is None and task.object_index >= 0:  # a replay, of which the log has percepts alone
        instance = Instance(task.object_index, domain.behaviors[e].name, NONE)
    percepts = None if instance is None else instance.percepts
    detected = detected_levels(percepts, domain, momdp.levels)
    shows = step.observation is not None or (levels is not None and (levels >= 0).any())
    unknown = levels is None or (levels < 0).all()
    if step.observation is not None and unknown and domain.behaviors[e].modalities:
        levels = record.nothing
        levels[domain.columns(momdp.query.attributes)] = step.observation
    # When all recordings are used, a loop that succeeds looks as one that fails.
    before = step.belief.percept_counts[0, e].sum() - shows
    success = -1
    if momdp.legal[step.x, e] and before < momdp.limit[e]:
        # Where the diagram does not lead, it was not meant to go.
        meant = momdp.transition[e, step.x, step.next_x] > 0
        success = int(shows or (step.next_x != step.x and meant))
    record.execute(
        task.key,
        task.object_name,
        e,
        success=success,
        instance=instance,
        levels=levels,
        detected=detected,
        k=momdp.levels,
    )
