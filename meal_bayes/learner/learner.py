"""The `Learner`: an agent and its experience; asked questions, updated by feedback, and saved."""

import threading
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from meal_bayes.agents import Agent, Knowledge, as_agent
from meal_bayes.arrays import check_whole
from meal_bayes.datasets import Dataset, PerceptTable, object_index
from meal_bayes.domain import Domain, Query, load_domain
from meal_bayes.errors import SettingsError
from meal_bayes.learner import sessions
from meal_bayes.learner.experience import Experience
from meal_bayes.learner.fitted import Fits, Fitted
from meal_bayes.learner.percepts import tell
from meal_bayes.learner.saved import load_learner, save_learner
from meal_bayes.learner.sessions import Question
from meal_bayes.learner.settings import LearnerSettings, check_data, own_posterior
from meal_bayes.momdp import MOMDP
from meal_bayes.robots import Robot
from meal_bayes.robots.recorded import RecordedRobot
from meal_bayes.trials import Session, Trial, run_trial


class Learner:
    """Answers questions about objects, and learns from what it does and is told.

    It works with any robot, from nothing or from recordings; with a percept table it replays its
    objects, each left out of what was learned.

    Parameters
    ----------
    domain : str, path or Domain
        A shipped domain, the path of a TOML file, or a domain.
    agent : str | Agent | Solver
        Who decides: see `meal_bayes.agents.as_agent`.
    seed : int
        Of planning, and of what is drawn in replays.
    classifier : object
        Of scikit-learn, in place of ours: see `meal_bayes.perception.with_classifier`.
    posterior : str, Path, InferenceData, DataTree or ConfusionPosterior, optional
        Of the confusion matrices, learned elsewhere (see `posterior.draws.posterior_from`) without
        the objects that are asked about, in place of the one that `fit` would learn.
    reward : float, optional
        r+ = -r- of a report; the domain's by default.
    percepts : str
        In replays: "recorded", or "model", drawn from the learned confusion matrices.
    refit_every : float, optional
        Refit once labeled instances have grown by such a fraction; None: only by `refit`.
    learn_success : bool
        Learn how often behaviors succeed, at every refit, or take it from the domain.
    horizon : float
        Queries to come, for which exploring is valued.
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
        logs: str | Path | None = "logs",
    ) -> None:
        check_whole("seed", seed)
        self.domain = domain if isinstance(domain, Domain) else load_domain(domain)
        self._agent = as_agent(agent)
        settings = LearnerSettings(
            classifier=classifier,
            posterior=own_posterior(posterior, self.domain, self._agent),
            learn_success=learn_success,
            reward=self.domain.report_reward if reward is None else reward,
            percepts=percepts,
        )
        if not 0 <= horizon < np.inf:
            raise SettingsError(f"horizon is {horizon}; give queries to come, 0 or more.")
        self.seed, self.horizon = int(seed), float(horizon)
        self.reward = None if reward is None else float(reward)
        self.logs = None if logs is None else Path(logs)
        self.experience = Experience(self.domain)
        self.fits = Fits(self.experience, settings, refit_every)
        self.table: PerceptTable | None = None  # that is replayed
        self.asked, self.lock = 0, threading.RLock()  # questions with robots

    def __repr__(self) -> str:
        data = f"{self.experience!r}" if self.table is None else "a percept table"
        return f"Learner({self.domain.name}, agent {self.agent.name}, {data})"

    def _repr_html_(self) -> str:
        shown = self.knowledge() if self.table is None else self.table
        return f"<p>{escape(repr(self))}</p>{shown._repr_html_()}"

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

    def fit(self, data: Dataset | PerceptTable) -> Self:
        """Learn from recordings, which join the experience, or replay a percept table.

        Raises
        ------
        SettingsError
            Data of another domain.
        DataError
            Features of another size than those that were learned from.
        """
        check_data(data, self.domain)
        with self.lock:
            self.table = data if isinstance(data, PerceptTable) else None
            if isinstance(data, Dataset):
                self.experience.give(data)
            return self.refit()

    def refit(self) -> Self:
        """Learn everything anew from the experience."""
        with self.lock:
            self.fits.clear()
            if self.table is None:
                self.fits.of(self.agent)
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
            return fit.agent.model(
                task.query, fit.knowledge, limit=fit.limit, reward=self.reward,
                labels=sessions.known_labels(self, fit.agent, task),
            )  # fmt: skip

    def ask(
        self,
        question: Question,
        robot: Robot | str | None = None,
        *,
        truth: Mapping[str, bool] | ArrayLike | None = None,
        object_name: str | None = None,
        learn: bool = True,
        log: str | Path | None = None,
        key: str | int | None = None,
        **options: Any,
    ) -> Trial:
        """Answer a question about the object in front of a robot.

        Every step is on disk before the next behavior. What ends the trial early (the driver, an
        interruption) is raised once it is logged so far.

        Parameters
        ----------
        question : Question
            A sentence ("Is it heavy?"), a comma list, or names of attributes.
        robot : Robot or str, optional
            See `Robot`; or the name of an object of the percept table, which is replayed.
        truth : mapping or array, optional
            {attribute: True or False} of what is known; compared with the report afterwards.
        object_name : str, optional
            An agent with `memory` recognizes it; by default it is a new object.
        learn : bool
            Whether it explores, and becomes experience; else a test, as replays of a table are.
        log : str or Path, optional
            Of the trial (.mcap); one in the folder of logs by default.
        key : str or int, optional
            Names the random streams; by default the number of questions so far, in replays nothing.
        **options
            `max_steps`, `max_cost` and `on_step`, see `Session`.

        Raises
        ------
        QueryError
            A question that cannot be understood.
        SettingsError
            No data were fitted of the kind that the robot needs.
        RobotError
            The robot came to a state that the domain does not know.
        """
        if isinstance(robot, str):
            object_name, robot = robot, None
        sessions.check_robot(self, robot)
        session = sessions.open_session(
            self, question, object_name, key=key, log=log, truth=truth, learn=learn,
            limit=robot.limit if isinstance(robot, RecordedRobot) else np.inf, **options,
        )  # fmt: skip
        robot = sessions.robot_of(self, session.task, self.seed) if robot is None else robot
        return run_trial(session, robot)

    def begin(
        self, question: Question, object_name: str | None = None, *, state: str | None = None,
        **options: Any,
    ) -> Session:  # fmt: skip
        """Begin a trial that somebody else drives; see `Session` for what to do with it.

        Whoever drives executes `behavior`, and gives its `Outcome` to `observe`, until there is no
        behavior; then `report` is the answer.

        Parameters
        ----------
        state : str, optional
            Where the robot is; the domain's start by default.
        **options
            All others are as for `ask`.
        """
        state = self.domain.diagram.start if state is None else state
        session = sessions.open_session(self, question, object_name, state=state, **options)
        return session.start(state)

    def resume(self, log: str | Path) -> Session:
        """Go on with a trial whose process ended in the middle of it, from its log.

        The learner is the one that began it, or has been saved before and loaded since. The robot
        is where the last step of the log led.

        Parameters
        ----------
        log : str or Path
            Of the trial, or its draft.

        Raises
        ------
        LogError
            The log holds no trial that is under way, or not of this learner's.
        """
        before, path, header = sessions.interrupted(Path(log))
        streams, begun = tuple(header["streams"]), dict(header["begun"])
        start = begun.pop("state", None) or self.domain.diagram.start
        session = sessions.session_of(self, before.task, streams, truth=before.truth, **begun)
        session.start(before.momdp.x_names[before.steps[0].x] if before.steps else start)
        session.repeat(before.steps)
        session.record(sessions.LiveLog(path, header))
        return session

    def tell(self, trial: Trial | str, values: Mapping[str, bool | None]) -> None:
        """Learn from labels of a trial's object; the posterior is updated at once.

        How much objects differ, and how their percepts err together, hold until the next refit.

        Parameters
        ----------
        trial : Trial or str
            An answer (of another learner's the percepts are learned from), or an object's name.
        values : mapping
            True, False or None by attribute, whether it was asked or not; a later label replaces
            an earlier one.

        Raises
        ------
        QueryError
            An attribute that the domain does not have.
        SettingsError
            A value that is no label; a trial with other levels than the agent's.
        """
        with self.lock:
            tell(self, trial, values)

    def forget(self, trial: Trial) -> None:
        """Forget the labels of a trial; refit without them if the last refit has used them.

        Raises
        ------
        SettingsError
            The trial has no labels.
        """
        key = trial.task.key
        with self.lock:
            if not self.experience.labels_by(key):
                raise SettingsError(f"The trial {trial.task.name!r} has no labels.")
            self.fits.withdraw(self.experience.forget(key))

    def save(self, path: str | Path) -> None:
        """Write everything into one file, for `load`; the file is there whole or not at all."""
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
        path : str or Path
            Of a file that `save` wrote.
        agent, classifier : object, optional
            One's own are given again; shipped agents are found by name.
        logs : str or Path, optional
            Folder of the logs to come.

        Raises
        ------
        DataError
            A file that is not a learner, is torn, or of another version.
        SettingsError
            An agent or a classifier of one's own is not given again.
        """
        return load_learner(cls, Path(path), agent=agent, classifier=classifier, logs=logs)
