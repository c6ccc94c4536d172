"""Agents: `Knowledge` and a `Solver` make a `Trial`.

Algorithm 1 is `offline.py`, Algorithm 2 `online.py`; the inner loop of both is `run_trial` in
`inner_loop.py`; the named agents are a table in `named.py`.
"""

from meal_bayes.agents.agent import Agent
from meal_bayes.agents.context import PublishedVariants, RunContext
from meal_bayes.agents.experience import Experience, Feedback, implied
from meal_bayes.agents.exploration import (
    ExplorationBonus,
    FittedITRSBonus,
    InformationBonus,
    ITRSBonus,
    NoBonus,
    Progress,
)
from meal_bayes.agents.inner_loop import Environment, Recorder, Streams, run_trial
from meal_bayes.agents.knowledge import Knowledge, knowledge_without
from meal_bayes.agents.named import AGENTS, as_agent, distinct, load_agent
from meal_bayes.agents.offline import OfflineRunner
from meal_bayes.agents.online import OnlineLearner
from meal_bayes.agents.origin import Origin, origin_of
from meal_bayes.agents.trial import Step, Task, Trial, truth_of
from meal_bayes.agents.trial_display import trials_frame

__all__ = [
    "AGENTS",
    "Agent",
    "Environment",
    "Experience",
    "ExplorationBonus",
    "Feedback",
    "FittedITRSBonus",
    "ITRSBonus",
    "InformationBonus",
    "Knowledge",
    "NoBonus",
    "OfflineRunner",
    "OnlineLearner",
    "Origin",
    "Progress",
    "PublishedVariants",
    "Recorder",
    "RunContext",
    "Step",
    "Streams",
    "Task",
    "Trial",
    "as_agent",
    "distinct",
    "implied",
    "knowledge_without",
    "load_agent",
    "origin_of",
    "run_trial",
    "trials_frame",
    "truth_of",
]
