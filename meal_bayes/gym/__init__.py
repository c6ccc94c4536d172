"""Gymnasium environments on real recordings, to train and compare policies.

Importing this module registers `meal_bayes/ROC36-v0`, `meal_bayes/ISPY32-v0`,
`meal_bayes/CY101-v0`, and `meal_bayes/Own-v0`, which takes your own percept table as ``dataset=``.
The module needs the extra ``gym``.

>>> import gymnasium
>>> env = gymnasium.make("meal_bayes.gym:meal_bayes/ROC36-v0", attributes=2)  # doctest: +SKIP
"""

import operator
import weakref
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from meal_bayes.agents import as_agent
from meal_bayes.arrays import check_amount, check_whole
from meal_bayes.datasets import PerceptTable, object_index
from meal_bayes.domain import unknown
from meal_bayes.errors import SettingsError
from meal_bayes.experiments import offline_tasks
from meal_bayes.experiments.config import MOST_TRIALS
from meal_bayes.files import LOGS, file_name, lasting_path
from meal_bayes.gym.episode_log import LEFT, EpisodeLog
from meal_bayes.learner import Learner
from meal_bayes.perception import TableSource
from meal_bayes.planners import Policy, unvalued
from meal_bayes.planners.solver import MAX_STEPS, decide
from meal_bayes.robots.recorded import RecordedRobot
from meal_bayes.seeds import stream
from meal_bayes.trials import Session, Trial
from meal_bayes.untrusted import LARGEST

__all__ = ["ENVIRONMENTS", "MealEnv"]

Observation = dict[str, Any]

_SEEDS = 2**31  # of failures and recordings
_HELD_OUT = 4  # one object of so many is a test's

ENVIRONMENTS = {
    "meal_bayes/ROC36-v0": {"dataset": "roc36"},
    "meal_bayes/ISPY32-v0": {"dataset": "ispy32"},
    "meal_bayes/CY101-v0": {"dataset": "cy101"},
    "meal_bayes/Own-v0": {},
}
for _name, _settings in ENVIRONMENTS.items():
    gymnasium.register(_name, entry_point="meal_bayes.gym:MealEnv", kwargs=_settings)


class MealEnv(gymnasium.Env[Observation, np.int64]):
    """Environment in which an episode is a trial of ``meal-bayes run offline``.

    Actions 0 to E - 1 are the behaviors, and the next 2^N actions are the reports. Action E + y
    reports the bits of y as values of the attributes; the most significant bit is the value of the
    first queried attribute. If the agent may abstain, the last action is "I do not know". A
    behavior has the reward minus its cost in seconds. A right report has the reward r, a wrong
    report -r, and "I do not know" 0. A behavior that is not legal (see ``info["action_mask"]``) is
    not executed: its cost is subtracted from the reward, and nothing else changes. Percepts are
    outputs of held-out classifiers on real recordings; a trial uses each recording at most once.

    An observation is a dictionary:

    * ``state``: index of the observed state; the last of the X states is ``term``.
    * ``asked``: (N,) positions of the queried attributes in the domain.
    * ``percepts``: (N,E,K) number of percepts so far, by attribute, behavior and level.
    * ``belief``: (N,) probability that each queried attribute is true, by the belief update of the
      agent, which has learned from other objects only.
    * ``cost``: (1,) cost so far, s.

    Parameters
    ----------
    dataset : str | Path | PerceptTable
        A shipped data set, or the path of a percept table (.npz).
    agent : object
        Agent whose belief is observed, and whose choices `decide` returns; see `as_agent`.
    seed : int
        Seed of the list of tasks, and of trials whose task is chosen by its number.
    attributes, trials : int
        Number N of attributes in a question, and number of tasks that are drawn about all objects.
        Those about `objects` form the list of tasks.
    answer : str
        Kind of question: "values", "yes or no" or "balanced"; see `OfflineConfig`. For the last two
        kinds there are two reports, no (action E) and yes (action E + 1).
    objects : str | Collection[str]
        Objects of the tasks: "all", "train" (three quarters), "test" (the other quarter), or names.
        The quarters are the same for every seed.
    scale : float
        Factor by which all rewards are multiplied.
    max_steps : int
        Number of behaviors after which an episode is truncated.
    logs : str | Path | None
        Folder of logs; None turns logging off. Each environment writes its episodes into one file,
        such as logs/gym-roc36-n2/20260131-142507-381904-test-a3f9c2.mcap. The file is opened at the
        end of the first episode with a step; `close`, or the end of the program, completes it. The
        logged trials name the agent if `decide` chose all actions, and "external" otherwise.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> from meal_bayes import read_trials
    >>> with TemporaryDirectory() as folder:
    ...     env = MealEnv("roc36", attributes=1, agent="greedy", logs=folder)
    ...     for seed in range(3):
    ...         _, info = env.reset(seed=seed)
    ...         ended = False
    ...         while not ended:
    ...             _, reward, ended, _, info = env.step(env.decide())
    ...     env.close()
    ...     (log,) = Path(folder).rglob("*.mcap")
    ...     len(list(read_trials(log)))
    3
    """

    def __init__(
        self,
        dataset: str | Path | PerceptTable | None = None,
        *,
        attributes: int = 2,
        answer: str = "values",
        agent: object = "bayes",
        seed: int = 0,
        trials: int = 400,
        objects: str | Collection[str] = "all",
        scale: float = 1.0,
        max_steps: int = MAX_STEPS,
        logs: str | Path | None = LOGS,
    ) -> None:
        if dataset is None:
            raise SettingsError("Give dataset=, the name of a data set or your own percept table.")
        seed = check_whole("seed", seed)
        attributes = check_whole("attributes", attributes)
        max_steps = _limited("max_steps", max_steps)
        trials = _limited("trials", trials)
        check_amount("scale", scale, LARGEST)
        table = TableSource.of(dataset).load()
        chosen_agent = as_agent(agent)
        names = _task_objects(table, objects)
        # The tasks of `run offline`, so that results of both can be compared.
        every = offline_tasks(table, attributes, trials, seed, answer=answer)
        self.tasks = [task for task in every if task.object_name in names]
        if not self.tasks:
            raise SettingsError(f"None of the {trials} tasks is about {sorted(names)}; give more.")
        self._max_steps = max_steps
        self._scale = float(scale)
        self._learner = Learner(table.domain, agent=chosen_agent, seed=seed, logs=None).fit(table)
        self._begun: tuple[Session, RecordedRobot] | None = None
        self._policy: Policy | None = None
        self._decided: int | None = None  # the action that the agent chose for the next step
        self._steps = 0
        place = None if logs is None else lasting_path("logs", logs)
        self._log = EpisodeLog(
            place and place / file_name(f"gym-{table.domain.name}-n{attributes}"),
            objects if isinstance(objects, str) else "objects",
            {
                "config": {
                    "command": "gymnasium",
                    "dataset": table.domain.data,
                    "attributes": attributes,
                    "answer": answer,
                    "agent": chosen_agent.name,
                    "trials": trials,
                    "objects": objects if isinstance(objects, str) else sorted(names),
                    "max_steps": max_steps,
                },
                "seed": seed,
                "data": table.domain.data,
            },
        )
        self._finish_log_with_self()
        n = attributes
        x = len(table.domain.diagram.states)
        e = len(table.domain.behaviors)
        p = len(table.domain.attributes)
        dearest = max(behavior.cost for behavior in table.domain.behaviors)
        reports = 2**n if answer == "values" else 2
        answers = reports + (chosen_agent.abstain and table.domain.diagram.abstain)
        self._actions = e + answers
        self._answers = np.ones(answers, bool)  # always legal
        self.action_space = spaces.Discrete(self._actions)
        self.observation_space = spaces.Dict(
            {
                "state": spaces.Discrete(x),
                "asked": spaces.MultiDiscrete(np.full(n, p)),
                "percepts": spaces.Box(0, max_steps + 1, (n, e, chosen_agent.levels), np.int64),
                "belief": spaces.Box(0.0, 1.0, (n,), np.float64),
                "cost": spaces.Box(0.0, dearest * (max_steps + 1), (1,), np.float64),
            }
        )

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the state of a copy, which writes its own log."""
        self.__dict__.update(state)
        self._finish_log_with_self()

    def _finish_log_with_self(self) -> None:
        """Complete the log when this environment, or the program, ends without `close`."""
        weakref.finalize(self, self._log.close)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode, and return observation and info.

        With ``options={"task": i}``, the episode is task i of the list, with the random draws of
        ``meal-bayes run offline``. By default, the task and the draws are random; they depend on
        the seed that was passed in this call or an earlier one.
        """
        super().reset(seed=seed)
        given_options: Any = {} if options is None else options  # users give anything
        if not isinstance(given_options, dict) or set(given_options) - {"task"}:
            raise SettingsError(f"options are {options!r:.60}; expected {{'task': i}}, or none.")
        index = given_options.get("task")
        seed_of_task = self._learner.settings.seed
        if index is None:
            index = int(self.np_random.integers(len(self.tasks)))
            seed_of_task = int(self.np_random.integers(_SEEDS))
        index = check_whole("task", index)
        if index >= len(self.tasks):
            raise SettingsError(
                f"The task is {index}; expected a number from 0 to {len(self.tasks) - 1}."
            )
        task = self.tasks[index]
        learner = self._learner
        truncated = self._steps >= self._max_steps
        self._log.leave(f"truncated after {self._steps} steps" if truncated else LEFT)
        robot = learner.replay(task, seed=seed_of_task)
        session = learner.begin(task, state=robot.start(), seed=seed_of_task, commanded=True)
        self._begun = (session, robot)
        self._log.begin(session, seed_of_task)
        self._asked = np.array(learner.domain.columns(task.query.attributes))
        self._question = {  # of every info until the next reset
            "object": task.object_name,
            "query": tuple(name for name, _ in task.query.questions),
            "question": task.query.text,
        }
        self._policy = self._decided = None
        self._steps = 0
        return self._seen()

    def step(self, action: int | np.int64) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Execute an action; return observation, reward, terminated, truncated and info."""
        running, robot = self._running
        if running.over:
            raise SettingsError("The episode is over; call reset() first.")
        momdp = running.momdp
        try:
            # 2.7 or "3" is no action, nor is True, which is a number to Python.
            index = operator.index(None if isinstance(action, bool) else action)  # type: ignore[arg-type]
        except TypeError:
            message = f"The action is {action!r:.60}; give a whole number of {self.action_space}."
            raise SettingsError(message) from None
        if not 0 <= index < self._actions:
            raise SettingsError(f"The action is {index!s:.60}; give one of {self.action_space}.")
        self._steps += 1
        # An illegal behavior costs its seconds and changes nothing: learners try it all the time.
        if index < momdp.n_behaviors and not momdp.legal[running.belief.x, index]:
            reward = -momdp.charged(index, failed=True)
        else:
            running.command(unvalued(momdp, index))
            if running.behavior is not None:
                running.observe(robot.execute(running.behavior))
            reward = float(running.steps[-1].reward)
        self._log.stepped(by_agent=index == self._decided)
        self._decided = None
        ended = bool(running.over)  # it may have been ended since
        truncated = not ended and self._steps >= self._max_steps
        observation, info = self._seen()
        return observation, self._scale * reward, ended, truncated, info

    def decide(self) -> int:
        """Return the action that the agent would choose."""
        running, _ = self._running
        if self._policy is None:
            self._policy = self._learner.policy(running.task)
        rng = running.streams.of("planner", running.agent)
        self._decided = int(decide(self._policy, running.history, rng).action)
        return self._decided

    def close(self) -> None:
        """End the episode, log its steps so far, and complete the log file.

        Later episodes are written into another file.
        """
        self._log.close()

    @property
    def _running(self) -> tuple[Session, RecordedRobot]:
        if self._begun is None:
            raise SettingsError("No episode has begun; call reset() first.")
        return self._begun

    @property
    def actions(self) -> list[str]:
        """Names of the actions in the present task."""
        momdp = self._running[0].momdp
        return list(map(momdp.action_name, range(momdp.n_actions)))

    @property
    def trial(self) -> Trial:
        """The trial so far. Its agent is "external" if any action was not chosen by `decide`."""
        return self._log.trial(self._running[0])

    def _seen(self) -> tuple[Observation, dict[str, Any]]:
        """Return observation and info."""
        running, _ = self._running
        belief = running.belief
        observation = {
            "state": belief.x,
            "asked": self._asked.copy(),
            "percepts": np.array(belief.percept_counts, np.int64),
            "belief": np.array(belief.positive, np.float64),
            "cost": np.array([running.history.cost], np.float64),
        }
        reported = belief.x == running.momdp.terminal
        return observation, {
            "action_mask": self.action_masks().astype(np.int8),
            **self._question,
            "success": bool(self.trial.success) if reported else None,
        }

    def action_masks(self) -> NDArray[np.bool_]:
        """Return which actions are legal, (A,), for sb3-contrib; answers are always legal."""
        running, _ = self._running
        return np.concatenate([running.momdp.legal[running.belief.x], self._answers])


def _limited(name: str, value: object) -> int:
    """Check a number of trials or steps; raise `SettingsError` if it is too large."""
    number = check_whole(name, value)
    if number > MOST_TRIALS:
        raise SettingsError(f"{name} is {number!s:.60}; give at most {MOST_TRIALS:,}.")
    return number


def _task_objects(table: PerceptTable, objects: str | Collection[str]) -> set[str]:
    """Return the names of the objects that tasks are about."""
    if isinstance(objects, str):
        # Some of the objects, the same in every environment, are held out.
        order = stream(0, "held-out objects", table.domain.data).permutation(len(table.objects))
        held_out = {table.objects[i] for i in order[: -(-len(order) // _HELD_OUT)]}
        sets = {"all": set(table.objects), "train": set(table.objects) - held_out, "test": held_out}
        if objects not in sets:
            raise SettingsError(unknown("set of objects", objects, sets))
        return sets[objects]
    names: Any = objects.tolist() if isinstance(objects, np.ndarray) else objects  # or anything
    if not isinstance(names, Iterable) or not all(isinstance(name, str) for name in names):
        raise SettingsError(f"objects are {objects!r:.60}; give names, or all, train or test.")
    for name in names:
        object_index(table.objects, name)  # raises where it is unknown
    return set(names)
