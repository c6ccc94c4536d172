"""Where knowing meets doing: `Knowledge` and a `Solver` make a `Trial`.

Algorithm 1 is `morc.py`; its inner loop, shared with Algorithm 2, is `run_trial` in `trial.py`;
the named agents are a table in `recipes.py`.
"""

from meal_bayes.agents.agent import Agent
from meal_bayes.agents.experience import Experience, Feedback, implied
from meal_bayes.agents.knowledge import Knowledge, knowledge_without
from meal_bayes.agents.morc import Morc
from meal_bayes.agents.morc_itrs import PUBLISHED, MorcItrs, OnlineAgent, Surroundings, heard
from meal_bayes.agents.online_recipes import ONLINE_AGENTS, as_online_agent, load_online_agent
from meal_bayes.agents.origin import Origin, origin_of
from meal_bayes.agents.recipes import AGENTS, as_agent, distinct, load_agent
from meal_bayes.agents.trial import Recorder, Step, Streams, Task, Trial, run_trial, truth_of
from meal_bayes.agents.trial_display import trials_frame

__all__ = [
    "AGENTS",
    "ONLINE_AGENTS",
    "PUBLISHED",
    "Agent",
    "Experience",
    "Feedback",
    "Knowledge",
    "Morc",
    "MorcItrs",
    "OnlineAgent",
    "Origin",
    "Recorder",
    "Step",
    "Streams",
    "Surroundings",
    "Task",
    "Trial",
    "as_agent",
    "as_online_agent",
    "distinct",
    "heard",
    "implied",
    "knowledge_without",
    "load_agent",
    "load_online_agent",
    "origin_of",
    "run_trial",
    "trials_frame",
    "truth_of",
]
