"""What a trial leaves in the record: executions, what was sensed and perceived of them."""

from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents import Agent
from meal_bayes.arrays import Levels, lowest_yes
from meal_bayes.datasets import Instance
from meal_bayes.datasets.percepts import detected_levels
from meal_bayes.domain import Domain, Query, unknown
from meal_bayes.errors import LogError, SettingsError
from meal_bayes.learner.experience import NONE, Experience, Labels
from meal_bayes.learner.fit import Fit, OnStep
from meal_bayes.look import warn_user
from meal_bayes.momdp import MOMDP
from meal_bayes.momdp.belief import percepts_left
from meal_bayes.perception import Perception
from meal_bayes.trials import Step, Task, Trial


class RobotFit(Fit, Protocol):
    """What an agent knows that asks a robot: classifiers, for what its sensors say."""

    perception: Perception

    def perceive(self, instance: Instance) -> Labels:
        """Return the percept levels (P,) of what was sensed; -1 unknown."""


class RecordingPerceiver:
    """A perceiver that records the executions of a trial, with all that was perceived."""

    def __init__(
        self,
        fit: RobotFit,
        task: Task,
        momdp: MOMDP,
        lock: AbstractContextManager[Any],
        on_step: OnStep,
    ) -> None:
        self._fit = fit
        self._task = task
        self._momdp = momdp
        self._lock = lock
        self._on_step = on_step
        self._last: tuple[Instance, NDArray[np.int8]] | None = None
        number = fit.record.trials.get(task.key, -1)
        recorded = fit.record.executions.values["trial"] == number
        self._n_recorded = int(recorded.sum())  # steps, before a restart

    def observe(self, instance: Instance, query: Query, rng: np.random.Generator) -> Levels | None:
        """Return percept levels of the queried attributes, (N,), -1 where nothing came of one."""
        fit = self._fit
        domain = fit.record.domain
        spec = domain.behaviors[domain.behavior_index(instance.behavior)]
        if spec.answer_accuracy is None:
            levels = fit.perceive(instance)
        else:
            known = Query(fit.perception.domain.attributes)
            levels = fit.perception.observe(instance, known, rng)
        self._last = instance, levels
        if fit.settings.drawn is not None:  # of the learned tables, not those that came
            return fit.perceiver.observe(instance, query, rng)
        return np.asarray(levels[domain.columns(query.attributes)], np.int8)

    def record(self, step: Step) -> None:
        """Record an executed step; what was recorded before a restart is not recorded again."""
        last = self._last
        self._last = None
        if last is None and step.sensed is not None:  # before a restart, by the same classifiers
            last = step.sensed, self._fit.perceive(step.sensed)
        if self._n_recorded:
            self._n_recorded -= 1
        else:
            with self._lock:
                record_step(self._fit.record, self._task, self._momdp, step, last)
        if self._on_step is not None:
            self._on_step(step)


def check_domain(domain: Domain, trial: Trial) -> None:
    """Refuse a trial of other behaviors than a domain's, or about attributes that it lacks."""
    for name in trial.task.query.attributes:
        if name not in domain.attributes:
            says = unknown("attribute", name, domain.attributes)
            raise SettingsError(
                f"The trial {trial.task.name!r} is of another domain. {says} Load the domain of "
                "that trial, or add the attribute (add_attribute)."
            )
    theirs = trial.momdp.behavior_names
    ours = domain.behavior_names
    if theirs != ours:
        raise SettingsError(
            f"The trial {trial.task.name!r} has the behaviors {', '.join(theirs)}; this learner's "
            f"domain has {', '.join(ours)}. Load the domain of that trial."
        )


def check_resumed(trial: Trial, record: Experience, agent: Agent) -> None:
    """Refuse a trial that cannot go on with a domain and an agent: its steps mean other things."""
    check_domain(record.domain, trial)
    end = "Load the learner that began it, or end it by give_up()."
    states = trial.momdp.x_names
    if tuple(states) != tuple(record.domain.diagram.states):
        raise LogError(
            f"The trial {trial.task.name!r} has the states {', '.join(states)}; this learner's "
            f"domain has {', '.join(record.domain.diagram.states)}. {end}"
        )
    if trial.momdp.levels != agent.levels:
        raise LogError(
            f"The trial {trial.task.name!r} has percepts of {trial.momdp.levels} levels, those of "
            f"this learner's agent have {agent.levels}. {end}"
        )


def record_steps(record: Experience, trial: Trial, steps: Sequence[Step]) -> None:
    """Record steps of another learner's trial, or of a log; warn once of what cannot be held."""
    for step in steps:
        perceived = None
        if step.sensed is not None:
            perceived = step.sensed, record.no_labels
            _warn_of_modalities(record, step.sensed)
        record_step(record, trial.task, trial.momdp, step, perceived)


def _warn_of_modalities(record: Experience, sensed: Instance) -> None:
    """Warn once of features whose behavior has other modalities in this domain."""
    spec = record.domain.behaviors[record.domain.behavior_index(sensed.behavior)]
    modalities = ", ".join(sorted(sensed.features or ()))
    case = f"{spec.name} {modalities}"
    if (
        not modalities
        or {*(sensed.features or ())} == {*spec.modalities}
        or case in record.warned_of
    ):
        return
    record.warned_of.add(case)
    warn_user(
        f"The features of {spec.name} have the modalities {modalities}; the domain "
        f"{record.domain.name!r} has {', '.join(spec.modalities) or 'none'}. "
        "The features are ignored, and the percepts of the log are used. Load the domain of "
        "that log to learn from them."
    )


def record_step(
    record: Experience,
    task: Task,
    momdp: MOMDP,
    step: Step,
    perceived: tuple[Instance, NDArray[np.int8]] | None = None,
) -> None:
    """Record a step, with what was sensed and the levels (P,) where these are known; no report.

    A step that only shows the queried attributes' percepts is recorded with these.
    """
    domain = record.domain
    e = step.decision.action
    if e >= momdp.n_behaviors:
        return
    instance, levels = perceived or (None, None)
    if levels is not None:  # attributes may have been added since it was perceived
        more = len(domain.attributes) - len(levels)
        levels = np.pad(levels, (0, more), constant_values=-1)
    if instance is None and task.object_index >= 0:  # a replay, of which the log has percepts alone
        instance = Instance(task.object_index, domain.behaviors[e].name, NONE)
    percepts = None if instance is None else instance.percepts
    detected = detected_levels(percepts, domain, momdp.levels)
    if percepts is not None and (levels is None or (levels < 0).all()):
        levels = detected  # what it did not name was shown at even odds, and is no percept
    shows = step.observation is not None or (levels is not None and (levels >= 0).any())
    shows |= instance is not None and bool(instance.scores)
    unperceived = levels is None or (levels < 0).all()
    if step.observation is not None and unperceived and domain.behaviors[e].modalities:
        levels = record.no_labels
        levels[domain.columns(momdp.query.attributes)] = step.observation
    if step.observation is not None and domain.behaviors[e].asks:
        answers = record.no_labels
        said = np.asarray(step.observation)
        yes = said >= lowest_yes(momdp.levels)
        answers[domain.columns(momdp.query.attributes)] = np.where(said >= 0, yes, -1)
        record.add_answers(task.key, task.object_name, e, answers)
    # When all recordings are used, a loop that succeeds looks as one that fails; so does one whose
    # features cannot be read.
    left_before = percepts_left(momdp, step.belief)[e] + shows
    unread = step.unread and not shows and step.next_x == step.x
    success = -1
    if momdp.legal[step.x, e] and left_before > 0 and not unread:
        # Where the diagram does not lead, it was not meant to go.
        meant = momdp.transition[e, step.x, step.next_x] > 0
        success = int(shows or (step.next_x != step.x and meant))
    record.add_execution(
        task.key,
        task.object_name,
        e,
        success=success,
        instance=instance,
        levels=levels,
        detected=detected,
        n_levels=momdp.levels,
    )
