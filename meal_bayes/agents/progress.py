"""What a robot has learned when it plans a training trial, and how many questions are to come."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents.knowledge import Knowledge
from meal_bayes.arrays import ByValue, Floats, no_and_yes_of, plain_fields

_FIRST = 20.0  # questions that a robot expects before it was asked any


@dataclass(frozen=True, slots=True)
class Horizon:
    """Questions to come.

    A robot that is told no number expects as many as it was asked so far, and 20 more. That is the
    mean of a Pareto law [Lomax1954]: of all that were asked t questions, (20 + t) / (20 + t + m) to
    the square will be asked m more; these expect 20 + t + m then.

    Attributes
    ----------
    asked : int
        Questions of training trials so far.
    expected : float | None
        To come, where a person told a number.
    """

    asked: int = 0
    expected: float | None = None

    def __post_init__(self) -> None:
        plain_fields(self)

    @property
    def questions(self) -> float:
        """Questions to come, expected now."""
        return _FIRST + self.asked if self.expected is None else self.expected

    def after(self, trials: Floats | float) -> Floats:
        """Return the questions expected to come after some trials more, of any shape."""
        now = self.questions
        if self.expected is None:
            return np.asarray(now**2 / (now + trials))
        return np.maximum(now - trials, 0.0)


@dataclass(frozen=True, slots=True)
class Progress(ByValue):
    """What a robot has learned when it plans a training trial.

    Attributes
    ----------
    knowledge : Knowledge
        So far.
    horizon : Horizon
        Questions to come.
    reward : float
        r+ = -r- of a report.
    discount : float
        Factor a step, in planning.
    percepts : NDArray[np.float64]
        (P,E,2,2) labeled objects by truth and percept, no and yes; repeats share the one of their
        object, and what a classifier shows that cannot tell yet is half of each.
    told_fraction : float
        Fraction of the labels beyond one that people have told of an object, by Laplace's rule.
    unit : float
        Labeled instances that make one unit of experience, delta of Eq. 10.
    instances : NDArray[np.int64]
        (P,E) labeled instances: delta x IE of Eq. 10.
    objects : NDArray[np.int64]
        (P,E) objects with a labeled instance.
    fresh : NDArray[np.bool_]
        (P,E) whether the object at hand has none.
    labeled : NDArray[np.bool_]
        (P,) attributes of the object at hand that were labeled before and are remembered.
    """

    knowledge: Knowledge
    horizon: Horizon
    reward: float
    discount: float
    percepts: NDArray[np.float64]
    told_fraction: float
    unit: float
    instances: NDArray[np.int64]
    objects: NDArray[np.int64]
    fresh: NDArray[np.bool_]
    labeled: NDArray[np.bool_]

    @property
    def beta(self) -> NDArray[np.float64]:
        """Beta parameters (P,E,2,2) of the rates, no and yes by truth.

        The prior is uniform, or that of percepts which the robot brings.
        """
        posterior = self.knowledge.posterior
        prior = np.ones(self.percepts.shape)
        if posterior.given_prior is not None:
            given = posterior.given
            prior[given] = no_and_yes_of(posterior.given_prior)[given]
        return np.asarray(prior + self.percepts)
