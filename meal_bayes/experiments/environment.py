"""The environment of an online run: recordings, true dynamics, and a person who gives feedback."""

import dataclasses
from collections.abc import Mapping

import numpy as np

from meal_bayes.domain import Domain
from meal_bayes.experiments.config import OnlineConfig
from meal_bayes.experiments.protocol import Protocol, Recordings
from meal_bayes.learner import Feedback, Learner
from meal_bayes.learner.percepts import record_step
from meal_bayes.perception.perceiver import answer
from meal_bayes.robots import Boundary, RecordedRobot
from meal_bayes.robots.recorded import Order
from meal_bayes.seeds import stream
from meal_bayes.trials import Task, Trial


class Environment:
    """The environment of an online run: recordings, true dynamics, a person."""

    def __init__(self, config: OnlineConfig, protocol: Protocol) -> None:
        self._config, self._data = config, protocol.dataset
        domain = protocol.dataset.domain
        rng = stream(config.seed, "world", domain.data, protocol.repeat)
        self._recordings = Recordings(protocol.dataset, rng)
        self._dynamics = true_dynamics(domain, dict(config.success))
        self._feedback = Feedback(config.answers, config.error)

    def test(self, learner: Learner, task: Task) -> Trial:
        """Run a test trial, on all recordings of the object."""
        order = stream(self._config.seed, "recordings", *task.key)
        return self._ask(learner, task, self._robot(task, order), learn=False)

    def train(self, learner: Learner, task: Task) -> Trial:
        """Run a training trial, and learn from its feedback before the next (Alg. 2, l. 5-23)."""
        robot = self._robot(task, self._recordings.supply(task.object_index))
        trial = self._ask(learner, task, robot, learn=True)
        self._tell(learner, trial)
        return trial

    def repeat(self, learner: Learner, trial: Trial) -> None:
        """Let a learner experience a trial that is logged; it perceives when it fits next."""
        task, domain = trial.task, self._data.domain
        robot = self._robot(task, self._recordings.supply(task.object_index))
        boundary = Boundary(domain, object_index=task.object_index)
        boundary.start(robot.start())
        for step in trial.steps:
            e, shown = step.decision.action, None
            if e >= trial.momdp.n_behaviors:
                continue
            done = boundary.execute(e, robot.execute(domain.behavior_names[e]))
            if done.instance is not None:
                shown = done.instance, np.full(len(domain.attributes), -1, np.int8)
            record_step(learner.experience, task, trial.momdp, step, shown)
        self._tell(learner, trial)

    def _ask(self, learner: Learner, task: Task, robot: RecordedRobot, *, learn: bool) -> Trial:
        columns = self._data.domain.columns(task.query.attributes)
        truth = self._data.labels[task.object_index, columns]
        return learner.ask(task, robot, truth=truth, learn=learn)

    def _tell(self, learner: Learner, trial: Trial) -> None:
        self._recordings.use(trial)
        rng = stream(self._config.seed, "feedback", *trial.task.key)
        labels = self._feedback.labels(trial, rng)
        pairs = zip(trial.task.query.attributes, labels.tolist(), strict=True)
        learner.tell(trial, {name: None if value < 0 else value == 1 for name, value in pairs})

    def _robot(self, task: Task, order: np.random.Generator | Order) -> RecordedRobot:
        seed, o = self._config.seed, task.object_index
        columns = self._data.domain.columns(task.query.attributes)
        rng = stream(seed, "percepts", *task.key)

        def person(accuracy: float) -> dict[str, bool]:
            said = answer(self._data.labels[o, columns], accuracy, 2, rng)
            return dict(zip(task.query.attributes, (said == 1).tolist(), strict=True))

        return RecordedRobot(
            self._dynamics, o, self._recordings.counts[o], order, stream(seed, "robot", *task.key),
            self._data, repeats=self._config.percepts == "model", person=person,
        )  # fmt: skip


def true_dynamics(domain: Domain, success: Mapping[str, float]) -> Domain:
    """Return the domain with other success probabilities."""
    for name in success:
        domain.behavior_index(name)  # or say what is wrong
    return dataclasses.replace(domain, diagram=domain.diagram.succeeding(success.get))
