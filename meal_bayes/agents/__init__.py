"""Agents: `Knowledge` and a `Solver` make a `Trial`.

Algorithm 1 is `learner/held_out.py`, Algorithm 2 `learner/online.py`, their inner loop
`trials/session.py`; the named agents are a table in `named.py`.
"""

from meal_bayes.agents.agent import Agent
from meal_bayes.agents.exploration import (
    ExplorationBonus,
    Horizon,
    ITRSBonus,
    LearningBonus,
    NoBonus,
    Progress,
    add_bonus,
)
from meal_bayes.agents.knowledge import Knowledge, knowledge_without
from meal_bayes.agents.named import AGENTS, as_agent, load_agent

__all__ = [
    "AGENTS", "Agent", "ExplorationBonus", "Horizon", "ITRSBonus", "Knowledge", "LearningBonus",
    "NoBonus", "Progress", "add_bonus", "as_agent", "knowledge_without", "load_agent",
]  # fmt: skip
