"""The check of a robot's driver: states, features and answers, as the domain describes them."""

import warnings
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import check_whole
from meal_bayes.domain import Behavior, Domain, load_domain
from meal_bayes.errors import ConformanceError, RobotError
from meal_bayes.robots import Outcome, OutcomeChecker, Robot
from meal_bayes.robots.robot import Execution

_SOON = 3  # successes of a behavior that must have yielded a percept once


def check_robot(
    robot: Robot,
    domain: str | Path | Mapping[str, Any] | Domain,
    *,
    trials: int = 5,
    steps: int = 12,
    seed: int = 0,
) -> None:
    """Check the driver of a robot. **The robot moves:** it executes `trials` x `steps` behaviors.

    In each trial, the check executes behaviors that are legal in the present state, and prefers
    those that it has executed least often. The driver passes if all of the following hold:

    - States are states of the domain, and transitions are those of its diagram.
    - Features are finite numbers, belong to a modality of the behavior, and have the same size in
      all executions.
    - Percepts of a detector name attributes or groups of the domain.
    - Only behaviors that ask a person return answers.
    - An outcome does not change after it was returned.
    - A behavior with modalities yields a percept at least once in its first successful executions.

    Parameters
    ----------
    robot : Robot
        Driver with the methods `start()` and `execute(behavior)`. Put an object in front of the
        robot.
    domain : str, path, mapping or Domain
        Domain of the robot, as for `Learner`.
    trials, steps : int
        Number of trials, and maximum number of behaviors in each.
    seed : int
        Seed of the choice among behaviors that were executed equally often.

    Raises
    ------
    ConformanceError
        The check failed; the message says what was found, what was expected, and how to correct it.
    """
    name = type(robot).__name__
    candidate: Any = robot  # users give anything
    methods = (getattr(candidate, method, None) for method in ("start", "execute"))
    if isinstance(candidate, type) or not all(map(callable, methods)):
        raise ConformanceError(
            f"A robot is an object with start() and execute(behavior); found {candidate!r:.60}. "
            "Give an instance of a class that has these two methods."
        )
    for setting, value in (("trials", trials), ("steps", steps), ("seed", seed)):
        check_whole(setting, value)
    check = _Check(robot, load_domain(domain), name)
    rng = np.random.default_rng(seed)
    for _ in range(trials):
        check.trial(steps, rng)
    check.check_percepts()


class _Check:
    """A robot, its domain, and what was seen of it so far."""

    def __init__(self, robot: Any, domain: Domain, name: str) -> None:
        self.robot = robot
        self.domain = domain
        self.name = name
        self.diagram = domain.diagram.compile(domain.behavior_names)
        self.sizes = dict[tuple[str, str], int]()
        self.checker = OutcomeChecker(domain, sizes=self.sizes)
        self.executed = Counter[int]()
        self.succeeded = Counter[int]()
        self.perceived = Counter[int]()
        self.returned: list[tuple[str, NDArray[Any], NDArray[Any]]] = []  # and a copy of then
        self.detected: list[tuple[str, Any, dict[Any, Any]]] = []  # the same of percepts

    def fail(self, fault: str, mend: str) -> ConformanceError:
        return ConformanceError(f"{self.name}: {fault.removesuffix('.')}. {mend}")

    def trial(self, steps: int, rng: np.random.Generator) -> None:
        """Start, and execute the legal behaviors, the least executed ones first."""
        x = self.index(lambda: self.checker.start(self.call("start()", self.robot.start)))
        for _ in range(steps):
            legal = np.flatnonzero(self.diagram.legal[x]).tolist()
            if not legal:
                break
            rarely = min(self.executed[behavior] for behavior in legal)
            choices = [behavior for behavior in legal if self.executed[behavior] == rarely]
            behavior = int(rng.choice(choices))
            self.executed[behavior] += 1
            x = self.execute(behavior, x)
        self.check_returned()

    def execute(self, behavior: int, x: int) -> int:
        """Execute a behavior in state x, check its outcome, and return the next state."""
        spec = self.domain.behaviors[behavior]
        outcome = self.call(f"execute({spec.name!r})", lambda: self.robot.execute(spec.name))
        execution = self.index(lambda: self.checker.execute(behavior, outcome))
        if execution.warning:
            raise self.fail(
                f"{execution.warning}.",
                f"The domain says that {spec.name!r} has the modalities {list(spec.modalities)}; "
                "return a finite number for each feature, or a detector's percepts of its "
                "attributes, or neither where it failed.",
            )
        self.check_move(spec, x, execution.next_x)
        self.check_outcome(spec, outcome)
        expected = self.diagram.observation_probability[behavior, x, execution.next_x]
        self.check_sense(spec, execution, expected)
        self.succeeded[behavior] += bool(spec.senses and expected > 0)
        self.perceived[behavior] += execution.instance is not None or bool(execution.answers)
        return int(execution.next_x)

    def call(self, what: str, function: Any) -> Any:
        """Call the driver's own code."""
        try:
            return function()
        except Exception as fault:  # whatever it raises
            raise self.fail(
                f"{what} raised {type(fault).__name__}: {fault}.",
                "An exception ends a trial; for a behavior that failed, return the state that the "
                "robot is in and no features.",
            ) from fault

    def index(self, function: Any) -> Any:
        """Return what the package's own checker makes of a value; its error as one of ours."""
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # the same as in the execution, which is told
                return function()
        except RobotError as fault:
            raise ConformanceError(f"{self.name}: {fault}") from fault

    def check_move(self, spec: Behavior, x: int, next_x: int) -> None:
        """Check that the diagram leads there."""
        index = self.domain.behavior_names.index(spec.name)
        reached = np.flatnonzero(self.diagram.transition[index, x])
        if next_x not in reached:
            states = self.domain.diagram.states
            raise self.fail(
                f"{spec.name!r} in {states[x]!r} came to {states[next_x]!r}.",
                f"In the domain, it leads only to {[states[place] for place in reached]}; add the "
                "effect to the domain, or return the state in which the robot is.",
            )

    def check_outcome(self, spec: Behavior, outcome: Outcome) -> None:
        """Check what the package lets pass: sizes, modalities that are not the behavior's."""
        features = outcome.features or {}
        foreign = sorted(set(features) - set(spec.modalities))
        if foreign:
            raise self.fail(
                f"{spec.name!r} returned features of {foreign}.",
                f"The domain says that its modalities are {list(spec.modalities)}; add what is "
                "missing there, or leave it out here.",
            )
        for modality, values in features.items():
            array = np.asarray(values)
            self.sizes.setdefault((spec.name, modality), array.size)
            self.returned.append((f"{spec.name!r}, {modality}", array, array.copy()))
        if outcome.percepts is not None:
            self.detected.append((repr(spec.name), outcome.percepts, dict(outcome.percepts)))
        if spec.asks and outcome.answers is not None and not outcome.answers:
            raise self.fail(
                f"{spec.name!r} returned answers that are empty.",
                "Leave answers out where the person said nothing.",
            )
        whole = isinstance(outcome.recording, int | np.integer | None)
        if not whole or isinstance(outcome.recording, bool):
            raise self.fail(
                f"{spec.name!r} returned the recording {outcome.recording!r:.60}.",
                "Leave `recording` out; a robot that replays recordings gives their number.",
            )

    def check_sense(self, spec: Behavior, execution: Execution, expected: float) -> None:
        """Check that no percept comes where the diagram says that none can."""
        if execution.instance is not None and not (spec.senses and expected > 0):
            raise self.fail(
                f"{spec.name!r} yields a percept although the domain says that it cannot where "
                f"it leads to {self.domain.diagram.states[execution.next_x]!r}.",
                "Return no features where a behavior failed, or let its effect sense.",
            )

    def check_returned(self) -> None:
        """Check that earlier features are what they were: drivers like to reuse a buffer."""
        for where, array, then in self.returned:
            if not np.array_equal(array, then, equal_nan=array.dtype.kind in "fc"):
                raise self.fail(
                    f"features that were returned ({where}) have changed since.",
                    "Return a copy of a buffer that is written again.",
                )
        for name, percepts, percepts_then in self.detected:
            if dict(percepts) != percepts_then:
                raise self.fail(
                    f"percepts that were returned ({name}) have changed since.",
                    "Return a new dictionary each time.",
                )

    def check_percepts(self) -> None:
        """Check that every behavior that senses has yielded a percept."""
        silent = [
            self.domain.behaviors[behavior].name
            for behavior, count in sorted(self.succeeded.items())
            if count >= _SOON and not self.perceived[behavior]
        ]
        if silent:
            raise self.fail(
                f"{silent} never yielded a percept, although they led to states in which they "
                "yield percepts.",
                "Return Outcome(state, {modality: numbers}) or Outcome(state, percepts={attribute: "
                "True or False}), or take their modalities out of the domain.",
            )
