"""What a learner does when it is asked: a session for each question, logged as it happens."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from numpy.typing import ArrayLike

from meal_bayes.domain import Query
from meal_bayes.errors import SettingsError
from meal_bayes.learner.experienced_agent import NO_TABLE, ExperiencedAgent
from meal_bayes.learner.trial import (
    NO_CLASSIFIERS,
    Question,
    TrialOptions,
    question_of,
    robot_or_name,
    session_of,
    start_of,
)
from meal_bayes.planners.solver import MAX_STEPS
from meal_bayes.robots import Robot
from meal_bayes.robots.recorded import RecordedRobot
from meal_bayes.robots.robot import state_index
from meal_bayes.seeds import Key
from meal_bayes.trial_log.folder import ASK
from meal_bayes.trial_log.live import Interrupted, LiveLog, resuming
from meal_bayes.trials import Session, Step, Task, Trial, run_trial


class Answerer(ExperiencedAgent):
    """Answers questions, one trial each."""

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
        options = TrialOptions(
            truth=truth, learn=learn, max_steps=max_steps, max_cost=max_cost, on_step=on_step
        )
        question = question_of(question, self.domain, answer, payoffs)
        return self._ask(question, robot, object_name, options, key=key, log=log)

    def _ask(
        self,
        question: Question,
        robot: Robot | None,
        object_name: str | None,
        options: TrialOptions,
        *,
        key: str | int | None,
        log: str | Path | None,
    ) -> Trial:
        """Run the trial of a question that was read, by a robot or a replay."""
        if (robot is None) == (self.table is None):
            raise SettingsError(NO_TABLE if robot is None else NO_CLASSIFIERS)
        if isinstance(robot, RecordedRobot):
            options = replace(options, limit=robot.limit)
        session = self._open(question, object_name, options, key=key, log=log)
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
            truth=truth,
            learn=learn,
            max_steps=max_steps,
            max_cost=max_cost,
            on_step=on_step,
            commanded=commanded,
            seed=seed,
        )
        question = question_of(question, self.domain, answer, payoffs)
        session = self._open(question, object_name, options, key=key, log=log, state=state)
        return session.start(state)

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
        path = self._logs.interrupted(log, "give resume() the trial's log")
        with resuming(path) as broken:
            return self._resumed(broken, state)

    def _resumed(self, broken: Interrupted, state: str | None) -> Session:
        """Return the session of a trial that was broken off, where it was."""
        trial = broken.trial
        begun = dict(broken.header["begun"])
        start = start_of(trial, begun.pop("state", None) or self.domain.diagram.start, state)
        options = TrialOptions(truth=trial.truth, **begun)
        session = self._session(trial.task, tuple(broken.header["streams"]), options)
        session.start(start)
        session.repeat(trial.steps)
        self.note_question(broken.header)
        self._record(session, broken.path, broken.header, broken)
        return session

    def _open(
        self,
        question: Question,
        object_name: str | None,
        options: TrialOptions,
        *,
        key: str | int | None,
        log: str | Path | None,
        state: str | None = None,
    ) -> Session:
        """Return the session of a question, logged if the learner logs, but not started yet."""
        path = self._logs.log_path(log)
        asked: Mapping[str, object] = {}
        with self._lock:
            task, streams = self._task(question, object_name, key, learn=options.learn)
            if self.table is None and not isinstance(question, Task):
                asked = self._questions.count(learn=options.learn, key=key)
        session = self._session(task, streams, options)
        if path is None:
            return session
        text = question.text if isinstance(question, Query) else str(question)
        config = {"command": ASK, "question": text, "agent": self.agent.name}
        self._record(session, path, {"config": config, "begun": options.begun(state), **asked})
        return session

    def _record(
        self,
        session: Session,
        path: Path,
        header: Mapping[str, object],
        resumed: Interrupted | None = None,
    ) -> None:
        """Log a session from now on, with a header that says how it came about."""
        drawn = {"seed": self.settings.seed, "streams": list(session.key), "data": self.domain.data}
        log = LiveLog(path, {**drawn, **header}, session.task.object_name, resumed=resumed)
        self._logs.note({session.task.key: log.path.parent})
        session.record(log)

    def _session(self, task: Task, key: Key, options: TrialOptions) -> Session:
        """Return the session of a task whose random streams `key` names."""
        with self._lock:
            if options.learn:
                self._fit_agents()
            fit = self._fit(task, learn=options.learn, beside=options.beside)
        return session_of(fit, task, key, options, lock=self._lock, on_end=self._end)

    def _end(self, trial: Trial) -> None:
        """Learn from a trial: labels of an object that is recognized are known already."""
        with self._lock:
            self._fits.update(self.experience.instances_of_trial(trial.task.key), refit=False)
