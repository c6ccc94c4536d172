"""A trial under way: the inner loop that Algorithms 1 and 2 share, as calls of the robot's driver.

A `Session` names the next behavior and is given its outcome by whoever drives the robot: a loop
(`run_trial`), a callback, or another thread, one call at a time. Between two steps nothing runs.
"""

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import wraps
from pathlib import Path
from typing import Concatenate, ParamSpec, Protocol, Self, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.arrays import check_kind, check_seconds, check_whole, plain_fields
from meal_bayes.errors import ImpossibleObservation, LogError, SettingsError
from meal_bayes.files import command_line
from meal_bayes.look import warn_user
from meal_bayes.momdp import MOMDP, Transition, best_answer, initial_belief, update_belief
from meal_bayes.perception import Perceiver
from meal_bayes.planners import Decision, History, Policy, unvalued
from meal_bayes.planners.solver import MAX_STEPS, decide
from meal_bayes.robots import Robot
from meal_bayes.robots.robot import Outcome, OutcomeChecker
from meal_bayes.seeds import Key, Streams
from meal_bayes.trials.perceiving import PerceptReader
from meal_bayes.trials.record import Step, Task, answer_step, truth_of
from meal_bayes.trials.trial import Trial

_OTHERWISE = (
    "At step {0}, the log continues with {1}, but the agent would now choose {2}, because it has "
    "learned something else since, or less. The trial continues after the steps in its log."
)


@dataclass(frozen=True, slots=True)
class Limits:
    """How long a trial may be; at a limit the best answer so far is given.

    Attributes
    ----------
    max_steps : int
        Behaviors.
    max_cost : float | None
        s; None: no limit.
    """

    max_steps: int
    max_cost: float | None = None

    def __post_init__(self) -> None:
        plain_fields(self)
        check_whole("max_steps", self.max_steps)
        check_seconds("max_cost", self.max_cost, or_none=True)

    def reached(self, steps: int, cost: float) -> str:
        """Return which limit forbids a behavior after so many steps, in words; empty: none.

        The cost, s, is that of the trial with this behavior.

        >>> Limits(100, 60.0).reached(3, 61.5)
        'max_cost = 60 s'
        """
        if steps >= self.max_steps:
            return f"max_steps = {self.max_steps}"
        if self.max_cost is not None and cost > self.max_cost:
            return f"max_cost = {self.max_cost:g} s"
        return ""


@runtime_checkable
class Recorder(Protocol):
    """Protocol of objects that record a trial while it runs, step by step.

    Examples
    --------
    >>> import meal_bayes
    >>> from pathlib import Path
    >>> class Printed:
    ...     path = Path("nowhere")
    ...     def begin(self, trial):
    ...         print("asked", trial.task.query.attributes)
    ...     def step(self, step):
    ...         print("executed", step.decision.action)
    ...     def end(self, trial):
    ...         print("reported", trial.report)
    >>> isinstance(Printed(), meal_bayes.Recorder)
    True
    """

    @property
    def path(self) -> Path:
        """Path of the file that holds the record."""

    def begin(self, trial: Trial) -> None:
        """Record a trial that has no steps yet."""

    def step(self, step: Step) -> None:
        """Record the next step."""

    def end(self, trial: Trial) -> None:
        """Record the whole trial after its end."""


class _Entrance:
    """Lets one call in; a copy of what holds it, in this process or another, has its own."""

    def __init__(self) -> None:
        self._held = threading.Lock()

    @contextmanager
    def taken(self, name: str) -> Iterator[None]:
        """Let a call in for a block; `SettingsError`, by the call's name, while one is inside."""
        if not self._held.acquire(blocking=False):
            raise SettingsError(
                f"{name} was called while another call of this session was in progress, in "
                "another thread or in a callback. A session accepts one call at a time: call it "
                "after the other call has returned. A callback can end the session by raising an "
                "exception."
            )
        try:
            yield
        finally:
            self._held.release()

    def __reduce__(self) -> tuple[type["_Entrance"], tuple[()]]:
        return _Entrance, ()


_Given = ParamSpec("_Given")
_Returned = TypeVar("_Returned")


def _alone(
    method: Callable[Concatenate["Session", _Given], _Returned],
) -> Callable[Concatenate["Session", _Given], _Returned]:
    """Make a session's method refuse to be called while another of its methods is inside."""

    @wraps(method)
    def called(
        session: "Session", /, *arguments: _Given.args, **options: _Given.kwargs
    ) -> _Returned:
        with session._entrance.taken(f"{method.__name__}()"):
            return method(session, *arguments, **options)

    return called


class Session:
    """A trial in progress (Algorithm 1, lines 6-11), whose loop over behaviors is your own code.

    Used as a context manager, a session ends the trial when the `with` block is left. If the robot
    has not answered by then, the record of the trial says why. An exception that leaves the block
    is recorded and reaches the caller. Any thread can call the methods, but only one thread at a
    time.

    Parameters
    ----------
    task : Task
        The question and the object.
    momdp : MOMDP
        The decision problem.
    policy : Policy | None
        Policy that chooses the behaviors; None if your program chooses them by `command`.
    checker : OutcomeChecker
        Checks the outcomes that the robot returns.
    perceiver : Perceiver
        Turns sensor data into percept levels.
    agent : str
        Name of the agent.
    seed : int
        Seed of the random draws. The stream of drawn percepts depends on the seed and the key, that
        of the policy also on the agent's name.
    key : Key | None
        Key of the random streams; by default the task's.
    truth : Mapping[str, bool] | ArrayLike | None
        The true attributes, see `truth_of`. The truth is only compared with the report; policy and
        belief do not use it.
    counts : NDArray[np.float64] | None
        (N,E,2,K) counts of the labeled percepts from which the MOMDP was learned. The counts are
        recorded but not used; see `Trial`.
    max_steps : int
        Maximum number of behaviors. After them, the session gives the best answer.
    max_cost : float | None
        Maximum cost in seconds. Instead of a behavior that would exceed it, the session gives the
        best answer.
    on_step : Callable[[Step], None] | None
        Called after every step.
    on_end : Callable[[Trial], None] | None
        Called once with the trial when it has ended, whatever the reason.
    on_start : Callable[[str], None] | None
        Called with the robot's state when the trial begins.
    on_lost : Callable[[], None] | None
        Called if the trial ends after `behavior` was read and before its outcome is observed. It is
        called only if this behavior can change the state. It is also called if the robot's `start`
        fails in `run_trial`, and there are several states.

    Examples
    --------
    >>> import meal_bayes
    >>> class Still:
    ...     def start(self):
    ...         return "ready"
    ...     def execute(self, behavior):
    ...         return meal_bayes.Outcome("ready")
    >>> learner = meal_bayes.Learner("toy", agent="prior", logs=None)
    >>> session = learner.begin("Is it red?", "a cup")
    >>> trial = meal_bayes.run_trial(session, Still())
    >>> session.behavior is None
    True
    """

    def __init__(
        self,
        task: Task,
        momdp: MOMDP,
        policy: Policy | None,
        checker: OutcomeChecker,
        perceiver: Perceiver,
        *,
        agent: str = "",
        seed: int = 0,
        key: Key | None = None,
        truth: Mapping[str, bool] | ArrayLike | None = None,
        counts: NDArray[np.float64] | None = None,
        max_steps: int = MAX_STEPS,
        max_cost: float | None = None,
        on_step: Callable[[Step], None] | None = None,
        on_end: Callable[[Trial], None] | None = None,
        on_start: Callable[[str], None] | None = None,
        on_lost: Callable[[], None] | None = None,
    ) -> None:
        self._entrance = _Entrance()
        self.task = task
        self.momdp = momdp
        self.agent = agent
        self.belief = self._first = initial_belief(momdp)
        self.history = History(self.belief)
        self.steps: list[Step] = []
        self.report: NDArray[np.bool_] | None = None
        self.limits = Limits(max_steps, max_cost)
        self._policy = policy
        self._checker = checker
        self._counts = counts
        self.key = task.key if key is None else key
        seed = check_whole("seed", seed)
        self.streams = Streams(seed, self.key)
        percept_rng = self.streams.of("percepts")  # the same for every agent
        self._warned = set[str]()  # excluded moves of which a person was warned
        self._percepts = PerceptReader(task, momdp, checker, perceiver, rng=percept_rng)
        self._truth = truth_of(task.query, truth)
        self._on_step = on_step
        self._on_end = on_end
        self._on_start = on_start
        self._on_lost = on_lost
        self._recorder: Recorder | None = None
        self._decision: Decision | None = None  # whose outcome is waited for
        self._behavior_known = False  # whether the caller knows that behavior, and may execute it
        self._running_part = "robot"  # for `Trial.ended`, if it raises
        self._starting = False  # whether the robot may be moving to where it starts
        self._begun = False
        self._ended: str | None = None
        self._start_x = momdp.start
        self._logged: tuple[Step, ...] | None = None  # steps of a log, behind which to decide yet

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _: object, fault: BaseException | None, __: object) -> None:
        if fault is None:
            self.cancel("left before the answer")
            return
        with ExitStack() as inside:
            try:
                inside.enter_context(self._entrance.taken("The end of its block"))
            except SettingsError as busy:  # what has to be told is the fault
                fault.add_note(f"the session has not ended: {busy}")
            else:
                self._end_by(fault)

    @_alone
    def record(self, recorder: Recorder) -> None:
        """Record the trial so far, and from now on each step before the next behavior begins."""
        self._recorder = recorder
        recorder.begin(replace(self.trial, steps=(), report=None, ended=""))
        for step in self.steps:
            recorder.step(step)
        if self._ended is not None:
            recorder.end(self.trial)

    def __repr__(self) -> str:
        """Return the trial so far."""
        return repr(self.trial)

    @property
    def behavior(self) -> str | None:
        """Name of the behavior to execute next; None if the session waits for no outcome."""
        self._decide_behind_log()
        if self._decision is None:
            return None
        self._behavior_known = True
        return self.momdp.behavior_names[self._decision.action]

    @property
    def begun(self) -> bool:
        """Whether the trial has begun; true also after its end."""
        return self._begun

    @property
    def over(self) -> bool:
        """Whether the trial has ended."""
        self._decide_behind_log()
        return self._ended is not None

    @property
    def trial(self) -> Trial:
        """The trial so far."""
        return Trial(
            task=self.task,
            agent=self.agent,
            momdp=self.momdp,
            first_belief=self._first,
            steps=tuple(self.steps),
            truth=self._truth,
            report=self.report,
            ended=self._ended or "",
            counts=self._counts,
        )

    @_alone
    def start(self, state: str, *, steps: Sequence[Step] = ()) -> Self:
        """Begin the trial in the robot's present state, and choose the first action.

        Parameters
        ----------
        state : str
            State of the robot; if you pass `steps`, its state before these steps.
        steps : Sequence[Step]
            Steps from the trial's log, which were executed before a restart. The trial continues
            after them. If the policy would now choose other behaviors, a warning names the first
            step that differs. The policy plans only when `behavior` or `over` is read or an outcome
            is observed, so a trial that is cancelled before that needs no planning.

        Raises
        ------
        RobotError
            The state is unknown, or impossible after the behavior.
        SettingsError
            The trial has begun already.
        """
        if self.begun:
            raise SettingsError("This trial has begun already; begin another trial.")
        self.belief = self.belief.at(self._checker.start(state))
        self._begun = True
        self._starting = False
        self._start_x = self.belief.x
        if self._on_start is not None:
            self._on_start(state)
        self.history = History(self.belief)
        for step in steps:
            self._repeat(step)
        if steps and self._policy is not None and self._ended is None:
            self._logged = tuple(steps)
        else:
            self._decide()
        return self

    @_alone
    def observe(self, outcome: Outcome, *, step: int | None = None) -> None:
        """Compute percepts from an outcome of `behavior`, update the belief, and choose again.

        To reject outcomes that arrive late or twice, pass as `step` the value that
        `len(session.steps)` had when the behavior was commanded.

        Raises
        ------
        SettingsError
            No behavior is in progress, or the outcome belongs to another step.
        RobotError
            The state is unknown, or impossible after the behavior.
        ImpossibleObservation
            The observation has probability 0 in the model.
        """
        self._repeat_decisions()
        decision = self._decision
        if decision is None:
            raise SettingsError("No behavior is in progress: the trial is over, or has not begun.")
        if step is not None and step != len(self.steps):
            raise SettingsError(
                f"The outcome belongs to step {step}, but the trial is at step "
                f"{len(self.steps)}: it came late or twice."
            )
        self._running_part = "robot"
        action = decision.action
        execution = self._checker.execute(action, outcome)
        self._running_part = "perceiver"
        x = self.belief.x
        # By the model nothing comes of a failure: a percept of it would have probability 0.
        if execution.next_x == x and not self.momdp.observation_probability[action, x, x]:
            execution = execution.failure()
        percept, warning = self._percepts.read(execution, action, self.history)
        next_x = execution.next_x
        excluded = self._excluded_move(x, action, next_x)
        warning = "; ".join(filter(None, (warning, excluded)))
        cost = self.momdp.charged_for(action, x, next_x, perceived=percept is not None)
        moved = Transition(action, next_x, percept)
        step_taken = Step(
            x=x,
            decision=decision,
            next_x=next_x,
            observation=percept,
            cost=cost,
            reward=-cost,
            belief=update_belief(self.belief, self.momdp, moved),
            warning=warning,
            # What a replay senses is in its data set.
            sensed=execution.instance if self.task.object_index < 0 else None,
        )
        self._decision, self._behavior_known = None, False
        self._append(step_taken)
        self._decide()
        if excluded and excluded not in self._warned:  # after the step is recorded, once a trial
            self._warned.add(excluded)
            warn_user(excluded)

    def _excluded_move(self, x: int, action: int, next_x: int) -> str:
        """Return a warning where the diagram of states excludes a move, else an empty text."""
        momdp = self.momdp
        # A behavior may fail, whatever the diagram says: the state is as it was.
        if next_x == x or momdp.transition[action, x, next_x] > 0:
            return ""
        before, after = momdp.x_names[x], momdp.x_names[next_x]
        return (
            f"{momdp.behavior_names[action]} led from {before!r} to {after!r}, which the diagram "
            "excludes: look where the object is, or add this effect to the domain"
        )

    def fail(self, *, step: int | None = None) -> None:
        """Record that `behavior` failed: the state did not change, and nothing was perceived."""
        index = len(self.steps) if step is None else step  # before the state: no later one's
        self.observe(Outcome(self.momdp.x_names[self.belief.x]), step=index)

    @_alone
    def cancel(self, why: str = "cancelled") -> None:
        """End the trial without a report. A trial that is over does not change."""
        if self._ended is None:
            self._end(why)

    @_alone
    def command(self, decision: Decision) -> None:
        """Choose a behavior or an answer in place of the policy.

        Raises
        ------
        SettingsError
            The trial is over, the problem does not have the action, or the action is not legal now.
        """
        if self._ended is not None:
            raise SettingsError("This trial is over; begin another trial.")
        if not isinstance(decision, Decision):
            raise SettingsError(f"command() takes a Decision; found {decision!r:.60}.")
        self._follow(decision)
        self._behavior_known = True

    def _repeat(self, step: Step) -> None:
        """Repeat a step of a log; the robot does not move, and nothing is decided.

        What was perceived is evidence for the model that is held now.
        """
        momdp = self.momdp
        action = step.decision.action
        if action >= momdp.n_behaviors:
            right = self.task.query.report_truth(self._truth)
            self._append(answer_step(momdp, self.belief, step.decision, right, step.warning))
            return
        moved = Transition(action, step.next_x, step.observation)
        try:
            belief = update_belief(self.belief, momdp, moved)
        except ImpossibleObservation:  # by what was learned since; the robot is there all the same
            belief = self.belief.at(step.next_x)
        self._append(replace(step, belief=belief))

    def _decide_behind_log(self) -> None:
        """Decide, if the steps of a log have been repeated and nothing was decided since."""
        if self._logged is not None:
            with self._entrance.taken("The first decision behind a log"):
                self._repeat_decisions()

    def _repeat_decisions(self) -> None:
        """Let the policy decide at each step of a log, then behind it.

        At the log's steps nothing follows of it, but that its random stream goes on where it stood
        if it decides as it did. Where it raises, the trial is as it was.
        """
        if self._logged is None or self._policy is None:
            return
        history = History(self._first.at(self._start_x))
        for number, step in enumerate(self._logged):
            decision = self._within(self._chosen(self._policy, history), history)[0]
            action = step.decision.action
            if decision.action != action and _OTHERWISE not in self._warned:
                self._warned.add(_OTHERWISE)
                then, now = (self.momdp.action_name(d.action) for d in (step.decision, decision))
                warn_user(_OTHERWISE.format(number, then, now))
            history = _after(history, self.steps[number])
        decided = self._within(self._chosen(self._policy, history), history)
        self._logged = None
        with _breaking(self._end_by):
            self._running_part = "planner"
            self._follow(*decided)
            self._running_part = "robot"

    def _chosen(self, policy: Policy, history: History) -> Decision:
        """Let the policy decide by what was done and perceived until then."""
        return decide(policy, history, self.streams.of("planner", self.agent))

    def _end_by(self, fault: BaseException) -> None:
        """End the trial by an exception, unless it is over."""
        if self._ended is None:
            with _noted(fault, self._recorder):
                text = f"{self._running_part} error: {type(fault).__name__}: {_text_of(fault)}"
                self._end(text.removesuffix(": "))

    def _decide(self) -> None:
        """Let the policy choose the next behavior, or the report that ends the trial."""
        self._decision = None
        self._running_part = "robot"
        if self._policy is None or self._ended is not None:
            return
        with _breaking(self._end_by):
            self._running_part = "planner"
            chosen = self._chosen(self._policy, self.history)
            self._follow(*self._within(chosen, self.history))
            self._running_part = "robot"

    def _within(self, decision: Decision, history: History) -> tuple[Decision, str]:
        """Return a decision, or the best answer where a limit is reached, with a warning."""
        if decision.action >= self.momdp.n_behaviors:
            return decision, ""
        cost = history.cost + self.momdp.charged(decision.action, failed=False)
        limit = self.limits.reached(len(history.actions), cost)
        if not limit:
            return decision, ""
        answer = unvalued(self.momdp, best_answer(self.momdp, history.belief))
        return answer, f"the best answer when {limit} was reached"

    def _follow(self, decision: Decision, answer_warning: str = "") -> None:
        """Wait for the outcome of a behavior, or end the trial with an answer."""
        momdp = self.momdp
        momdp.check_action(self.belief.x, decision.action)
        self._logged = None  # whoever commands decides behind a log
        decision = replace(decision, momdp=momdp)
        if decision.action < momdp.n_behaviors:
            self._decision = decision
            return
        # The truth is compared here alone; neither policy nor belief sees it.
        right = self.task.query.report_truth(self._truth)
        self._append(answer_step(momdp, self.belief, decision, right, answer_warning))

    def _append(self, step: Step) -> None:
        """Record a step, and end the trial where it leads to `term`."""
        self.steps.append(step)
        self.belief = step.belief
        self.history = _after(self.history, step)
        if step.decision.action >= self.momdp.n_behaviors:
            self.report = self.momdp.reported(step.decision.action)
        # On the disk before the next behavior is named: a robot may go on after a crash.
        with _breaking(self._end_by):
            if self._recorder is not None:
                self._running_part = "log"
                self._recorder.step(step)
            if self._on_step is not None:
                self._running_part = "on_step"
                self._on_step(step)
        if step.next_x == self.momdp.terminal:
            self._end("")

    def _end(self, why: str) -> None:
        self._ended = why
        self._logged = None
        if why and self._on_lost is not None and self._may_be_moving():
            self._on_lost()
        self._decision = None
        trial = self.trial
        try:
            if self._recorder is not None:
                self._recorder.end(trial)
        finally:  # what was executed is known, logged or not
            if self._on_end is not None:
                self._on_end(trial)

    def _may_be_moving(self) -> bool:
        """Whether the caller may be executing what can change the state."""
        if self._starting:
            return len(self.momdp.x_names) > 2  # and "term"
        decision = self._decision if self._behavior_known else None
        return decision is not None and bool(moves(self.momdp, self.belief.x)[decision.action])


def moves(momdp: MOMDP, x: int) -> NDArray[np.bool_]:
    """Return which behaviors are legal in state x and can lead to another state, (E,)."""
    leads_on = momdp.transition[:, x] > 0
    leads_on[:, [x, momdp.terminal]] = False
    return np.asarray(leads_on.any(axis=1) & momdp.legal[x])


def _after(history: History, step: Step) -> History:
    """Return the history behind a step."""
    return history.after(
        step.belief,
        step.decision.action,
        perceived=step.observation is not None,
        cost=step.cost,
        unread=step.unread,
    )


def _text_of(fault: BaseException) -> str:
    """Return the text of an exception; "" where the exception cannot be shown as text."""
    try:
        return str(fault)
    except Exception:  # of another package: the trial has to end all the same
        return ""


@contextmanager
def _breaking(end: Callable[[BaseException], None]) -> Iterator[None]:
    """End a trial where the block raises: the robot has moved, and nobody may wait for it."""
    try:
        yield
    except BaseException as fault:
        end(fault)
        raise


@contextmanager
def _noted(fault: BaseException, recorder: Recorder | None) -> Iterator[None]:
    """Let the block end a trial that a fault broke off, and note at the fault where its log is."""
    try:
        yield
    except LogError as unlogged:  # as where the disk is full: the fault itself says why
        fault.add_note(f"the end of the trial is not logged: {unlogged}")
    else:
        if recorder is not None:
            show = command_line("meal-bayes log show", recorder.path)
            fault.add_note(f"the trial, as far as it went: {show}")


def run_trial(session: Session, robot: Robot) -> Trial:
    """Run a trial to its end: execute the behaviors of a session until it gives an answer.

    If the session has begun already, `robot.start` is not called, and the robot must be in the
    state of the session. If the robot, the perceiver or the policy raises an exception, or the
    program is interrupted, the trial ends: the trial so far is recorded with the reason in `ended`,
    and the exception is raised again.

    Examples
    --------
    >>> import meal_bayes
    >>> class Still:
    ...     def start(self):
    ...         return "ready"
    ...     def execute(self, behavior):
    ...         return meal_bayes.Outcome("ready")
    >>> learner = meal_bayes.Learner("toy", agent="prior", logs=None)
    >>> session = learner.begin("Is it red?", "a cup")
    >>> trial = meal_bayes.run_trial(session, Still())
    >>> trial.agent
    'prior'
    """
    check_kind("session", session, Session)
    if not hasattr(robot, "execute"):
        raise SettingsError(f"robot is {robot!r:.60}; give one that has execute(behavior).")
    with session:
        if not session.begun:
            session._starting = True
            session.start(robot.start())
        while (behavior := session.behavior) is not None:
            session.observe(robot.execute(behavior))
    return session.trial
