"""An agent: settings that turn knowledge into a decision problem, and its planner."""

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.agents.exploration import ExplorationBonus, NoBonus
from meal_bayes.agents.joint_prior import joint_prior
from meal_bayes.agents.knowledge import Knowledge
from meal_bayes.arrays import plain_fields
from meal_bayes.domain import Domain, Payoffs, Query
from meal_bayes.domain.event import wrong_reward
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import MOMDP, Objective, build_momdp, with_joint_prior
from meal_bayes.momdp.model import DISCOUNT
from meal_bayes.planners import Solver, warm_up
from meal_bayes.planners.solver import checked_solver
from meal_bayes.untrusted import name_fault

Rows = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64] | None]
ObservationModel = Callable[[Knowledge, Sequence[int]], Rows]


@dataclass(frozen=True, slots=True)
class Agent:
    """Settings of an agent: observation model, prior, planner and exploration.

    Attributes
    ----------
    name : str
        Name of the agent in tables, logs and folders.
    solver : Callable[[Domain, Query], Solver]
        Function that makes the planner for a query.
    object_level : bool
        Whether each object has its own confusion matrices (finite precision). If False, all objects
        have the same confusion matrices, as in the paper's Eq. 8.
    shared_trait : bool
        Whether classifier errors about one object may be correlated.
    base_rates : bool
        Whether the prior belief is learned from the training objects; otherwise it is uniform.
    co_occurrence : bool
        Whether a prior with base rates also models that attributes exclude or imply each other. If
        False, attributes are independent a priori, except for the values of a group.
    levels : int
        Number K of levels of the agent's percepts, from no to yes.
    abstain : bool
        Whether the agent may answer "I do not know".
    discount : float
        Discount factor of a step, used in planning only. With 1, the agent plans for the
        undiscounted reward, as results report it.
    observation_model : ObservationModel | None
        Your own observation model: a function of the knowledge and of the positions of the N
        queried attributes. The function returns the arrays `confusion` (N,E,C,K), `precision`
        (N,E,C) and `latent_classes` (N,2,C) for `build_momdp`. Return None for `latent_classes` if
        the truth is the latent class. By default the settings above determine the model.
    exploration : ExplorationBonus
        Exploration bonus that the agent adds to rewards in training trials of online learning.
    memory : bool
        Whether the agent recognizes objects and remembers the labels that people gave for them in
        earlier trials. Earlier percepts of an object update the confusion matrices, but not the
        belief about the object.
    whiten : bool
        Whether the agent whitens features: it learns from repeated recordings how features vary for
        one and the same object, and scales this variation down.
    trained_by : Agent | None
        Agent that executes this agent's training trials in online runs; by default this agent
        itself.

    Examples
    --------
    >>> import meal_bayes
    >>> from dataclasses import replace
    >>> replace(meal_bayes.load_agent("bayes"), name="mine").name
    'mine'
    """

    name: str
    solver: Callable[[Domain, Query], Solver]
    object_level: bool = False
    shared_trait: bool = False
    base_rates: bool = False
    co_occurrence: bool = False
    levels: int = 2
    abstain: bool = False
    discount: float = DISCOUNT
    observation_model: ObservationModel | None = None
    exploration: ExplorationBonus = field(default_factory=NoBonus)
    memory: bool = False
    whiten: bool = False
    trained_by: "Agent | None" = None

    def __post_init__(self) -> None:
        plain_fields(self)
        fault = name_fault(self.name)
        if fault:
            raise SettingsError(f"The agent's name {self.name!a:.60} {fault}; rename it.")
        try:
            inspect.signature(self.solver).bind("a domain", "a query")
        except (TypeError, ValueError):
            raise SettingsError(
                f"The setting `solver` of agent {self.name!r} must be a function of domain and "
                f"query; found {self.solver!r:.60}."
            ) from None

    def warm_up(self, domain: Domain, query: Query) -> None:
        """Compile the kernels that the solver of a query needs, before the first decision."""
        warm_up(self.planner(domain, query), yes_or_no=query.event is not None)

    def planner(self, domain: Domain, query: Query) -> Solver:
        """Return the planner for a query; raise `SettingsError` if `solver` does not return one."""
        return checked_solver(self.solver(domain, query), self.name)

    def model(
        self,
        query: Query,
        knowledge: Knowledge,
        *,
        limit: ArrayLike = np.inf,
        reward: float | None = None,
        payoffs: Payoffs | None = None,
        told: NDArray[np.float64] | None = None,
    ) -> MOMDP:
        """Build the MOMDP of a query from the knowledge (Algorithm 1, lines 1-4).

        Parameters
        ----------
        query : Query
            The question.
        knowledge : Knowledge
            Knowledge learned without the object in the trial.
        limit : ArrayLike
            Maximum number of recordings of a behavior that the robot can perceive in a trial: one
            number for all behaviors, or (E,) a number for each behavior.
        reward : float | None
            Reward of a right report; a wrong report gets minus this reward. By default it is the
            domain's reward.
        payoffs : Payoffs | None
            Payoffs of the answers yes and no for a query without payoffs of its own. By default
            they are the domain's payoffs.
        told : NDArray[np.float64] | None
            (N,) probability that each queried attribute is true, according to labels that people
            gave for this object; NaN for an attribute without labels.
        """
        domain = knowledge.domain
        columns = domain.columns(query.attributes)
        observation = self.observation_model or self._observation
        confusion, precision, latent_classes = observation(knowledge, columns)
        prior = knowledge.base_rates[columns] if self.base_rates else np.full(len(query), 0.5)
        if told is None:
            told = np.full(len(query), np.nan)
        joint = None
        if self.base_rates and self.co_occurrence:
            of_labels = None if knowledge.rates is None else knowledge.rates.of_labels
            joint = joint_prior(
                domain, knowledge.labels, knowledge.base_rates, query, told, of_labels
            )
        loss = None if reward is None else wrong_reward(reward)
        momdp = build_momdp(
            domain,
            query,
            confusion,
            precision,
            prior=np.where(np.isnan(told), prior, told),
            limit=limit,
            latent_classes=latent_classes,
            objective=Objective(reward, loss, self.discount, self.abstain, payoffs),
        )
        return momdp if joint is None else with_joint_prior(momdp, joint)

    def _observation(self, knowledge: Knowledge, columns: Sequence[int]) -> Rows:
        """Return rows, precision and latent classes from the posterior, and the trait if any."""
        confusion, precision = knowledge.posterior.select(columns, exact=not self.object_level)
        if not self.shared_trait or knowledge.trait is None:
            return confusion, precision, None
        rows, weight = knowledge.trait.select(confusion, precision)
        classes = knowledge.trait.latent_classes
        return rows, weight, np.tile(classes, (len(columns), 1, 1))  # (N,2,M)
