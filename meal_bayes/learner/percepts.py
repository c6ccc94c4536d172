"""What a learner records of a trial: its percepts, and what a person says of the object."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import Levels
from meal_bayes.datasets import Instance, object_index
from meal_bayes.domain import Domain, Query
from meal_bayes.errors import DataError, QueryError, SettingsError
from meal_bayes.learner.experience import Experience, told
from meal_bayes.learner.fitted import Fitted, sampled
from meal_bayes.momdp import MOMDP
from meal_bayes.trial_log import Logs
from meal_bayes.trials import Step, Task, Trial

if TYPE_CHECKING:
    from meal_bayes.learner.learner import Learner


class Witness:
    """A perceiver that records the executions of a trial, with all that was perceived."""

    def __init__(
        self, learner: "Learner", task: Task, momdp: MOMDP, fit: Fitted,
        on_step: Callable[[Step], None] | None = None,
    ) -> None:  # fmt: skip
        self._learner, self._task, self._momdp, self._fit = learner, task, momdp, fit
        self._on_step = on_step
        self._last: tuple[Instance, NDArray[np.int8]] | None = None
        number, rows = learner.experience.trials.get(task.key, -1), learner.experience.executions
        self._known = int((rows.values[:, 0] == number).sum())  # before a restart

    def observe(self, instance: Instance, query: Query, rng: np.random.Generator) -> Levels:
        """Return percept levels of the queried attributes, (N,)."""
        domain = self._learner.domain
        levels = self._fit.perception.observe(instance, Query(domain.attributes), rng)
        self._last = instance, levels
        labels = self._fit.settings.drawn
        if labels is not None:  # percepts of the learned tables, in place of those that came
            return sampled(self._fit.refitted, labels).observe(instance, query, rng)
        return levels[domain.columns(query.attributes)]

    def record(self, step: Step) -> None:
        """Record an executed step; what was recorded before a restart is not recorded again."""
        last, self._last = self._last, None
        if self._known:
            self._known -= 1
        else:
            with self._learner.lock:
                record_step(self._learner.experience, self._task, self._momdp, step, last)
        if self._on_step is not None:
            self._on_step(step)

    def end(self, trial: Trial) -> None:
        """Learn from the trial: labels of an object that is recognized are known already."""
        experience, key = self._learner.experience, trial.task.key
        with self._learner.lock:
            experience.complete(key)
            self._learner.fits.update(experience.shown(key))


def recall(learner: "Learner", *logs: str | Path) -> list[Trial]:
    """Rebuild the experience of a learner from the logs of its robot's trials.

    What was executed, whether it succeeded and what it showed of the attributes asked is in a log;
    features and labels are not: labels can be told of the trials.
    Trials that the learner has had, or with other levels than its agent's, are passed over.

    Parameters
    ----------
    logs : str or Path
        Files, or folders of them.

    Returns
    -------
    trials : list[Trial]
        That are experience now, in their order.

    Raises
    ------
    LogError
        Logs that cannot be read, or of several data sets.
    SettingsError
        Trials of another domain.
    """
    experience, recalled = learner.experience, list[Trial]()
    with learner.lock:
        for group in Logs(*logs).groups():
            for trial in group.trials:
                known = trial.task.key in experience.trials
                if not known and trial.momdp.levels == learner.agent.levels:
                    record_trial(experience, trial)
                    recalled.append(trial)
        learner.refit()
    return recalled


def implied(report: NDArray[np.bool_], *, right: bool) -> NDArray[np.int8]:
    """Return the labels (N,) that a verdict on a report (N,) implies; -1 unknown.

    A wrong report of several attributes implies none, as any of them may be wrong (Sect. 7.3).
    """
    if right:
        return report.astype(np.int8)
    return (~report).astype(np.int8) if len(report) == 1 else np.full(len(report), -1, np.int8)


def tell(learner: "Learner", trial: Trial | str, values: Mapping[str, bool | None]) -> None:
    """Add labels of a trial's object, and update what was fitted; see `Learner.tell`."""
    experience = learner.experience
    labels = checked_labels(values, learner.domain)
    if not (labels >= 0).any():
        return
    name = trial.task.object_name if isinstance(trial, Trial) else trial
    if not isinstance(name, str):
        raise SettingsError(f"Labels are of a trial or an object's name; found {name!r:.60}.")
    key = trial.task.key if isinstance(trial, Trial) else told(name)
    if learner.table is not None:
        object_index(learner.table.objects, name)
    elif isinstance(trial, Trial) and key not in experience.trials:
        perceived = any(step.observation is not None for step in trial.steps)
        if perceived and trial.momdp.levels != learner.agent.levels:
            raise SettingsError("The trial has other levels; give one of this learner's.")
        record_trial(experience, trial)
    try:
        learner.domain.replace(experience.labels_for([name])[0], labels)
    except QueryError as fault:
        raise QueryError(f"Then {name!r} would be {fault}.") from None
    rows = experience.label(key, name, labels)
    learner.fits.update(rows, len(experience.shown(key)) * int((labels >= 0).sum()))


def checked_labels(values: Mapping[str, bool | None], domain: Domain) -> NDArray[np.int8]:
    """Return labels by attribute as an array (P,); -1 where there is none."""
    if not isinstance(values, Mapping):
        raise SettingsError(f"Labels are {values!r}; give {{attribute: True, False or None}}.")
    try:
        return domain.labels(values)
    except DataError as fault:
        raise SettingsError(str(fault)) from None


def record_trial(experience: Experience, trial: Trial) -> None:
    """Record the steps of a trial of another learner's, with what they show of the percepts."""
    theirs, own = trial.momdp.behavior_names, experience.domain.behavior_names
    if theirs != own:
        raise SettingsError(
            f"The trial {trial.task.name!r} has the behaviors {', '.join(theirs)}; this learner's "
            f"domain has {', '.join(own)}. Load the domain of that trial."
        )
    experience.trial(trial.task.key)
    for step in trial.steps:
        record_step(experience, trial.task, trial.momdp, step)


def record_step(
    experience: Experience, task: Task, momdp: MOMDP, step: Step,
    perceived: tuple[Instance, NDArray[np.int8]] | None = None,
) -> None:  # fmt: skip
    """Record a step, with what was sensed and the levels (P,) where these are known; no report.

    A step that only shows the queried attributes' percepts is recorded with these.
    """
    domain, e = experience.domain, step.decision.action
    if e >= momdp.n_behaviors:
        return
    instance, levels = perceived or (None, None)
    shows = step.observation is not None
    if step.observation is not None and levels is None and domain.behaviors[e].modalities:
        levels = np.full(len(domain.attributes), -1, np.int8)
        levels[domain.columns(momdp.query.attributes)] = step.observation
    # When all recordings are used, a loop that succeeds looks as one that fails.
    before = step.belief.percept_counts[0, e].sum() - shows
    success = -1
    if momdp.legal[step.x, e] and before < momdp.limit[e]:
        # Where the diagram does not lead, it was not meant to go.
        meant = momdp.transition[e, step.x, step.next_x] > 0
        success = int(shows or (step.next_x != step.x and meant))
    experience.execute(
        task.key, task.object_name, e, success=success, instance=instance,
        levels=levels, k=momdp.levels,
    )  # fmt: skip
