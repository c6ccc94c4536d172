"""Algorithm 2: a robot that learns online, from its own trials alone.

After every training trial D grows, and the posterior by the percepts of objects that no classifier
has seen (Alg. 2, l. 18-23); after every batch classifiers and tables are fitted anew on D (l. 6).
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents.agent import TRUST, Agent
from meal_bayes.agents.context import RunContext
from meal_bayes.agents.experience import Experience
from meal_bayes.agents.exploration import (
    FittedITRSBonus,
    ITRSBonus,
    NoBonus,
    Progress,
    information_value,
)
from meal_bayes.agents.inner_loop import Environment, Streams, run_trial
from meal_bayes.agents.knowledge import Knowledge, knowledge_of
from meal_bayes.agents.trial import Task, Trial
from meal_bayes.datasets.percepts import BIN_EDGES, levels_of
from meal_bayes.domain import learn_success
from meal_bayes.momdp import MOMDP
from meal_bayes.perception import (
    Kernels,
    Perceiver,
    PerceptionSettings,
    fit_and_score,
    sampled_percepts,
    scored_percepts,
)
from meal_bayes.planners import POMCP, Policy, Remembering, Solver
from meal_bayes.planners.pomcp.policy import POMCPPolicy
from meal_bayes.robots import CheckedRobot, RecordedRobot
from meal_bayes.robots.recorded import Order
from meal_bayes.seeds import stream

Names = tuple[str, ...]  # attributes of a query


@dataclass(slots=True)
class OnlineLearner:
    """Runs the trials of one agent between two refits; made by `fit`.

    Attributes
    ----------
    agent, context, experience, seed : as `fit` takes them; the experience grows by `tell`.
    knowledge : fitted on D, updated by `tell`.
    perceiver : the classifiers, or draws from the tables.
    valued : returns (P,E) `information_value` at the refit.
    _levels : (O,R,E,P) percepts of all recordings.
    _unseen : (O,E,P) whether the object was in no classifier's training set.
    _answering : model and policy of each query without a bonus.
    _exploring : searches of training trials, by query.
    """

    agent: Agent
    context: RunContext
    experience: Experience
    seed: int
    knowledge: Knowledge
    perceiver: Perceiver
    valued: Callable[[], NDArray[np.float64]]
    _levels: NDArray[np.int8]
    _unseen: NDArray[np.bool_]
    _answering: dict[Names, tuple[MOMDP, Policy]] = field(default_factory=dict)
    _exploring: dict[Names, POMCPPolicy] = field(default_factory=dict)

    @classmethod
    def fit(
        cls, agent: Agent, context: RunContext, experience: Experience, seed: int
    ) -> "OnlineLearner":
        """Fit classifiers, tables and posterior on D (Alg. 2, l. 6)."""
        dataset, published = context.dataset, context.published
        settings = PerceptionSettings(levels=agent.levels, by_object=not published.sample_wise)
        kernels = context.kernels
        if agent.whiten:
            kernels = Kernels.of(dataset, experience.recordings(), whiten=True)
        outputs, counts = fit_and_score(
            kernels, experience.training_set(), context.scored, settings=settings
        )
        domain = dataset.domain
        if context.learn_success:
            domain = learn_success(domain, experience.attempts)
        knowledge = knowledge_of(
            domain, counts, experience.object_labels, object_level=agent.object_level
        )
        if published.model_percepts:
            every = range(len(domain.attributes))
            confusion, _ = knowledge.posterior.select(every, exact=True)
            perceiver = sampled_percepts(domain, dataset.labels, confusion)
        else:
            perceiver = scored_percepts(domain, dataset.labels, outputs, agent.levels)

        @cache
        def valued() -> NDArray[np.float64]:
            return information_value(knowledge, reward=context.reward, discount=agent.discount)

        levels = levels_of(outputs, BIN_EDGES, agent.levels)
        unseen = ~experience.recorded()
        return cls(
            agent, context, experience, seed, knowledge, perceiver, valued, levels, unseen
        )  # fmt: skip

    def test(self, task: Task) -> Trial:
        """Run a test trial, on all recordings of the object; D does not change."""
        order = stream(self.seed, "recordings", *task.key)
        return self._run(task, *self._answer(task), order)

    def train(self, task: Task) -> Trial:
        """Run a training trial, on recordings that enter D (Alg. 2, l. 5-18)."""
        o, agent = task.object_index, self.agent
        if isinstance(agent.exploration, NoBonus) and not agent.memory:
            momdp, policy = self._answer(task)
        else:
            labels = self.experience.object_labels[o, self._columns(task)] if agent.memory else None
            plain = self._model(task, labels)
            momdp = self._shaped(plain, o)
            policy = self._explore(task, plain, momdp)
        return self._run(task, momdp, policy, self.experience.supply(o))

    def tell(self, trial: Trial) -> None:
        """Update D and the posterior by the feedback on a training trial (Alg. 2, l. 18-23)."""
        domain, o = self.context.dataset.domain, trial.task.object_index
        feedback = self.context.labels_of(trial, self.seed)
        before, rates = self._counts(o), self.knowledge.base_rates
        self.experience = self.experience.absorb(domain, trial, feedback)
        after = self._counts(o)
        self.knowledge = self.knowledge.with_object(before, after, self.experience.object_labels)
        moved = (before != after).any(axis=(1, 2, 3))
        if self.agent.base_rates:
            moved |= self.knowledge.base_rates != rates
        names = {domain.attributes[p] for p in np.flatnonzero(moved)}
        self._answering = {q: one for q, one in self._answering.items() if not names & {*q}}

    def _counts(self, o: int) -> NDArray[np.int64]:
        """Count the labeled percepts of an object that no classifier was trained on, (P,E,2,K)."""
        labels = np.where(self._unseen[o][:, None], self.experience.labels[o], -1)  # (E,R,P)
        e, r, p = np.nonzero(labels >= 0)
        shape = self.knowledge.posterior.counts.shape
        counts = np.zeros(shape, np.int64)
        np.add.at(counts, (p, e, labels[e, r, p], self._levels[o, r, e, p]), 1)
        return counts

    def _answer(self, task: Task) -> tuple[MOMDP, Policy]:
        """Return model and policy without a bonus, solved anew when the posterior moved."""
        key = task.query.attributes
        if key not in self._answering:
            momdp = self._model(task, None)
            itrs = isinstance(self.agent.exploration, ITRSBonus | FittedITRSBonus)
            if itrs and self.context.published.shaped_test:
                momdp = self._shaped(momdp, None)
            policy = self._solver(task).solve(momdp, self._planning(task))
            if getattr(policy, "deterministic", False):
                policy = Remembering(policy)
            self._answering[key] = momdp, policy
        return self._answering[key]

    def _explore(self, task: Task, plain: MOMDP, momdp: MOMDP) -> Policy:
        """Plan with the bonus of this trial; searches of equal queries share a plan library.

        `plain` is without the bonus, but with the labels that memory knows of this object.
        """
        key, solver, rng = task.query.attributes, self._solver(task), self._planning(task)
        if not isinstance(solver, POMCP):
            return solver.solve(momdp, rng)
        if key not in self._exploring:
            new = self._model(task, None) if self.agent.memory else plain
            self._exploring[key] = solver.solve(self._shaped(new, None), rng)
        return self._exploring[key].sharing_plans(momdp)

    def _solver(self, task: Task) -> Solver:
        solver = self.agent.solver(self.knowledge.domain, task.query)
        paid = self.agent.exploration.paid
        return replace(solver, paid=paid) if isinstance(solver, POMCP) else solver

    def _planning(self, task: Task) -> np.random.Generator:
        return stream(self.seed, "solver", self.agent.name, *task.key)

    def _columns(self, task: Task) -> list[int]:
        return self.knowledge.domain.columns(task.query.attributes)

    def _model(self, task: Task, labels: NDArray[np.int8] | None) -> MOMDP:
        forever = self.context.published.model_percepts and labels is None
        return self.agent.model(
            task.query,
            self.knowledge,
            limit=np.inf if forever else self.context.dataset.recordings,
            reward=self.context.reward,
            labels=labels,
            trust=min(TRUST, 1.0 - self.context.feedback.error),
        )

    def _shaped(self, momdp: MOMDP, object_index: int | None) -> MOMDP:
        """Add the exploration bonus; `object_index` None: of a new object."""
        context = self.context
        progress = Progress(
            self.knowledge, self.experience, self.valued, context.queries, context.counted
        )
        return self.agent.exploration.shape(momdp, object_index, progress)

    def _run(
        self, task: Task, momdp: MOMDP, policy: Policy, order: np.random.Generator | Order
    ) -> Trial:
        context, o = self.context, task.object_index
        robot = RecordedRobot(
            context.true_dynamics,
            o,
            self.experience.counts[o],
            order,
            stream(self.seed, "robot", *task.key),
            repeats=context.published.model_percepts,
        )
        return run_trial(
            task,
            momdp,
            policy,
            Environment(
                CheckedRobot(robot, context.true_dynamics, object_index=o),
                self.perceiver,
                Streams.of(self.seed, task, self.agent.name),
                context.dataset.labels[o, self._columns(task)],
                self.knowledge.posterior.counts[self._columns(task)],
            ),
            agent=self.agent.name,
        )
