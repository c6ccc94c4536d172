"""Agents: `Knowledge` and a `Solver` make a `Trial`.

Algorithm 1 is `offline.py`; the inner loop is `trials/session.py`, and what Algorithm 2 learns
`learner/fitted.py`; the named agents are a table in `named.py`.
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
from meal_bayes.agents.named import AGENTS, as_agent, distinct, load_agent
from meal_bayes.agents.offline import OfflineRunner

__all__ = [
    "AGENTS",
    "Agent",
    "ExplorationBonus",
    "FittedITRSBonus",
    "ITRSBonus",
    "InformationBonus",
    "Knowledge",
    "NoBonus",
    "OfflineRunner",
    "Progress",
    "as_agent",
    "distinct",
    "information_value",
    "knowledge_without",
    "load_agent",
]
