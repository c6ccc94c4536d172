"""The `Learner`: a robot's mind that is fitted, asked, told, and saved."""

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
from meal_bayes.learner.lesson import Key, Lesson, Percept, checked_values, labels_of, percepts_of
from meal_bayes.learner.live_log import logged, next_log
from meal_bayes.learner.replayed import Replayed
from meal_bayes.learner.sources import own_posterior, source_of
from meal_bayes.learner.tasks import live_task, replay_task
from meal_bayes.momdp import MOMDP
from meal_bayes.robots import Robot

_NO_CLASSIFIERS = (
    "A percept table holds no classifiers for what a robot feels; fit recordings (load_dataset), "
    "or name an object of the table."
)
_KEPT = 1000  # trials that nobody spoke of, whose features a refit could still learn from


class Learner:
    """Answers questions about objects, and learns from what people say of its answers.

    Fitted on recordings it works with any robot; on a percept table it replays the table's objects,
    each left out of what is known.

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
        What percepts say of attributes, learned elsewhere (`meal-bayes posterior`, PyMC; see
        `ConfusionPosterior.from_idata`), in place of what `fit` would learn of it. It needs the
        levels of the agent, and should know nothing of the objects that are asked about.
    reward : float, optional
        r+ = -r- of a report; the domain's by default.
    percepts : str
        In replays: "recorded", or "model", drawn from the learned confusion matrices.
    refit_every : int, optional
        Refit after so many labels told; only when asked to by default.
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
        self._lessons: dict[Key, Lesson] = {}
        self._refitted: set[Key] = set()  # lessons that the last refit learned from
        self._met: dict[Key, tuple[Percept, ...]] = {}  # of trials that nobody spoke of yet
        self.asked = 0  # questions, with robots

    def __repr__(self) -> str:
        """Return a line that says what it has learned from."""
        fitted = type(self._source).__name__.lower() if self._source else "not fitted"
        name, told = self.domain.name, len(self._lessons)
        return f"Learner({name}, agent {self.agent.name}, {fitted}, {told} trials told of)"

    @property
    def lessons(self) -> tuple[Lesson, ...]:
        """What people told, in order."""
        return tuple(self._lessons.values())

    @property
    def source(self) -> Replayed | Fitted:
        """What is known, by the kind of data that it was learned from.

        Raises
        ------
        SettingsError : nothing was fitted.
        """
        if self._source is None:
            raise SettingsError("This learner knows nothing yet; call fit(recordings) first.")
        return self._source

    def refitted(self, lesson: Lesson) -> bool:
        """Return whether the last refit has learned from a lesson."""
        return lesson.key in self._refitted

    def fit(self, data: Dataset | PerceptTable) -> Self:
        """Learn from recordings, or from a table of what classifiers said of them.

        What was told before is kept. Raises `SettingsError` for data of another domain.
        """
        self._source = source_of(self, data)
        return self.refit()

    def resume(
        self,
        data: Dataset | PerceptTable,
        lessons: Sequence[Lesson],
        refitted: Sequence[bool],
        state: Mapping[str, Any] | None = None,
    ) -> Self:
        """Come to the state of a learner with this data and these lessons, in order.

        `refitted` says of each lesson whether the last refit had learned from it; without the
        `state` of a `Fitted` everything is fitted again, with equal results.
        """
        pairs = list(zip(lessons, refitted, strict=True))
        self._lessons = {lesson.key: lesson for lesson, done in pairs if done}
        self._source = source_of(self, data)
        if state is not None and isinstance(self._source, Fitted):
            self._source.restore(state)
            self._refitted = set(self._lessons)
            self._lessons = {lesson.key: lesson for lesson in lessons}
            return self
        self.refit()
        self._lessons = {lesson.key: lesson for lesson in lessons}
        return self.refit() if isinstance(self.source, Replayed) else self._relearn(self.source)

    def refit(self) -> Self:
        """Learn everything anew from the data and from all that was told.

        Classifiers are fitted on the data and on the features of trials that people spoke of.
        """
        source = self.source
        if isinstance(source, Replayed):
            source.learn(self.lessons)
            return self
        kept = [lesson for lesson in self.lessons if lesson.refittable]
        source.refit(kept)
        self._refitted = {lesson.key for lesson in kept}
        return self._relearn(source)

    def knowledge(self, object_name: str | None = None) -> Knowledge:
        """Return what is known; of a percept table, what is known without one of its objects."""
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
        object_name : the object's name, if the robot's owner knows it again; what was told of it
            before is believed. Without a name it is an object of its own.
        on_step : called after every step.
        log : path of the trial's log (.mcap); one in the folder of logs by default.
        key : names the random streams of this question, and what is told of it; by default the
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
        told = labels_of(self.lessons, self.domain).get(task.object_name, unknown)

        def run(recorder: Recorder | None) -> Trial:
            trial, self._met[task.key] = source.run(
                task, robot, told=told, truth=truth, on_step=on_step, recorder=recorder
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
        return self._replayed().run(task, on_step=on_step, recorder=recorder)

    def problem(self, task: Task) -> MOMDP:
        """Return the decision problem of a task about an object of the percept table."""
        return self._replayed().problem(task)

    def tell(self, trial: Trial, values: Mapping[str, bool | None]) -> None:
        """Learn what the object of a trial is; the posterior is updated at once.

        How much objects differ, and how their percepts err together, hold until `refit`.

        Parameters
        ----------
        trial : an answer of this learner's.
        values : by attribute, also of attributes that were not asked; None tells nothing. What is
            told of a trial twice replaces what was told first.

        Raises
        ------
        QueryError : an attribute that the domain does not have.
        """
        source, key, name = self.source, trial.task.key, trial.task.object_name
        told = checked_values(values, self.domain)
        if not told:
            return
        if isinstance(source, Replayed):
            object_index(source.table.objects, name)
        elif trial.momdp.levels != self.agent.levels:
            raise SettingsError("The trial is of an agent with other levels; tell of one's own.")
        percepts = self._met.pop(key, None)
        if key in self._lessons:
            percepts = self._lessons.pop(key).percepts
        elif percepts is None:
            percepts = percepts_of(trial, self.domain)
        self._lessons[key] = Lesson(key, name, told, percepts)
        self._changed(source, key, name)
        labels = sum(len(lesson.values) for lesson in self._pending())
        if self.refit_every is not None and labels >= self.refit_every:
            self.refit()

    def forget(self, trial: Trial) -> None:
        """Forget what was told of a trial; where a refit has learned from it, refit without it."""
        lesson = self._lessons.pop(trial.task.key, None)
        if lesson is None:
            raise SettingsError(f"Nothing was told of the trial {trial.task.name!r}.")
        self._met[lesson.key] = lesson.percepts
        self._changed(self.source, lesson.key, lesson.object_name)

    def save(self, path: str | Path) -> None:
        """Write everything into one file, which `load` reads back."""
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

    def _changed(self, source: Replayed | Fitted, key: Key, object_name: str) -> None:
        if isinstance(source, Replayed):
            source.learn(self.lessons)
        elif key in self._refitted:
            self.refit()
        else:
            self._relearn(source, object_name)

    def _relearn(self, source: Fitted, *names: str) -> Self:
        """Take in the lessons of some objects, or of all, that came after the last refit."""
        pending = self._pending()
        for name in names or dict.fromkeys(lesson.object_name for lesson in pending):
            source.learn(name, [lesson for lesson in pending if lesson.object_name == name])
        return self

    def _pending(self) -> list[Lesson]:
        """Return the lessons that came after the last refit, or that it could not learn from."""
        return [lesson for lesson in self.lessons if lesson.key not in self._refitted]

    def _replayed(self) -> Replayed:
        source = self.source
        if isinstance(source, Fitted):
            raise SettingsError(
                "Objects are replayed from a percept table (build_percept_table); or give a robot."
            )
        return source

    def _header(self, question: object) -> dict[str, Any]:
        config = {"command": "Learner.ask", "question": str(question), "agent": self.agent.name}
        return {"config": config, "seed": self.seed, "data": self.domain.data}
