"""Gymnasium environments on real recordings, to train and compare policies.

>>> import gymnasium
>>> env = gymnasium.make("meal_bayes/ROC36-v0", attributes=2)  # doctest: +SKIP

`meal_bayes/ROC36-v0`, `meal_bayes/ISPY32-v0`, `meal_bayes/CY101-v0`, and `meal_bayes/Own-v0` with
``dataset=`` your own percept table. Gymnasium finds them where this package is installed;
`register` adds them by hand. Needs the extra ``gym``.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from meal_bayes.gym.environment import MealEnv

__all__ = ["ENVIRONMENTS", "MealEnv", "register"]

ENVIRONMENTS = {
    "meal_bayes/ROC36-v0": {"dataset": "roc36"},
    "meal_bayes/ISPY32-v0": {"dataset": "ispy32"},
    "meal_bayes/CY101-v0": {"dataset": "cy101"},
    "meal_bayes/Own-v0": {},
}


def register() -> None:
    """Register the environments with Gymnasium, which calls this when it is imported."""
    import gymnasium  # noqa: PLC0415  an extra

    for name, settings in ENVIRONMENTS.items():
        if name not in gymnasium.registry:
            gymnasium.register(
                name, entry_point="meal_bayes.gym.environment:MealEnv", kwargs=settings
            )


def __getattr__(name: str) -> object:
    if name == "MealEnv":
        from meal_bayes.gym.environment import MealEnv  # noqa: PLC0415  loads Gymnasium

        return MealEnv
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
