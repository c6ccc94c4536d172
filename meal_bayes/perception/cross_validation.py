"""How good percepts of unseen objects are, by cross-validation over the objects inside D."""

from meal_bayes.datasets import Dataset
from meal_bayes.datasets.training_set import TrainingSet
from meal_bayes.perception.confusion import ConfusionCounts
from meal_bayes.perception.ensemble import fit_and_validate
from meal_bayes.perception.settings import DEFAULT, PerceptionSettings


def cross_validate(
    dataset: Dataset, training_set: TrainingSet, *, settings: PerceptionSettings = DEFAULT
) -> ConfusionCounts:
    """Count the percepts of each training object by classifiers that never saw it.

    Nested over objects: for object o' both the classifiers and the rule that pools them are
    trained without o', and that rule learns only from decisions on objects that the classifiers
    behind them never saw. Each labelled instance gives exactly one count; where the other objects
    hold one class only its percept says nothing (the level around even odds).
    """
    return fit_and_validate(dataset, training_set, settings=settings)[1]
