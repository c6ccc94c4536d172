"""What an online run is about, the same for every agent that works in it."""

from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents.experience import Feedback
from meal_bayes.agents.trial import Trial
from meal_bayes.datasets import Dataset
from meal_bayes.domain import Domain, unknown
from meal_bayes.errors import SettingsError
from meal_bayes.perception import Kernels
from meal_bayes.seeds import stream


@dataclass(frozen=True, slots=True)
class PublishedVariants:
    """What the authors' code does otherwise than the paper.

    Attributes
    ----------
    shaped_test : rewards are shaped in tests as well.
    sample_wise : tables are cross-validated over samples, so that classifiers saw the object.
    joint_label : every attribute gets the label of the whole query.
    model_percepts : percepts are drawn from the learned tables, without end.
    """

    shaped_test: bool = False
    sample_wise: bool = False
    joint_label: bool = False
    model_percepts: bool = False

    @classmethod
    def named(cls, *names: str) -> "PublishedVariants":
        """Return the variants of these names; "all" stands for every one.

        Raises
        ------
        SettingsError : an unknown name.
        """
        known = [own.name for own in fields(cls)]
        for name in names:
            if name not in (*known, "all"):
                raise SettingsError(unknown("published variant", name, known))
        return cls(**{name: name in names or "all" in names for name in known})


@dataclass(frozen=True, slots=True)
class RunContext:
    """The environment of an online run: data, true dynamics, feedback.

    Attributes
    ----------
    dataset : recordings and true labels.
    kernels : in the spaces of what the robot has before its first trial.
    scored : objects that queries will be about: their recordings are scored.
    counted : objects whose labelled instances are experience (Eq. 10).
    queries : about each attribute, to come; what a bonus for exploring plans for.
    reward : r+ = -r-.
    feedback : what a person says after a trial.
    true_dynamics : domain with the success probabilities of the robot; the agent plans with those
        of the data set.
    learn_success : whether success probabilities are learned, or taken from the domain.
    published : what is done as in the authors' code.
    """

    dataset: Dataset
    kernels: Kernels
    scored: NDArray[np.intp]
    counted: NDArray[np.intp]
    queries: float
    reward: float
    feedback: Feedback
    true_dynamics: Domain
    learn_success: bool = False
    published: PublishedVariants = field(default_factory=PublishedVariants)

    def labels_of(self, trial: Trial, seed: int) -> NDArray[np.int8]:
        """Return the labels (N,) that the feedback on a training trial implies; -1 unknown."""
        labels = self.feedback.labels(trial, stream(seed, "feedback", *trial.task.key))
        if self.published.joint_label:
            return np.where(labels < 0, labels, (labels == 1).all()).astype(np.int8)
        return labels
