"""The named agents: the paper's strategies (Sect. 7) and ours; and agents given as values.

Every agent runs offline (Sect. 7.2) and online (Sect. 7.3).
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
    return RandomLegal(budget, tuple(asks))  # the paper's explores, and asks nobody


def _predefined(domain: Domain, query: Query, persistent: bool = False) -> Solver:
    return Predefined(domain.default_sequence, persistent=persistent)


_LEGAL = Agent("random_legal", _random_legal)
_SEARCH = _Always(POMCP())  # one planner of the paper's agents and of ours
# The paper's: percepts independent given the truth (Eq. 8), uniform prior.
_MORC = Agent("morc", _SEARCH, abstain=True)
_ITERATIVE = replace(_MORC, name="iterative_morc")
_ITRS = replace(_MORC, name="morc_itrs", exploration=ITRSBonus())
# Ours: graded percepts, objects differ and may seem what they are not, prior from the training
# objects, planning for the undiscounted reward that is reported, exploring for what it is worth.
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
        # Base rates alone: an agent that does not beat it has not been worth its seconds.
        Agent("prior", _Always(Untouched()), base_rates=True),
        _LEGAL,
        Agent("predefined", _predefined),
        Agent("predefined_plus", partial(_predefined, persistent=True)),
        Agent("greedy", _Always(Greedy())),
        _MORC,
        # The same with the cheapest planner: microseconds a decision, any number of attributes.
        Agent("olfc", _Always(OpenLoop()), abstain=True),
        _BAYES,
        # What they learn at work (Sect. 7.3) is all that sets the following apart offline.
        replace(_LEGAL, name="iterative_random_legal"),
        _ITERATIVE,
        _ITRS,
        replace(_BAYES, name="bayes_memory", memory=True),
        # What comes from the belief, and what from exploring.
        replace(_BAYES, name="bayes_no_bonus", exploration=NoBonus()),
        replace(_BAYES, name="bayes_itrs", exploration=ITRSBonus()),
        replace(_BAYES, name="iterative_morc_bayes", trained_by=_ITERATIVE),
    )
}


def load_agent(name: str) -> Agent:
    """Return an agent by its name; an unknown name raises `SettingsError` with similar names.

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
    """Return the agent that a value stands for.

    Parameters
    ----------
    value : object
        The name of an agent; an `Agent`; or a planner: an object with a method `solve(momdp, rng)`,
        its class, or a function of domain and query that makes one. A planner gets the observation
        model, prior and levels of `bayes`, and its own name: its attribute `name` where that is
        text, by which two of one class are told apart; else that of its class.

    Raises
    ------
    SettingsError
        An unknown name, or a value that cannot plan.
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
