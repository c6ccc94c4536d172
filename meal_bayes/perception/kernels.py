"""Kernels between recordings of a data set, in spaces that many refits share.

A robot refits its classifiers after every batch. Its feature spaces (means, standard deviations,
kernel widths, whitening) need no labels: they can be fitted once, or again as recordings come in.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meal_bayes.datasets import Dataset, TrainingSet
from meal_bayes.datasets.percepts import round_log_odds
from meal_bayes.display import short_repr
from meal_bayes.perception.confusion import ConfusionCounts
from meal_bayes.perception.cross_validation import fit_behavior
from meal_bayes.perception.ensemble import BehaviorFit, KernelFit
from meal_bayes.perception.modality import FeatureSpace, fit_space, widened
from meal_bayes.perception.recordings import BehaviorRecordings, rows_of, with_landmarks
from meal_bayes.perception.settings import DEFAULT, PerceptionSettings
from meal_bayes.perception.width import learned_widths


@dataclass(frozen=True, slots=True)
class Kernels:
    """All n = O R recordings in the spaces of every behavior's modalities.

    Attributes
    ----------
    spaces : (behavior, modality) -> space with rows (n,d).
    """

    dataset: Dataset
    spaces: Mapping[tuple[str, str], FeatureSpace]

    __repr__ = short_repr

    @classmethod
    def of(
        cls,
        dataset: Dataset,
        gathered: TrainingSet,
        *,
        kernel: str = "rbf",
        whiten: bool = False,
    ) -> "Kernels":
        """Fit the spaces to the recordings that a robot has, without labels.

        A behavior without recordings has no kernels: percepts of it are at even odds.

        Parameters
        ----------
        gathered : the recordings.
        whiten : shrink directions in which repeats of one object differ.
        """
        spaces = {}
        n = len(dataset.objects) * dataset.recordings
        for behavior, modality in dataset.features:
            rows = gathered.behavior == dataset.domain.behavior_index(behavior)
            if rows.any():
                values, objects = dataset.features[behavior, modality], gathered.object[rows]
                known = values[objects, gathered.recording[rows]]
                space = fit_space(known, kernel, objects if whiten else None)
                spaces[behavior, modality] = space.over(values.reshape(n, -1))
        return cls(dataset, spaces)

    def spaces_of(self, behavior: str, rows: NDArray[np.int64]) -> tuple[FeatureSpace, ...]:
        """Return the spaces of a behavior's modalities with some recordings (r,)."""
        return tuple(space.at(rows) for (name, _), space in self.spaces.items() if name == behavior)


def fit_and_score(
    kernels: Kernels,
    training_set: TrainingSet,
    objects: NDArray[np.intp],
    *,
    settings: PerceptionSettings = DEFAULT,
) -> tuple[NDArray[np.float16], ConfusionCounts]:
    """Fit Psi on a training set, and score all recordings of some objects.

    Returns
    -------
    log_odds : (O,R,E,P) of the objects' recordings; NaN of everything else.
    counts : such percepts of training objects that they never saw (see `cross_validate`).
    """
    dataset, domain = kernels.dataset, kernels.dataset.domain
    shape = (len(dataset.objects), len(domain.attributes), len(domain.behaviors))
    counts = np.zeros((*shape, 2, settings.levels), np.int64)
    log_odds = np.full((shape[0], dataset.recordings, shape[2], shape[1]), np.nan, np.float16)
    every = np.arange(dataset.recordings)
    scored = (np.asarray(objects)[:, None] * dataset.recordings + every).ravel()
    gathered = {}
    for e, behavior in enumerate(domain.behaviors):
        if not behavior.modalities:
            continue
        log_odds[objects, :, e] = 0.0
        rows = rows_of(dataset, training_set, behavior.name)
        if not len(rows) or (behavior.name, behavior.modalities[0]) not in kernels.spaces:
            continue
        names = training_set.object[rows].astype(np.int64)
        place = names * dataset.recordings + training_set.recording[rows]
        spaces = kernels.spaces_of(behavior.name, place)
        gathered[e] = BehaviorRecordings(names, training_set.labels[rows], spaces)
    gathered = with_landmarks(gathered, settings)
    width, _ = learned_widths(gathered.values(), settings)
    for e, recordings in gathered.items():
        fit, used, nested = fit_behavior(recordings.widened(width), settings, shape[0])
        counts[:, :, e] = nested.counts[:, :, 0]
        others = kernels.spaces_of(domain.behaviors[e].name, scored)
        outputs = round_log_odds(np.where(used, _scored(fit, recordings, others, width), 0.0))
        log_odds[objects, :, e] = outputs.reshape(len(objects), dataset.recordings, -1)
    log_odds[np.arange(dataset.recordings)[:, None] >= dataset.recording_counts[:, None]] = np.nan
    return log_odds, ConfusionCounts(counts)


def _scored(
    fit: BehaviorFit, recordings: BehaviorRecordings, others: Sequence[FeatureSpace], width: float
) -> NDArray[np.float64]:
    """Score other recordings (B,) by what was fitted to these, (B,P)."""
    rows = [space.rows for space in others]
    if not isinstance(fit, KernelFit):
        return fit.scored(recordings.compared, rows)
    pairs = zip(recordings.compared, rows, strict=True)
    return fit.log_odds(widened(np.stack([space.similarity(own) for space, own in pairs]), width))
