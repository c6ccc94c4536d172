"""The named agents: the paper's strategies (Sect. 7) and ours. A table, no logic."""

from meal_bayes.agents.agent import Agent
from meal_bayes.domain import Domain, Query, unknown
from meal_bayes.errors import SettingsError
from meal_bayes.planners import (
    POMCP,
    Factored,
    Greedy,
    OpenLoop,
    Predefined,
    Random,
    RandomLegal,
    Solver,
)

_EXACT = 3  # attributes up to which the paper's problem is solved to the optimum


def _random(domain: Domain, query: Query) -> Solver:
    return Random()


def _random_legal(domain: Domain, query: Query) -> Solver:
    return RandomLegal(domain.legal_budget[min(len(query), len(domain.legal_budget)) - 1])


def _predefined(domain: Domain, query: Query) -> Solver:
    return Predefined(domain.predefined)


def _predefined_plus(domain: Domain, query: Query) -> Solver:
    return Predefined(domain.predefined, persistent=True)


def _greedy(domain: Domain, query: Query) -> Solver:
    return Greedy()


def _pomcp(domain: Domain, query: Query) -> Solver:
    return POMCP()


def _optimal(domain: Domain, query: Query) -> Solver:
    return Factored() if len(query) <= _EXACT else POMCP()


def _open_loop(domain: Domain, query: Query) -> Solver:
    return OpenLoop()


AGENTS = {
    agent.name: agent
    for agent in (
        Agent("random", _random),
        Agent("random_legal", _random_legal),
        Agent("predefined", _predefined),
        Agent("predefined_plus", _predefined_plus),
        Agent("greedy", _greedy),
        # The paper's: percepts independent given the truth (Eq. 8), uniform prior.
        Agent("morc", _optimal, searches=True, abstain=True),
        # The same with the cheapest planner: microseconds a decision, any number of attributes.
        Agent("olfc", _open_loop, searches=True, abstain=True),
        # Ours: graded percepts, objects differ and may seem what they are not, prior from the
        # training objects, and planning for the undiscounted reward that is reported.
        Agent(
            "bayes",
            _pomcp,
            searches=True,
            object_level=True,
            shared_degree=True,
            base_rates=True,
            levels=4,
            abstain=True,
            discount=1.0,
        ),
    )
}


def load_agent(name: str) -> Agent:
    """Look an agent up; `SettingsError` with the nearest names where there is none."""
    if name not in AGENTS:
        raise SettingsError(unknown("agent", name, AGENTS))
    return AGENTS[name]
