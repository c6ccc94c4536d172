"""Where percepts of a trial come from, and what of them is recorded."""

import numpy as np
from numpy.typing import NDArray

from meal_bayes.datasets import Instance
from meal_bayes.domain import Query
from meal_bayes.learner.experience import Experience, Key
from meal_bayes.perception import Perceiver
from meal_bayes.trials import Step, Trial


class Witness:
    """A perceiver that records the executions of a trial, with all that was perceived.

    Parameters
    ----------
    experience : Experience
        The record.
    trial : Trial
        Before its first step.
    perceiver : Perceiver
        The classifiers.
    drawn : Perceiver, optional
        Shows percepts drawn from tables in place of theirs.
    """

    def __init__(
        self,
        experience: Experience,
        trial: tuple[Key, str],
        perceiver: Perceiver,
        drawn: Perceiver | None = None,
    ) -> None:
        self._experience, (self._key, self._name) = experience, trial
        self._perceiver, self._drawn = perceiver, drawn
        self._every = Query(experience.domain.attributes)
        self._last: tuple[Instance, NDArray[np.int8]] | None = None
        self._known = experience.executions_of(self._key)  # before a restart

    def observe(
        self, instance: Instance, query: Query, rng: np.random.Generator
    ) -> NDArray[np.int8]:
        """Return percept levels of the queried attributes, (N,)."""
        levels = self._perceiver.observe(instance, self._every, rng)
        self._last = instance, levels
        if self._drawn is not None:
            return self._drawn.observe(instance, query, rng)
        return levels[self._experience.domain.columns(query.attributes)]

    def record(self, trial: Trial, step: Step) -> None:
        """Record an executed step; what was recorded before a restart is not recorded again."""
        last, self._last = self._last, None
        if step.decision.action >= trial.momdp.n_behaviors:
            return
        if self._known:
            self._known -= 1
            return
        record_step(self._experience, trial, step, last)


def record_trial(experience: Experience, trial: Trial) -> None:
    """Record the steps of a trial of another learner's, with what they show of the percepts."""
    for step in trial.steps:
        if step.decision.action < trial.momdp.n_behaviors:
            record_step(experience, trial, step)


def record_step(
    experience: Experience,
    trial: Trial,
    step: Step,
    perceived: tuple[Instance, NDArray[np.int8]] | None = None,
) -> None:
    """Record an executed step, of which only the queried attributes' percepts may be known.

    Parameters
    ----------
    experience : Experience
        The record.
    trial, step : Trial, Step
        The step, and its trial.
    perceived : tuple of Instance and (P,) array, optional
        What was sensed, and the percept levels of all attributes.
    """
    domain, momdp, e = experience.domain, trial.momdp, step.decision.action
    instance, levels = perceived or (None, None)
    shows = step.observation is not None
    if step.observation is not None and levels is None and domain.behaviors[e].modalities:
        levels = np.full(len(domain.attributes), -1, np.int8)
        levels[domain.columns(momdp.query.attributes)] = step.observation
    # When all recordings are used, a loop that succeeds looks as one that fails.
    before = step.belief.percept_counts[0, e].sum() - shows
    success = -1
    if momdp.legal[step.x, e] and before < momdp.limit[e]:
        success = int(shows or step.next_x != step.x)
    experience.execute(
        trial.task.key, trial.task.object_name, e, success=success, instance=instance,
        levels=levels, k=momdp.levels,
    )  # fmt: skip
