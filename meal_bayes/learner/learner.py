"""The `Learner`: fitted on data, asked questions, updated by feedback, and saved."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from meal_bayes.agents import Agent, Knowledge, Recorder, Step, Task, Trial, as_agent
from meal_bayes.datasets import Dataset, PerceptTable, object_index
from meal_bayes.domain import Domain, Query, load_domain, read_query
from meal_bayes.errors import SettingsError
from meal_bayes.learner.fitted import Fitted
from meal_bayes.learner.labeled_trial import (
    Key,
    LabeledTrial,
    Percept,
    checked_values,
    labels_of,
    percepts_of,
)  # fmt: skip
from meal_bayes.learner.live_log import logged, next_log
from meal_bayes.learner.replayed import Replayed
from meal_bayes.learner.sources import own_posterior, source_of
from meal_bayes.learner.tasks import live_task, replay_task
from meal_bayes.momdp import MOMDP
from meal_bayes.robots import Robot

_NO_CLASSIFIERS = (
    "A percept table holds no classifiers for a robot's sensors; fit recordings (load_dataset), "
    "or name an object of the table."
)
_KEPT = 1000  # trials without feedback, whose features are kept


class Learner:
    """Answers questions about objects, and learns from feedback.

    Fitted on recordings it works with any robot; on a percept table it replays the table's objects,
    each left out of what was learned.

    Parameters
    ----------
    domain : str, path or Domain
        A shipped domain, the path of a TOML file, or a domain.
    agent : str, Agent, or planner
        Who decides: see `meal_bayes.agents.as_agent`.
    seed : int
        Of planning, and of what is drawn in replays.
    classifier : scikit-learn classifier, optional
        Of one's own, in place of ours: see `meal_bayes.perception.with_classifier`.
    posterior : InferenceData, DataTree or ConfusionPosterior, optional
        Of the confusion matrices, learned elsewhere (`meal-bayes posterior`, PyMC; see
        `ConfusionPosterior.from_idata`), in place of the one that `fit` would learn. It needs the
        levels of the agent, and should be learned without the objects that are asked about.
    reward : float, optional
        r+ = -r- of a report; the domain's by default.
    percepts : str
        In replays: "recorded", or "model", drawn from the learned confusion matrices.
    refit_every : int, optional
        Refit after so many labels; by default only when `refit` is called.
    logs : str or path, optional
        Folder of the logs of trials with a robot; None logs nothing.

    Examples
    --------
    >>> from meal_bayes import Learner, load_percepts
    >>> learner = Learner("roc36", agent="greedy", logs=None).fit(load_percepts("roc36"))
    >>> trial = learner.ask("Is it heavy?", "heavy_blue_beans")
    >>> trial.task.query.report_name(trial.report), trial.success
    ('heavy', True)
    """

    def __init__(
        self,
        domain: str | Path | Domain,
        *,
        agent: object = "bayes",
        classifier: object = None,
        posterior: object = None,
        seed: int = 0,
        reward: float | None = None,
        percepts: str = "recorded",
        refit_every: int | None = None,
        logs: str | Path | None = "logs",
    ) -> None:
        if seed < 0:
            raise SettingsError(f"seed is {seed}; give a whole number, 0 or more.")
        if refit_every is not None and refit_every < 1:
            raise SettingsError(f"refit_every is {refit_every}; give 1 or more, or None.")
        self.domain = domain if isinstance(domain, Domain) else load_domain(domain)
        self.agent: Agent = as_agent(agent)
        self.classifier = classifier
        self.posterior = own_posterior(posterior, self.domain, self.agent)
        self.seed, self.reward, self.percepts = seed, reward, percepts
        self.refit_every = refit_every
        self.logs = None if logs is None else Path(logs)
        self._source: Replayed | Fitted | None = None
        self._labeled_trials: dict[Key, LabeledTrial] = {}
        self._refitted: set[Key] = set()  # that the last refit used
        self._met: dict[Key, tuple[Percept, ...]] = {}  # of trials without feedback
        self.asked = 0  # questions, with robots

    def __repr__(self) -> str:
        """Return a line that says what it has learned from."""
        fitted = type(self._source).__name__.lower() if self._source else "not fitted"
        name, labeled = self.domain.name, len(self._labeled_trials)
        return f"Learner({name}, agent {self.agent.name}, {fitted}, {labeled} labeled trials)"

    @property
    def labeled_trials(self) -> tuple[LabeledTrial, ...]:
        """Trials whose object was labeled, in order."""
        return tuple(self._labeled_trials.values())

    @property
    def source(self) -> Replayed | Fitted:
        """What was learned, by the kind of data.

        Raises
        ------
        SettingsError : the learner is not fitted.
        """
        if self._source is None:
            raise SettingsError("This learner is not fitted yet; call fit(recordings) first.")
        return self._source

    def refitted(self, labeled: LabeledTrial) -> bool:
        """Return whether the last refit has used a labeled trial."""
        return labeled.key in self._refitted

    def fit(self, data: Dataset | PerceptTable) -> Self:
        """Learn from recordings, or from a percept table.

        Feedback given before is kept. Raises `SettingsError` for data of another domain.
        """
        self._source = source_of(self, data)
        return self.refit()

    def resume(
        self,
        data: Dataset | PerceptTable,
        labeled_trials: Sequence[LabeledTrial],
        refitted: Sequence[bool],
        state: Mapping[str, Any] | None = None,
    ) -> Self:
        """Restore the state of a learner with this data and these labeled trials, in order.

        `refitted` is whether the last refit had used each; without the `state` of a `Fitted` all is
        fitted again, with equal results.
        """
        pairs = list(zip(labeled_trials, refitted, strict=True))
        self._labeled_trials = {labeled.key: labeled for labeled, done in pairs if done}
        self._source = source_of(self, data)
        if state is not None and isinstance(self._source, Fitted):
            self._source.restore(state)
            self._refitted = set(self._labeled_trials)
            self._labeled_trials = {labeled.key: labeled for labeled in labeled_trials}
            return self
        self.refit()
        self._labeled_trials = {labeled.key: labeled for labeled in labeled_trials}
        return self._update()

    def refit(self) -> Self:
        """Learn everything anew from the data and from all labeled trials.

        Classifiers are fitted on the data and on the features of labeled trials.
        """
        if isinstance(self.source, Fitted):
            kept = [labeled for labeled in self.labeled_trials if labeled.refittable]
            self.source.refit(kept)
            self._refitted = {labeled.key for labeled in kept}
        return self._update()

    def knowledge(self, object_name: str | None = None) -> Knowledge:
        """Return what was learned; from a percept table, without one of its objects."""
        return self.source.known(object_name)

    def ask(
        self,
        question: str | Sequence[str] | Query,
        robot: Robot | str,
        *,
        truth: Mapping[str, bool] | ArrayLike | None = None,
        object_name: str | None = None,
        on_step: Callable[[Step], None] | None = None,
        log: str | Path | None = None,
        key: str | int | None = None,
    ) -> Trial:
        """Answer a question about the object in front of a robot.

        Every step is on disk before the next behavior is executed. Whatever ends the trial early
        (the robot's driver, an interruption) is raised once the trial is logged as far as it went.

        Parameters
        ----------
        question : a sentence ("Is it heavy?"), a comma list, attribute names, or a query.
        robot : see `Robot`; or the name of an object of the percept table, which is replayed.
        truth : {attribute: True or False} of what is known; compared with the report afterwards.
        object_name : the object's name, if it is recognized; then labels given before enter the
            prior. Without a name it is an object of its own.
        on_step : called after every step.
        log : path of the trial's log (.mcap); one in the folder of logs by default.
        key : names the random streams of this question, and its feedback; by default the
            number of questions so far, and in replays nothing, so that equal questions are equal.

        Raises
        ------
        QueryError : a question that cannot be understood.
        SettingsError : no data were fitted, or not of the kind that the robot needs.
        RobotError : the robot came to a state that the domain does not know.
        """
        query = question if isinstance(question, Query) else read_query(question, self.domain)
        source, header = self.source, self._header(question)
        if isinstance(robot, str):
            task = replay_task(query, self._replayed().table, robot, key)
            return logged(log, header, lambda to: self.replay(task, on_step=on_step, recorder=to))
        if isinstance(source, Replayed):
            raise SettingsError(_NO_CLASSIFIERS)
        task = live_task(query, self.domain, self.asked if key is None else key, object_name)
        self.asked += 1
        unknown = np.full(len(self.domain.attributes), -1, np.int8)
        known = labels_of(self.labeled_trials, self.domain).get(task.object_name, unknown)

        def run(recorder: Recorder | None) -> Trial:
            trial, self._met[task.key] = source.run(
                task, robot, known=known, truth=truth, on_step=on_step, recorder=recorder
            )
            if len(self._met) > _KEPT:
                del self._met[next(iter(self._met))]
            return trial

        if log is not None:
            return logged(log, header, run)
        with next_log(self.logs, self.domain.name, task.object_name) as path:
            return logged(path, header, run)

    def replay(
        self,
        task: Task,
        *,
        on_step: Callable[[Step], None] | None = None,
        recorder: Recorder | None = None,
    ) -> Trial:
        """Answer a task about an object of the percept table; equal tasks give equal trials."""
        return self._replayed().runner.run(task, on_step=on_step, recorder=recorder)

    def problem(self, task: Task) -> MOMDP:
        """Return the decision problem of a task about an object of the percept table."""
        return self._replayed().runner.prepare(task)[0]

    def tell(self, trial: Trial, values: Mapping[str, bool | None]) -> None:
        """Learn from labels of a trial's object; the posterior is updated at once.

        How much objects differ, and how their percepts err together, hold until `refit`.

        Parameters
        ----------
        trial : an answer of this learner's.
        values : by attribute, also of attributes that were not asked; None is ignored. Later labels
            of a trial replace earlier ones.

        Raises
        ------
        QueryError : an attribute that the domain does not have.
        """
        source, key, name = self.source, trial.task.key, trial.task.object_name
        labels = checked_values(values, self.domain)
        if not labels:
            return
        if isinstance(source, Replayed):
            object_index(source.table.objects, name)
        elif trial.momdp.levels != self.agent.levels:
            raise SettingsError("The trial has other levels; give a trial of this learner's.")
        percepts = self._met.pop(key, None)
        if key in self._labeled_trials:
            percepts = self._labeled_trials.pop(key).percepts
        elif percepts is None:
            percepts = percepts_of(trial, self.domain)
        self._labeled_trials[key] = LabeledTrial(key, name, labels, percepts)
        self._changed(key, name)
        pending = sum(len(labeled.values) for labeled in self._pending())
        if self.refit_every is not None and pending >= self.refit_every:
            self.refit()

    def forget(self, trial: Trial) -> None:
        """Forget the labels of a trial; refit without them if the last refit has used them."""
        labeled = self._labeled_trials.pop(trial.task.key, None)
        if labeled is None:
            raise SettingsError(f"The trial {trial.task.name!r} has no labels.")
        self._met[labeled.key] = labeled.percepts
        self._changed(labeled.key, labeled.object_name)

    def save(self, path: str | Path) -> None:
        """Write everything into one file, for `load`."""
        from meal_bayes.learner.saved import save_learner  # noqa: PLC0415

        save_learner(self, Path(path))

    @classmethod
    def load(
        cls,
        path: str | Path,
        *,
        agent: object = None,
        classifier: object = None,
        logs: str | Path | None = "logs",
    ) -> "Learner":
        """Read a learner from a file; only classifiers of one's own are fitted again.

        Parameters
        ----------
        path : written by `save`.
        agent, classifier : one's own are given again; shipped agents are found by name.
        logs : of a new learner.

        Raises
        ------
        DataError : a file that is not a learner, is torn, or of another version.
        """
        from meal_bayes.learner.saved import load_learner  # noqa: PLC0415

        return load_learner(Path(path), agent=agent, classifier=classifier, logs=logs)

    def _changed(self, key: Key, object_name: str) -> Self:
        return self.refit() if key in self._refitted else self._update(object_name)

    def _update(self, *names: str) -> Self:
        """Update by the labeled trials of some objects, or of all, after the last refit."""
        if isinstance(self.source, Replayed):
            self.source.learn(self.labeled_trials)
            return self
        pending = self._pending()
        for name in names or dict.fromkeys(one.object_name for one in pending):
            self.source.learn(name, [one for one in pending if one.object_name == name])
        return self

    def _pending(self) -> list[LabeledTrial]:
        """Return the labeled trials that came after the last refit, or that it could not use."""
        return [labeled for labeled in self.labeled_trials if labeled.key not in self._refitted]

    def _replayed(self) -> Replayed:
        if isinstance(self.source, Replayed):
            return self.source
        raise SettingsError("Give a robot, or fit a percept table (build_percept_table) to replay.")

    def _header(self, question: object) -> dict[str, Any]:
        config = {"command": "Learner.ask", "question": str(question), "agent": self.agent.name}
        return {"config": config, "seed": self.seed, "data": self.domain.data}
