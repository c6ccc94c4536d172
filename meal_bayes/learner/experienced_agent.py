"""An agent with what it has experienced: what it learned, and the problems of questions."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from meal_bayes.agents import Agent, Knowledge, as_agent
from meal_bayes.datasets import PerceptTable, object_index
from meal_bayes.domain import Domain
from meal_bayes.errors import SettingsError
from meal_bayes.learner.columns import Objects
from meal_bayes.learner.experience import Experience
from meal_bayes.learner.fit import Fit, problem_of, training_agent
from meal_bayes.learner.fit_cache import FitCache
from meal_bayes.learner.held_out import replay
from meal_bayes.learner.online import Online
from meal_bayes.learner.settings import LearnerSettings, check_object_name, own_posterior
from meal_bayes.learner.trial import Question, QuestionCounts, task_of
from meal_bayes.learner.trial_logs import TrialLogs
from meal_bayes.momdp import MOMDP
from meal_bayes.planners import Policy
from meal_bayes.processes import Lock
from meal_bayes.robots.recorded import RecordedRobot
from meal_bayes.seeds import Key
from meal_bayes.trials import Task

NO_TABLE = "Give a robot, or fit a percept table (build_percept_table) to replay its objects."


class ExperiencedAgent:
    """An agent with what it has experienced, or with a percept table that it replays."""

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

    def note_question(self, header: Mapping[str, object]) -> None:
        """Count the question of a log of before a restart, by its header, if it was not yet."""
        with self._lock:
            self._questions.count_resumed(header)

    def _fit(self, task: Task, *, learn: bool, beside: Objects = ()) -> Fit:
        """Return what is known for a trial, by who runs it: training may be another agent's."""
        if self.table is not None:
            return self._fits.held_out(self.table, self.agent, task.object_index, beside)
        return self._fits.of(training_agent(self.agent) if learn else self.agent)

    def _fit_agents(self) -> None:
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
