"""The named agents: the paper's strategies (Sect. 7) and those of this package.

`as_agent` also makes agents from planners. Every agent runs offline (Sect. 7.2) and online (Sect.
7.3).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import cast

from meal_bayes.agents.agent import Agent
from meal_bayes.agents.exploration import ITRSBonus, LearningBonus, NoBonus
from meal_bayes.domain import Domain, Query, unknown
from meal_bayes.errors import SettingsError
from meal_bayes.planners import (
    POMCP,
    Greedy,
    OpenLoop,
    Predefined,
    Random,
    RandomLegal,
    Solver,
    Untouched,
)


@dataclass(frozen=True, slots=True, eq=False)
class _Always:
    """The same solver for every query."""

    planner: Solver

    def __call__(self, domain: Domain, query: Query) -> Solver:
        return self.planner


def _random_legal(domain: Domain, query: Query) -> Solver:
    budget = domain.legal_budget[min(len(query), len(domain.legal_budget)) - 1]
    asks = (behavior.name for behavior in domain.behaviors if behavior.asks)
    return RandomLegal(budget, tuple(asks))  # as in the paper, it never asks a person


def _predefined(domain: Domain, query: Query, persistent: bool = False) -> Solver:
    return Predefined(domain.default_sequence, persistent=persistent)


_LEGAL = Agent("random_legal", _random_legal)
_SEARCH = _Always(POMCP())  # the planner of MORC and of `bayes`
# The paper's model: percepts independent given the truth (Eq. 8), uniform prior.
_MORC = Agent("morc", _SEARCH, abstain=True)
_ITERATIVE = replace(_MORC, name="iterative_morc")
_ITRS = replace(_MORC, name="morc_itrs", exploration=ITRSBonus())
# The model of this package: four levels of percepts, differences between objects, a shared trait, a
# prior from the training objects, no discount, and a bonus that is the value of exploration.
_BAYES = Agent(
    "bayes",
    _SEARCH,
    object_level=True,
    shared_trait=True,
    base_rates=True,
    co_occurrence=True,
    levels=4,
    abstain=True,
    discount=1.0,
    exploration=LearningBonus(),
    whiten=True,
)

AGENTS = {
    agent.name: agent
    for agent in (
        Agent("random", _Always(Random())),
        # Answers by base rates without any behavior: a baseline for all other agents.
        Agent("prior", _Always(Untouched()), base_rates=True),
        _LEGAL,
        Agent("predefined", _predefined),
        Agent("predefined_plus", partial(_predefined, persistent=True)),
        Agent("greedy", _Always(Greedy())),
        _MORC,
        # MORC with open-loop plans: microseconds per decision, any number of attributes.
        Agent("olfc", _Always(OpenLoop()), abstain=True),
        _BAYES,
        # The following agents differ only in online learning (Sect. 7.3).
        replace(_LEGAL, name="iterative_random_legal"),
        _ITERATIVE,
        _ITRS,
        replace(_BAYES, name="bayes_memory", memory=True),
        # These separate the effect of the belief from that of exploration.
        replace(_BAYES, name="bayes_no_bonus", exploration=NoBonus()),
        replace(_BAYES, name="bayes_itrs", exploration=ITRSBonus()),
        replace(_BAYES, name="iterative_morc_bayes", trained_by=_ITERATIVE),
    )
}


def load_agent(name: str) -> Agent:
    """Return an agent by its name; the error for an unknown name lists similar names.

    Examples
    --------
    >>> import meal_bayes
    >>> meal_bayes.load_agent("greedy").name
    'greedy'
    """
    if name not in AGENTS:
        raise SettingsError(unknown("agent", name, AGENTS))
    return AGENTS[name]


def as_agent(value: object) -> Agent:
    """Return an agent for a name, an agent or a planner.

    Parameters
    ----------
    value : object
        The name of an agent, an `Agent`, or a planner. A planner is an object with a method
        `solve(momdp, rng)`. You can also pass the planner's class, or a function of domain and
        query that returns a planner. The agent plans with this planner, and has the observation
        model, prior and levels of the agent `bayes`. Its name is the planner's attribute `name` if
        this is text, and otherwise the name of the planner's class.

    Raises
    ------
    SettingsError
        If the name is unknown, or the value is not a planner.
    """
    if isinstance(value, Agent):
        return value
    if isinstance(value, str):
        return load_agent(value)
    label = getattr(value, "name", None)
    named = label if isinstance(label, str) else getattr(value, "__name__", type(value).__name__)
    ours = replace(AGENTS["bayes_no_bonus"], name=named)
    if hasattr(value, "solve"):
        planner = value() if isinstance(value, type) else value
        return replace(ours, solver=_Always(cast(Solver, planner)))
    if callable(value):
        return replace(ours, solver=cast(Callable[[Domain, Query], Solver], value))
    raise SettingsError(
        f"An agent is a name, an Agent, or a planner with a method solve(momdp, rng); "
        f"found {named}."
    )
