"""Algorithm 2, MORC-ITRS in its batch form (Sect. 7.3): a robot that learns while it works.

Within a batch classifiers and confusion matrices wait; D and the experience grow at every trial.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents.agent import TRUST, Agent
from meal_bayes.agents.curiosity import chosen_weights, exploration_bonus, information_value
from meal_bayes.agents.experience import Experience, Feedback
from meal_bayes.agents.knowledge import Knowledge, knowledge_of
from meal_bayes.agents.trial import Streams, Task, Trial, run_trial
from meal_bayes.datasets import Dataset
from meal_bayes.domain import Domain, unknown
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import ITRS, MOMDP, shape_reward
from meal_bayes.perception import (
    ConfusionSampler,
    FittedPercepts,
    Kernels,
    Perceiver,
    PerceptionSettings,
    fit_and_score,
)
from meal_bayes.planners import POMCP, Policy, Remembering
from meal_bayes.planners.pomcp import POMCPPolicy
from meal_bayes.robots import CheckedRobot, RecordedRobot
from meal_bayes.robots.recorded import Order
from meal_bayes.seeds import stream

PUBLISHED = ("shaped_test", "sample_wise", "joint_label", "model_percepts")


@dataclass(frozen=True, slots=True)
class OnlineAgent:
    """How an agent answers, and what it is curious about while it still learns."""

    name: str
    recipe: Agent  # how it perceives, believes and plans
    curiosity: str = "none"  # "itrs": Eq. 11; "auto": the same, weights chosen; "information"
    alpha: float = 6.0  # the published code's
    beta: float = 30.0
    memory: bool = False  # does it know objects again?
    whiten: bool = False  # does it learn, from repeats, which differences say nothing of an object?

    def __post_init__(self) -> None:
        known = ("none", "itrs", "auto", "information")
        if self.curiosity not in known:
            raise SettingsError(unknown("curiosity", self.curiosity, known))


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What a run is about, the same for every agent.

    Raises
    ------
    SettingsError : an unknown published variant.
    """

    dataset: Dataset
    kernels: Kernels  # in the spaces of what the robot has before its first trial
    objects: NDArray[np.intp]  # that queries will be about: their recordings are scored
    delta: float  # of Eq. 10
    queries: float  # about each attribute, to come; what curiosity plans for
    reward: float  # r+ = -r-
    feedback: Feedback
    body: Domain  # whose success probabilities the robot has; the agent plans with the dataset's
    learn_success: bool = False  # are success probabilities learned, or the domain's believed?
    published: tuple[str, ...] = ()  # of PUBLISHED: what the authors' code does otherwise

    def __post_init__(self) -> None:
        for name in self.published:
            if name not in PUBLISHED:
                raise SettingsError(unknown("published variant", name, PUBLISHED))


@dataclass(slots=True)
class MorcItrs:
    """Runs the trials of one agent between two refits; made by `learn`."""

    agent: OnlineAgent
    world: Surroundings
    experience: Experience
    knowledge: Knowledge
    percepts: Perceiver
    seed: int
    gain: NDArray[np.float64]  # (P,E) `information_value`; zeros where curiosity asks for none
    _policies: dict[tuple[str, ...], tuple[MOMDP, Policy]] = field(default_factory=dict)
    _plans: dict[tuple[str, ...], POMCPPolicy] = field(default_factory=dict)

    @classmethod
    def learn(
        cls, agent: OnlineAgent, world: Surroundings, experience: Experience, seed: int
    ) -> "MorcItrs":
        """Refit classifiers, tables and posterior on D (Alg. 2, l. 6)."""
        dataset, levels = world.dataset, agent.recipe.levels
        by_object = "sample_wise" not in world.published
        settings = PerceptionSettings(levels=levels, by_object=by_object)
        kernels = world.kernels
        if agent.whiten:
            kernels = Kernels.of(dataset, experience.recordings(), whiten=True)
        outputs, counts = fit_and_score(
            kernels, experience.training_set(), world.objects, settings=settings
        )
        domain = dataset.domain
        if world.learn_success:
            domain = with_success(domain, experience.attempts)
        knowledge = knowledge_of(
            domain, counts, experience.told, object_level=agent.recipe.object_level
        )
        percepts: Perceiver
        if "model_percepts" in world.published:
            every = range(len(domain.attributes))
            confusion, _ = knowledge.posterior.select(every, exact=True)
            percepts = ConfusionSampler(domain, dataset.labels, confusion)
        else:
            percepts = FittedPercepts(domain, dataset.labels, outputs, levels)
        gain = np.zeros((len(domain.attributes), len(domain.behaviors)))
        if agent.curiosity in ("auto", "information"):
            gain = information_value(knowledge, reward=world.reward, discount=agent.recipe.discount)
        return cls(agent, world, experience, knowledge, percepts, seed, gain)

    def test(self, task: Task) -> Trial:
        """Answer with D frozen; all recordings of the object are fresh."""
        order = stream(self.seed, "recordings", *task.key)
        return self._run(task, *self._settled(task), order)

    def train(self, task: Task) -> Trial:
        """Answer and explore, with recordings that enter D (Alg. 2, l. 5-18)."""
        agent = self.agent
        if agent.curiosity == "none" and not agent.memory:
            momdp, policy = self._settled(task)
        else:
            told = self.experience.told[task.object_index, self._columns(task)]
            momdp = self._model(task, told if agent.memory else None)
            if agent.curiosity == "information":
                momdp = self._priced(momdp, task, new=False)
                policy = self._explore(task, momdp)
            else:
                momdp = momdp if agent.curiosity == "none" else self._shaped(momdp, task)
                policy = self._solve(task, momdp)
        return self._run(task, momdp, policy, self.experience.supply(task.object_index))

    def _settled(self, task: Task) -> tuple[MOMDP, Policy]:
        """Give the policy of a query in tests, solved once between two refits."""
        key = task.query.attributes
        if key not in self._policies:
            momdp = self._model(task, None)
            if "shaped_test" in self.world.published and self.agent.curiosity in ("itrs", "auto"):
                momdp = self._shaped(momdp, task)
            policy = self._solve(task, momdp)
            if getattr(policy, "deterministic", False):
                policy = Remembering(policy)
            self._policies[key] = momdp, policy
        return self._policies[key]

    def absorb(self, trial: Trial) -> None:
        """Take in a training trial, and what a person says of it (Alg. 2, l. 19-23)."""
        told = heard(self.world, trial, self.seed)
        self.experience = self.experience.absorb(self.world.dataset.domain, trial, told)

    @property
    def weights(self) -> ITRS:
        """Weights of Eq. 11, given or chosen by the agent itself."""
        if self.agent.curiosity == "auto":
            return chosen_weights(
                self.gain, self.knowledge, self.experience, self.world.delta, self.world.queries
            )
        return ITRS(self.agent.alpha, self.agent.beta, self.world.delta)

    @property
    def _recordings(self) -> int:
        return self.world.dataset.recordings

    def _columns(self, task: Task) -> list[int]:
        return self.knowledge.domain.columns(task.query.attributes)

    def _model(self, task: Task, told: NDArray[np.int8] | None) -> MOMDP:
        forever = "model_percepts" in self.world.published and told is None
        return self.agent.recipe.model(
            task.query,
            self.knowledge,
            limit=np.inf if forever else self._recordings,
            reward=self.world.reward,
            told=told,
            trust=min(TRUST, 1.0 - self.world.feedback.error),
        )

    def _shaped(self, momdp: MOMDP, task: Task) -> MOMDP:
        weights = self.weights
        experience = self.experience.evidence()[self._columns(task)] / weights.delta
        return shape_reward(momdp, experience, weights, domain=self.knowledge.domain)

    def _solve(self, task: Task, momdp: MOMDP) -> Policy:
        agent = self.agent.recipe
        rng = stream(self.seed, "solver", agent.name, *task.key)
        return agent.solver(self.knowledge.domain, task.query).solve(momdp, rng)

    def _explore(self, task: Task, momdp: MOMDP) -> Policy:
        """Plan with a bonus of its own for every trial, but one plan library for every query."""
        key = task.query.attributes
        if key not in self._plans:
            new = self._priced(self._model(task, None), task, new=True)
            policy = POMCP(paid=1).solve(new, stream(0))  # an object is new to a table but once
            self._plans[key] = policy
        return self._plans[key].with_rewards_of(momdp)

    def _priced(self, momdp: MOMDP, task: Task, *, new: bool) -> MOMDP:
        """Pay for the first percept of each behavior what it is worth to queries to come."""
        worth = exploration_bonus(
            self.gain, self.experience, None if new else task.object_index,
            self._columns(task), self.world.queries,
        )  # fmt: skip
        bonus = np.zeros((len(task.query), len(worth), 2))
        bonus[0] = worth[:, None]
        return replace(momdp, bonus=bonus)

    def _run(
        self, task: Task, momdp: MOMDP, policy: Policy, order: np.random.Generator | Order
    ) -> Trial:
        body, o = self.world.body, task.object_index
        robot = RecordedRobot(
            body,
            o,
            self.experience.counts[o],
            order,
            stream(self.seed, "robot", *task.key),
            repeats="model_percepts" in self.world.published,
        )
        return run_trial(
            task,
            momdp,
            policy,
            CheckedRobot(robot, body, object_index=o),
            self.percepts,
            Streams.of(self.seed, task, self.agent.name),
            truth=self.world.dataset.labels[o, self._columns(task)],
            agent=self.agent.name,
        )


def heard(world: Surroundings, trial: Trial, seed: int) -> NDArray[np.int8]:
    """Labels (N,) that a robot takes from what a person says of a trial; -1 none."""
    told = world.feedback.told(trial, stream(seed, "feedback", *trial.task.key))
    if "joint_label" in world.published:
        return np.where(told < 0, told, (told == 1).all()).astype(np.int8)
    return told


def with_success(domain: Domain, attempts: NDArray[np.int64]) -> Domain:
    """Replace success probabilities by the mean of Beta posteriors.

    A behavior's prior is worth two executions at the domain's own probability.

    Parameters
    ----------
    attempts : (E,2) legal executions that failed, and that succeeded.
    """
    weight = 2.0

    def mean(behavior: str, prior: float) -> float:
        failed, succeeded = attempts[domain.behavior_index(behavior)]
        return float((weight * prior + succeeded) / (weight + failed + succeeded))

    return replace(domain, diagram=domain.diagram.succeeding(mean))
