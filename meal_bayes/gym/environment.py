"""One environment: a query about an object that was never learned from."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from meal_bayes.agents import Agent, OfflineRunner, Task, Trial, load_agent
from meal_bayes.agents.inner_loop import RunningTrial
from meal_bayes.datasets import PerceptTable
from meal_bayes.errors import SettingsError
from meal_bayes.experiments import offline_tasks
from meal_bayes.experiments.percepts import percepts_for
from meal_bayes.momdp import MOMDP
from meal_bayes.planners import Decision, History, unvalued

Observation = dict[str, Any]

_SEEDS = 2**31  # of failures and recordings


class MealEnv(gymnasium.Env[Observation, np.int64]):
    """Choose behaviors, perceive, and report; an episode is a trial of ``run offline``.

    Actions are the E behaviors and then the 2^N reports: E + y reports the values whose bits are y,
    the first asked attribute the most significant. The reward is the true one: minus a behavior's
    seconds, and plus or minus r for a report. A behavior that is illegal may end the episode
    without a report (see ``info["action_mask"]``). Percepts are outputs of held-out classifiers
    on real recordings, none used twice.

    Observations are a dictionary:

    * ``state``: x, of X; the last is ``term``.
    * ``asked``: (N,) positions of the asked attributes in the domain.
    * ``percepts``: (N,E,K) how often each behavior has shown each level of each attribute.
    * ``belief``: (N,) Pr(attribute is true), by the agent's filter, learned without the object.
    * ``cost``: (1,) s so far.

    Parameters
    ----------
    dataset : a shipped data set, the path of a percept table (.npz), or a percept table.
    attributes : N, asked at a time.
    agent : whose belief is observed, and who decides in `decide`.
    seed : of the task list, and of the trials of tasks that are chosen by number.
    trials : tasks in the list.
    percepts : "recorded", or "model": drawn from the learned confusion matrices.
    reward : r, the domain's by default.
    max_steps : behaviors after which an episode is truncated.
    render_mode : "ansi" or None.
    """

    metadata = {"render_modes": ["ansi"], "render_fps": 1}  # noqa: RUF012  Gymnasium's

    def __init__(
        self,
        dataset: str | Path | PerceptTable | None = None,
        *,
        attributes: int = 2,
        agent: str | Agent = "bayes",
        seed: int = 0,
        trials: int = 400,
        percepts: str = "recorded",
        reward: float | None = None,
        max_steps: int = 100,
        render_mode: str | None = None,
    ) -> None:
        if dataset is None:
            raise SettingsError("Give dataset=, a shipped name, or a percept table of your own.")
        table = dataset if isinstance(dataset, PerceptTable) else percepts_for(str(dataset))
        chosen = agent if isinstance(agent, Agent) else load_agent(agent)
        self.tasks = offline_tasks(table, attributes, trials, seed)
        self.render_mode, self._max_steps = render_mode, max_steps
        self._runner = OfflineRunner(table, chosen, seed, percepts, reward)
        self._begun: RunningTrial | None = None
        self._action = 0
        n, x = attributes, len(table.domain.diagram.states)
        e, p = len(table.domain.behaviors), len(table.domain.attributes)
        dearest = max(behavior.cost for behavior in table.domain.behaviors)
        self.action_space = spaces.Discrete(e + 2**n)
        self.observation_space = spaces.Dict(
            {
                "state": spaces.Discrete(x),
                "asked": spaces.MultiDiscrete(np.full(n, p)),
                "percepts": spaces.Box(0, max_steps + 1, (n, e, chosen.levels), np.int64),
                "belief": spaces.Box(0.0, 1.0, (n,), np.float64),
                "cost": spaces.Box(0.0, dearest * (max_steps + 1), (1,), np.float64),
            }
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode, and return observation and info.

        Parameters
        ----------
        seed : of the tasks and the random draws of this and all later episodes.
        options : ``{"task": i}`` chooses task i of the list with the random draws of
            ``run offline``; by default both are new.
        """
        super().reset(seed=seed)
        index = (options or {}).get("task")
        seed_of_task = self._runner.seed
        if index is None:
            index = int(self.np_random.integers(len(self.tasks)))
            seed_of_task = int(self.np_random.integers(_SEEDS))
        if not 0 <= index < len(self.tasks):
            raise SettingsError(f"Task {index}; expected 0 to {len(self.tasks) - 1}.")
        self._begin(self.tasks[index], seed_of_task)
        return self._observation(), self._info()

    def step(self, action: int | np.int64) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Execute a behavior or report; return observation, reward, terminated, truncated, info."""
        running = self._running
        if running.belief.x == running.momdp.terminal:
            raise SettingsError("The episode is over; call reset() first.")
        self._action = int(action)
        step = running.step(self._max_steps + 1)
        terminated = step.next_x == running.momdp.terminal
        truncated = not terminated and len(running.steps) >= self._max_steps
        return self._observation(), float(step.reward), terminated, truncated, self._info()

    def decide(self) -> int:
        """Return the action that the agent itself would choose."""
        _, policy = self._runner.prepare(self._running.task)
        return int(
            policy.decide(self._running.history, self._running.environment.streams.planner).action
        )

    def render(self) -> str | None:
        """Return the trial so far as text, in the mode "ansi"."""
        return repr(self.trial) if self.render_mode == "ansi" else None

    @property
    def _running(self) -> RunningTrial:
        if self._begun is None:
            raise SettingsError("No episode has begun; call reset() first.")
        return self._begun

    @property
    def trial(self) -> Trial:
        """The trial so far."""
        return self._running.trial(self._runner.agent.name)

    def _begin(self, task: Task, seed: int) -> None:
        momdp, _ = self._runner.prepare(task)
        runner = replace(self._runner, seed=seed)  # which shares what was learned
        environment = runner.environment(task)
        self._begun = RunningTrial(task, momdp, _Commanded(self, momdp), environment)
        self._begun.start()

    def _observation(self) -> Observation:
        running, domain = self._running, self._runner.table.domain
        asked = domain.columns(running.task.query.attributes)
        return {
            "state": running.belief.x,
            "asked": np.array(asked),
            "percepts": np.array(running.belief.percept_counts, np.int64),
            "belief": np.array(running.belief.positive, np.float64),
            "cost": np.array([running.history.cost], np.float64),
        }

    def _info(self) -> dict[str, Any]:
        running = self._running
        done = running.belief.x == running.momdp.terminal
        return {
            "action_mask": self._mask(),
            "object": running.task.object_name,
            "query": running.task.query.attributes,
            "actions": [running.momdp.action_name(a) for a in range(running.momdp.n_actions)],
            "success": bool(self.trial.success) if done else None,
        }

    def _mask(self) -> NDArray[np.int8]:
        """Return which actions are legal, (A,); reports always are."""
        momdp, x = self._running.momdp, self._running.belief.x
        mask = np.ones(momdp.n_actions, np.int8)
        mask[: momdp.n_behaviors] = momdp.legal[x]
        return mask


class _Commanded:
    """A policy that takes the environment's action."""

    def __init__(self, env: MealEnv, momdp: MOMDP) -> None:
        self._env, self._momdp = env, momdp

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        return unvalued(self._momdp, self._env._action)
