"""Learners: an agent with its experience.

The input is questions, a robot, labels from people, and recordings or a percept table. The output
is trials, which are logged step by step, and a posterior of the confusion matrices. Labels update
this posterior.
"""

from meal_bayes.learner.experience import Experience
from meal_bayes.learner.learner import Learner, ask
from meal_bayes.learner.question import implied
from meal_bayes.learner.recalled import recall
from meal_bayes.learner.settings import LearnerSettings

__all__ = ["Experience", "Learner", "LearnerSettings", "ask", "implied", "recall"]
