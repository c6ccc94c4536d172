"""Percept levels of what was sensed: by a detector of the robot's own, else by our classifiers."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from meal_bayes.datasets import Instance
from meal_bayes.datasets.detections import detected_levels
from meal_bayes.datasets.levels import classifier_levels
from meal_bayes.domain import Query
from meal_bayes.learner import views
from meal_bayes.learner.columns import Context, Labels
from meal_bayes.learner.experience import Experience
from meal_bayes.perception import Perception


def expected_sizes(
    record: Experience, perception: Perception, sizes: views.Sizes
) -> dict[Context, int]:
    """Return the number of features of each context of which there are classifiers."""
    by_context = zip(record.domain.contexts, sizes.tolist(), strict=True)
    return {context: n for context, n in by_context if context[0] in perception.classifiers}


def levels_since(
    record: Experience, perception: Perception, sizes: views.Sizes, n_levels: int, first: int
) -> NDArray[np.int8]:
    """Return the percept levels (n - first,P) of the instances from a first one; -1 unknown.

    Those without features are perceived as they were in their trial.
    """
    detections = views.percepts_given(record, n_levels)
    levels = detections.copy()
    for e in record.domain.recorded:
        name = record.domain.behavior_names[e]
        rows = views.sensed(record, sizes, name)
        rows = rows[rows >= first]
        # Log-odds of 0, even odds, where no classifier knows the behavior yet.
        log_odds = np.zeros((len(rows), levels.shape[1]))
        classifier = perception.classifiers.get(name)
        if classifier is not None and len(rows):
            features = {
                modality: np.stack([record.features[name, modality][i] for i in rows.tolist()])
                for modality in classifier.spaces
            }
            log_odds = classifier.log_odds(features)
        percepts = classifier_levels(log_odds, n_levels)
        levels[rows] = np.where(detections[rows] >= 0, detections[rows], percepts)
    return levels[first:]


def levels_of(
    record: Experience,
    perception: Perception,
    sizes: views.Sizes,
    n_levels: int,
    instance: Instance,
) -> Labels:
    """Return the percept levels (P,) of what was sensed; -1 unknown.

    What a detector says holds; features of another size than learned from show nothing.
    """
    domain = record.domain
    levels = record.no_labels
    expected = expected_sizes(record, perception, sizes)
    fitted = {
        modality: values
        for modality, values in (instance.features or {}).items()
        if len(values) == expected.get((instance.behavior, modality), len(values))
    }
    if fitted:
        of_all = Query(domain.attributes)
        log_odds = perception.log_odds(replace(instance, features=fitted), of_all)
        levels = classifier_levels(log_odds, n_levels)
    detected = detected_levels(instance.percepts, domain, n_levels)
    return np.where(detected >= 0, detected, levels).astype(np.int8)
