"""The interface that the driver of a real robot implements, by names alone, and its checker.

What a robot returns is checked once, there, and becomes indices. Any robot may make frames for the
viewer.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.arrays import ByValue, is_whole
from meal_bayes.datasets import Instance, checked_features
from meal_bayes.datasets.percepts import Said, checked_percepts
from meal_bayes.domain import TERMINAL, Behavior, Domain, unknown
from meal_bayes.domain.diagram import TransitionArrays
from meal_bayes.errors import DataError, QueryError, RobotError
from meal_bayes.look import warn_user
from meal_bayes.robots.heard import Heard

Features = dict[str, NDArray[np.float32]]
Sizes = Mapping[tuple[str, str], int]  # (behavior, modality) -> D
NO_PERCEPT = "no percept"  # how a warning begins where what came could not be read
_RECORDINGS = 2**31  # that a data set may have


@dataclass(frozen=True, slots=True)
class Outcome(ByValue):
    """Result of one behavior, which a driver returns: the next state, and features or percepts.

    Attributes
    ----------
    state : str
        Name of the observed state after the behavior, one of the domain's states. The state is
        never "term", because only an answer leads to "term".
    features : Mapping[str, ArrayLike] | None
        Feature vector (D,) of each modality of the behavior; None if the behavior failed or has no
        modalities.
    answers : Mapping[str, bool | str | None] | None
        Answers of a person, if the behavior asks one: True or False for each attribute, or the name
        of a value for each group; None if there was no answer.
    recording : int | None
        Number of the recording, if the robot replays recordings. A real robot leaves it out.
    percepts : Mapping[str, bool | str | float | None] | None
        Outputs of the robot's own detector, with or without features. The output for an attribute
        is True or False, "yes", "no", "surely yes" or "surely no"; for a group it is the name of a
        value. Any other number is a score; a higher score means that the attribute is more probably
        true. Attributes that the detector leaves out are perceived from the features, if there are
        any.

    Examples
    --------
    >>> import meal_bayes
    >>> meal_bayes.Outcome("ready", {"color": [0.8, 0.1, 0.1]}).state
    'ready'
    """

    state: str
    features: Mapping[str, ArrayLike] | None = None
    answers: Mapping[str, bool | str | None] | None = None
    recording: int | None = None
    percepts: Mapping[str, bool | str | float | None] | None = None


@runtime_checkable
class Robot(Protocol):
    """Protocol of robots: an object with the methods `start` and `execute`.

    Examples
    --------
    >>> import meal_bayes
    >>> class Still:
    ...     def start(self):
    ...         return "ready"
    ...     def execute(self, behavior):
    ...         return meal_bayes.Outcome("ready")
    >>> isinstance(Still(), meal_bayes.Robot)
    True
    """

    def start(self) -> str:
        """Start a trial, and return the name of the state in which the robot is."""
        ...

    def execute(self, behavior: str) -> Outcome:
        """Execute a behavior, given by its name, and return its outcome.

        If the behavior fails, return only the present state of the robot and no features. An
        exception ends the trial.
        """
        ...


@dataclass(frozen=True, slots=True)
class Execution(ByValue):
    """A checked outcome, with the index of the next state.

    The instance can be perceived, None where the behavior failed or its features are invalid;
    answers are a person's, by attribute. The warning says why features or answers are invalid, if
    they are.
    """

    next_x: int
    instance: Instance | None = None
    answers: Mapping[str, bool] | None = None
    warning: str = ""

    def failure(self) -> "Execution":
        """Return it as a failure, of which nothing is perceived."""
        sensed = self.instance is not None or self.answers is not None
        warning = "it failed: what it sensed is left aside" if sensed else ""
        return Execution(self.next_x, warning=warning)


class _NoPercept(Exception):
    """The features or answers are invalid."""


class OutcomeChecker:
    """Check of what a robot returns: every outcome fits the domain, and names become indices.

    A state in which a robot cannot be raises a `RobotError`. A modality is left out, with a
    warning, if it is missing or if its features are not finite numbers. A modality with another
    number of features than those that were learned (`sizes`, if known) is kept, but not used for
    the percept. The percept is computed from the other modalities; if there are none, the trial
    continues without a percept. Modalities that the behavior does not have are ignored.
    `object_index` is the index of the object in the data set, or -1 if the object has no
    recordings. Outputs of a detector are compared with its earlier outputs, `heard`.
    """

    def __init__(
        self,
        domain: Domain,
        *,
        object_index: int = -1,
        sizes: Sizes | None = None,
        heard: Heard | None = None,
    ) -> None:
        self._domain = domain
        self._object = object_index
        self._sizes = {} if sizes is None else sizes
        self._heard = Heard() if heard is None else heard
        self._warned = set[str]()

    @property
    def usual(self) -> TransitionArrays:
        """The domain's diagram as arrays, which say how often behaviors succeed."""
        return self._domain.diagram.compile(self._domain.behavior_names)

    def start(self, state: object) -> int:
        """Return the index of the robot's first state; raise a `RobotError` if it is unknown."""
        return state_index(self._domain.diagram.states, state, "start()")

    def execute(self, behavior: int, outcome: object) -> Execution:
        """Return the checked outcome of a behavior; an unknown state raises a `RobotError`."""
        spec = self._domain.behaviors[behavior]
        if not isinstance(outcome, Outcome):
            raise RobotError(
                f"execute({spec.name!r}) returned {type(outcome).__name__}; "
                "return an Outcome(state, features)."
            )
        where = f"execute({spec.name!r})"
        next_x = state_index(self._domain.diagram.states, outcome.state, where)
        try:
            return self._perceived(spec, outcome, next_x)
        except _NoPercept as fault:
            why = " ".join(str(fault).split())  # a value may be shown on several lines
            return Execution(next_x, warning=f"{NO_PERCEPT} of {spec.name}: {why}")

    def _perceived(self, spec: Behavior, outcome: Outcome, next_x: int) -> Execution:
        accuracy = spec.answer_accuracy
        recording = _recording(outcome.recording)
        features = None
        warning = ""
        if accuracy is None and outcome.answers is not None:
            raise _NoPercept("it does not ask a person, but returned answers")
        sensed = outcome.features is not None or outcome.percepts is not None
        if accuracy is not None and sensed:
            raise _NoPercept("it asks a person; give answers, not features or percepts")
        said, warning = self._percepts(spec, outcome.percepts)
        if outcome.features is not None:
            features, fault = self._features(spec, outcome.features, alone=said is None)
            warning = "; ".join(filter(None, (warning, fault)))
        # A percept comes from features, a detector, or a recording that was scored before.
        if features is not None or recording is not None or said is not None:
            number = -1 if recording is None else recording  # what a sensor gives has none
            sure, scores = said or (None, None)
            instance = Instance(
                self._object, spec.name, number, features, sure or None, scores or None
            )
            return Execution(next_x, instance, warning=warning)
        if outcome.answers is None:
            return Execution(next_x, warning=warning)
        return Execution(next_x, answers=self._answers(outcome.answers))

    def _answers(self, said: Mapping[str, bool | str | None]) -> dict[str, bool]:
        """Return what a person said by attribute; of a group the value that is true says all."""
        if not isinstance(said, Mapping):
            raise _NoPercept(f"answers are {said!r:.60}, not {{attribute: True or False}}")
        for name, value in said.items():
            if not isinstance(value, bool | np.bool_ | str | None):
                raise _NoPercept(f"the answer {name!r}: {value!r} is not True or False")
        try:
            labels = self._domain.labels(said)
        except (DataError, QueryError) as fault:
            raise _NoPercept(str(fault)) from None
        pairs = zip(self._domain.attributes, labels.tolist(), strict=True)
        return {name: value == 1 for name, value in pairs if value >= 0}

    def _percepts(self, spec: Behavior, percepts: object) -> tuple[Said | None, str]:
        """Return what a detector says, None where that is nothing, and a warning of the rest."""
        if percepts is None:
            return None, ""
        if not spec.modalities:
            raise _NoPercept("it has no modalities; name one, such as that of the detector")
        try:
            said = checked_percepts(percepts, self._domain)
        except DataError as fault:
            raise _NoPercept(str(fault)) from None
        said, faults = self._heard.take(spec.name, said)
        if not faults:
            return said if any(said) else None, ""
        warning = f"percept of {spec.name}: {'; '.join(faults)}"
        if f"scores {spec.name}" not in self._warned:  # a person sees it once a trial
            warn_user(f"{warning}.")
            self._warned.add(f"scores {spec.name}")
        return said if any(said) else None, warning

    def _features(
        self, spec: Behavior, sensed: object, *, alone: bool
    ) -> tuple[Features | None, str]:
        """Return the valid features, and a warning of what is wrong with the others.

        Where they are not `alone`, but come with percepts, none may be valid.
        """
        if not isinstance(sensed, Mapping):
            raise _NoPercept(f"features are {type(sensed).__name__}, not {{modality: numbers}}")
        features = Features()
        faults = list[str]()
        showing = list[str]()
        for name in spec.modalities:  # what the domain does not know of is left aside
            try:
                features[name] = _checked(name, sensed)
            except _NoPercept as fault:
                faults.append(str(fault))
                continue
            size = self._sizes.get((spec.name, name), len(features[name]))
            if len(features[name]) == size:
                showing.append(name)
            else:
                faults.append(f"{name}: found shape {features[name].shape}; expected ({size},)")
        # One modality is enough: the classifiers' pool does without the others.
        why = "; ".join(faults) or "it has no modalities"
        if not showing and alone:
            if not features:
                raise _NoPercept(why)
            return features, f"{NO_PERCEPT} of {spec.name}: {why}"
        if not faults:
            return features, ""
        warning = f"percept of {spec.name} by {', '.join(showing) or 'its detector'} alone: {why}"
        if spec.name not in self._warned:  # a person sees it once a trial
            warn_user(warning)
            self._warned.add(spec.name)
        return features or None, warning


def state_index(states: Sequence[str], state: object, where: str) -> int:
    """Return the index of the state that a robot is in; a `RobotError` where it cannot be there.

    Of the states of a diagram the last, "term", is none of a robot's: an answer alone leads there.
    """
    possible = states[:-1]
    if isinstance(state, str) and state in possible:
        return possible.index(state)
    if isinstance(state, str) and state == TERMINAL:
        raise RobotError(
            f"{where} of the robot returned {TERMINAL!r}, which only an answer reaches; expected "
            f"one of {', '.join(possible)}; return the state that the robot is in."
        )
    message = unknown("state", str(state), possible)
    raise RobotError(f"{where} of the robot returned an unknown state. {message}")


def _recording(number: object) -> int | None:
    """Return which recording is replayed; -1 is of what a person answers, None of a real robot."""
    if number is None:
        return None
    if not is_whole(number) or not -1 <= number < _RECORDINGS:
        raise _NoPercept(f"its recording is {number!r:.60}, not a number of one; leave it out")
    return int(number)


def _checked(modality: str, sensed: Mapping[str, ArrayLike]) -> NDArray[np.float32]:
    """Return a modality's features (D,), of any size."""
    if modality not in sensed:
        raise _NoPercept(f"{modality} is not among {sorted(map(str, sensed))}")
    try:
        return checked_features(sensed[modality])
    except DataError as fault:
        raise _NoPercept(f"{modality}: {fault}") from fault


@dataclass(frozen=True, slots=True)
class Frame(ByValue):
    """The geometry of a robot and its surroundings at one moment, for the viewer.

    Attributes
    ----------
    seconds : float
        Time since the trial began, in seconds.
    centers, half_sizes : NDArray[np.float32]
        (B,3) centers of B boxes and balls, and half of their edges or radii, in meters.
    quaternions : NDArray[np.float32]
        (B,4) orientations of the boxes as quaternions x, y, z, w.
    colors : NDArray[np.float32]
        (B,3) colors: red, green and blue in [0, 1].
    shapes : NDArray[np.int8]
        (B,) kind of each body: `Frame.SOLID`, `Frame.SHELL` (a transparent box) or `Frame.BALL`.
    contacts, forces : NDArray[np.float32]
        (C,3) points of contact in meters, and the forces that act there in newtons.
    picture : NDArray[np.float32]
        (rows, columns, 3) image of the robot's camera, in [0, 1].

    Examples
    --------
    A red ball on a table, without contacts:

    >>> import numpy as np
    >>> from meal_bayes import Frame
    >>> none, pixels = np.zeros((0, 3)), np.zeros((4, 4, 3))
    >>> place, size = np.array([[0, 0, 0.02]]), np.full((1, 3), 0.02)
    >>> turned, red = np.array([[0, 0, 0, 1]]), np.array([[0.8, 0.1, 0.1]])
    >>> ball = np.array([Frame.BALL])
    >>> Frame(0.5, place, size, turned, red, ball, none, none, pixels).seconds
    0.5
    """

    seconds: float
    centers: NDArray[np.float32]
    half_sizes: NDArray[np.float32]
    quaternions: NDArray[np.float32]
    colors: NDArray[np.float32]
    shapes: NDArray[np.int8]
    contacts: NDArray[np.float32]
    forces: NDArray[np.float32]
    picture: NDArray[np.float32]

    SOLID: ClassVar[int] = 0
    SHELL: ClassVar[int] = 1
    BALL: ClassVar[int] = 2
