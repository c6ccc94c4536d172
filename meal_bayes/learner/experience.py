"""The only record of what a robot did and was told: executions, instances, labels.

Everything else is a view of it (`views.py`): the training set D of Algorithm 2, evidence (Eq. 10),
success rates. A recording is what was sensed: two of equal features, by one behavior on one object
in one data set, are two; in two data sets they are one. Rows are added at the end.

A label is told in a trial, or of an object by its name, as those of a data set are. Each row of
labels (of an instance, of an object) is what `Domain.replace` makes of all that was told of it, in
order.
"""

import hashlib
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.arrays import Rows
from meal_bayes.datasets import Dataset, Instance
from meal_bayes.domain import Domain
from meal_bayes.errors import QueryError
from meal_bayes.kinds import checked
from meal_bayes.learner.columns import (
    EXECUTION,
    FEEDBACK,
    GATHERED,
    GIVEN,
    INSTANCE,
    NONE,
    WITHDRAWN,
    Context,
    Labels,
    told,
)
from meal_bayes.seeds import Key
from meal_bayes.trial_log.feedback import Feedback


def features_digest(features: Mapping[str, NDArray[np.float32]] | None) -> int:
    """Compute the digest of a recording's features by modality; 0 where there are none."""
    if not features:
        return 0
    digest = hashlib.blake2b(digest_size=8)
    for modality in sorted(features):
        values = np.ascontiguousarray(features[modality], "<f4")
        digest.update(f"{modality}\0{len(values)}\0".encode())
        digest.update(values.tobytes())
    return int.from_bytes(digest.digest()) >> 1 or 1


@checked
class Experience:
    """Executions, instances and labels, of E behaviors and P attributes.

    Attributes
    ----------
    objects, trials : dict
        Names of objects and keys of trials, with their numbers.
    instances, executions, feedback : Rows
        `INSTANCE` (n,), `EXECUTION` (m,), `FEEDBACK` (l,).
    levels : Rows (n,P)
        Percepts at the time they came; -1 unknown.
    detected : Rows (n,P)
        Those of them that a detector of the robot's own gave; -1 none.
    labels, known : Rows (n,P), (O,P)
        Labels of instances, of the trials in which they were shown; of objects; -1 unknown.
    features : dict
        Of each (behavior, modality), (D,) by number of the instance; any sizes.
    """

    def __init__(self, domain: Domain) -> None:
        p = len(domain.attributes)
        self.domain = domain
        self.objects: dict[str, int] = {}
        self.trials: dict[Key, int] = {}
        self.instances = Rows(INSTANCE)
        self.executions = Rows(EXECUTION)
        self.feedback = Rows(FEEDBACK)
        self.levels = Rows(np.int8, p)
        self.detected = Rows(np.int8, p)
        self.labels = Rows(np.int8, p)
        self.known = Rows(np.int8, p)
        self.features: dict[Context, dict[int, NDArray[np.float32]]] = {
            context: {} for context in domain.contexts
        }
        self.heard: dict[str, None] = {}  # names of the logs of what was told, in order
        self.unlogged = list[tuple[Path, Feedback]]()  # what was told, and the folder of its log
        self.named = set[str]()  # recordings that warnings have named

    def __repr__(self) -> str:
        """Return how much there is."""
        recordings = int((self.instances.values["origin"] != WITHDRAWN).sum())
        rows = [self.trial_rows(o) for o in range(len(self.objects))]
        labels = sum(int((row >= 0).sum()) for by_trial in rows for row in by_trial)
        against = sum(
            int(((by_trial == 1).any(axis=0) & (by_trial == 0).any(axis=0)).sum())
            for by_trial in rows
        )
        contradicted = f", {against} of them contradicted" if against else ""
        return (
            f"{recordings} recordings of {len(self.objects)} objects, {labels} labels{contradicted}"
        )

    def object(self, name: str) -> int:
        """Return the number of an object, a new one where it was not met before."""
        if name not in self.objects:
            self.objects[name] = len(self.objects)
            self.known.append(self.nothing)
        return self.objects[name]

    def trial(self, key: Key) -> int:
        """Return the number of a trial, a new one where it is not known."""
        return self.trials.setdefault(key, len(self.trials))

    @property
    def nothing(self) -> Labels:
        """Labels (P,) of which none is known."""
        return np.full(len(self.domain.attributes), -1, np.int8)

    def gathered(self, o: int) -> NDArray[np.intp]:
        """Return the instances of an object, by its number."""
        return np.flatnonzero(self.instances.values["object"] == o)

    def shown(self, trial: Key) -> NDArray[np.intp]:
        """Return the instances of a trial; where labels are told of an object, all of its own."""
        name = str(trial[-1])
        if trial == told(name):
            return self.gathered(self.objects.get(name, NONE))
        rows = self.executions.values
        of_trial = rows["trial"] == self.trials.get(trial, NONE)
        instances: NDArray[np.intp] = rows["instance"][of_trial]
        instances = instances[instances >= 0]
        held: NDArray[np.bool_] = self.instances.values["origin"][instances] != WITHDRAWN
        return instances[held]

    def give(self, dataset: Dataset) -> int:
        """Add the recordings of a data set that are not there, and its labels; return how many."""
        names = ["object", "behavior", "digest", "copy"]
        rows = self.instances.values
        present = set(rows[names][rows["origin"] != WITHDRAWN].tolist())
        before = len(self.instances)
        for o, name in enumerate(dataset.objects):
            number = self.object(name)
            copies = Counter[tuple[int, int]]()
            for e in dataset.domain.recorded:
                behavior = dataset.domain.behavior_names[e]
                for r in range(int(dataset.recording_counts[o, e])):
                    features = dataset.instance(o, behavior, r).features
                    digest = features_digest(features)
                    copy = copies[e, digest]
                    copies[e, digest] += 1
                    if (number, e, digest, copy) not in present:
                        row = (number, e, digest, copy, r, GIVEN, 0)
                        self._instance(row, features, self.nothing, self.nothing)
            labels = dataset.labels[o]
            said = self.told_in(told(name))
            if ((labels >= 0) & (labels != said)).any():
                self.label(told(name), name, labels, given=True)
        return len(self.instances) - before

    def execute(
        self,
        trial: Key,
        object_name: str,
        behavior: int,
        *,
        success: int,
        instance: Instance | None = None,
        levels: Labels | None = None,
        detected: Labels | None = None,
        k: int = 2,
    ) -> None:
        """Add an execution, and its instance if it is a new one.

        Parameters
        ----------
        behavior : int
            Its position.
        success : int
            1 succeeded, 0 failed, -1 not known.
        instance : Instance, optional
            What was sensed; of a replayed recording its number tells whether it is new (NONE where
            nobody says which it was: then it is the next of the data set).
        levels, detected : Labels | None
            (P,) its percept levels, of 0 to K - 1, and those that were given as such; -1 unknown.
        """
        number = self.trial(trial)
        row = NONE
        if levels is not None:
            o = self.object(object_name)
            features = None if instance is None else instance.features
            digest = features_digest(features)
            before = self.instances.values
            like = (before["object"] == o) & (before["behavior"] == behavior)
            like &= (before["digest"] == digest) & (before["origin"] != WITHDRAWN)
            # The same recording shown again is the instance that is there; a robot's is a new one.
            replayed = instance is not None and instance.object_index >= 0
            recording = NONE if instance is None or not replayed else instance.recording
            if replayed and recording == NONE:
                row = self._given_unshown(o, behavior, number)
            elif replayed:
                shown = like & ((before["recording"] == recording) | (before["origin"] == GIVEN))
                row = int(np.flatnonzero(shown).max(initial=NONE))
            if row == NONE:
                copy = int(like.sum())
                fields = (o, behavior, digest, copy, recording, GATHERED, k)
                row = self._instance(fields, features, levels, detected)
            self.levels.values[row] = levels
        self.executions.append((number, behavior, row, success))
        if row != NONE:
            self._relabel([row])

    def _given_unshown(self, o: int, behavior: int, trial: int) -> int:
        """Return the first given recording that a trial has not shown yet; NONE where none is."""
        rows = self.instances.values
        matching = (
            (rows["object"] == o) & (rows["behavior"] == behavior) & (rows["origin"] == GIVEN)
        )
        executions = self.executions.values
        shown = executions["instance"][executions["trial"] == trial]
        unshown = np.setdiff1d(np.flatnonzero(matching), shown)
        return int(unshown[0]) if len(unshown) else NONE

    def label(
        self, trial: Key, object_name: str, labels: Labels, *, given: bool = False
    ) -> NDArray[np.intp]:
        """Add labels (P,) of a trial's object, -1 unknown; return the instances of the object."""
        number = self.trial(trial)
        o = self.object(object_name)
        call = len(self.feedback)
        for p in np.flatnonzero(labels >= 0):
            self.feedback.append((number, call, o, p, labels[p], given))
        self._relabel(self.shown(trial), [o])
        return self.gathered(o)

    def forget(self, trial: Key, *, recordings: bool = False) -> NDArray[np.intp]:
        """Withdraw the labels of a trial, perhaps all it did; return the object's instances."""
        number = self.trials[trial]
        instances = self.shown(trial)
        if recordings:
            rows = self.executions.values
            # A recording that another trial showed, too, stays with that trial.
            held = (rows["trial"] != number) & (rows["success"] != WITHDRAWN)
            others = rows["instance"][held]
            gathered = self.instances.values["origin"][instances] == GATHERED
            for i in instances[gathered & ~np.isin(instances, others)].tolist():
                self.instances.values["origin"][i] = WITHDRAWN
                self.levels.values[i] = -1
                self.detected.values[i] = -1
                for by_instance in self.features.values():
                    by_instance.pop(i, None)
            rows["success"][rows["trial"] == number] = WITHDRAWN
        answers = self.feedback.values[self.feedback.values["trial"] == number]
        objects = {
            *answers["object"].tolist(),
            *self.instances.values["object"][instances].tolist(),
        }
        for p in np.flatnonzero(self.told_in(trial) >= 0):
            self.feedback.append((number, len(self.feedback), answers["object"][0], p, -1, 0))
        moved = np.flatnonzero(np.isin(self.instances.values["object"], list(objects)))
        self._relabel(moved, objects)
        return moved

    def told_in(self, trial: Key) -> Labels:
        """Return the labels (P,) that hold of those given in a trial; -1 unknown."""
        number = self.trials.get(trial, NONE)
        objects = self.feedback.values["object"][self.feedback.values["trial"] == number]
        calls = self.calls(int(objects[0])) if len(objects) else []
        return self._folded(labels for t, labels in calls if t == number)

    def trial_rows(self, o: int) -> Labels:
        """Return what each trial says of an object, (trials,P); -1 nothing."""
        by_trial: dict[int, list[Labels]] = {}
        for t, labels in self.calls(o):
            by_trial.setdefault(t, []).append(labels)
        rows = [self._folded(calls) for calls in by_trial.values()]
        return np.array(rows, np.int8).reshape(-1, len(self.domain.attributes))

    def calls(self, o: int) -> list[tuple[int, Labels]]:
        """Return what was told of an object and holds, in order: (trial, labels (P,)) a call."""
        rows = self.feedback.values[self.feedback.values["object"] == o]
        # Feedback is never erased: a row of value -1 withdraws the earlier ones of its trial.
        withdrawn: dict[tuple[int, int], int] = {}
        for at, (t, p, value) in enumerate(rows[["trial", "attribute", "value"]].tolist()):
            if value < 0:
                withdrawn[t, p] = at
        calls: dict[int, tuple[int, Labels]] = {}
        for at, (t, call, _, p, value, _) in enumerate(rows.tolist()):
            if value >= 0 and at > withdrawn.get((t, p), -1):
                calls.setdefault(call, (t, self.nothing))[1][p] = value
        return list(calls.values())

    def _relabel(self, instances: ArrayLike, objects: Iterable[int] = ()) -> None:
        """Fold all that was told of instances (k,), and of objects, into their labels."""
        executions = self.executions.values
        names = list(self.objects)
        rows = np.asarray(instances, np.intp)
        owners = self.instances.values["object"][rows].tolist()
        calls = {o: self.calls(o) for o in {*owners, *objects}}
        for i, o in zip(rows.tolist(), owners, strict=True):
            trials = {*executions["trial"][executions["instance"] == i].tolist()}
            trials.add(self.trials.get(told(names[o]), NONE))  # told by name, outside of any trial
            self.labels.values[i] = self._folded(labels for t, labels in calls[o] if t in trials)
        for o in objects:
            self.known.values[o] = self._folded(labels for _, labels in calls[o])

    def _folded(self, calls: Iterable[Labels]) -> Labels:
        """Return labels (P,) after others were told, in order.

        Where what a denial referred to was withdrawn, so that none of a group is left, it holds
        alone.
        """
        row = self.nothing
        for labels in calls:
            try:
                row = self.domain.replace(row, labels)
            except QueryError:
                groups = map(self.domain.columns, self.domain.groups.values())
                rest = row.copy()
                denied = (columns for columns in groups if (labels[columns] >= 0).any())
                rest[[p for columns in denied for p in columns]] = -1
                row = self.domain.replace(rest, labels)
        return row

    def _instance(
        self,
        fields: tuple[int, ...],
        features: Mapping[str, NDArray[np.float32]] | None,
        levels: Labels,
        detected: Labels | None,
    ) -> int:
        """Add an instance; return its number.

        Features are kept where they are of all the behavior's modalities.
        """
        row = self.instances.append(fields)
        spec = self.domain.behaviors[fields[1]]
        if features and all(modality in features for modality in spec.modalities):
            for modality in spec.modalities:
                self.features[spec.name, modality][row] = np.array(features[modality], np.float32)
        self.levels.append(levels)
        self.detected.append(self.nothing if detected is None else detected)
        self.labels.append(self.nothing)
        self._relabel([row])
        return row
