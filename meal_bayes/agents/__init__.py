"""Where knowing meets doing: `Knowledge` and a `Solver` make a `Trial`.

Algorithm 1 is `morc.py`; its inner loop, shared with Algorithm 2, is `run_trial` in `trial.py`;
the named agents are a table in `recipes.py`.
"""

from meal_bayes.agents.agent import Agent
from meal_bayes.agents.knowledge import Knowledge, knowledge_without
from meal_bayes.agents.morc import Morc
from meal_bayes.agents.recipes import AGENTS, load_agent
from meal_bayes.agents.trial import Step, Streams, Task, Trial, run_trial

__all__ = [
    "AGENTS",
    "Agent",
    "Knowledge",
    "Morc",
    "Step",
    "Streams",
    "Task",
    "Trial",
    "knowledge_without",
    "load_agent",
    "run_trial",
]
