"""Views of the experience record: functions that compute tables from it.

With memory, an agent recognizes objects, so the labels of an instance are those of its object in
all trials. Without memory, they are those of the trials that showed the instance, and those that
were given for the object by its name.
"""

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from itertools import islice, takewhile

import numpy as np
from numpy.typing import NDArray

from meal_bayes.datasets import Dataset, PerceptTable, TrainingSet
from meal_bayes.learner.experience import (
    FROM_DATASET,
    NONE,
    WITHDRAWN,
    Experience,
    Labels,
    is_key_of_name,
    nobody_named,
)
from meal_bayes.robots.heard import Heard
from meal_bayes.seeds import Key
from meal_bayes.trials import Step, Trial

HALVED = 5  # half-life of the weight of an execution in success rates, in trials
_ENOUGH = 2  # labeled objects of each truth, from which on labels decide about a detector
Sizes = NDArray[np.int64]  # number of features of each context of the domain; NONE without any


def attempts(record: Experience) -> NDArray[np.float64]:
    """Return weighted counts of failed and successful executions of each behavior, (E,2).

    Hardware may break and be repaired. Therefore the weight of an execution decreases with every
    trial that begins after it, so that the estimate returns to the domain's probability.
    """
    e = len(record.domain.behaviors)
    rows = record.executions.values
    began = taught(record)
    since = began.sum() - began.cumsum()  # trials that began after each
    rows = rows[(rows["success"] == 0) | (rows["success"] == 1)]
    cells = 2 * rows["behavior"] + rows["success"]
    weights = 0.5 ** (since[rows["trial"]] / HALVED)
    counts = np.zeros(2 * e)
    np.add.at(counts, cells, weights)
    return counts.reshape(e, 2)


def answered(record: Experience) -> NDArray[np.float64]:
    """Count wrong and right answers of each behavior that asks, (E,2), by the present labels.

    An answer about an attribute of an object without a label does not count.
    """
    answers = record.answers.values
    executions = record.executions.values
    withdrawn = executions["trial"][executions["success"] == WITHDRAWN]
    answers = answers[~np.isin(answers["trial"], withdrawn)]
    labels = record.object_labels.values[answers["object"], answers["attribute"]]
    known = labels >= 0
    right = (labels == answers["value"])[known].astype(np.intp)
    counts = np.zeros((len(record.domain.behaviors), 2))
    np.add.at(counts, (answers["behavior"][known], right), 1)
    return counts


def taught(record: Experience) -> NDArray[np.bool_]:
    """Return the training trials (trials,): those of a robot that were not forgotten."""
    rows = record.executions.values
    of_robot = np.array([not is_key_of_name(key) for key in record.trials], bool)
    of_robot[rows["trial"][rows["success"] == WITHDRAWN]] = False
    return of_robot


def rows(record: Experience) -> int:
    """Return the number of rows that trials, data sets and people have added."""
    return len(record.trials) + len(record.executions) + len(record.feedback)


def has_taught(record: Experience, trial: Key) -> bool:
    """Return whether a trial is a training trial (see `taught`)."""
    return trial in record.trials and bool(taught(record)[record.trials[trial]])


def unrecorded(record: Experience, trial: Trial) -> list[Step]:
    """Return the executed steps of a trial that the record does not contain yet."""
    behaviors = [step for step in trial.steps if step.decision.action < trial.momdp.n_behaviors]
    executions = record.executions.values["trial"]
    return behaviors[int((executions == record.trials.get(trial.task.key, NONE)).sum()) :]


def trials_before(record: Experience, trial: Key) -> int:
    """Return the number of training trials that began before a trial."""
    first = record.trials.get(trial, len(record.trials))
    return int(taught(record)[:first].sum())


def asked_before(record: Experience, trial: Key) -> NDArray[np.int64]:
    """Return the number (P,) of training trials before a trial whose question has each attribute.

    The key of a trial ends with the attributes of its question.
    """
    columns: dict[str | int, int] = {a: p for p, a in enumerate(record.domain.attributes)}
    first = record.trials.get(trial, len(record.trials))
    counts = np.zeros(len(columns), np.int64)
    for key, teaches in zip(islice(record.trials, first), taught(record)[:first], strict=True):
        if teaches:
            counts[[columns[name] for name in takewhile(columns.__contains__, reversed(key))]] += 1
    return counts


def told_fraction(record: Experience) -> float:
    """Return the fraction of the other attributes that people label in addition to one.

    The fraction is estimated by Laplace's rule over all trials with labels.
    """
    rows = record.feedback.values
    rows = rows[rows["given"] == 0]
    cells = (len(record.trials), len(record.domain.attributes))
    labels = np.full(cells, -1)
    labels[rows["trial"], rows["attribute"]] = rows["value"]  # the latest of each
    number = (labels >= 0).sum(axis=1)  # of each trial
    beyond = np.maximum(number - 1, 0).sum()
    possible = (number > 0).sum() * (cells[1] - 1)
    return float((beyond + 1) / (possible + 2))


def labels_for(record: Experience, names: Iterable[str]) -> Labels:
    """Return the labels (O,P) of objects by name; -1 unknown."""
    rows = np.vstack([record.object_labels.values, record.no_labels])
    return rows[[record.objects.get(name, NONE) for name in names]]


def labels_touched(record: Experience, trial: Key, name: str) -> Labels:
    """Return labels (rows,P): those of a trial, then those of its object and its instances."""
    instances = record.instances_of_object(record.objects.get(name, NONE))
    of_object = labels_for(record, [name])
    return np.vstack([record.labels_of_trial(trial), of_object, record.labels.values[instances]])


def labeled_table(record: Experience, table: PerceptTable) -> PerceptTable:
    """Return a percept table with the labels of `Experience.labels_beside`."""
    labels = table.labels.copy()
    for o, name in enumerate(table.objects):
        if name in record.objects:
            labels[o] = record.labels_beside(name, labels[o])
    return replace(table, labels=labels)


def labels_of(record: Experience, *, memory: bool) -> Labels:
    """Return the labels (n,P) of all instances."""
    labels = record.labels.values
    if memory:
        labels = record.object_labels.values[record.instances.values["object"]]
    withdrawn = record.instances.values["origin"] == WITHDRAWN
    return np.where(withdrawn[:, None], -1, labels).astype(np.int8)


Rows = NDArray[np.intp]
NO_ROWS: Rows = np.empty(0, np.intp)


def labeled(
    record: Experience, *, memory: bool, given: bool = True, apart: Rows = NO_ROWS
) -> NDArray[np.int64]:
    """Count the labeled instances by object, behavior and attribute, (O,E,P).

    Instances of data sets count only if `given`; the instances `apart` (k,) do not count.
    """
    instances = record.instances.values
    counted = given | (instances["origin"] != FROM_DATASET)
    e = len(record.domain.behaviors)
    p = len(record.domain.attributes)
    counts = np.zeros((len(record.objects), e, p), int)
    labels = (labels_of(record, memory=memory) >= 0) & counted[:, None]
    labels[apart] = False
    np.add.at(counts, (instances["object"], instances["behavior"]), labels)
    return counts


def sizes(record: Experience) -> Sizes:
    """Return the most frequent number of features of each context; the latest one in a tie."""
    most = np.full(len(record.domain.contexts), NONE)
    for number, context in enumerate(record.domain.contexts):
        lengths = [len(values) for values in record.features[context].values()]
        if lengths:
            counts = Counter(lengths)
            often = [size for size in lengths if counts[size] == max(counts.values())]
            most[number] = often[-1]
    return most


def sensed(record: Experience, of_sizes: Sizes, behavior: str) -> NDArray[np.intp]:
    """Return the instances (k,) of a behavior with features of these sizes."""
    rows: set[int] | None = None
    for context, size in zip(record.domain.contexts, of_sizes.tolist(), strict=True):
        if context[0] == behavior:
            fitting = {i for i, v in record.features[context].items() if len(v) == size}
            rows = fitting if rows is None else rows & fitting
    return np.array(sorted(rows or ()), np.intp)


def odd_recordings(record: Experience, of_sizes: Sizes) -> list[str]:
    """Return a message for each recording with another number of features than most."""
    names = list(record.objects)
    owners = record.instances.values["object"]
    texts = []
    for context, size in zip(record.domain.contexts, of_sizes.tolist(), strict=True):
        odd = {i: len(v) for i, v in record.features[context].items() if len(v) != size}
        for i, length in odd.items():
            recording = f"{' '.join(context)} of {names[owners[i]]!r}"
            texts.append(f"{recording} has {length} features, most have {size}")
    return texts


def in_order(record: Experience) -> list[str]:
    """Return the objects in an order that does not depend on random names.

    Named objects are sorted by name. Objects that nobody named have a random name; they are sorted
    by their recordings, and then by the order in which they were met. Forgotten objects are left
    out.
    """
    rows = record.instances.values
    withdrawn = rows["origin"] == WITHDRAWN
    recordings_of: dict[int, list[tuple[int, int]]] = {}
    for o, behavior, digest in rows[["object", "behavior", "digest"]][~withdrawn].tolist():
        recordings_of.setdefault(o, []).append((behavior, digest))

    def sort_key(name: str) -> tuple[str, list[tuple[int, int]]]:
        if not nobody_named(name):
            return name, []
        # The same name for all of them, so that only their recordings determine the order.
        return "object", sorted(recordings_of.get(record.objects[name], ()))

    return sorted(record.met, key=sort_key)


def training(
    record: Experience, labels: Labels, of_sizes: Sizes
) -> tuple[Dataset, NDArray[np.intp], TrainingSet]:
    """Return the training set D: the instances with features as a data set, and their labels.

    The result does not depend on the order in which instances came or on random names of objects
    (see `in_order`); recordings are sorted by digest.

    Parameters
    ----------
    labels : Labels
        (n,P) labels of the first n instances, which are used.
    of_sizes : Sizes
        Numbers of features; recordings with other numbers are left out.

    Returns
    -------
    dataset : Dataset
        Recordings of all objects that were not forgotten; their numbers may differ.
    rows : NDArray[np.intp]
        (k,) instances in the order of the training set.
    recorded : TrainingSet
        All these instances, with and without labels.
    """
    domain = record.domain
    fitting = [sensed(record, of_sizes, domain.behavior_names[e]) for e in domain.recorded]
    rows = np.concatenate([np.empty(0, np.intp), *fitting])
    rows = rows[rows < len(labels)]
    objects = tuple(in_order(record))
    position = np.full(len(record.objects), NONE)
    position[[record.objects[name] for name in objects]] = np.arange(len(objects))
    instances = record.instances.values
    keys = [instances[name][rows] for name in ("copy", "digest", "behavior")]
    rows = rows[np.lexsort([*keys, position[instances["object"][rows]]])]
    o = position[instances["object"][rows]].astype(np.int32)
    e = instances["behavior"][rows].astype(np.int32)
    # Rows are sorted, so the recordings of an object and behavior are numbered from the first.
    pairs = o * len(domain.behaviors) + e
    r = (np.arange(len(rows)) - np.searchsorted(pairs, pairs)).astype(np.int32)
    most = int(r.max(initial=0)) + 1
    features = {}
    for context, size in zip(domain.contexts, of_sizes.tolist(), strict=True):
        values = np.full((len(objects), most, max(size, 1)), np.nan, np.float32)
        for row in np.flatnonzero(e == domain.behavior_index(context[0])):
            values[o[row], r[row]] = record.features[context][int(rows[row])]
        features[context] = values
    object_labels = labels_for(record, objects) if objects else record.object_labels.values[:0]
    dataset = Dataset(domain, objects, features, object_labels, partial=True)
    return dataset, rows, TrainingSet(o, e, r, labels[rows])


def percepts_given(record: Experience, k: int, scored: Labels) -> Labels:
    """Return the percepts (n,P) at K levels that do not come from classifiers; -1 if none.

    These are percepts of the robot's own detector, whose scores have the levels `scored` (n,P), and
    percepts of instances without features.
    """
    instances = record.instances.values
    bare = (instances["digest"] == 0) & (instances["scale"] == k)
    levels = np.where(bare[:, None], record.levels.values, -1)
    scale = np.maximum(instances["scale"], 1)[:, None]
    detections = record.detected.values.astype(int)
    # The extreme levels stay the extreme levels.
    scaled = np.where(
        detections == scale - 1, k - 1, np.where(detections == 0, 0, detections * k // scale)
    )
    levels = np.where(np.isnan(record.scores.values), levels, scored)
    return np.where(detections >= 0, scaled, levels).astype(np.int8)


def detected(record: Experience) -> NDArray[np.bool_]:
    """Return the instances and attributes (n,P) with a percept or score of the robot's detector."""
    return np.asarray((record.detected.values >= 0) | ~np.isnan(record.scores.values))


def given_pairs(record: Experience) -> NDArray[np.bool_]:
    """Return the pairs (P,E) with a percept or score of the robot's own detector."""
    given = np.zeros((len(record.domain.attributes), len(record.domain.behaviors)), np.bool_)
    instance, attribute = np.nonzero(detected(record))
    given[attribute, record.instances.values["behavior"][instance]] = True
    return given


def trusted_pairs(record: Experience) -> NDArray[np.bool_]:
    """Return the given pairs (P,E) that have the prior of a detector: those with few labels.

    With labels of two true and two false objects of the detector, the labels decide.
    """
    given = given_pairs(record)
    instance, attribute = np.nonzero(detected(record))
    rows = record.instances.values[instance]
    label = record.object_labels.values[rows["object"], attribute]
    cells = np.stack([attribute, rows["behavior"], label, rows["object"]])[:, label >= 0]
    number = np.zeros((*given.shape, 2), np.int64)  # of labeled objects
    np.add.at(number, tuple(np.unique(cells, axis=1)[:3]), 1)
    return given & (number < _ENOUGH).any(axis=2)


def heard(record: Experience) -> Heard:
    """Return the percepts and scores of the robot's own detectors so far."""
    attributes, behaviors = record.domain.attributes, record.domain.behavior_names
    behavior = record.instances.values["behavior"]
    said = Heard()
    words = given_by(record.detected.values >= 0, behavior)
    said.words.update((behaviors[e], attributes[p]) for e, p in words)
    scores = record.scores.values
    for e, p in given_by(~np.isnan(scores), behavior):
        of_pair = scores[behavior == e, p]
        said.scores[behaviors[e], attributes[p]] = of_pair[~np.isnan(of_pair)].tolist()
    return said


def given_by(said: NDArray[np.bool_], behavior: NDArray[np.int64]) -> list[tuple[int, int]]:
    """Return the pairs of behavior and attribute that occur in instances (n,P)."""
    i, p = np.nonzero(said)
    return sorted({*zip(behavior[i].tolist(), p.tolist(), strict=True)})
