"""Gymnasium environments on real recordings, to train and compare policies.

Importing this module registers `meal_bayes/ROC36-v0`, `meal_bayes/ISPY32-v0`,
`meal_bayes/CY101-v0`, and `meal_bayes/Own-v0` with ``dataset=`` your own percept table. Needs the
extra ``gym``.

>>> import gymnasium
>>> env = gymnasium.make("meal_bayes.gym:meal_bayes/ROC36-v0", attributes=2)  # doctest: +SKIP
"""

import gymnasium

from meal_bayes.gym.environment import MealEnv

__all__ = ["ENVIRONMENTS", "MealEnv"]

ENVIRONMENTS = {
    "meal_bayes/ROC36-v0": {"dataset": "roc36"},
    "meal_bayes/ISPY32-v0": {"dataset": "ispy32"},
    "meal_bayes/CY101-v0": {"dataset": "cy101"},
    "meal_bayes/Own-v0": {},
}

for _name, _settings in ENVIRONMENTS.items():
    gymnasium.register(_name, entry_point="meal_bayes.gym.environment:MealEnv", kwargs=_settings)
