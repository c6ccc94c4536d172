"""The `Learner`: an agent and its experience; asked questions, updated by feedback, and saved."""

import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from meal_bayes.agents import Agent, Knowledge, as_agent
from meal_bayes.agents.agent import TRUST
from meal_bayes.datasets import Dataset, PerceptTable, object_index
from meal_bayes.domain import Domain, Query, load_domain
from meal_bayes.errors import SettingsError
from meal_bayes.learner import sessions
from meal_bayes.learner.experience import Experience
from meal_bayes.learner.feedback import checked_labels, replacing
from meal_bayes.learner.fits import Fits
from meal_bayes.learner.fitted import Fitted
from meal_bayes.learner.percepts import record_trial
from meal_bayes.learner.settings import LearnerSettings, check_data, own_posterior
from meal_bayes.learner.tasks import Question
from meal_bayes.momdp import MOMDP
from meal_bayes.robots import Robot
from meal_bayes.trials import Session, Trial, run_trial
from meal_bayes.trials.session import MAX_STEPS
from meal_bayes.untrusted import LARGEST


class Learner:
    """Answers questions about objects, and learns from what it does and is told.

    It works with any robot, from nothing or from recordings; with a percept table it replays the
    table's objects, each left out of what was learned.

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
    posterior : str, Path, InferenceData, DataTree or ConfusionPosterior, optional
        Of the confusion matrices, learned elsewhere (see `ConfusionPosterior.from_idata`) without
        the objects that are asked about, in place of the one that `fit` would learn.
    reward : float, optional
        r+ = -r- of a report; the domain's by default.
    percepts : str
        In replays: "recorded", or "model", drawn from the learned confusion matrices.
    refit_every : int or float, optional
        When everything is learned anew: after so many labels, or (a float below 1) when labeled
        instances have grown by such a fraction; None: only when `refit` is called.
    learn_success : bool
        Learn how often behaviors succeed, at every refit, or take it from the domain.
    horizon : float
        Queries to come, for which exploring is valued.
    trust : float
        Pr(a label of an object that is recognized is right).
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
        refit_every: float | None = 0.2,
        learn_success: bool = True,
        horizon: float = 1000.0,
        trust: float = TRUST,
        logs: str | Path | None = "logs",
    ) -> None:
        if seed < 0:
            raise SettingsError(f"seed is {seed}; give a whole number, 0 or more.")
        if reward is not None and not 0 < reward <= LARGEST:
            raise SettingsError(f"reward is {reward}; give a number above 0, at most {LARGEST:g}.")
        self.domain = domain if isinstance(domain, Domain) else load_domain(domain)
        self._agent = as_agent(agent)
        settings = LearnerSettings(
            classifier=classifier,
            posterior=own_posterior(posterior, self.domain, self._agent),
            learn_success=learn_success,
            reward=self.domain.report_reward if reward is None else reward,
            percepts=percepts,
        )
        self.seed, self.reward = seed, reward
        self.horizon, self.trust = horizon, trust
        self.logs = None if logs is None else Path(logs)
        self.experience = Experience(self.domain)
        self.fits = Fits(self.experience, settings, refit_every)
        self.asked = 0  # questions, with robots
        self.lock = threading.RLock()

    def __repr__(self) -> str:
        """Return a line that says what it has learned from."""
        data = f"{self.experience!r}" if self.table is None else "a percept table"
        return f"Learner({self.domain.name}, agent {self.agent.name}, {data})"

    @property
    def agent(self) -> Agent:
        """Who decides; another agent learns from the same experience."""
        return self._agent

    @agent.setter
    def agent(self, agent: object) -> None:
        chosen = as_agent(agent)
        own_posterior(self.fits.settings.posterior, self.domain, chosen)
        with self.lock:
            self._agent = chosen

    @property
    def table(self) -> PerceptTable | None:
        """The percept table that is replayed, if there is one."""
        return self.fits.table

    def fit(self, data: Dataset | PerceptTable) -> Self:
        """Learn from recordings, which join the experience, or replay a percept table.

        Raises
        ------
        SettingsError : data of another domain.
        """
        check_data(data, self.domain)
        with self.lock:
            self.fits.table = data if isinstance(data, PerceptTable) else None
            if isinstance(data, Dataset):
                self.experience.give(data)
            return self.refit()

    def refit(self) -> Self:
        """Learn everything anew from the experience."""
        with self.lock:
            self.fits.clear()
            if self.table is None:
                self.fitted(self.agent)
                self.agent.warm_up(self.domain, Query(self.domain.attributes[:1]))
        return self

    def fitted(self, agent: Agent) -> Fitted:
        """Return what an agent makes of the experience; learned when it is first needed."""
        with self.lock:
            return self.fits.of(agent)

    def knowledge(self, object_name: str | None = None) -> Knowledge:
        """Return what was learned; from a percept table, without one of its objects."""
        if self.table is None:
            return self.fitted(self.agent).knowledge
        if object_name is None:
            raise SettingsError("A percept table holds only what is known without an object of it.")
        o = object_index(self.table.objects, object_name)
        return self.fits.held_out(self.table, self.agent, o).knowledge

    def problem(self, question: Question, object_name: str | None = None) -> MOMDP:
        """Return the decision problem of a question, as a test of it would have it."""
        task, _ = sessions.task_of(self, question, object_name)
        with self.lock:
            fit = sessions.fit_of(self, task, learn=False)
            labels = fit.labels_of(task) if self.agent.memory else None
            return sessions.problem_of(self, fit, task.query, labels=labels)

    def ask(
        self,
        question: Question,
        robot: Robot | str | None = None,
        *,
        truth: Mapping[str, bool] | ArrayLike | None = None,
        object_name: str | None = None,
        learn: bool | None = None,
        log: str | Path | None = None,
        key: str | int | None = None,
        **options: Any,
    ) -> Trial:
        """Answer a question about the object in front of a robot.

        Every step is on disk before the next behavior. What ends the trial early (the driver, an
        interruption) is raised once the trial is logged as far as it went.

        Parameters
        ----------
        question : a sentence ("Is it heavy?"), a comma list, attribute names, a query, or a task.
        robot : see `Robot`; or an object of the percept table, which is replayed; None: a task's.
        truth : {attribute: True or False} of what is known; compared with the report afterwards.
        object_name : if it is known; an agent with `memory` recognizes it. By default a new object.
        learn : whether the trial becomes experience, and explores for the queries to come as the
            agent does; otherwise it is a test. By default with a robot alone: what a percept table
            shows is in it already.
        log : path of the trial's log (.mcap); one in the folder of logs by default.
        key : names the random streams of this question; by default the number of questions so
            far, and in replays nothing, so that equal questions are equal.
        options : `max_steps`, `max_cost` and `on_step`, see `Session`.

        Raises
        ------
        QueryError : a question that cannot be understood.
        SettingsError : no data were fitted of the kind that the robot needs.
        RobotError : the robot came to a state that the domain does not know.
        """
        if isinstance(robot, str):
            object_name, robot = robot, None
        sessions.check_robot(self, robot)
        session = sessions.open_session(
            self, question, object_name, key, log, truth=truth, learn=learn,
            limit=getattr(robot, "limit", np.inf), **options,
        )  # fmt: skip
        return run_trial(session, sessions.robot_of(self, session.task) if robot is None else robot)

    def begin(
        self,
        question: Question,
        object_name: str | None = None,
        truth: Mapping[str, bool] | ArrayLike | None = None,
        max_steps: int = MAX_STEPS,
        max_cost: float | None = None,
        *,
        state: str | None = None,
        **options: Any,
    ) -> Session:
        """Begin a trial that somebody else drives; see `Session` for what to do with it.

        Whoever drives executes `behavior`, and gives its `Outcome` to `observe`, until there is no
        behavior; then `report` is the answer.

        Parameters
        ----------
        question, object_name, truth, max_steps, max_cost :
            As for `ask`.
        state : str, optional
            Where the robot is; the domain's start by default.
        options :
            `learn`, `on_step`, `log` and `key`, as for `ask`.
        """
        session = sessions.open_session(
            self, question, object_name, options.pop("key", None), options.pop("log", None),
            truth=truth, max_steps=max_steps, max_cost=max_cost, **options,
        )  # fmt: skip
        return session.start(self.domain.diagram.start if state is None else state)

    def resume(self, log: str | Path) -> Session:
        """Go on with a trial whose process ended in the middle of it, from its log.

        The learner is the one that began it, or has been saved before and loaded since. The robot
        is where the last step of the log led.

        Parameters
        ----------
        log : str or path
            Of the trial, or its draft.

        Raises
        ------
        LogError : the log holds no trial that is under way, or not of this learner's.
        """
        return sessions.resume_session(self, Path(log))

    def tell(self, trial: Trial | str, values: Mapping[str, bool | None]) -> None:
        """Learn from labels of a trial's object; the posterior is updated at once.

        How much objects differ, and how their percepts err together, hold until the next refit.

        Parameters
        ----------
        trial : an answer, or the name of an object. Of an answer of another learner's the percepts
            of the attributes asked are learned from.
        values : by attribute, also of attributes that were not asked; None is ignored. A later
            label of an attribute replaces an earlier one.

        Raises
        ------
        QueryError : an attribute that the domain does not have.
        SettingsError : a value that is no label; a trial with other levels than the agent's.
        """
        labels = checked_labels(values, self.domain)
        if not (labels >= 0).any():
            return
        name = trial.task.object_name if isinstance(trial, Trial) else trial
        if not isinstance(name, str):
            raise SettingsError(f"Labels are of a trial or an object's name; found {name!r:.60}.")
        key = trial.task.key if isinstance(trial, Trial) else ("told", name)
        with self.lock:
            if self.table is not None:
                object_index(self.table.objects, name)
                self.fits.clear()
            elif isinstance(trial, Trial) and key not in self.experience.trials:
                perceived = any(step.observation is not None for step in trial.steps)
                if perceived and trial.momdp.levels != self.agent.levels:
                    raise SettingsError("The trial has other levels; give one of this learner's.")
                record_trial(self.experience, trial)
            labels = replacing(labels, self.experience.labels_for([name])[0], self.domain)
            self.fits.update(self.experience.label(key, name, labels))
            self.fits.grow(len(self.experience.shown(key)), int((labels >= 0).sum()))

    def forget(self, trial: Trial) -> None:
        """Forget the labels of a trial; refit without them if the last refit has used them."""
        key = trial.task.key
        with self.lock:
            if not self.experience.labels_by(key):
                raise SettingsError(f"The trial {trial.task.name!r} has no labels.")
            self.fits.withdraw(self.experience.forget(key))
            if self.table is not None:
                self.fits.clear()

    def save(self, path: str | Path) -> None:
        """Write everything into one file, for `load`."""
        from meal_bayes.learner.saved import save_learner  # noqa: PLC0415

        with self.lock:
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
