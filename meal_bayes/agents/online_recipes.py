"""The agents that learn while they work: the paper's (Sect. 7.3), ours, and one's own."""

from dataclasses import replace

from meal_bayes.agents.morc_itrs import OnlineAgent
from meal_bayes.agents.recipes import AGENTS, as_agent
from meal_bayes.domain import Domain, Query, unknown
from meal_bayes.errors import SettingsError
from meal_bayes.planners import Factored, OpenLoop, Solver

_EXACT = 2  # attributes up to which the paper's problem is solved to the optimum, many times


def _paper(domain: Domain, query: Query) -> Solver:
    return Factored(points=2_000) if len(query) <= _EXACT else OpenLoop()


def _open_loop(domain: Domain, query: Query) -> Solver:
    return OpenLoop()


_LEGAL = AGENTS["random_legal"]
_MORC = replace(AGENTS["morc"], solver=_paper)
_BAYES = replace(AGENTS["bayes"], solver=_open_loop)  # the tree search takes too long for thousands

ONLINE_AGENTS = {
    agent.name: agent
    for agent in (
        OnlineAgent("iterative_random_legal", _LEGAL),
        OnlineAgent("iterative_morc", _MORC),
        OnlineAgent("morc_itrs", _MORC, curiosity="itrs"),
        OnlineAgent("morc_itrs_auto", _MORC, curiosity="auto"),
        OnlineAgent("bayes", _BAYES, curiosity="information", whiten=True),
        OnlineAgent("bayes_memory", _BAYES, curiosity="information", memory=True, whiten=True),
    )
}


def load_online_agent(name: str) -> OnlineAgent:
    """Look an agent up; `SettingsError` with the nearest names where there is none."""
    if name not in ONLINE_AGENTS:
        raise SettingsError(unknown("online agent", name, ONLINE_AGENTS))
    return ONLINE_AGENTS[name]


def as_online_agent(value: object) -> OnlineAgent:
    """Return the online agent that a value stands for.

    Parameters
    ----------
    value : a name, an `OnlineAgent`, or what `as_agent` takes: an agent that is not curious.

    Raises
    ------
    SettingsError : an unknown name, or a value that cannot plan.
    """
    if isinstance(value, OnlineAgent):
        return value
    if isinstance(value, str):
        return load_online_agent(value)
    agent = as_agent(value)
    return OnlineAgent(agent.name, agent)
