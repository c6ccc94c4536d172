"""Fitting Psi, and how good percepts of unseen objects are: cross-validation inside D."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.datasets import Dataset, TrainingSet
from meal_bayes.datasets.percepts import BIN_EDGES, levels_of, round_log_odds
from meal_bayes.perception.confusion import ConfusionCounts, positive_youden
from meal_bayes.perception.ensemble import BehaviorClassifier, BehaviorFit, Perception
from meal_bayes.perception.methods import method_of
from meal_bayes.perception.recordings import BehaviorRecordings, all_recordings_of
from meal_bayes.perception.settings import DEFAULT, PerceptionSettings
from meal_bayes.perception.width import learned_widths


def fit_perception(
    dataset: Dataset, training_set: TrainingSet, *, settings: PerceptionSettings = DEFAULT
) -> Perception:
    """Fit Psi of every behavior on the training set D."""
    return fit_and_validate(dataset, training_set, settings=settings)[0]


def cross_validate(
    dataset: Dataset, training_set: TrainingSet, *, settings: PerceptionSettings = DEFAULT
) -> ConfusionCounts:
    """Count the percepts of each training object by classifiers that never saw it.

    Nested over objects: for object o' both the classifiers and the rule that pools them are
    trained without o', and that rule learns only from decisions on objects that the classifiers
    behind them never saw. Above the settings' exact sizes, folds of objects take the place of
    objects. Each labelled instance is one count, at even odds where the other objects hold one
    class only.
    """
    return fit_and_validate(dataset, training_set, settings=settings)[1]


def fit_and_validate(
    dataset: Dataset, training_set: TrainingSet, *, settings: PerceptionSettings = DEFAULT
) -> tuple[Perception, ConfusionCounts]:
    """Fit Psi and cross-validate it; both share the work.

    See `fit_perception` and `cross_validate`.
    """
    domain, n_objects = dataset.domain, len(dataset.objects)
    shape = (n_objects, len(domain.attributes), len(domain.behaviors), 2, settings.levels)
    counts = np.zeros(shape, np.int64)
    gathered = all_recordings_of(dataset, training_set, settings)
    width, _ = learned_widths(gathered.values(), settings)
    classifiers = {}
    for name, recordings in gathered.items():
        fit, used, own = fit_behavior(recordings.widened(width), settings, n_objects)
        e = domain.behavior_index(name)
        counts[:, :, e] = own.counts[:, :, 0]
        spaces = [space.widened(width) for space in recordings.compared]
        wide = dict(zip(domain.behaviors[e].modalities, spaces, strict=True))
        classifiers[name] = BehaviorClassifier(wide, fit, used)
    perception = Perception(domain, classifiers, dataset.labels, settings.levels)
    return perception, ConfusionCounts(counts)


def fit_behavior(
    recordings: BehaviorRecordings, settings: PerceptionSettings, n_objects: int
) -> tuple[BehaviorFit, NDArray[np.bool_], ConfusionCounts]:
    """Fit one behavior.

    Returns
    -------
    The fit; for which attributes (P,) its percepts are used; and counts (O,P,1,2,K) of percepts of
    objects that the classifiers behind them never saw.
    """
    fit = method_of(settings).fit(recordings, settings)
    used = np.ones(fit.nested.shape[1], np.bool_)
    if settings.positive_youden_only:
        used = positive_youden(_count(recordings, fit.nested, 2, n_objects))[:, 0]
    nested = np.where(used, fit.nested, 0.0)
    return fit, used, _count(recordings, nested, settings.levels, n_objects)


def _count(
    recordings: BehaviorRecordings, nested: NDArray[np.float64], levels: int, n_objects: int
) -> ConfusionCounts:
    """Count the levels of nested outputs (n,P) by object and truth, (O,P,1,2,K)."""
    levels_shown = levels_of(round_log_odds(nested), BIN_EDGES, levels)
    counts = np.zeros((n_objects, nested.shape[1], 1, 2, levels), np.int64)
    row, attribute = np.nonzero(recordings.labels >= 0)
    truth, level = recordings.labels[row, attribute], levels_shown[row, attribute]
    place: tuple[Any, ...] = (recordings.objects[row], attribute, 0, truth, level)
    np.add.at(counts, place, 1)
    return ConfusionCounts(counts)
