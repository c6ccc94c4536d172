"""One front door: fit, ask, tell.

In: recordings or a percept table, questions, a robot, what people say of its answers. Out: trials,
each logged as it happens, and a confusion posterior that is updated with every answer.
"""

from meal_bayes.learner.asking import ask
from meal_bayes.learner.learner import Learner
from meal_bayes.learner.lesson import Lesson

__all__ = ["Learner", "Lesson", "ask"]
