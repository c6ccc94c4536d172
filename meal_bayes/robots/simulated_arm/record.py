"""Recording of every behavior on every object; what fails is tried again."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from numpy.typing import ArrayLike

from meal_bayes.datasets import Dataset
from meal_bayes.domain import Domain
from meal_bayes.errors import RobotError
from meal_bayes.robots.simulated_arm.arm import SimulatedArm
from meal_bayes.robots.simulated_arm.behaviors import GRASPED, LEGAL, LIFTED, READY
from meal_bayes.robots.simulated_arm.objects import ObjectParameters, attributes_of, draw_object

Recording = Mapping[tuple[str, str], ArrayLike]  # (behavior, modality) -> (D,)
Happened = Counter[tuple[str, str, str]]  # (state, behavior, state after, or `FAULT`)

ORDER = ("look", "press", "grasp", "lift", "hold", "lower", "shake", "drop", "push")
ATTEMPTS = 4  # at each behavior of a recording
FAULT = "fault"

_TOWARDS = {READY: "grasp", GRASPED: "lift"}  # what comes nearer to `LIFTED`


@dataclass(frozen=True, slots=True)
class Recorded:
    """The recordings of one object.

    Attributes
    ----------
    recordings : tuple[Recording, ...]
        The features of each recording, without the behaviors that never succeeded.
    happened : Happened
        Counts of (state, behavior, next state).
    """

    name: str
    parameters: ObjectParameters
    recordings: tuple[Recording, ...]
    happened: Happened


def record_object(
    number: int,
    *,
    recordings: int,
    seed: int,
    population: str = "training",
    alter: Callable[[ObjectParameters], ObjectParameters] | None = None,
) -> Recorded:
    """Record the object of that number in a population.

    Parameters
    ----------
    alter : Callable[[ObjectParameters], ObjectParameters] | None
        Changes what was drawn, for experiments on one parameter.
    """
    parameters, happened = draw_object(seed, population, number), Happened()
    if alter is not None:
        parameters = alter(parameters)
    rows = tuple(
        _record(SimulatedArm(parameters, seed, population, number, "recording", row), happened)
        for row in range(recordings)
    )
    return Recorded(f"object_{number:03d}", parameters, rows, happened)


def _record(arm: SimulatedArm, happened: Happened) -> Recording:
    found: dict[tuple[str, str], ArrayLike] = {}
    state = arm.start()
    for behavior in ORDER:
        for _ in range(ATTEMPTS):
            state, features = _attempt(arm, state, behavior, happened)
            if features is not None:
                found |= {(behavior, modality): values for modality, values in features.items()}
                break
    return found


def _attempt(
    arm: SimulatedArm, state: str, behavior: str, happened: Happened
) -> tuple[str, Mapping[str, ArrayLike] | None]:
    """Execute a behavior once it is legal; return the state, and the features of a success."""
    while True:
        here = state in LEGAL[behavior]
        step = behavior if here else _way(state, LEGAL[behavior])
        try:
            outcome = arm.execute(step)
        except RobotError:
            happened[state, step, FAULT] += 1
            return arm.start(), None
        happened[state, step, outcome.state] += 1
        slipped = step in _TOWARDS.values() and outcome.state not in (GRASPED, LIFTED)
        state = outcome.state
        if here or slipped:
            return state, outcome.features if here else None


def _way(state: str, goals: tuple[str, ...]) -> str:
    """Return a behavior that leads from a state towards one of the goals."""
    reachable = state in _TOWARDS and READY not in goals
    return _TOWARDS[state] if reachable else "reinit"


def to_dataset(domain: Domain, recorded: Sequence[Recorded]) -> Dataset:
    """Join the recordings of objects, labeled by what their parameters make true.

    Where a behavior never succeeded, the object has fewer recordings of it.
    """
    contexts = [(b.name, modality) for b in domain.behaviors for modality in b.modalities]
    features = {
        context: {
            one.name: rows
            for one in recorded
            if (rows := [row[context] for row in one.recordings if context in row])
        }
        for context in contexts
    }
    labels = {one.name: attributes_of(one.parameters) for one in recorded}
    return Dataset.from_frames(domain, features, labels)
