"""What a learner does when it is asked: its tasks, their problems and policies, their sessions."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from meal_bayes.agents import Agent, Knowledge, as_agent
from meal_bayes.datasets import PerceptTable, object_index
from meal_bayes.domain import Domain, Query
from meal_bayes.errors import SettingsError
from meal_bayes.learner.columns import Objects
from meal_bayes.learner.experience import Experience
from meal_bayes.learner.fit import Fit, problem_of, training_agent
from meal_bayes.learner.fit_cache import FitCache
from meal_bayes.learner.held_out import replay
from meal_bayes.learner.online import Online
from meal_bayes.learner.settings import LearnerSettings, check_object_name, own_posterior
from meal_bayes.learner.trial import (
    NO_CLASSIFIERS,
    Question,
    QuestionCounts,
    TrialOptions,
    question_of,
    robot_or_name,
    session_of,
    start_of,
    task_of,
)
from meal_bayes.learner.trial_logs import TrialLogs
from meal_bayes.momdp import MOMDP
from meal_bayes.planners import Policy
from meal_bayes.planners.solver import MAX_STEPS
from meal_bayes.processes import Lock
from meal_bayes.robots import Robot
from meal_bayes.robots.recorded import RecordedRobot
from meal_bayes.robots.robot import state_index
from meal_bayes.seeds import Key
from meal_bayes.trial_log.live import Interrupted, LiveLog, resuming
from meal_bayes.trial_log.schema import ASK
from meal_bayes.trials import Session, Step, Task, Trial, run_trial

NO_TABLE = "Give a robot, or fit a percept table (build_percept_table) to replay its objects."


class Answerer:
    """Answers questions: an agent with what it has experienced, or with a percept table."""

    def __init__(
        self, domain: Domain, agent: Agent, settings: LearnerSettings, logs: str | Path | None
    ) -> None:
        self.domain = domain
        self.settings = settings
        self.experience = Experience(domain)
        self.table: PerceptTable | None = None  # that is replayed
        self._agent = agent
        self._fits = FitCache(self.experience, settings)
        self._questions = QuestionCounts()
        self._logs = TrialLogs(logs, domain.name)
        self._lock = Lock()

    @property
    def agent(self) -> Agent:
        """Who decides; another agent learns from the same experience."""
        return self._agent

    @agent.setter
    def agent(self, agent: object) -> None:
        chosen = as_agent(agent)
        own_posterior(self.settings.posterior, self.domain, chosen)
        with self._lock:
            self._agent = chosen

    def knowledge(self, object_name: str | None = None) -> Knowledge:
        """Return what was learned; from a percept table, without one of its objects."""
        if self.table is None:
            return self.fitted(self.agent).knowledge
        if object_name is None:
            raise SettingsError("A percept table holds only what is known without an object of it.")
        with self._lock:
            o = object_index(self.table.objects, object_name)
            return self._fits.held_out(self.table, self.agent, o).knowledge

    def fitted(self, agent: Agent) -> Online:
        """Return what an agent makes of the experience; learned when it is first needed."""
        with self._lock:
            return self._fits.of(agent)

    def task(self, question: Question, object_name: str | None = None) -> Task:
        """Return the task that a question would be; an object without a name gets one."""
        return self._task(question, object_name)[0]

    def problem(self, question: Question, object_name: str | None = None) -> MOMDP:
        """Return the decision problem of a question, as a test of it would have it."""
        task = self.task(question, object_name)
        with self._lock:
            return problem_of(self._fit(task, learn=False), task)

    def policy(self, question: Question, object_name: str | None = None) -> Policy:
        """Return who decides about a question, as in a test of it."""
        task, streams = self._task(question, object_name)
        with self._lock:
            return self._fit(task, learn=False).plan(task, streams, limit=np.inf, explore=False)[1]

    def replay(
        self, question: Question, object_name: str | None = None, *, seed: int | None = None
    ) -> RecordedRobot:
        """Return the robot that replays an object of the percept table.

        The seed, by default the learner's, draws what fails and the order of recordings.
        """
        if self.table is None:
            raise SettingsError(NO_TABLE)
        seed = self.settings.seed if seed is None else seed
        repeats = self.settings.percepts == "model"
        return replay(self.table, self.task(question, object_name), seed, repeats=repeats)

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
        answer : str
            "values" of what is asked, or "yes or no": "Is it red and not empty?", see `read_event`.
        payoffs : Sequence[float], optional
            What a right yes, a wrong yes, a right no and a wrong no earn; the learner's by default.
        learn : bool
            Whether it explores, and becomes experience; else a test, as replays of a table are.
        log : str or Path, optional
            Of the trial (.mcap); one in the folder of logs by default.
        key : str or int, optional
            Names the random streams; by default the number of questions so far, of tests apart
            from those that it learned from; in replays nothing.
        max_steps, max_cost, on_step : int, float, callable
            See `Session`.

        Raises
        ------
        QueryError
            A question that cannot be understood.
        SettingsError
            No data were fitted of the kind that the robot needs.
        RobotError
            The robot came to a state that it cannot be in.
        """
        robot, object_name = robot_or_name(robot, object_name)
        if (robot is None) == (self.table is None):
            raise SettingsError(NO_TABLE if robot is None else NO_CLASSIFIERS)
        limit = robot.limit if isinstance(robot, RecordedRobot) else np.inf
        options = TrialOptions(truth, learn, limit, max_steps, max_cost, on_step)
        question = question_of(question, self.domain, answer, payoffs)
        session = self._open(question, object_name, key, log, options, state=None)
        return run_trial(session, self.replay(session.task) if robot is None else robot)

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
        """Begin a trial that somebody else drives; see `Session` for what to do with it.

        Whoever drives executes `behavior`, and gives its `Outcome` to `observe`, until the
        trial is `over`; then `report` is the answer.

        Parameters
        ----------
        state : str, optional
            Where the robot is, the domain's start by default; a `RobotError` where it cannot be.
        commanded : bool
            Whether somebody else decides, too, by `Session.command`.
        seed : int, optional
            Of what is drawn; the learner's by default.
        question, object_name, truth, answer, payoffs, learn, log, key : Any
            As for `ask`; so are `max_steps`, `max_cost` and `on_step`.
        """
        diagram = self.domain.diagram
        state = diagram.start if state is None else state
        state_index(diagram.states, state, "begin(state=)")  # before there is a log of it
        options = TrialOptions(
            truth, learn, max_steps=max_steps, max_cost=max_cost, on_step=on_step,
            commanded=commanded, seed=seed,
        )  # fmt: skip
        question = question_of(question, self.domain, answer, payoffs)
        return self._open(question, object_name, key, log, options, state).start(state)

    def resume(self, log: str | Path | None = None, *, state: str | None = None) -> Session:
        """Go on with a trial whose process ended in the middle of it, from its log.

        The learner is the one that began it, or has been saved before and loaded since. What it
        sensed until then is in the log, and is learned from.

        Parameters
        ----------
        log : str or Path, optional
            Of the trial, or its draft, or a folder of logs where one trial was broken off; by
            default this learner's.
        state : str, optional
            Where the robot is now, which has to be where the log ends; needed of several states.

        Raises
        ------
        LogError
            There is no trial that was broken off, or several; it is another learner's, another
            process drives the robot, or that is elsewhere.
        """
        place = self._logs.interrupted(log, "give resume() the trial's log")
        with resuming(place, Interrupted) as broken:
            return self._resumed(broken, state)

    def _resumed(self, broken: Interrupted, state: str | None) -> Session:
        """Return the session of a trial that was broken off, where it was."""
        before = broken.trial
        begun = dict(broken.header["begun"])
        start = start_of(before, begun.pop("state", None) or self.domain.diagram.start, state)
        options = TrialOptions(truth=before.truth, **begun)
        session = self._session(before.task, tuple(broken.header["streams"]), options)
        session.start(start)
        session.repeat(before.steps)
        self.note_question(broken.header)
        self._record(session, broken.path, broken.header, broken)
        return session

    def note_question(self, header: Mapping[str, object]) -> None:
        """Count the question of a log of before a restart, by its header, if it was not yet."""
        with self._lock:
            self._questions.count_resumed(header)

    def _fit(self, task: Task, *, learn: bool, beside: Objects = ()) -> Fit:
        """Return what is known for a trial, by who runs it: training may be another agent's."""
        if self.table is not None:
            return self._fits.held_out(self.table, self.agent, task.object_index, beside)
        return self._fits.of(training_agent(self.agent) if learn else self.agent)

    def _use(self) -> None:
        """Let the agents learn from the record before it changes, if they have not."""
        if self.table is None:
            for agent in (self.agent, training_agent(self.agent)):
                self._fits.of(agent)

    def _task(
        self,
        question: Question,
        object_name: str | None,
        key: str | int | None = None,
        *,
        learn: bool = False,
    ) -> tuple[Task, Key]:
        """Return the task of a question, and the key of its random streams, by `key`."""
        name = question.object_name if isinstance(question, Task) else object_name
        if name is not None:
            check_object_name(name, self.experience.met)
        if key is None and self.table is None:
            key = self._questions.next_key(learn=learn)
        return task_of(self.domain, self.table, question, object_name, key)

    def _open(
        self,
        question: Question,
        object_name: str | None,
        key: str | int | None,
        log: str | Path | None,
        options: TrialOptions,
        state: str | None,
    ) -> Session:
        """Return the session of a question, logged if there is a place, but not started yet."""
        place = self._logs.place(log)
        asked: Mapping[str, object] = {}
        with self._lock:
            task, streams = self._task(question, object_name, key, learn=options.learn)
            if self.table is None and not isinstance(question, Task):
                asked = self._questions.count(learn=options.learn, key=key)
        session = self._session(task, streams, options)
        if place is None:
            return session
        text = question.text if isinstance(question, Query) else str(question)
        config = {"command": ASK, "question": text, "agent": self.agent.name}
        self._record(session, place, {"config": config, "begun": options.begun(state), **asked})
        return session

    def _record(
        self,
        session: Session,
        place: Path,
        header: Mapping[str, object],
        resumed: Interrupted | None = None,
    ) -> None:
        """Log a session from now on, with a header that says how it came about."""
        drawn = {"seed": self.settings.seed, "streams": list(session.key), "data": self.domain.data}
        log = LiveLog(place, {**drawn, **header}, session.task.object_name, resumed=resumed)
        self._logs.note({session.task.key: log.path.parent})
        session.record(log)

    def _session(
        self, task: Task, key: Key, options: TrialOptions, beside: Objects = ()
    ) -> Session:
        """Return the session of a task, perhaps of a search, whose random streams `key` names."""
        with self._lock:
            if options.learn:
                self._use()
            fit = self._fit(task, learn=options.learn, beside=beside)
        return session_of(fit, task, key, options, lock=self._lock, on_end=self._end)

    def _end(self, trial: Trial) -> None:
        """Learn from a trial: labels of an object that is recognized are known already."""
        with self._lock:
            self._fits.update(self.experience.instances_of_trial(trial.task.key), refit=False)
