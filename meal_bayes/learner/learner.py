"""The `Learner`: an agent and its experience; asked questions, updated by feedback, and saved."""

import contextlib
import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from html import escape
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.agents import Agent, Knowledge, as_agent
from meal_bayes.agents.named import AGENTS
from meal_bayes.arrays import check_kind
from meal_bayes.datasets import Dataset, PerceptTable, load_percepts, object_index
from meal_bayes.domain import Domain, Query, load_domain, with_attribute
from meal_bayes.errors import LogError, QueryError, SettingsError
from meal_bayes.files import LOGS, checked_path, file_name
from meal_bayes.learner import views
from meal_bayes.learner.card import JoinedRecordings, learned_html, next_html, table_knowledge
from meal_bayes.learner.experience import Experience, Objects, key_of_name, record_steps
from meal_bayes.learner.find import Found, checked_objects, prior_of_yes, read_claim, truth_of
from meal_bayes.learner.fit import Fit, problem_of, solve, training_agent
from meal_bayes.learner.held_out import HeldOut, replay
from meal_bayes.learner.online import Online
from meal_bayes.learner.question import (
    IDLE,
    LOST,
    NO_CLASSIFIERS,
    NO_TABLE,
    Question,
    QuestionCounts,
    TrialOptions,
    asked_again,
    check_domain,
    check_resumed,
    is_idle,
    read_task,
    robot_or_name,
    start_again,
    start_of,
)
from meal_bayes.learner.saved import SavedLearner, agent_digest, read_learner, write_learner
from meal_bayes.learner.settings import (
    REFIT_EVERY,
    LearnerSettings,
    check_data,
    check_object_name,
    check_object_names,
    checked_labels,
    own_posterior,
    settings_of,
)
from meal_bayes.learner.told import Telling, log_told, nothing_told, warn_of_typo
from meal_bayes.learner.trial_logs import TrialLogs
from meal_bayes.look import holding_warnings, warn_user
from meal_bayes.momdp import MOMDP
from meal_bayes.planners import Policy
from meal_bayes.planners.solver import MAX_STEPS
from meal_bayes.robots import OutcomeChecker, Robot
from meal_bayes.robots.recorded import RecordedRobot
from meal_bayes.robots.robot import state_index
from meal_bayes.seeds import Key
from meal_bayes.threads import Lock
from meal_bayes.trial_log.feedback import Change
from meal_bayes.trial_log.file import SUFFIX
from meal_bayes.trial_log.folder import ASK, present_time
from meal_bayes.trial_log.live import Interrupted, LiveLog, end_broken, resuming
from meal_bayes.trials import FaultTolerant, Session, Step, Task, Trial, run_trial
from meal_bayes.trials.record import truth_of as trial_truth
from meal_bayes.trials.session import moves
from meal_bayes.trials.text import UNFINISHED

_notes = logging.getLogger("meal_bayes.learner")

_STRANGER = (
    "According to the logs, the agent {!r} decided from then on, which is no agent of the package. "
    "Load the learner with it, by load(path, agent=...), or set learner.agent, before recall(); "
    "otherwise recall() cannot repeat what was learned."
)


class _Fits:
    """The fits of a learner: an `Online` for each agent, a `HeldOut` for each object of a table.

    A `HeldOut` is a function of the table and the labels. An `Online` has a state: it is made by
    `refit`, when an agent is first used, and by `update` if a refit is due. Reading a result never
    changes this state, because every change of the record uses the agent first.

    Agents are compared by equality and not by hash, because a user's solver or bonus may not be
    hashable. There are only a few agents.
    """

    def __init__(self, record: Experience, settings: LearnerSettings) -> None:
        self.record = record
        self.settings = settings
        self.online: list[Online] = []
        self._held_out: list[HeldOut] = []

    def of(self, agent: Agent) -> Online:
        """Return the fit of an agent; make it if the agent is used for the first time."""
        for fit in self.online:
            if fit.agent == agent:
                return fit
        fit = Online.refit(self.record, agent, self.settings)
        self.online.append(fit)
        return fit

    def has(self, agent: Agent) -> bool:
        """Return whether there is a fit of an agent."""
        return any(fit.agent == agent for fit in self.online)

    def held_out(self, table: PerceptTable, agent: Agent, o: int, beside: Objects = ()) -> HeldOut:
        """Return the fit of an agent to a table without object `o` and the objects `beside`."""
        for fit in self._held_out:
            if (fit.object_index, fit.beside) == (o, beside) and fit.agent == agent:
                return fit
        fit = HeldOut(self.record, agent, self.settings, table=table, object_index=o, beside=beside)
        self._held_out.append(fit)
        return fit

    def clear(self) -> None:
        """Delete all fits."""
        self.online = []
        self._held_out = []

    def update(self, rows: NDArray[np.intp]) -> None:
        """Update all fits by instances (k,) with their present labels."""
        self._held_out = []
        for fit in self.online:
            fit.update(rows)

    def update_or_name_due(self, rows: NDArray[np.intp], *, anew: bool) -> list[Agent]:
        """Update the fits by instances (k,) if no refit is due; return the agents with one due.

        If executions were removed (`anew`), a refit is due for all agents.
        """
        due = [fit.agent for fit in self.online if anew or fit.due]
        self._held_out = []
        for fit in self.online:
            if fit.agent not in due:
                fit.update(rows)
        return due

    def refitted(self, agents: Sequence[Agent]) -> list[Online]:
        """Return new fits for some agents; the record and the present fits do not change."""
        return [Online.refit(self.record, agent, self.settings) for agent in agents]

    def replace(self, refitted: Sequence[Online]) -> None:
        """Replace the fits of the same agents by new ones."""
        for new in refitted:
            agents = [fit.agent for fit in self.online]
            self.online[agents.index(new.agent)] = new


class Learner:
    """An agent that answers questions, keeps its experience, and learns from trials and labels.

    A learner works with any robot, and can begin with recordings or without any. If it is given a
    percept table, it replays the objects of the table; in each trial it uses only what it learned
    from the other objects.

    Parameters
    ----------
    domain : str, path, mapping or Domain
        A shipped domain by its name, the path of a TOML file, its content as a dictionary, or a
        `Domain`.
    agent : str | Agent | Solver
        Agent that chooses the behaviors; see `meal_bayes.agents.as_agent`.
    seed : int
        Seed of the planner and of the draws in replays.
    classifier : object
        A scikit-learn classifier that replaces the default classifier; see
        `meal_bayes.perception.with_classifier`.
    posterior : str, Path, InferenceData, DataTree or ConfusionPosterior, optional
        Posterior of the confusion matrices that replaces the one that `fit` learns. The posterior
        must not be learned from the objects about which you ask.
    reward : float, optional
        Reward of a right report; a wrong report gets minus this reward. By default it is the
        domain's reward.
    payoffs : Sequence[float], optional
        Rewards of a right yes, a wrong yes, a right no and a wrong no. These payoffs apply to
        yes-or-no questions that have no payoffs of their own. The domain's payoffs are the default.
    percepts : str
        Source of the percepts in replays: "recorded", or "model" to draw them from the learned
        confusion matrices.
    refit_every : float, optional
        Refit when the number of labeled executions has grown by this fraction. With None, the
        learner refits only if `refit` is called.
    learn_success : bool
        Whether to learn the success rates of behaviors at every refit. If False, they are taken
        from the domain.
    label_accuracy : float, optional
        Probability that a label is right, if you know it, for example from two people who label the
        same objects. Base rates then take this probability into account, and an agent with memory
        believes a label with this probability. By default, base rates count every label as right,
        and an agent with memory believes a label with probability .99. The base rates of a percept
        table do not use this setting.
    horizon : float, optional
        Expected number of future questions, which determines how much exploration is worth. By
        default it is 20 plus the number of questions so far; tests do not count.
    logs : str or path, optional
        Folder for the logs of trials with a robot; None turns logging off.
    settings : LearnerSettings, optional
        One value that contains these settings, except `agent` and `logs`, and rarer ones. If you
        pass it, you cannot pass the same settings by name.

    Examples
    --------
    >>> from meal_bayes import Learner, load_percepts
    >>> learner = Learner("roc36", agent="greedy", logs=None).fit(load_percepts("roc36"))
    >>> trial = learner.ask("Is it heavy?", "heavy_blue_beans")
    >>> trial.answer, trial.success
    ({'heavy': True}, True)
    """

    def __init__(
        self,
        domain: str | Path | Mapping[str, Any] | Domain,
        *,
        agent: object = "bayes",
        classifier: object = None,
        posterior: object = None,
        seed: int = 0,
        reward: float | None = None,
        payoffs: Sequence[float] | None = None,
        percepts: str = "recorded",
        refit_every: float | None = REFIT_EVERY,
        learn_success: bool = True,
        label_accuracy: float | None = None,
        horizon: float | None = None,
        logs: str | Path | None = LOGS,
        settings: LearnerSettings | None = None,
    ) -> None:
        domain = load_domain(domain)
        chosen = as_agent(agent)
        by_name = {
            "seed": seed,
            "horizon": horizon,
            "refit_every": refit_every,
            "learn_success": learn_success,
            "label_accuracy": label_accuracy,
            "reward": reward,
            "percepts": percepts,
            "classifier": classifier,
            "payoffs": payoffs,
            "posterior": posterior,
        }
        settings = settings_of(settings, by_name, domain, chosen)
        self.domain = domain
        self.settings = settings
        self.table: PerceptTable | None = None  # that is replayed
        self._experience = Experience(domain)
        self._agent = chosen
        self._fits = _Fits(self._experience, settings)
        self._questions = QuestionCounts()
        self._logs = TrialLogs(logs, domain.name)
        self._lock = Lock()
        self._joined = JoinedRecordings()
        self._file = ""  # id of the file that was read or written last
        self._robot_state: str | None = None  # where the last trial with a robot left it, or LOST
        self._robot_seen = ""  # when that trial was over; while it is not, when it began
        self._under_way = dict[Key, str]()  # the object of each trial that teaches, and is not over
        self._stranger = False  # who decided then is not known, where a log is heard
        self._idle_told = False  # a person was warned of an agent that does not explore

    def __repr__(self) -> str:
        data = "a percept table"
        if self.table is None:
            data = f"{self._experience!r}{self._joined.text(self._experience)}"
        return f"Learner({self.domain.name}, agent {self.agent.name}, {data})"

    def _repr_html_(self) -> str:
        """Return what was learned about each attribute, or what to do next, as HTML."""
        head = f"<p>{escape(repr(self))}</p>"
        table = None if self.table is None else views.labeled_table(self.experience, self.table)
        labels = self.experience.object_labels.values if table is None else table.labels
        if not (labels >= 0).any():
            return head + next_html(self.domain.attributes[0], len(self.experience.instances))
        if table is None:
            return head + learned_html(self.knowledge(), labels)
        knowledge = table_knowledge(table, self.agent, self.settings)
        return f"{head}{learned_html(knowledge, labels)}"

    def __getstate__(self) -> dict[str, Any]:
        """Return the state for a copy or another process, after a running refit has ended."""
        with self._lock:
            return self.__dict__.copy()

    # What it knows.

    @property
    def experience(self) -> Experience:
        """All recordings, executions and labels; reading them waits for the end of a refit."""
        with self._lock:
            return self._experience

    @property
    def known_names(self) -> list[str]:
        """Names of the objects that were met, also in trials that are not over."""
        return [*self.experience.met, *self._under_way.values()]

    @property
    def is_refitting(self) -> bool:
        """Whether a refit that `tell` or `forget` started is still running.

        The next call that needs the result waits until the refit has ended. If the refit failed,
        that call raises its error.
        """
        return self._lock.is_busy

    @property
    def agent(self) -> Agent:
        """Agent that chooses behaviors. An agent that you set learns from the same experience."""
        return self._agent

    @agent.setter
    def agent(self, agent: object) -> None:
        chosen = as_agent(agent)
        own_posterior(self.settings.posterior, self.domain, chosen)
        with self._lock:
            change = self._change(chosen)
            self._agent = chosen
            if change.digest != change.before:
                self._log_change(change)

    def knowledge(self, object_name: str | None = None) -> Knowledge:
        """Return what was learned; with a percept table, what was learned without an object."""
        if self.table is None:
            return self.fitted(self.agent).knowledge
        if object_name is None:
            raise SettingsError(
                "Knowledge from a percept table is learned without one of its objects; name this "
                "object by object_name=."
            )
        with self._lock:
            o = object_index(self.table.objects, object_name)
            return self._fits.held_out(self.table, self.agent, o).knowledge

    def fitted(self, agent: Agent) -> Online:
        """Return what an agent learns from the experience; a later call does not fit it again."""
        with self._lock:
            return self._fits.of(agent)

    def task(
        self,
        question: Question,
        object_name: str | None = None,
        *,
        answer: str = "values",
        payoffs: Sequence[float] | None = None,
    ) -> Task:
        """Return the task of a question; without an object's name, it is about a new object."""
        return self._read(question, object_name, answer=answer, payoffs=payoffs)[0]

    def problem(self, question: Question, object_name: str | None = None) -> MOMDP:
        """Return the decision problem of a question, as in a test (without exploration bonus)."""
        task, _ = self._read(question, object_name)
        with self._lock:
            return problem_of(self._fit(task, learn=False), task)

    def policy(self, question: Question, object_name: str | None = None) -> Policy:
        """Return the policy for a question, as in a test (without exploration bonus)."""
        task, streams = self._read(question, object_name)
        with self._lock:
            return self._fit(task, learn=False).plan(task, streams, limit=np.inf, explore=False)[1]

    def replay(
        self, question: Question, object_name: str | None = None, *, seed: int | None = None
    ) -> RecordedRobot:
        """Return a simulated robot that replays the recordings of an object of the percept table.

        The seed determines failures and the order of recordings. By default it is the learner's
        seed.
        """
        if self.table is None:
            raise SettingsError(NO_TABLE)
        seed = self.settings.seed if seed is None else seed
        repeats = self.settings.percepts == "model"
        return replay(self.table, self._read(question, object_name)[0], seed, repeats=repeats)

    def _fit(self, task: Task, *, learn: bool, beside: Objects = ()) -> Fit:
        """Return the fit for a trial; another agent may execute training trials."""
        if self.table is not None:
            return self._fits.held_out(self.table, self.agent, task.object_index, beside)
        return self._fits.of(training_agent(self.agent) if learn else self.agent)

    def _fit_agents(self) -> None:
        """Make the fits of the agents before the record changes, if there are none."""
        if self.table is None and not self._stranger:
            for agent in (self.agent, training_agent(self.agent)):
                self._fits.of(agent)

    # Questions.

    def ask(
        self,
        question: Question,
        robot: Robot | str | None = None,
        *,
        truth: Mapping[str, bool] | ArrayLike | None = None,
        object_name: str | None = None,
        answer: str = "values",
        payoffs: Sequence[float] | None = None,
        learn: bool = True,
        log: str | Path | None = None,
        key: str | int | None = None,
        max_steps: int = MAX_STEPS,
        max_cost: float | None = None,
        on_step: Callable[[Step], None] | None = None,
    ) -> Trial:
        """Answer a question about the object in front of a robot.

        Each step is written to disk before the next behavior begins. If an exception of the robot's
        driver or an interruption ends the trial, the trial so far is logged, and the exception is
        raised again.

        Parameters
        ----------
        question : Question
            A sentence ("Is it heavy?"), a comma-separated list, or names of attributes.
        robot : Robot or str, optional
            A robot (see `Robot`), or the name of an object of the percept table to replay.
        truth : mapping or array, optional
            The true attributes as far as known, {attribute: True or False}. The truth is only
            compared with the report after the trial.
        object_name : str, optional
            Name by which an agent with `memory` recognizes the object. By default the trial is
            about a new object.
        answer : str
            Kind of answer: "values" of the attributes, or "yes or no" ("Is it red and not empty?");
            see `read_event`.
        payoffs : Sequence[float], optional
            Rewards of a right yes, a wrong yes, a right no and a wrong no. By default they are the
            learner's payoffs.
        learn : bool
            Whether the robot explores and learns from the trial. If False, the trial is a test;
            replays of a percept table always are tests.
        log : str or Path, optional
            File for the log of the trial (.mcap). By default the log is a new file in the folder of
            logs.
        key : str or int, optional
            Name of the random streams of the trial; equal keys and seeds give equal draws. By
            default it is the number of questions so far, counted separately for tests and other
            trials. Replays have no key.
        max_steps, max_cost, on_step : int, float, callable
            See `Session`.

        Raises
        ------
        QueryError
            The question cannot be read.
        SettingsError
            The learner was not fitted with the data that this robot needs.
        RobotError
            The robot returned a state that is impossible after the behavior.
        """
        driver, object_name = robot_or_name(robot, object_name)
        if (driver is None) == (self.table is None):
            raise SettingsError(NO_TABLE if driver is None else NO_CLASSIFIERS)
        options = TrialOptions(
            truth=truth,
            learn=learn,
            limit=driver.limit if isinstance(driver, RecordedRobot) else np.inf,
            max_steps=max_steps,
            max_cost=max_cost,
            on_step=on_step,
        )
        path = self._logs.log_path(log)
        task, streams, header = self._asked(
            question, object_name, options, key=key, answer=answer, payoffs=payoffs
        )
        session = self._session(task, streams, options, path, header)
        return run_trial(session, self.replay(task) if driver is None else driver)

    def begin(
        self,
        question: Question,
        object_name: str | None = None,
        *,
        state: str | None = None,
        truth: Mapping[str, bool] | ArrayLike | None = None,
        answer: str = "values",
        payoffs: Sequence[float] | None = None,
        learn: bool = True,
        log: str | Path | None = None,
        key: str | int | None = None,
        max_steps: int = MAX_STEPS,
        max_cost: float | None = None,
        on_step: Callable[[Step], None] | None = None,
        commanded: bool = False,
        seed: int | None = None,
    ) -> Session:
        """Begin a trial whose loop is your own code; see `Session`.

        Your loop executes `session.behavior` and passes the `Outcome` to `session.observe` until
        `session.over` is true. The answer is then `session.report`.

        Parameters
        ----------
        state : str, optional
            Present state of the robot. By default it is the domain's start state. If the last trial
            left the robot in another state, or was broken off while a behavior may have been in
            progress, this argument is required. An impossible state raises a `RobotError`.
        commanded : bool
            Whether your program chooses behaviors too, by `Session.command`.
        seed : int, optional
            Seed of the random draws. By default it is the learner's seed.
        question, object_name, truth, answer, payoffs, learn, log, key : Any
            As for `ask`; so are `max_steps`, `max_cost` and `on_step`.

        Raises
        ------
        SettingsError
            `state` is missing, and the last trial left the robot in another state than the domain's
            start state, or in a state that is not known.
        """
        diagram = self.domain.diagram
        if state is None:
            state = start_again(diagram.start, self._robot_state)
        state_index(diagram.states, state, "begin(state=)")  # before there is a log of it
        options = TrialOptions(
            truth=truth,
            learn=learn,
            max_steps=max_steps,
            max_cost=max_cost,
            on_step=on_step,
            commanded=commanded,
            seed=seed,
        )
        path = self._logs.log_path(log)
        task, streams, header = self._asked(
            question, object_name, options, key=key, answer=answer, payoffs=payoffs, state=state
        )
        session = self._session(task, streams, options, path, header)
        return session.start(state)

    def find(
        self,
        question: str | Sequence[str] | Query,
        objects: Sequence[str] | Mapping[str, Robot],
        *,
        truth: Mapping[str, Mapping[str, bool]] | None = None,
        payoffs: Sequence[float] | None = None,
        learn: bool = True,
        log: str | Path | None = None,
        max_steps: int = MAX_STEPS,
        max_cost: float | None = None,
        on_step: Callable[[Step], None] | None = None,
    ) -> Found:
        """Ask about one object after another, the most probable first, until one answer is yes.

        Each question is an ordinary trial with its own log. If one arm handles all objects, the
        method `start` of each robot must put down what the arm holds and turn to its own object.
        The trial begins in the state that `start` returns.

        Parameters
        ----------
        question : str | Sequence[str] | Query
            A yes-or-no question about each object ("Which one is full and red?").
        objects : Sequence[str] | Mapping[str, Robot]
            Names of objects of the percept table to replay, or {name: robot}. The learner does not
            use the labels that the table has for these objects.
        truth : mapping, optional
            The known truth, {object: {attribute: True or False}}. The truth is only compared with
            the answers.
        payoffs : Sequence[float], optional
            Four rewards, as for `ask`. By default the answer yes gets the usual reward, and the
            answer no gets 0.
        learn, max_steps, max_cost, on_step : Any
            As for `ask`; they apply to each trial.
        log : str or Path, optional
            Folder for the logs of the trials; the logs are numbered in the order of the trials. By
            default it is a new folder in the folder of logs.

        Returns
        -------
        found : Found
            The object that was found, its probability, the total cost, and the trials.

        Raises
        ------
        QueryError
            The question cannot be understood, or the payoffs are invalid.
        SettingsError
            There are no objects, an object is given twice, or the learner lacks the data that the
            robots need.
        RobotError
            A robot returned a state that is impossible after the behavior.

        Examples
        --------
        >>> from meal_bayes import Learner, load_percepts
        >>> learner = Learner("roc36", agent="greedy", logs=None).fit(load_percepts("roc36"))
        >>> boxes = ["light_blue_beans", "medium_brown_rice", "heavy_green_glass"]
        >>> learner.find("Which one is heavy?", boxes).object_name
        'heavy_green_glass'
        """
        replayed = self.table is not None
        robots = checked_objects(objects, self.known_names, replayed=replayed)
        query = read_claim(question, self.domain, payoffs, self.settings)
        folder = self._logs.folder_of_find(log)
        options = TrialOptions(learn=learn, max_steps=max_steps, max_cost=max_cost, on_step=on_step)
        if self.table is not None:
            rows = tuple(object_index(self.table.objects, name) for name in robots)
            options = replace(options, beside=rows)
        known = truth_of(truth, robots, self.domain)
        prior = dict[str, float]()
        for name in robots:
            task, _ = self._read(query, name)
            self._truth(task, replace(options, truth=known.get(name)))
            with self._lock:
                fit = self._fit(task, learn=False, beside=options.beside)
                prior[name] = prior_of_yes(problem_of(fit, task))
        trials = dict[str, Trial]()
        for name in sorted(robots, key=lambda name: -prior[name]):
            robot = robots[name]
            limit = robot.limit if isinstance(robot, RecordedRobot) else np.inf
            of_object = replace(options, truth=known.get(name), limit=limit)
            task, streams, header = self._asked(query, name, of_object)
            path = folder and folder / f"{len(trials) + 1:02d}-{file_name(name)}{SUFFIX}"
            session = self._session(task, streams, of_object, path, header)
            trials[name] = trial = run_trial(session, self.replay(task) if robot is None else robot)
            if trial.report is not None and trial.report[0]:
                return Found(name, trials)
        return Found(None, trials)

    def resume(self, log: str | Path | None = None, *, state: str | None = None) -> Session:
        """Continue an interrupted trial from its log after its process has ended.

        Use the learner that began the trial, or one that was saved before the trial and loaded
        again. The learner learns from the logged steps, and the trial continues after the last one.
        If the agent would now choose other behaviors than those logged, a warning says so. The
        agent plans only when the session's `behavior` or `over` is read, so `cancel` needs no
        planning. To end the trial without continuing it, call `give_up`, which works in every state
        of the robot.

        Parameters
        ----------
        log : str or Path, optional
            Log of the trial, its unfinished draft, or a folder of logs with one interrupted trial.
            By default it is this learner's folder of logs.
        state : str, optional
            Present state of the robot, which must be the last state of the log. `state` can be left
            out if the domain has only one state.

        Raises
        ------
        LogError
            There is no interrupted trial, or there are several; the trial has other states or
            percept levels than the learner; another process still runs the trial; or the robot is
            in another state.
        SettingsError
            The trial belongs to another domain, or `state` is missing.

        Examples
        --------
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> learner = Learner("toy", agent="prior", logs=None)
        >>> with TemporaryDirectory() as folder:
        ...     log = Path(folder, "1.mcap")
        ...     ended = learner.begin("Is it red?", "a cup", log=log, commanded=True)
        ...     ended.cancel()
        ...     session = learner.resume(log, state="x0")
        ...     print(session.begun, session.over)
        ...     session.cancel()
        True False
        """
        path = self._logs.interrupted(log, "give resume() the trial's log")
        with resuming(path) as broken:
            trial = broken.trial
            check_resumed(trial, self.experience, self.agent)
            check_object_name(trial.task.object_name, self.known_names)
            begun = dict(broken.header["begun"])
            start = start_of(trial, begun.pop("state", None) or self.domain.diagram.start, state)
            options = TrialOptions(truth=trial.truth, **begun)
            try:
                session = self._session(trial.task, tuple(broken.header["streams"]), options)
                session.start(start, steps=trial.steps)
                self._robot_seen = broken.time
            except Exception as fault:
                fault.add_note("give_up() ends the trial, and needs no agent for it")
                raise
            self.note_question(broken.header)
            self._record(session, broken.path, broken.header, broken)
            return session

    def give_up(self, log: str | Path | None = None) -> Trial:
        """End an interrupted trial whose process has ended, and complete its log.

        Giving up needs no planning, and works in every state of the robot. The learner learns from
        the steps of the trial if learner and trial have the same domain and the same percept
        levels. The state of the robot becomes that of the trial if no later trial is known.

        Parameters
        ----------
        log : str or Path, optional
            As for `resume`.

        Returns
        -------
        trial : Trial
            The trial so far, whose `ended` is "cancelled". A trial that already has an answer keeps
            this answer.

        Raises
        ------
        LogError
            There is no interrupted trial, or there are several; or another process still runs the
            trial.

        Examples
        --------
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> learner = Learner("toy", agent="prior", logs=None)
        >>> with TemporaryDirectory() as folder:
        ...     log = Path(folder, "1.mcap")
        ...     ended = learner.begin("Is it red?", "a cup", log=log, commanded=True)
        ...     ended.cancel("the driver failed")
        ...     learner.give_up(log).ended
        'cancelled'
        """
        path = self._logs.interrupted(log, "give give_up() the trial's log")
        trial, broken = end_broken(path)
        self.note_state(trial, broken.time)
        with contextlib.suppress(LogError, SettingsError, QueryError):
            check_resumed(trial, self.experience, self.agent)
            if trial.task.learn and self.table is None:
                self.note_question(broken.header)
                self.record(trial)
                self._end(trial)
        return trial

    def hear_trial(self, trial: Trial, n_steps: int | None = None) -> None:
        """Record a logged trial, or its first steps, and learn from it if it has ended.

        `recall` calls this method and the others whose names begin with `hear`.
        """
        self.record(trial if n_steps is None else replace(trial, steps=trial.steps[:n_steps]))
        if n_steps is None and trial.ended != UNFINISHED:
            with self._lock:
                self._fits.update(self.experience.instances_of_trial(trial.task.key))

    def hear_moved(self, rows: NDArray[np.intp], anew: bool) -> None:
        """Learn from new labels of k executions, and refit if enough labels are new."""
        with self._lock:
            due = self._fits.update_or_name_due(rows, anew=anew)
            self._fits.replace(self._fits.refitted(due))

    def hear_change(self, change: Change, own: Agent) -> None:
        """Repeat a logged change: a refit, another agent, or a new attribute."""
        with self._lock:
            if change.added:
                if not {change.added, *change.values} & {*self.domain.attributes}:
                    self.hear_attribute(change.added, change.values)
            elif change.refit:
                self.hear_refit()
            else:
                if change.used and agent_digest(self.agent) == change.before:
                    self._fit_agents()  # by what was known until then
                self._decide_by(change.digest, own)
                if self._stranger:
                    warn_user(_STRANGER.format(change.agent))

    @contextlib.contextmanager
    def hearing_changes(self, changes: Sequence[Change]) -> Iterator[Agent]:
        """Yield this learner's own agent to a `with` block that repeats logged changes of agents.

        After the block, the learner has the agent of the last change if its own agent is the one
        that the first change replaced. Otherwise it has its own agent again.
        """
        own = self.agent
        follows = not changes or agent_digest(own) == changes[0].before
        if not follows:
            self._decide_by(changes[0].before, own)
        try:
            yield own
        finally:
            self._stranger = False
            if not follows:
                self._agent = own

    def _decide_by(self, digest: str, own: Agent) -> None:
        """Let the agent of a digest decide; if it is not known, nothing is learned for it."""
        agents = (own, *(fit.agent for fit in self._fits.online), *AGENTS.values())
        known = [agent for agent in agents if agent_digest(agent) == digest]
        self._stranger = not known
        self._agent = known[0] if known else own

    def note_state(self, trial: Trial, time: str) -> None:
        """Remember in which state a logged trial left the robot.

        The time, such as `trial_log.folder.time_of`, is that of its log. A log from before the last
        trial that is known is ignored.
        """
        momdp, diagram = trial.momdp, self.domain.diagram
        theirs = momdp.behavior_names, momdp.x_names
        ours = self.domain.behavior_names, diagram.states
        if trial.task.object_index >= 0 or theirs != ours or trial.task.key in self._under_way:
            return
        if time < self._robot_seen:
            return
        self._robot_seen = time
        ends = [step.next_x for step in trial.steps if step.next_x != momdp.terminal]
        if ends:
            self._robot_state = diagram.states[ends[-1]]
        # A log does not contain the behavior during which a trial was broken off, nor the start.
        if trial.ended and trial.report is None:
            moved = moves(momdp, trial.last_belief.x).any() if ends else len(diagram.states) > 2
            self._robot_state = LOST if moved else self._robot_state

    def note_question(self, header: Mapping[str, object]) -> None:
        """Count the question of a log written before a restart, unless it is counted already."""
        with self._lock:
            self._questions.count_resumed(header)

    def _read(
        self,
        question: Question,
        object_name: str | None,
        key: str | int | None = None,
        *,
        learn: bool = False,
        answer: str = "values",
        payoffs: Sequence[float] | None = None,
    ) -> tuple[Task, Key]:
        """Read a question into a task; return it with the key of its random streams, by `key`."""
        name = question.object_name if isinstance(question, Task) else object_name
        if name is not None:
            check_object_name(name, self.known_names)
        if key is None and self.table is None:
            key = self._questions.next_key(learn=learn)
        return read_task(
            self.domain, self.table, question, object_name, key=key, answer=answer, payoffs=payoffs
        )

    def _asked(
        self,
        question: Question,
        object_name: str | None,
        options: TrialOptions,
        *,
        key: str | int | None = None,
        answer: str = "values",
        payoffs: Sequence[float] | None = None,
        state: str | None = None,
    ) -> tuple[Task, Key, dict[str, object]]:
        """Read a question and count it; return its task, its key, and the header of its log."""
        with self._lock:
            task, streams = self._read(
                question, object_name, key, learn=options.learn, answer=answer, payoffs=payoffs
            )
            self._truth(task, options)  # before it is counted
            counted: Mapping[str, object] = {}
            if self.table is None and not isinstance(question, Task):
                counted = self._questions.count(learn=options.learn, key=key)
            elif self.table is None and (
                task.key in self.experience.trials or self._logs.has_logged(task.key)
            ):
                task = asked_again(task)
        config = {"command": ASK, "question": task.name, "agent": self.agent.name}
        return task, streams, {"config": config, "begun": options.begun(state), **counted}

    def _session(
        self,
        task: Task,
        key: Key,
        options: TrialOptions,
        log: Path | None = None,
        header: Mapping[str, object] | None = None,
    ) -> Session:
        """Plan a task with the random streams `key`; return its session, which may be logged."""
        domain = self.domain
        columns = domain.columns(task.query.attributes)
        with self._lock:
            if options.learn:
                self._fit_agents()
            fit = self._fit(task, learn=options.learn, beside=options.beside)
            learn = options.learn and fit.teaches  # nothing is learned from replays
            if fit.teaches:
                task = replace(task, learn=learn)
            policy: Policy | None = None
            if options.commanded:
                momdp = fit.problem(task, options.limit)
            else:
                momdp, policy = fit.plan(task, key, limit=options.limit, explore=learn)
                if task.object_index < 0:  # recordings run out, the sensors of a robot fail
                    usual = domain.diagram.compile(domain.behavior_names)
                    policy = FaultTolerant(momdp, policy, partial(solve, fit, task, key), usual)
        on_step = options.on_step
        if task.object_index < 0:
            on_step = partial(self._follow, momdp, on_step)
        perceiver, on_step = fit.perceiving(task, momdp, self._lock, on_step)
        with_robot = task.object_index < 0
        session = Session(
            task,
            momdp,
            policy,
            OutcomeChecker(
                domain,
                object_index=task.object_index,
                sizes=fit.expected_sizes,
                heard=views.heard(self.experience),
            ),
            perceiver,
            agent=fit.agent.name,
            seed=self.settings.seed if options.seed is None else options.seed,
            key=key,
            truth=fit.truth(task.query) if options.truth is None else self._truth(task, options),
            counts=fit.knowledge.posterior.counts[columns],
            max_steps=options.max_steps,
            max_cost=options.max_cost,
            on_step=on_step,
            on_end=partial(self._over, with_robot=with_robot, learn=learn),
            on_start=partial(self._started, present_time()) if with_robot else None,
            on_lost=self._lose if with_robot else None,
        )
        if log is not None:
            self._record(session, log, header or {})
        if learn:
            with self._lock:
                self.experience.trial_number(task.key)  # the trial is now part of the experience
                self._under_way[task.key] = task.object_name
        return session

    def _truth(self, task: Task, options: TrialOptions) -> NDArray[np.int8]:
        """Return the truth (N,) that is given for a task, after a check; -1 unknown."""
        truth = options.truth
        if isinstance(truth, Mapping):
            truth = self.domain.labels(truth)[self.domain.columns(task.query.attributes)]
        return trial_truth(task.query, truth)

    def _started(self, time: str, state: str) -> None:
        """Remember where a robot starts, and the time before the log of the trial was opened."""
        self._robot_state = state
        self._robot_seen = time

    def _follow(self, momdp: MOMDP, on_step: Callable[[Step], None] | None, step: Step) -> None:
        """Remember where a robot is after a step; an answer leaves it where it was."""
        self._robot_state = momdp.x_names[step.x if step.next_x == momdp.terminal else step.next_x]
        if on_step is not None:
            on_step(step)

    def _record(
        self,
        session: Session,
        path: Path,
        header: Mapping[str, object],
        resumed: Interrupted | None = None,
    ) -> None:
        """Log a session from now on, with a header that describes how it began."""
        drawn = {"seed": self.settings.seed, "streams": list(session.key), "data": self.domain.data}
        log = LiveLog(path, {**drawn, **header}, session.task.object_name, resumed=resumed)
        self._logs.note({session.task.key: log.path.parent})
        session.record(log)

    def _lose(self) -> None:
        """Note that a trial was broken off while a behavior may have moved the robot."""
        self._robot_state = LOST

    def _over(self, trial: Trial, *, with_robot: bool, learn: bool) -> None:
        """Note the end of a session."""
        if with_robot:
            self._robot_seen = present_time()
        if learn:
            self._end(trial)

    def _end(self, trial: Trial) -> None:
        """Learn from a trial that has ended; a recognized object may have labels already."""
        with self._lock:
            self._under_way.pop(trial.task.key, None)
            self._fits.update(self.experience.instances_of_trial(trial.task.key))
        if not self._idle_told and is_idle(trial, training_agent(self.agent)):
            self._idle_told = True
            warn_user(IDLE.format(trial.agent))

    # Experience.

    def fit(self, data: Dataset | PerceptTable) -> Self:
        """Add recordings to the experience and learn from them, or take a percept table to replay.

        Recordings and labels that were added before are not added again, also if a person has
        replaced or removed the labels since.

        Raises
        ------
        SettingsError
            The data belong to another domain.
        DataError
            Features have another size than those of the experience.
        QueryError
            The name of an object differs from a known name only in invisible ways.
        """
        check_data(data, self.domain)
        check_object_names(data.objects, self.known_names)
        with self._lock:
            self.table = data if isinstance(data, PerceptTable) else None
            if isinstance(data, Dataset):
                joined = self.experience.add_dataset(data)
                offered = int(data.recording_counts[:, data.domain.recorded].sum())
                self._joined = JoinedRecordings(joined, offered, views.rows(self.experience))
            self.hear_refit()
        return self

    def refit(self) -> Self:
        """Train classifiers and compute the posterior again from all experience."""
        with self._lock:
            self.hear_refit()
            self._log_change(self._change(self.agent, refit=True))
        return self

    def hear_refit(self) -> None:
        """Do what `refit` does, without logging it."""
        with self._lock:
            self._fits.clear()
            if self.table is None:
                self._fits.of(self.agent)
                self.agent.warm_up(self.domain, Query(self.domain.attributes[:1]))

    def _change(self, agent: Agent, *, refit: bool = False) -> Change:
        """Return the message for a change of the agent, or for a refit."""
        before = agent_digest(self.agent)
        used = self._fits.has(self.agent)
        under_way = self._steps_under_way()
        return Change(agent.name, agent_digest(agent), before, used, refit, under_way=under_way)

    def _log_change(self, change: Change) -> None:
        """Log a change; without experience, only an attribute that is added matters."""
        folder = self._logs.log_path(None)
        matters = change.added or not self.experience.is_empty
        if folder is not None and self.table is None and matters:
            log_told(self.experience, folder, change)

    def _steps_under_way(self) -> dict[Key, int]:
        """Return the number of recorded steps of each trial in progress."""
        trials = self.experience.trials
        recorded = np.bincount(self.experience.executions.values["trial"], minlength=len(trials))
        return {key: int(recorded[trials[key]]) for key in self._under_way}

    def add_attribute(self, name: str, values: Sequence[str] = ()) -> Self:
        """Add an attribute to the domain, or a group with its values.

        Earlier recordings are used too: as soon as objects get labels of the attribute, classifiers
        learn it from all recordings of these objects. The learner refits at once, and again
        whenever the number of labels of an added attribute has grown by the fraction `refit_every`.
        A trial in progress keeps the attributes with which it began.

        From then on, the attribute is part of the learner's domain and of its saved files. The logs
        record the addition, so `recall` repeats it. The file from which the domain was read does
        not change.

        Parameters
        ----------
        name : str
            Name of the attribute or of the group.
        values : Sequence[str]
            Values of the group; every object has exactly one of them. Empty for a single attribute.

        Raises
        ------
        DomainError
            The domain already has the name, or the name is not valid.
        SettingsError
            The learner uses a percept table or your own posterior. No attribute can be added to
            either.

        Examples
        --------
        >>> from meal_bayes import Learner
        >>> learner = Learner("toy", logs=None).add_attribute("warm")
        >>> learner.add_attribute("size", ["small", "large"]).domain.attributes
        ('red', 'heavy', 'warm', 'small', 'large')
        """
        with self._lock:
            settings = self.settings
            if self.table is not None or settings.drawn is not None:
                raise SettingsError(
                    f"A percept table has no percepts of {name!r:.60}; fit recordings "
                    "(load_dataset), from which it can be learned."
                )
            if settings.posterior is not None:
                raise SettingsError(
                    f"The posterior of this learner (posterior=) has no attribute {name!r:.60}; "
                    "make a learner without posterior=, or give one with this attribute."
                )
            change = replace(self._change(self.agent), added=name, values=tuple(values))
            self.hear_attribute(name, values)
            self._log_change(change)
        return self

    def hear_attribute(self, name: str, values: Sequence[str]) -> None:
        """Do what `add_attribute` does, without logging it."""
        with self._lock:
            self.domain = with_attribute(self.domain, name, values)
            self.experience.add_attributes(self.domain)
            self._fits.clear()
            self._fit_agents()

    def tell(self, trial: Trial | str, values: Mapping[str, bool | None]) -> None:
        """Learn from labels that a person gives for an object, and update the posterior at once.

        The estimates of how objects differ and of how errors correlate do not change until the next
        refit. If a refit is due (`refit_every`), it runs in a thread, and the next call waits for
        its end (see `is_refitting`). The learner learns the same as if `tell` had waited. If trials
        are logged, labels are logged too; the labels of a trial are in a file beside its log.

        Parameters
        ----------
        trial : Trial or str
            A trial of this or another learner, or the name of an object.
        values : mapping
            True, False or None for each attribute, also for attributes about which the trial did
            not ask. A later label for the same trial, or for the same name, replaces the earlier
            one, also one of a percept table. If labels from several trials of an object contradict
            each other, the latest label is used.

        Raises
        ------
        QueryError
            An attribute is not in the domain, or the name of the object is invalid.
        SettingsError
            A value is not a label, or the percepts of the trial have other levels than those of the
            agent.
        """
        labels = checked_labels(values, self.domain)
        if not (labels >= 0).any():
            return
        name = trial.task.object_name if isinstance(trial, Trial) else trial
        check_object_name(name, self.known_names)
        with self._lock:
            if isinstance(trial, str) and self.table is None:
                warn_of_typo(self.experience, name)
            # A test is not part of the experience, so its labels are those of its named object.
            key = key_of_name(name)
            if isinstance(trial, Trial) and trial.task.learn:
                key = trial.task.key
            known = views.labels_for(self.experience, [name])[0]
            if self.table is not None:
                row = self.table.labels[object_index(self.table.objects, name)]
                known = self.experience.labels_beside(name, row)
            try:
                self.domain.replace(known, labels)
            except QueryError as fault:
                raise QueryError(f"With these labels, {name!r} would be {fault}.") from None
            if self.table is None and isinstance(trial, Trial) and key != key_of_name(name):
                new = views.unrecorded(self.experience, trial)
                perceived = any(step.observation is not None for step in new)
                if perceived and trial.momdp.levels != self.agent.levels:
                    raise SettingsError(
                        f"The trial has percepts of {trial.momdp.levels} levels, but the agent of "
                        f"this learner has {self.agent.levels}; give a trial with as many levels."
                    )
                self.record(trial)
            telling = self._telling(name, key)
            moved = self.experience.add_labels(key, name, labels)
            self._learn_told(trial, telling, moved)

    def forget(self, trial: Trial | str, *, recordings: bool = False) -> None:
        """Remove the labels of a trial or an object, and refit if the last refit used them.

        Parameters
        ----------
        trial : Trial or str
            A trial, or the name of an object. Such an object must have labels that were given for
            its name or together with recordings.
        recordings : bool
            Whether to remove the recordings and failures of the trial too. The learner then refits
            as if the trial had never taken place. This needs a trial, not a name.

        Raises
        ------
        SettingsError
            There are no labels or recordings to remove, or recordings of a name.
        """
        if not isinstance(trial, str):
            check_kind("trial", trial, Trial)
        elif recordings:
            raise SettingsError(
                f"The recordings of {trial!r:.60} are forgotten by the trial that made them: "
                "forget(trial, recordings=True). The trial may come from a log, "
                "next(meal_bayes.read_trials(log))."
            )
        name = trial if isinstance(trial, str) else trial.task.object_name
        key = (
            key_of_name(name) if isinstance(trial, str) or not trial.task.learn else trial.task.key
        )
        with self._lock:
            whole = recordings and views.has_taught(self.experience, key)
            if not whole and not (self.experience.labels_of_trial(key) >= 0).any():
                raise nothing_told(self.experience, name, key, recordings=recordings)
            telling = self._telling(name, key, recordings=whole)
            moved = self.experience.forget(key, recordings=whole)
            self._learn_told(trial, telling, moved)

    def note_folders(self, folders: Mapping[Key, Path]) -> None:
        """Store the folders of the trials' logs, so that labels are logged beside them."""
        if self._logs.log_path(None) is not None:
            self._logs.note(folders)

    def _telling(self, name: str, key: Key, *, recordings: bool = False) -> Telling:
        """Return the labels before a change, with the name and key to which it applies."""
        self._fit_agents()
        before = views.labels_touched(self.experience, key, name)
        return Telling(name, key, before, recordings, self._steps_under_way())

    def _learn_told(self, trial: Trial | str, telling: Telling, moved: NDArray[np.intp]) -> None:
        """Learn from changed labels of instances (k,), and log them beside the trial's log.

        Labels that change nothing are not logged and do not lead to a refit. A refit runs in a
        thread that holds the lock; logging does not change its inputs.
        """
        feedback = telling.feedback(self.experience)
        if feedback is None:
            self._fits.update(moved)
        else:
            self._refit_behind(self._fits.update_or_name_due(moved, anew=telling.recordings))
        folder = self._logs.told_folder(trial)
        if folder is not None:
            log_told(self._experience, folder, feedback)

    def _refit_behind(self, agents: Sequence[Agent]) -> None:
        """Refit for agents in a thread; the next call waits for its end."""
        if not agents:
            return
        _notes.info("%r refits; the next call waits for it", self)

        def refit() -> tuple[list[Online], list[str]]:
            with holding_warnings() as warned:
                return self._fits.refitted(agents), warned

        def finish(refitted: tuple[list[Online], list[str]]) -> None:
            fits, warned = refitted
            self._fits.replace(fits)
            for text in warned:
                warn_user(text)

        self._lock.start_behind(refit, finish)

    def record(self, trial: Trial) -> None:
        """Add a trial of another learner, or from a log, to the experience.

        This learner's classifiers compute percepts from the features of the steps. If a step has no
        features, its logged percepts of the queried attributes are used. Steps that were added
        before are not added again. Afterwards `tell` accepts labels for the trial.

        Parameters
        ----------
        trial : Trial
            A trial with the same behaviors.

        Raises
        ------
        SettingsError
            The trial has other behaviors than the domain.
        QueryError
            The name of the object differs from a known name only in invisible ways.
        """
        check_kind("trial", trial, Trial)
        check_domain(self.domain, trial)
        check_object_name(trial.task.object_name, self.known_names)
        with self._lock:
            self._fit_agents()
            self.experience.trial_number(trial.task.key)
            record_steps(self.experience, trial, views.unrecorded(self.experience, trial))

    def save(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Write the learner into one file that `load` reads; a failed write leaves no partial file.

        Parameters
        ----------
        path : str or Path
            File to write. An existing file is replaced only if this learner was the last to load or
            save it, or with `overwrite=True`.
        overwrite : bool
            Whether to replace the file, whoever saved it last.

        Raises
        ------
        OutputError
            Another program or learner wrote the existing file, or the file cannot be written.
        """
        target = checked_path("The file", path)
        with self._lock:
            self._file = write_learner(self._saved(), target, overwrite=overwrite)

    @classmethod
    def load(
        cls,
        path: str | Path,
        *,
        agent: object = None,
        classifier: object = None,
        logs: str | Path | None = LOGS,
    ) -> Self:
        """Read a learner from a file that `save` wrote; only classifiers of your own are refitted.

        Parameters
        ----------
        path : str or Path
            File that `save` wrote.
        agent, classifier : object, optional
            Your own agent or classifier, if the learner was saved with one. Agents of the package
            are found by their names.
        logs : str or Path, optional
            Folder for new logs, in which `resume` also looks for interrupted trials. The file does
            not name this folder, because another machine may load the file. Call `recall(learner,
            folder)` if labels of earlier trials should be logged beside their logs.

        Raises
        ------
        DataError
            The file does not contain a learner, is damaged, or was written by another version.
        SettingsError
            Your own agent or classifier is missing.
        """
        saved = read_learner(checked_path("The file", path), agent=agent, classifier=classifier)
        domain = saved.experience.domain
        learner = cls(domain, agent=saved.agent, settings=saved.settings, logs=logs)
        learner._experience = saved.experience
        learner.table = saved.table
        learner._questions = saved.questions
        learner._file = saved.file
        learner._robot_state = saved.robot_state
        learner._robot_seen = saved.robot_seen
        learner._fits = _Fits(saved.experience, saved.settings)
        learner._fits.online = saved.fitted
        return learner

    def _saved(self) -> SavedLearner:
        """Return the complete state of this learner."""
        return SavedLearner(
            agent=self.agent,
            settings=self.settings,
            experience=self.experience,
            table=self.table,
            fitted=self._fits.online,
            questions=self._questions,
            file=self._file,
            robot_state=self._robot_state,
            robot_seen=self._robot_seen,
        )


def ask(
    question: str | Sequence[str],
    *,
    dataset: str | Path | PerceptTable,
    object: str,
    agent: object = "bayes",
    answer: str = "values",
    payoffs: Sequence[float] | None = None,
    seed: int = 0,
    percepts: str = "recorded",
    reward: float | None = None,
    on_step: Callable[[Step], None] | None = None,
    log: str | Path | None = None,
    logs: str | Path | None = LOGS,
) -> Trial:
    """Ask an agent about a recorded object, without learning from this object before.

    The result is deterministic: equal arguments give equal trials.

    Parameters
    ----------
    question : str | Sequence[str]
        A sentence ("Is it heavy?"), a comma-separated list, or a list of attribute names.
    dataset : str | Path | PerceptTable
        Name of a shipped data set (roc36, ispy32, cy101), the path of a percept table that
        `save_percepts` wrote (.npz), or a percept table.
    object : str
        Name of the object.
    agent : object
        Name of an agent, an `Agent`, or a planner; see `meal_bayes.agents.as_agent`.
    answer, payoffs : str, Sequence[float] | None
        Kind of answer ("values" or "yes or no"), and payoffs of yes and no, as for `Learner.ask`.
    seed : int
        Seed of failed behaviors, of the order of recordings, and of planning.
    percepts : str
        Source of the percepts: "recorded", or "model" to draw them from the learned confusion
        matrices.
    reward : float | None
        Reward of a right report; a wrong report gets minus this reward. By default it is the
        domain's reward.
    on_step : Callable[[Step], None] | None
        Called after every step.
    log : str | Path | None
        Path of the trial's log (.mcap). By default the log is a new file in the folder of logs.
    logs : str | Path | None
        Folder of logs. With None, nothing is logged unless `log` is a path.

    Raises
    ------
    SettingsError
        The data set, object or agent is unknown.
    QueryError
        The question names no attribute, an unknown attribute, or the same attribute twice.

    Examples
    --------
    >>> import meal_bayes
    >>> trial = meal_bayes.ask(
    ... "heavy", dataset="roc36", object="heavy_green_beans", agent="greedy", logs=None
    ... )
    >>> trial.report, trial.success
    (array([ True]), True)
    """
    table = dataset if isinstance(dataset, PerceptTable) else load_percepts(dataset)
    learner = Learner(
        table.domain, agent=agent, seed=seed, reward=reward, percepts=percepts, logs=logs
    ).fit(table)
    return learner.ask(question, object, answer=answer, payoffs=payoffs, on_step=on_step, log=log)
