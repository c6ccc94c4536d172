"""An agent and its experience: ask, tell, fit.

In: questions, a robot, feedback, recordings or a percept table. Out: trials, each logged as it
happens, and a confusion posterior that is updated by feedback.
"""

from meal_bayes.learner.experience import Experience
from meal_bayes.learner.learner import Learner, ask
from meal_bayes.learner.question import implied
from meal_bayes.learner.recalled import recall
from meal_bayes.learner.settings import LearnerSettings

__all__ = ["Experience", "Learner", "LearnerSettings", "ask", "implied", "recall"]
