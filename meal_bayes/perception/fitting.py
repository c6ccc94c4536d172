"""Fitting Psi, and how good percepts of unseen objects are: cross-validation inside D."""

from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from meal_bayes.datasets import Dataset, TrainingSet
from meal_bayes.datasets.percepts import BIN_EDGES, levels_of, round_log_odds
from meal_bayes.perception import stacked
from meal_bayes.perception.confusion import ConfusionCounts, youden
from meal_bayes.perception.ensemble import BehaviorClassifier, BehaviorFit, Perception
from meal_bayes.perception.recordings import BehaviorRecordings, Spaces, gather
from meal_bayes.perception.settings import DEFAULT, PerceptionSettings
from meal_bayes.perception.width import learned_widths

Floats = NDArray[np.float64]


def method_of(settings: PerceptionSettings) -> ModuleType:
    """Return the module of the method that the settings name, with `fit` and `outputs`."""
    if settings.method == "stacked":
        return stacked
    from meal_bayes.perception import classifier  # noqa: PLC0415  scikit-learn takes a second

    return classifier


def fit_and_validate(
    dataset: Dataset,
    training_set: TrainingSet,
    *,
    settings: PerceptionSettings = DEFAULT,
    spaces: Spaces | None = None,
) -> tuple[Perception, ConfusionCounts]:
    """Fit Psi of every behavior on the training set D, and cross-validate it.

    Cross-validation is nested over objects: for object o' both the classifiers and the rule that
    pools them are trained without o', and that rule learns only from decisions on objects that the
    classifiers behind them never saw. Above the settings' exact sizes, folds of objects take the
    place of objects. Each labelled instance is one count, at even odds where the other objects
    hold one class only.

    Parameters
    ----------
    dataset : Dataset
        Features and labels.
    training_set : TrainingSet
        The recordings of D.
    settings : PerceptionSettings
        The method.
    spaces : Spaces, optional
        Of `fit_spaces`, fitted before; by default they are fitted to D.

    Returns
    -------
    Perception
        Fitted to all of D.
    ConfusionCounts
        Percepts of each training object by classifiers that never saw it.
    """
    domain, classifiers = dataset.domain, {}
    shape = len(dataset.objects), len(domain.attributes), len(domain.behaviors)
    counts = np.zeros((*shape, 2, settings.levels), np.int64)
    gathered = gather(dataset, training_set, settings, spaces)
    width, _ = learned_widths(gathered.values(), settings)
    for e, recordings in gathered.items():
        fit: BehaviorFit = method_of(settings).fit(recordings.widened(width), settings)
        used = np.ones(shape[1], np.bool_)
        if settings.positive_youden_only:
            used = youden(_count(recordings, fit.nested, 2, len(counts)).sum(axis=0)) > 0
        nested = np.where(used, fit.nested, 0.0)
        counts[:, :, e] = _count(recordings, nested, settings.levels, len(counts))
        wide = [space.widened(width) for space in recordings.compared]
        spaces_of = dict(zip(domain.behaviors[e].modalities, wide, strict=True))
        classifiers[domain.behaviors[e].name] = BehaviorClassifier(spaces_of, fit, used)
    perception = Perception(domain, classifiers, dataset.labels, settings.levels)
    return perception, ConfusionCounts(counts)


def _count(
    recordings: BehaviorRecordings, nested: Floats, levels: int, n_objects: int
) -> NDArray[np.int64]:
    """Count the levels of nested outputs (n,P) by object and truth, (O,P,2,K)."""
    shown = levels_of(round_log_odds(nested), BIN_EDGES, levels)
    counts = np.zeros((n_objects, nested.shape[1], 2, levels), np.int64)
    row, attribute = np.nonzero(recordings.labels >= 0)
    truth, level = recordings.labels[row, attribute], shown[row, attribute]
    np.add.at(counts, (recordings.objects[row], attribute, truth, level), 1)
    return counts
