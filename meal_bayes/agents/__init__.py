"""Agents: `Knowledge` and a `Solver` make a `Trial`.

Both algorithms are `learner/sessions.py`, their inner loop is `trials/session.py`, and what they
learn `learner/fitted.py`; the named agents are a table in `named.py`.
"""

from meal_bayes.agents.agent import Agent
from meal_bayes.agents.exploration import (
    ExplorationBonus,
    FittedITRSBonus,
    InformationBonus,
    ITRSBonus,
    NoBonus,
    Progress,
    information_value,
)
from meal_bayes.agents.knowledge import Knowledge, knowledge_without
from meal_bayes.agents.named import AGENTS, as_agent, load_agent

__all__ = [
    "AGENTS", "Agent", "ExplorationBonus", "FittedITRSBonus", "ITRSBonus", "InformationBonus",
    "Knowledge", "NoBonus", "Progress", "as_agent", "information_value", "knowledge_without",
    "load_agent",
]  # fmt: skip
