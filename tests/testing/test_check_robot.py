"""Each rule that a robot owes is broken once, and told; the package's own robots keep them all."""

from typing import Any

import numpy as np
import pytest

from meal_bayes.datasets import make_synthetic
from meal_bayes.domain import TERMINAL, Domain, load_domain
from meal_bayes.errors import ConformanceError
from meal_bayes.robots import Outcome
from meal_bayes.robots.recorded import RecordedRobot
from meal_bayes.testing import check_robot

TOY = load_domain("toy")


class Arm:
    """A driver of the toy domain, with sizes of its own; faults are planted."""

    def __init__(self, domain: Domain = TOY, **faults: bool) -> None:
        self.domain = domain
        self.faults = faults
        self.rng = np.random.default_rng(0)
        self.buffer = np.zeros(3)
        self.count = 0
        self.arrays = domain.diagram.compile(domain.behavior_names)

    def start(self) -> str:
        self.x = self.domain.diagram.states.index(self.domain.diagram.start)
        if self.faults.get("starts nowhere"):
            return "somewhere"
        if self.faults.get("starts at the end"):
            return TERMINAL
        if self.faults.get("starts at a number"):
            return 0  # type: ignore[return-value]
        return self.domain.diagram.start

    def execute(self, behavior: str) -> Outcome:
        faults = self.faults
        index = self.domain.behavior_names.index(behavior)
        spec = self.domain.behaviors[index]
        before = self.x
        states = self.domain.diagram.states
        self.x = int(self.rng.choice(len(states), p=self.arrays.transition[index, before]))
        self.count += 1
        comes = self.rng.random() < self.arrays.observation_probability[index, before, self.x]
        features: dict[str, Any] | None = None
        if comes and spec.senses:
            features = {name: self.rng.normal(size=3) for name in spec.modalities}
        if faults.get("fails by an exception") and self.count > 3:
            raise OSError("no route to host")
        if faults.get("returns a pair"):
            return states[self.x], features  # type: ignore[return-value]
        if faults.get("comes to an unknown state"):
            return Outcome("lost", features)
        if faults.get("comes to the end"):
            return Outcome(TERMINAL, features)
        if faults.get("moves where nothing leads") and behavior == "look":
            return Outcome("x1", features)
        if faults.get("never senses"):
            features = None
        if faults.get("senses where it moves only") and not spec.senses:
            features = {"wrist": np.zeros(3)}
        if features:
            features = self.spoilt(features)
        if faults.get("answers unasked"):
            return Outcome(states[self.x], features, answers={"red": True})
        recording = "first" if faults.get("names its recording") else None
        return Outcome(states[self.x], features, recording=recording)  # type: ignore[arg-type]

    def spoilt(self, features: dict[str, Any]) -> dict[str, Any]:
        faults = self.faults
        first = next(iter(features))
        if faults.get("has features of changing size") and self.count > 3:
            features[first] = np.zeros(self.count)
        if faults.get("has features that are not numbers"):
            features[first] = np.full(3, np.nan)
        if faults.get("has features of text"):
            features[first] = "red"
        if faults.get("has a table of features"):
            features[first] = np.zeros((3, 3))
        if faults.get("lacks a modality"):
            del features[first]
        if faults.get("has a modality of its own"):
            features["lidar"] = np.zeros(3)
        if faults.get("writes over what it returned"):
            self.buffer[:] = self.count
            features[first] = self.buffer
        return features


FAULTS = {
    "starts nowhere": r"start\(\) .* unknown state",
    "starts at a number": r"start\(\) .* unknown state",
    "starts at the end": r"start\(\) .* 'term', .*expected one of x0, x1; return the state",
    "comes to the end": r"execute\(.*\) .* 'term', .*expected one of x0, x1; return the state",
    "comes to an unknown state": r"execute\(.*\) .* unknown state. Unknown state 'lost'",
    "moves where nothing leads": "came to .* In the domain, it leads only to",
    "returns a pair": r"returned tuple; return an Outcome\(state, features\)",
    "fails by an exception": "raised OSError: no route to host",
    "never senses": "never yielded a percept",
    "senses where it moves only": "modalities|percept although",
    "has features of changing size": r"shape \(4,\).*expected \(3,\)",
    "has features that are not numbers": "NaN or infinity",
    "has features of text": "text; expected real numbers",
    "has a table of features": r"shape \(3, 3\)",
    "lacks a modality": "is not among",
    "has a modality of its own": r"returned features of \['lidar'\]",
    "writes over what it returned": "have changed since. Return a copy",
    "answers unasked": "does not ask a person, but returned answers",
    "names its recording": "its recording is 'first', not a number",
}


@pytest.mark.parametrize("name", ["toy", "roc36", "ispy32", "cy101"])
def test_a_sound_robot_passes(name: str) -> None:
    domain = load_domain(name)
    if not any(behavior.answer_accuracy for behavior in domain.behaviors):
        check_robot(Arm(domain), domain, trials=20)


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_found(fault: str) -> None:
    with pytest.raises(ConformanceError, match=FAULTS[fault]) as told:
        check_robot(Arm(**{fault: True}), TOY, trials=20)
    assert "Arm" in str(told.value)
    assert "\n" not in str(told.value)


def test_what_is_no_robot_is_told() -> None:
    for found in (Arm, object(), None):
        with pytest.raises(
            ConformanceError, match=r"A robot is an object with start\(\) and execute"
        ):
            check_robot(found, TOY)  # type: ignore[arg-type]


@pytest.mark.parametrize("replayed", [True, False])
@pytest.mark.parametrize("name", ["toy", "roc36", "roc36_published", "ispy32", "cy101"])
def test_recorded_robots_pass(name: str, replayed: bool) -> None:
    domain = load_domain(name)
    order = np.random.default_rng(0)
    failures = np.random.default_rng(1)
    rng = np.random.default_rng(2)
    dataset = make_synthetic(domain, objects=4, recordings=20, rng=rng) if replayed else None
    robot = RecordedRobot(domain, 1, 20, order, failures, dataset=dataset, repeats=True)
    check_robot(robot, domain)


class Detector(Arm):
    """Names attributes itself, in place of features."""

    def __init__(self, percepts: Any) -> None:
        super().__init__()
        self.percepts = percepts

    def execute(self, behavior: str) -> Outcome:
        outcome = super().execute(behavior)
        if outcome.features is None:
            return outcome
        said = self.percepts() if callable(self.percepts) else self.percepts
        return Outcome(outcome.state, percepts=said)


@pytest.mark.parametrize("said", [{"red": True}, {"red": "surely no", "heavy": None}])
def test_a_detector_of_the_robots_own_passes(said: Any) -> None:
    check_robot(Detector(said), TOY)


SHARED: dict[str, bool] = {}


def written_again() -> dict[str, bool]:
    SHARED["red"] = not SHARED.get("red", False)
    return SHARED


@pytest.mark.parametrize(
    ("said", "found"),
    [
        ({"rad": True}, "Unknown attribute 'rad': did you mean 'red'"),
        ({"red": "maybe"}, "the percept of 'red' is 'maybe'"),
        ([True], r"percepts are \[True\]"),
        ({"red": None}, r"never yielded a percept.*percepts="),
        ({}, "never yielded a percept"),
        (written_again, "have changed since. Return a new dictionary"),
    ],
)
def test_faults_of_a_detector_are_found(said: Any, found: str) -> None:
    with pytest.raises(ConformanceError, match=found):
        check_robot(Detector(said), TOY)
