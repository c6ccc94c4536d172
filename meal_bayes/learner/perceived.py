"""What is perceived of the recordings: classifiers, the levels of percepts, and their counts."""

from collections.abc import Sequence
from dataclasses import astuple, replace

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents import Agent
from meal_bayes.arrays import no_and_yes_of
from meal_bayes.datasets import Dataset, Instance, TrainingSet
from meal_bayes.datasets.features import warn_of_order
from meal_bayes.datasets.percepts import classifier_levels, detected_levels, scores_of
from meal_bayes.domain import Query
from meal_bayes.learner import views
from meal_bayes.learner.experience import (
    FROM_DATASET,
    FROM_TRIAL,
    NONE,
    Context,
    Experience,
    Labels,
)
from meal_bayes.learner.settings import LearnerSettings
from meal_bayes.look import listed, warn_user
from meal_bayes.perception import (
    Perception,
    PerceptionSettings,
    fit_and_validate,
    fit_spaces,
    with_classifier,
)
from meal_bayes.perception.scores import (
    cut_scores,
    edges_by_rank,
    first_levels,
    object_means,
    scored_levels,
)


def expected_sizes(
    record: Experience, perception: Perception, sizes: views.Sizes
) -> dict[Context, int]:
    """Return the number of features of each context of which there are classifiers."""
    by_context = zip(record.domain.contexts, sizes.tolist(), strict=True)
    return {context: n for context, n in by_context if context[0] in perception.classifiers}


def cut_by_labels(record: Experience, labels: Labels, n_levels: int) -> NDArray[np.float64]:
    """Return edges (P,E,K-1) between the levels of scores, by labels (n,P) of their instances.

    A warning names scores that are lower where the truth is yes, once.
    """
    instances = record.instances.values
    edges, falling = cut_scores(
        record.scores.values,
        labels,
        instances["behavior"],
        instances["object"],
        behaviors=len(record.domain.behaviors),
        levels=n_levels,
    )
    for p, e in np.argwhere(falling).tolist():
        behavior, attribute = record.domain.behavior_names[e], record.domain.attributes[p]
        case = f"reversed scores {behavior} {attribute}"
        if case not in record.warned_of:
            record.warned_of.add(case)
            warn_user(
                f"The scores of {attribute!r} by {behavior} are lower where it is true; a score "
                "has to be higher there: give its negative."
            )
    return edges


def cut_by_rank(
    record: Experience, edges: NDArray[np.float64], pairs: NDArray[np.bool_], n_levels: int
) -> NDArray[np.float64]:
    """Return edges (P,E,K-1) of which those of pairs (P,E) are cut anew, by rank."""
    edges = edges.copy()
    instances = record.instances.values
    scores = record.scores.values
    pairs = pairs & views.given_pairs(record)
    for e in np.flatnonzero(pairs.any(axis=0)).tolist():
        rows = instances["behavior"] == e
        if not np.isnan(scores[rows]).all():
            means = object_means(scores[rows], instances["object"][rows])
            edges[pairs[:, e], e] = edges_by_rank(means, n_levels)
    return edges


def levels_by(record: Experience, edges: NDArray[np.float64]) -> Labels:
    """Return the levels (n,P) of the scores of all instances by edges (P,E,K-1); -1 none."""
    of_instances = edges.swapaxes(0, 1)[record.instances.values["behavior"]]
    return scored_levels(record.scores.values, of_instances)


def levels_since(
    record: Experience,
    perception: Perception,
    sizes: views.Sizes,
    n_levels: int,
    scored: Labels,
    first: int,
) -> NDArray[np.int8]:
    """Return the percept levels (n - first,P) of the instances from a first one; -1 unknown.

    Scores are of the levels `scored` (n,P). What else has no features is perceived as it was in
    its trial.
    """
    detections = views.percepts_given(record, n_levels, scored)
    levels = detections.copy()
    executed = {*record.instances.values["behavior"][first:].tolist()}
    for e in record.domain.recorded:
        if e not in executed:
            continue
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
        given = (detections[rows] >= 0) | ~np.isnan(record.scores.values[rows])
        levels[rows] = np.where(given, detections[rows], percepts)
    return levels[first:]


def levels_of(
    record: Experience,
    perception: Perception,
    sizes: views.Sizes,
    n_levels: int,
    instance: Instance,
    edges: NDArray[np.float64],
) -> Labels:
    """Return the percept levels (P,) of what was sensed; -1 unknown.

    What a detector says holds, its scores by edges (P,E,K-1); features of another size than
    learned from show nothing.
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
        of_all = Query(perception.domain.attributes)  # others may have been added since
        log_odds = perception.log_odds(replace(instance, features=fitted), of_all)
        levels[: len(log_odds)] = classifier_levels(log_odds, n_levels)
    detected = detected_levels(instance.percepts, domain, n_levels)
    scores = scores_of(instance.scores, domain)
    known = len(edges)  # attributes may have been added since, of which nothing is cut
    scored = record.no_labels
    of_behavior = edges[:, domain.behavior_index(instance.behavior)]
    scored[:known] = scored_levels(scores[:known], of_behavior)
    scored = np.where(scored >= 0, scored, first_levels(scores, n_levels))
    levels = np.where(scored >= 0, scored, levels)
    return np.where(detected >= 0, detected, levels).astype(np.int8)


def classify(
    record: Experience,
    agent: Agent,
    settings: LearnerSettings,
    labels: Labels,
    sizes: views.Sizes,
) -> tuple[Dataset, NDArray[np.intp], Perception, NDArray[np.int64]]:
    """Fit classifiers to instances with labels (n,P) and features of most sizes, and validate them.

    What a detector of the robot's own gave is learned from as it is, by no classifier.

    Returns
    -------
    data : Dataset
        Of the objects that were met, see `views.in_order`.
    rows : NDArray[np.intp]
        (k,) instances of D.
    perception : Perception
        The classifiers.
    counts : NDArray[np.int64]
        (O,P,E,2,K) percepts by classifiers that never saw the object.
    """
    bare = views.percepts_given(record, agent.levels, record.no_labels) >= 0
    detected = (bare | views.detected(record))[: len(labels)]
    learned = np.where(detected, -1, labels).astype(np.int8)
    data, rows, recorded = views.training(record, learned, sizes)
    training = _selected(recorded, np.asarray((recorded.labels >= 0).any(axis=1)))
    perceives = PerceptionSettings(levels=agent.levels, by_object=settings.by_object)
    # Scaling comes from all instances; the labels have no part in it.
    spaces = None
    if settings.classifier is not None:
        perceives = with_classifier(settings.classifier, levels=agent.levels)
    elif agent.whiten:
        spaces = fit_spaces(data, recorded, whiten=True)
    else:  # the spaces of what it was given hold for good
        from_dataset = record.instances.values["origin"][rows] == FROM_DATASET
        not_in_dataset = ~np.isin(recorded.behavior, recorded.behavior[from_dataset])
        spaces = fit_spaces(data, _selected(recorded, from_dataset | not_in_dataset))
    perception, counts = fit_and_validate(data, training, settings=perceives, spaces=spaces)
    return data, rows, perception, counts


def count_detections(
    record: Experience,
    counts: NDArray[np.int64],
    objects: Sequence[str],
    labels: Labels,
    detections: Labels,
) -> None:
    """Add what a detector said of instances with labels (n,P) to counts (O,P,E,2,K) of objects.

    It counts as it is, beside what classifiers of other objects said.
    """
    rows = {name: row for row, name in enumerate(objects)}
    row_of = np.array([rows.get(name, NONE) for name in record.objects], np.intp)
    instances = record.instances.values
    i, p = np.nonzero((detections >= 0) & (labels >= 0))
    cells = (row_of[instances["object"][i]], p, instances["behavior"][i])
    np.add.at(counts, (*cells, labels[i, p], detections[i, p]), 1)


def labels_used(
    record: Experience,
    settings: LearnerSettings,
    labels: Labels,
    detections: Labels,
    rows: NDArray[np.intp],
) -> Labels:
    """Return the labels (n,P) of instances that enter the posterior by a refit; -1 none.

    They are those of D (rows (k,)), and of what a detector said. A label enters once: the others
    enter later, by `Online.update`. A posterior of one's own holds what was given alone.
    """
    used = np.where(detections >= 0, labels, -1)
    used[rows] = labels[rows]
    if settings.posterior is not None:
        used[record.instances.values["origin"] != FROM_DATASET] = -1
    return used.astype(np.int8)


def trained_cells(
    record: Experience,
    settings: LearnerSettings,
    labels: Labels,
    detections: Labels,
    rows: NDArray[np.intp],
) -> NDArray[np.bool_]:
    """Return of which objects, behaviors and attributes (O,E,P) classifiers have seen a label.

    What they say of these is no evidence. A posterior of one's own may come from all that was
    given, and so counts as if they had seen that.
    """
    instances = record.instances.values
    taught = np.zeros(labels.shape, np.bool_)
    taught[rows] = (detections[rows] < 0) & (labels[rows] >= 0)
    if settings.posterior is not None:
        taught[:] = (instances["origin"] == FROM_DATASET)[:, None]
    shape = (len(record.objects), len(record.domain.behaviors), labels.shape[1])
    trained = np.zeros(shape, np.bool_)
    np.logical_or.at(trained, (instances["object"], instances["behavior"]), taught)
    return trained


def experience_of(
    record: Experience, agent: Agent, settings: LearnerSettings, apart: views.Rows = views.NO_ROWS
) -> tuple[NDArray[np.int64], float]:
    """Count labeled instances and objects, (2,P,E), and those that make one unit of Eq. 10.

    Instances `apart` (k,) do not count.
    """
    labeled = views.labeled(record, memory=agent.memory, apart=apart)
    counted = views.labeled(record, memory=agent.memory, given=settings.count_given, apart=apart)
    met = record.met_without(apart)
    unit = settings.unit or max(1.0, float(counted.max(initial=0)) * len(met))
    return np.stack([counted.sum(axis=0).T, (labeled > 0).sum(axis=0).T]), unit


def fractions(
    record: Experience, perception: Perception, counts: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return the fractions (...,P,E,2,2) of no and yes among an object's percepts (...,P,E,2,K).

    Zeros where there are none; half of each where the classifier cannot tell yet.
    """
    sides = no_and_yes_of(counts)
    total = sides.sum(axis=-1, keepdims=True)
    silent = np.ones(counts.shape[-4:-2], np.bool_)  # (P,E)
    for name, classifier in perception.classifiers.items():
        silent[:, perception.domain.behavior_index(name)] = ~classifier.used
    i, p = np.nonzero(views.detected(record))
    silent[p, record.instances.values["behavior"][i]] = False
    # No and yes alike, so that what tells nothing adds to neither rate.
    even = silent[..., None, None] & (total > 0)
    return np.asarray(np.where(even, 0.5, sides / np.maximum(total, 1)))


def warn_of_odd(record: Experience, sizes: views.Sizes) -> None:
    """Name recordings of another size than most, once."""
    odd = [text for text in views.odd_recordings(record, sizes) if text not in record.warned_of]
    if odd:
        record.warned_of.update(odd)
        warn_user(f"Left out of what is learned: {listed(odd, 5)}.")


def warn_of_clocks(record: Experience, sizes: views.Sizes) -> None:
    """Name features that a robot sensed and that only grow with its trials, once a modality.

    Those of recordings were looked at when these were read.
    """
    rows = record.instances.values
    for (behavior, modality), size in zip(record.domain.contexts, sizes.tolist(), strict=True):
        what = f"The robot's {modality} of {behavior}"
        features = record.features[behavior, modality]
        sensed = [
            i for i, v in features.items() if rows["origin"][i] == FROM_TRIAL and len(v) == size
        ]
        if sensed and what not in record.warned_of:
            values = np.stack([features[i] for i in sensed])
            if warn_of_order(what, values, rows["object"][sensed]):
                record.warned_of.add(what)


def _selected(training: TrainingSet, rows: NDArray[np.bool_]) -> TrainingSet:
    return TrainingSet(*(column[rows] for column in astuple(training)))
