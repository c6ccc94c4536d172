"""Bayesian multimodal embodied attribute learning (MEAL) for robots.

A person asks a robot about attributes of an object ("Is it heavy, and does it hold beans?"). The
robot has not learned from this object. The robot chooses behaviors, perceives, updates an exact
belief, and answers. Every trial is logged.

>>> import meal_bayes
>>> trial = meal_bayes.ask(
...     "Is it heavy, and does it hold beans?",
...     dataset="roc36",
...     object="heavy_green_beans",
...     agent="predefined_plus",
... )
>>> trial.answer, trial.success, round(trial.cost, 1)
({'heavy': True, 'beans': True}, True, 19.1)

The public API consists of the names in `__all__` and those of `meal_bayes.testing` and
`meal_bayes.gym`. The package of a name is loaded when the name is first used, so
`import meal_bayes` itself loads at most NumPy. Other names of the packages
(`meal_bayes.planners`, ...) may change in any version.

All shapes, such as ``cost: (E,) s``, are written with these letters:

| | |
|---|---|
| P | attributes of the domain |
| N | queried attributes |
| E | behaviors |
| M | modalities |
| D | features of a modality |
| O | objects |
| R | recordings per (object, behavior) |
| X | observed states; the last is `term` |
| Y | 2^N combinations of attribute values; bit 0 of the query is the most significant |
| K | levels of a percept: 2 is the paper's yes/no, 4 is "surely no, no, yes, surely yes" |
| L | bins of a percept table, which are merged to K levels |
| A | actions: E behaviors, then Y reports, then "I do not know" if the agent may abstain |
| Z | K^N + 1 observations, the last is "none" |
| T | steps of a trial |
| S | search nodes |
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from meal_bayes.agents import Agent, load_agent
    from meal_bayes.datasets import (
        Dataset,
        PerceptTable,
        load_dataset,
        load_percepts,
        save_csv_folder,
        save_percepts,
    )
    from meal_bayes.domain import Domain, Query, load_domain, read_query
    from meal_bayes.errors import MealBayesError, RobotError
    from meal_bayes.evaluation import compare, summarize
    from meal_bayes.experiments import OfflineConfig, OnlineConfig, run_offline, run_online
    from meal_bayes.learner import Learner, ask, recall
    from meal_bayes.momdp import MOMDP, Belief, build_momdp, initial_belief, update_belief
    from meal_bayes.perception import Perceiver, build_percept_table
    from meal_bayes.planners import POMCP, Decision, Policy, Solver
    from meal_bayes.posterior import ConfusionPosterior
    from meal_bayes.robots import Frame, Outcome, Robot
    from meal_bayes.trial_log import read_trials, write_trials
    from meal_bayes.trials import Recorder, Session, Trial, run_trial
    from meal_bayes.viewer import write_recording

__all__ = [
    "MOMDP", "POMCP", "Agent", "Belief", "ConfusionPosterior", "Dataset", "Decision", "Domain",
    "Frame",
    "Learner", "MealBayesError", "OfflineConfig", "OnlineConfig", "Outcome", "Perceiver",
    "PerceptTable", "Policy", "Query", "Recorder", "Robot", "RobotError", "Session", "Solver",
    "Trial", "ask", "build_momdp", "build_percept_table", "compare", "initial_belief",
    "load_agent", "load_dataset", "load_domain", "load_percepts", "read_query", "read_trials",
    "recall", "run_offline", "run_online", "run_trial", "save_csv_folder", "save_percepts",
    "summarize", "update_belief", "write_recording", "write_trials",
]  # fmt: skip

_ROOMS = {
    "agents": ("Agent", "load_agent"),
    "datasets": (
        "Dataset",
        "PerceptTable",
        "load_dataset",
        "load_percepts",
        "save_csv_folder",
        "save_percepts",
    ),
    "domain": ("Domain", "Query", "load_domain", "read_query"),
    "errors": ("MealBayesError", "RobotError"),
    "evaluation": ("compare", "summarize"),
    "experiments": ("OfflineConfig", "OnlineConfig", "run_offline", "run_online"),
    "learner": ("Learner", "ask", "recall"),
    "momdp": ("MOMDP", "Belief", "build_momdp", "initial_belief", "update_belief"),
    "perception": ("Perceiver", "build_percept_table"),
    "planners": ("POMCP", "Decision", "Policy", "Solver"),
    "posterior": ("ConfusionPosterior",),
    "robots": ("Frame", "Outcome", "Robot"),
    "trial_log": ("read_trials", "write_trials"),
    "trials": ("Recorder", "Session", "Trial", "run_trial"),
    "viewer": ("write_recording",),
}
_HOME = {name: room for room, names in _ROOMS.items() for name in names}


__version__: str

if not TYPE_CHECKING:  # a type checker sees the names themselves, and misspelled ones

    def __getattr__(name: str) -> object:
        if name == "__version__":
            return import_module("meal_bayes.digests").package_version()
        if name not in _HOME:
            names = f"its names are: {', '.join(__all__)}"
            raise AttributeError(f"module 'meal_bayes' has no attribute {name!r}; {names}.")
        value = getattr(import_module(f"meal_bayes.{_HOME[name]}"), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, "__version__"})
