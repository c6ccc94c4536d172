"""What is learned from recordings: classifiers, and a posterior updated with every labeled trial.

`refit` learns everything anew: classifiers, how much objects differ, how their percepts err
together. Between refits these are constant, and a labeled trial is a conjugate update: the object's
percepts, over all its trials, are one row of counts.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.agents import (
    Agent,
    Environment,
    Knowledge,
    Recorder,
    Step,
    Streams,
    Task,
    Trial,
    run_trial,
)
from meal_bayes.agents.knowledge import knowledge_of
from meal_bayes.datasets import Dataset, TrainingSet
from meal_bayes.domain import Query
from meal_bayes.learner.labeled_trial import (
    LabeledTrial,
    Percept,
    RecordingPerceiver,
    extended,
    labels_of,
    level_counts,
)
from meal_bayes.perception import (
    Perception,
    PerceptionSettings,
    fit_and_validate,
    with_classifier,
)
from meal_bayes.posterior import ConfusionPosterior
from meal_bayes.robots import CheckedRobot, Robot
from meal_bayes.seeds import stream

Labels = NDArray[np.int8]


@dataclass(slots=True)
class Fitted:
    """Knowledge from a data set and from labeled trials.

    Attributes
    ----------
    dataset : Dataset
        What it was fitted on first.
    agent : Agent
        Who answers: its levels and its view of objects decide what is learned.
    classifier : scikit-learn classifier or None
        Of one's own, or ours.
    seed : int
        Of planning.
    reward : float or None
        r+ = -r-, the domain's by default.
    given : ConfusionPosterior or None
        Of one's own, in place of what the recordings imply; labeled trials are added to it.
    _rows, _labels : dict
        Of each object, its percept counts (P,E,2,K) and its labels (P,).
    _fitted : dict
        Both, as they were at the last refit.
    """

    dataset: Dataset
    agent: Agent
    classifier: object
    seed: int
    reward: float | None
    given: ConfusionPosterior | None
    perception: Perception = field(init=False)
    knowledge: Knowledge = field(init=False)
    _rows: dict[str, NDArray[np.int64]] = field(init=False)
    _labels: dict[str, Labels] = field(init=False)
    _fitted: dict[str, tuple[NDArray[np.int64], Labels]] = field(init=False)

    def __post_init__(self) -> None:
        domain = self.dataset.domain  # here, so that the first decision does not wait for it
        self.agent.warm_up(domain, Query(domain.attributes[:1]))

    def refit(self, labeled_trials: Sequence[LabeledTrial]) -> None:
        """Learn everything anew from the data set and from labeled trials with features."""
        data, levels = extended(self.dataset, labeled_trials), self.agent.levels
        settings = PerceptionSettings(levels=levels)
        if self.classifier is not None:
            settings = with_classifier(self.classifier, levels=levels)
        everything = TrainingSet.everything(data)
        self.perception, counts = fit_and_validate(data, everything, settings=settings)
        self.knowledge = knowledge_of(
            data.domain, counts, data.labels, object_level=self.agent.object_level
        )
        if self.given is not None:
            posterior = self._with_own(self.given, labeled_trials)
            self.knowledge = replace(self.knowledge, posterior=posterior)
        self._fitted = {
            name: (counts.counts[o], data.labels[o]) for o, name in enumerate(data.objects)
        }
        self._rows = {name: row for name, (row, _) in self._fitted.items()}
        self._labels = {name: labels for name, (_, labels) in self._fitted.items()}

    def _with_own(
        self, posterior: ConfusionPosterior, labeled_trials: Sequence[LabeledTrial]
    ) -> ConfusionPosterior:
        """Add the objects of labeled trials to a posterior, as rows of their own."""
        domain, levels = self.dataset.domain, self.agent.levels
        for name, labels in labels_of(labeled_trials, domain).items():
            own = [labeled for labeled in labeled_trials if labeled.object_name == name]
            row = level_counts(own, labels, domain, levels)
            posterior = posterior.replace_object(np.zeros_like(row), row)
        return posterior

    def learn(self, object_name: str, labeled_trials: Sequence[LabeledTrial]) -> None:
        """Update the posterior by all labeled trials of an object after the last refit."""
        domain, levels = self.knowledge.domain, self.agent.levels
        nothing = np.zeros((len(domain.attributes), len(domain.behaviors), 2, levels), np.int64)
        unknown = np.full(len(domain.attributes), -1, np.int8)
        row, labels = self._fitted.get(object_name, (nothing, unknown))
        given = labels_of(labeled_trials, domain).get(object_name, unknown)
        labels = np.where(given < 0, labels, given)
        row = row + level_counts(labeled_trials, labels, domain, levels)
        before = self._rows.get(object_name, nothing)
        self._rows[object_name], self._labels[object_name] = row, labels
        self.knowledge = self.knowledge.with_object(before, row, list(self._labels.values()))

    @property
    def state(self) -> dict[str, Any]:
        """All that was fitted and learned since, which `restore` reads."""
        rows, fitted = self._rows, list(self._fitted.values())
        return {
            "perception": self.perception,
            "knowledge": self.knowledge,
            "rows": dict(rows),
            "labels": dict(self._labels),
            "fitted_rows": dict(zip(self._fitted, (row for row, _ in fitted), strict=True)),
            "fitted_labels": dict(zip(self._fitted, (own for _, own in fitted), strict=True)),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore a state that was saved.

        Raises
        ------
        ValueError : arrays that do not fit the recordings.
        """
        p, e = len(self.dataset.domain.attributes), len(self.dataset.domain.behaviors)
        shape = (p, e, 2, self.agent.levels)
        self.perception, self.knowledge = state["perception"], state["knowledge"]
        rows, fitted = (dict(state[name]) for name in ("rows", "fitted_rows"))
        labels, own = (dict(state[name]) for name in ("labels", "fitted_labels"))
        for name, classifier in self.perception.classifiers.items():
            zeros = {m: np.zeros((1, self.sizes[name, m])) for m in classifier.spaces}
            if classifier.log_odds(zeros).shape != (1, p):
                raise ValueError(f"the classifiers of {name} do not fit the attributes")
        counted = [self.knowledge.posterior.counts, *rows.values(), *fitted.values()]
        labelled = [self.knowledge.base_rates, *labels.values(), *own.values()]
        if any(each.shape != shape for each in counted) or any(
            each.shape != (p,) for each in labelled
        ):
            raise ValueError("what was counted does not fit attributes, behaviors and levels")
        self._rows, self._labels = rows, labels
        self._fitted = {name: (row, own[name]) for name, row in fitted.items()}

    def known(self, object_name: str | None) -> Knowledge:
        """Return what is known; the same of every object."""
        return self.knowledge

    def run(
        self,
        task: Task,
        robot: Robot,
        *,
        known: Labels,
        truth: Mapping[str, bool] | ArrayLike | None = None,
        on_step: Callable[[Step], None] | None = None,
        recorder: Recorder | None = None,
    ) -> tuple[Trial, tuple[Percept, ...]]:
        """Answer a task with a robot; return the trial, and its percepts with their features.

        Parameters
        ----------
        known : (P,) labels that people gave to this object before; -1 unknown.
        """
        domain, agent = self.knowledge.domain, self.agent
        columns = domain.columns(task.query.attributes)
        momdp, policy = agent.prepare(
            task.query,
            self.knowledge,
            stream(self.seed, "solver", agent.name, *task.key),
            reward=self.reward,
            labels=known[columns],
        )
        perceiver = RecordingPerceiver(domain, self.perception)
        trial = run_trial(
            task,
            momdp,
            policy,
            Environment(
                CheckedRobot(robot, domain, sizes=self.sizes),
                perceiver,
                Streams.of(self.seed, task, agent.name),
                truth,
                self.knowledge.posterior.counts[columns],
            ),
            agent=agent.name,
            on_step=on_step,
            recorder=recorder,
        )
        return trial, tuple(perceiver.percepts)

    @property
    def sizes(self) -> dict[tuple[str, str], int]:
        """Number of features of each (behavior, modality)."""
        return {context: values.shape[2] for context, values in self.dataset.features.items()}

    @property
    def instances(self) -> NDArray[np.int64]:
        """Labelled percepts of each attribute and behavior, (P,E): delta x IE of Eq. 10."""
        return np.asarray(sum(row.sum(axis=(2, 3)) for row in self._rows.values()))
