"""Agents: they turn `Knowledge` into a decision problem and choose the `Solver` for it.

Algorithm 1 of the paper is in `learner/held_out.py`, Algorithm 2 in `learner/online.py`, and their
inner loop in `trials/session.py`. The named agents are defined in `named.py`.
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
