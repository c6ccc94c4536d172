"""What can be set in perception, and the two named recipes."""

from dataclasses import dataclass

from meal_bayes.datasets.percepts import BIN_EDGES, level_edges
from meal_bayes.domain import unknown
from meal_bayes.errors import SettingsError


@dataclass(frozen=True, slots=True)
class PerceptionSettings:
    """How a behavior's percept is made from its modalities.

    `joint` and the last five are cures: each can be taken out to see what it is good for (tests,
    benchmarks).
    """

    recipe: str = "stacked"  # or "paper": support vector machines, Cohen's kappa weights
    kernel: str = "rbf"  # exp(-d^2 / w^2); "polynomial": degree 2
    width: float | None = None  # w in median distances; None: learned (1, 1.5 or 2)
    joint: bool = True  # "stacked", RBF only: one more kernel, of all modalities at once
    noise: float = 0.15  # lambda of C = K + lambda I
    ridge: float = 0.5  # on the stacker's slopes
    levels: int = 2  # K, what an observed percept tells: yes or no; 4: and how surely
    folds: int = 5  # "paper" only: grouped folds, an object never split
    box: float = 10.0  # "paper" only: the support vector machine's C
    by_object: bool = True  # cross-validate over objects; False: over samples, as published
    nested: bool = True  # stackers learn from decisions that saw none of the objects left out
    balanced: bool = True  # both classes weigh the same, so a percept is a likelihood ratio
    nonnegative: bool = True  # a modality may be ignored, never turned around
    believable_only: bool = True  # where TPR - FPR <= 0 in training, percepts say nothing

    def __post_init__(self) -> None:
        for name, known in (("recipe", ("stacked", "paper")), ("kernel", ("rbf", "polynomial"))):
            if getattr(self, name) not in known:
                raise SettingsError(unknown(name, getattr(self, name), known))
        for name in ("noise", "ridge", "box"):
            if not getattr(self, name) > 0:
                raise SettingsError(f"{name} is {getattr(self, name)}; give a number above 0.")
        if self.width is not None:
            if not self.width > 0:
                raise SettingsError(f"width is {self.width}; give a number above 0.")
            if (self.recipe, self.kernel) != ("stacked", "rbf"):
                raise SettingsError("Only the stacked recipe's RBF has a width; give width=None.")
        if self.joint and (self.recipe, self.kernel) == ("stacked", "polynomial"):
            raise SettingsError("Polynomial kernels have no joint one; give joint=False.")
        level_edges(BIN_EDGES, self.levels)
        if self.folds < 2:  # noqa: PLR2004
            raise SettingsError(f"folds is {self.folds}; give at least 2.")


DEFAULT = PerceptionSettings()
PAPER = PerceptionSettings(recipe="paper", kernel="polynomial", joint=False)


def named_settings(name: str) -> PerceptionSettings:
    """Look a recipe up: "default" or "paper"."""
    known = {"default": DEFAULT, "paper": PAPER}
    if name not in known:
        raise SettingsError(unknown("perception", name, known))
    return known[name]
