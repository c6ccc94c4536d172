"""The inner loop that Algorithms 1 and 2 share: decide, execute, perceive, filter."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.agents.trial import Step, Task, Trial, truth_of
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import MOMDP, Transition, best_report, initial_belief, update_belief
from meal_bayes.perception import Perceiver
from meal_bayes.planners import Decision, History, Policy, unvalued
from meal_bayes.robots import CheckedRobot, Execution
from meal_bayes.seeds import stream


class Streams(NamedTuple):
    """The random streams of one trial.

    Attributes
    ----------
    percepts : of percepts that are drawn from tables; the same for every agent.
    planner : of the agent.
    """

    percepts: np.random.Generator
    planner: np.random.Generator

    @classmethod
    def of(cls, seed: int, task: Task, agent: str) -> "Streams":
        """Return the streams that seed and task name, and for the planner the agent as well."""
        return cls(
            stream(seed, "percepts", *task.key),
            stream(seed, "planner", agent, *task.key),
        )


class Recorder(Protocol):
    """Writes a trial as it happens: each step before the next behavior is executed."""

    def begin(self, trial: Trial) -> None:
        """Record a trial that has no steps yet."""
        ...

    def step(self, step: Step) -> None:
        """Record the next step."""
        ...

    def end(self, trial: Trial) -> None:
        """Record the whole trial."""
        ...


@dataclass(frozen=True, slots=True)
class Environment:
    """What a trial runs in.

    Attributes
    ----------
    robot : in front of the object, behind its boundary.
    perceiver : turns sensor data into percept levels.
    streams : random streams of the trial.
    truth : see `truth_of`; compared with the report only, neither policy nor belief sees it.
    counts : labeled percepts behind the MOMDP, for the record alone; see `Trial`.

    Raises
    ------
    SettingsError : a robot without a boundary.
    """

    robot: CheckedRobot
    perceiver: Perceiver
    streams: Streams
    truth: Mapping[str, bool] | ArrayLike | None = None
    counts: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.robot, CheckedRobot):
            raise SettingsError(
                f"The robot is {type(self.robot).__name__}; hand it over as "
                "CheckedRobot(robot, domain), or ask by Learner.ask, which does."
            )


def run_trial(
    task: Task,
    momdp: MOMDP,
    policy: Policy,
    environment: Environment,
    *,
    agent: str = "",
    max_steps: int = 100,
    on_step: Callable[[Step], None] | None = None,
    recorder: Recorder | None = None,
) -> Trial:
    """Run one trial (Alg. 1, l. 6-11): decide, execute, perceive, filter, until `term`.

    An exception of robot, perceiver or policy, an interruption too, ends the trial: the recorder
    gets the trial so far, with `ended`, and the exception is raised again.

    Parameters
    ----------
    agent : name of the agent.
    max_steps : behaviors, after which the best report is made.
    on_step : called after every step.
    recorder : records every step before the next behavior is executed.

    Raises
    ------
    RobotError : the robot came to a state that the domain does not know.
    QueryError : a truth that does not fit the query.
    """
    running = RunningTrial(task, momdp, policy, environment)
    trial = running.trial(agent)
    if recorder is not None:
        recorder.begin(trial)
    try:
        running.start()
        while running.belief.x != momdp.terminal:
            step = running.step(max_steps)
            if recorder is not None:
                recorder.step(step)
            if on_step is not None:
                on_step(step)
    except BaseException as fault:
        if recorder is not None:
            said = f"{type(fault).__name__}: {fault}".removesuffix(": ")
            recorder.end(running.trial(agent, ended=f"{running.at} error: {said}"))
        raise
    trial = running.trial(agent)
    if recorder is not None:
        recorder.end(trial)
    return trial


class RunningTrial:
    """A trial under way: `start` it, then `step` until its belief is at `term`."""

    def __init__(self, task: Task, momdp: MOMDP, policy: Policy, environment: Environment) -> None:
        self.task, self.momdp, self.policy = task, momdp, policy
        self.environment, self.truth = environment, truth_of(task.query, environment.truth)
        self.belief = self.first = initial_belief(momdp)
        self.history = History(self.belief)
        self.steps: list[Step] = []
        self.report: NDArray[np.bool_] | None = None
        self.at = "robot"  # which part runs, for `Trial.ended`

    def trial(self, agent: str, *, ended: str = "") -> Trial:
        """Return the trial so far."""
        return Trial(
            self.task, agent, self.momdp, self.first, tuple(self.steps), self.truth, self.report,
            ended, self.environment.counts,
        )  # fmt: skip

    def start(self) -> None:
        """Start the robot, and move the belief to its state."""
        self.belief = self.belief.at(self.environment.robot.start())
        self.history = History(self.belief)

    def step(self, max_steps: int) -> Step:
        """Decide, execute and perceive, or report: after `max_steps` behaviors the best."""
        momdp, belief, history = self.momdp, self.belief, self.history
        self.at = "planner"
        decision = self.policy.decide(history, self.environment.streams.planner)
        if decision.action < momdp.n_behaviors and len(self.steps) >= max_steps:
            decision = unvalued(momdp, best_report(momdp, belief))
        if decision.action >= momdp.n_behaviors:
            step = self._report(decision)
        else:
            step = self._execute(decision)
        self.steps.append(step)
        self.belief = step.belief
        perceived = step.observation is not None
        self.history = history.after(step.belief, decision.action, perceived, step.cost)
        return step

    def _report(self, decision: Decision) -> Step:
        momdp, x = self.momdp, self.belief.x
        self.report = momdp.query.values_of(decision.action - momdp.n_behaviors)
        reward = float("nan")
        if (self.truth >= 0).all():
            reward = float(momdp.report_reward((self.report == self.truth).astype(float)))
        last = self.belief.at(momdp.terminal)
        return Step(x, decision, momdp.terminal, None, 0.0, reward, last)

    def _execute(self, decision: Decision) -> Step:
        action, belief, momdp = decision.action, self.belief, self.momdp
        self.at = "robot"
        execution = self.environment.robot.execute(action)
        self.at = "perceiver"
        observation, warning = self._perceive(execution)
        transition = Transition(action, execution.next_x, observation)
        after = update_belief(belief, momdp, transition)
        cost = momdp.step_cost(belief.x, action, execution.next_x)
        return Step(belief.x, decision, execution.next_x, observation, cost, -cost, after, warning)

    def _perceive(self, execution: Execution) -> tuple[NDArray[np.int8] | None, str]:
        """Return percept levels (N,), or None, and a warning."""
        query, answers, own = self.task.query, execution.answers, self.environment
        if execution.instance is not None:
            seen = own.perceiver.observe(execution.instance, query, own.streams.percepts)
            return seen, execution.warning
        if answers is None:
            return None, execution.warning
        missing = [name for name in query.attributes if name not in answers]
        if missing:
            return None, f"no percept: the person did not answer about {missing}"
        return _levels(query.attributes, answers, self.momdp.levels), ""


def _levels(names: Sequence[str], answers: Mapping[str, bool], levels: int) -> NDArray[np.int8]:
    """Return the percepts (N,) of a person's answers: the two extreme levels."""
    return np.array([levels - 1 if answers[name] else 0 for name in names], np.int8)
