"""An agent: how it turns what is known into a decision problem, and how it solves that."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.agents.exploration import ExplorationBonus, NoBonus
from meal_bayes.agents.knowledge import Knowledge
from meal_bayes.domain import Domain, Query
from meal_bayes.momdp import MOMDP, build_momdp
from meal_bayes.planners import Policy, Solver, warm_up

TRUST = 0.99  # Pr(what a person told is right)

Rows = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64] | None]
ObservationModel = Callable[[Knowledge, Sequence[int]], Rows]


@dataclass(frozen=True, slots=True)
class Agent:
    """A recipe. The two wings meet here: two arrays go from the posterior to the planner.

    An observation model of one's own takes what is known and the positions of the N queried
    attributes, and returns `confusion` (N,E,C,K), `precision` (N,E,C) and `latent_classes`
    (N,2,C), or None for latent classes that are the truth (see `build_momdp`).
    """

    name: str
    solver: Callable[[Domain, Query], Solver]
    object_level: bool = False  # objects differ (finite precision), or Eq. 8
    shared_trait: bool = False  # all percepts of an object may err together, or never do
    base_rates: bool = False  # prior belief from the training objects, or uniform
    levels: int = 2  # K of its percepts
    abstain: bool = False  # may its planner end a trial by an illegal behavior?
    discount: float = 0.99  # of a step, in planning only; 1 plans for the reward that is reported
    observation_model: ObservationModel | None = None  # what percepts tell; by the flags above
    # while it learns at work:
    exploration: ExplorationBonus = field(default_factory=NoBonus)
    memory: bool = False  # does it know objects again?
    whiten: bool = False  # does it learn, from repeats, which differences say nothing of an object?
    trained_by: "Agent | None" = None  # who does its training trials; itself by default

    def warm_up(self, domain: Domain, query: Query) -> None:
        """Compile the kernels that the solver of a query needs; the first decision does it else."""
        warm_up(self.solver(domain, query))

    def prepare(
        self,
        query: Query,
        knowledge: Knowledge,
        rng: np.random.Generator,
        *,
        limit: ArrayLike = np.inf,
        reward: float | None = None,
        told: NDArray[np.int8] | None = None,
    ) -> tuple[MOMDP, Policy]:
        """Build the query's MOMDP and solve it (Alg. 1, l. 1-5); see `model`."""
        momdp = self.model(query, knowledge, limit=limit, reward=reward, told=told)
        return momdp, self.solver(knowledge.domain, query).solve(momdp, rng)

    def model(
        self,
        query: Query,
        knowledge: Knowledge,
        *,
        limit: ArrayLike = np.inf,
        reward: float | None = None,
        told: NDArray[np.int8] | None = None,
        trust: float = TRUST,
    ) -> MOMDP:
        """Build the query's MOMDP from what is known (Alg. 1, l. 1-4).

        Parameters
        ----------
        query : what is asked.
        knowledge : learned without the object at hand.
        limit : (E,) or a number: recordings of a behavior that one trial can perceive.
        reward : r+ = -r-, the domain's by default.
        told : (N,) what people said of this object before; -1 nothing.
        trust : Pr(what people said is right).
        """
        domain = knowledge.domain
        columns = domain.columns(query.attributes)
        confusion, precision, latent_classes = (self.observation_model or self._observation)(
            knowledge, columns
        )
        prior = knowledge.base_rates[columns] if self.base_rates else np.full(len(query), 0.5)
        if told is not None:
            prior = np.where(told < 0, prior, np.where(told == 1, trust, 1.0 - trust))
        return build_momdp(
            domain,
            query,
            confusion,
            precision,
            prior=prior,
            correct=reward,
            incorrect=None if reward is None else -reward,
            limit=limit,
            latent_classes=latent_classes,
            discount=self.discount,
            abstain=self.abstain,
            counts=knowledge.posterior.counts[columns],
        )

    def _observation(self, knowledge: Knowledge, columns: Sequence[int]) -> Rows:
        """Return the rows of the confusion posterior, of latent classes where they are shared."""
        confusion, precision = knowledge.posterior.select(columns, exact=not self.object_level)
        if not self.shared_trait or knowledge.trait is None:
            return confusion, precision, None
        rows, weight = knowledge.trait.select(confusion, precision)
        classes = knowledge.trait.latent_classes
        return rows, weight, np.tile(classes, (len(columns), 1, 1))  # (N,2,M)
