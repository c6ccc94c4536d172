"""MEAL, the Bayesian way: which behaviors a robot should try before it answers.

A robot is asked about attributes of an object it has never learned from ("Is it heavy, and does it
hold beans?"). It chooses behaviors, perceives, updates an exact belief, and reports; every trial is
logged.

>>> import meal_bayes
>>> trial = meal_bayes.ask(
...     "Is it heavy, and does it hold beans?",
...     dataset="roc36",
...     object="heavy_green_beans",
...     agent="predefined_plus",
... )
>>> trial.task.query.report_name(trial.report), trial.success, round(trial.cost, 1)
('heavy, beans', True, 19.1)

These names are the public API; each is loaded with its package when it is first used, so that the
import itself costs nothing. The packages (`meal_bayes.domain`, `.datasets`, `.perception`,
`.posterior`, `.momdp`, `.planners`, `.robots`, `.trials`, `.agents`, `.trial_log`, `.learner`,
`.experiments`, `.evaluation`, `.viewer`, `.gym`) hold the rest.

Shape comments, such as ``cost: (E,) s``, speak one alphabet everywhere:

| | |
|---|---|
| P | attributes of the domain |
| N | queried attributes |
| E | exploratory behaviors |
| M | modalities |
| D | features of a modality |
| O | objects |
| R | recordings per (object, behavior) |
| X | fully observable states, the last is `term` |
| Y | 2^N combinations of attribute values; bit 0 of the query is the most significant |
| K | levels of a percept: 2 is the paper's yes/no, 4 is "surely no, no, yes, surely yes" |
| L | fine bins of a percept table, which levels merge |
| A | actions: E behaviors, then Y reports |
| Z | K^N + 1 observations, the last is "none" |
| T | steps of a trial |
| S | search nodes |
"""

from importlib import import_module
from typing import TYPE_CHECKING

from meal_bayes.version import package_version

if TYPE_CHECKING:
    from meal_bayes.datasets import Dataset, load_dataset, load_percepts, save_percepts
    from meal_bayes.domain import Query, load_domain, read_query
    from meal_bayes.errors import MealBayesError
    from meal_bayes.evaluation import summarize
    from meal_bayes.experiments import OfflineConfig, run_offline
    from meal_bayes.learner import Learner, ask
    from meal_bayes.momdp import build_momdp, initial_belief, update_belief
    from meal_bayes.perception import build_percept_table
    from meal_bayes.planners import POMCP
    from meal_bayes.posterior import ConfusionPosterior
    from meal_bayes.robots import Outcome
    from meal_bayes.trial_log import read_trials, write_trials
    from meal_bayes.trials import Trial, run_trial

__all__ = [
    "POMCP", "ConfusionPosterior", "Dataset", "Learner", "MealBayesError", "OfflineConfig",
    "Outcome", "Query", "Trial", "ask", "build_momdp", "build_percept_table", "initial_belief",
    "load_dataset", "load_domain", "load_percepts", "read_query", "read_trials", "run_offline",
    "run_trial", "save_percepts", "summarize", "update_belief", "write_trials",
]  # fmt: skip

_ROOMS = {
    "datasets": ("Dataset", "load_dataset", "load_percepts", "save_percepts"),
    "domain": ("Query", "load_domain", "read_query"),
    "errors": ("MealBayesError",),
    "evaluation": ("summarize",),
    "experiments": ("OfflineConfig", "run_offline"),
    "learner": ("Learner", "ask"),
    "momdp": ("build_momdp", "initial_belief", "update_belief"),
    "perception": ("build_percept_table",),
    "planners": ("POMCP",),
    "posterior": ("ConfusionPosterior",),
    "robots": ("Outcome",),
    "trial_log": ("read_trials", "write_trials"),
    "trials": ("Trial", "run_trial"),
}
_HOME = {name: room for room, names in _ROOMS.items() for name in names}


__version__: str

if not TYPE_CHECKING:  # a type checker sees the names themselves, and misspelled ones

    def __getattr__(name: str) -> object:
        if name == "__version__":
            return package_version()
        if name not in _HOME:
            names = f"its names are: {', '.join(__all__)}"
            raise AttributeError(f"module 'meal_bayes' has no attribute {name!r}; {names}.")
        value = getattr(import_module(f"meal_bayes.{_HOME[name]}"), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, "__version__"})
