"""The public API: fit, ask, tell.

In: recordings or a percept table, questions, a robot, feedback. Out: trials, each logged as it
happens, and a confusion posterior that is updated by feedback.
"""

from meal_bayes.learner.api import ask
from meal_bayes.learner.labeled_trial import LabeledTrial
from meal_bayes.learner.learner import Learner

__all__ = ["LabeledTrial", "Learner", "ask"]
