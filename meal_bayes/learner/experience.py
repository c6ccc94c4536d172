"""The only record of what a robot did and was told: executions, instances, labels.

Everything else is a view of it: the training set D of Algorithm 2, evidence (Eq. 10), labels by
object, success rates. Rows are added at the end, and are written as they are.
"""

from collections.abc import Iterable, Mapping
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import Rows
from meal_bayes.datasets import Dataset, Instance, TrainingSet
from meal_bayes.domain import Domain
from meal_bayes.errors import DataError, QueryError

Key = tuple[str | int, ...]
Labels = NDArray[np.int8]
Context = tuple[str, str]  # (behavior, modality)

GIVEN = 0  # in place of the levels of its percepts: the instance was not gathered in a trial
UNNUMBERED = 1 << 20  # recordings of a robot's own, after those that a data set numbers


def told(name: str) -> Key:
    """Return what stands for a trial where labels are told of an object by its name."""
    return ("told", name)


class Experience:
    """Executions, instances and labels, of E behaviors and P attributes.

    Attributes
    ----------
    objects, trials : dict
        Names of objects and keys of trials, with their numbers.
    instances : Rows (n,5)
        Object, behavior, recording, row of its features (-1: none), levels K of its percepts, or
        0 where it was not gathered in a trial but given.
    levels : Rows (n,P)
        Percepts at the time they came; -1 unknown.
    labels : Rows (n,P)
        Of the trials in which an instance was shown; -1 unknown.
    executions : Rows (m,4)
        Trial, behavior, instance (-1: nothing perceived), and success: 1, 0, or -1 where failing
        and succeeding look the same.
    feedback : Rows (l,4)
        Trial, object, attribute, and value; -1 where a label was withdrawn.
    features : dict
        Rows (r,D) of each (behavior, modality).
    known : Rows (O,P)
        Labels of objects, the latest of each; -1 unknown.
    """

    def __init__(self, domain: Domain) -> None:
        p = len(domain.attributes)
        self.domain = domain
        self.objects: dict[str, int] = {}
        self.trials: dict[Key, int] = {}
        self.instances, self.levels, self.labels = Rows(int, 5), Rows(np.int8, p), Rows(np.int8, p)
        self.executions, self.feedback = Rows(int, 4), Rows(int, 4)
        self.features: dict[Context, Rows] = {}
        self.known = Rows(np.int8, p)

    def __repr__(self) -> str:
        """Return how much there is."""
        latest = {tuple(row[:3]): row[3] for row in self.feedback.values.tolist()}
        labels = sum(value >= 0 for value in latest.values())
        return f"{len(self.instances)} recordings of {len(self.objects)} objects, {labels} labels"

    @property
    def attempts(self) -> NDArray[np.int64]:
        """Executions of each behavior that failed, and that succeeded, (E,2)."""
        e, rows = len(self.domain.behaviors), self.executions.values
        rows = rows[rows[:, 3] >= 0]
        return np.bincount(2 * rows[:, 1] + rows[:, 3], minlength=2 * e).reshape(e, 2)

    def object(self, name: str) -> int:
        """Return the number of an object, a new one where it was not met before."""
        if name not in self.objects:
            self.objects[name] = len(self.objects)
            self.known.append(np.full(len(self.domain.attributes), -1))
        return self.objects[name]

    def trial(self, key: Key) -> int:
        """Return the number of a trial, a new one where it is not known."""
        return self.trials.setdefault(key, len(self.trials))

    def give(self, dataset: Dataset) -> None:
        """Add the recordings and labels of a data set; those that are there are not added again."""
        for context, values in dataset.features.items():
            name, size = " ".join(context), values.shape[-1]
            if (before := self.sizes.get(context, size)) != size:
                raise DataError(f"{name}: {size} features, where {before} came before.")
        places = {tuple(row) for row in self.instances.values[:, :3].tolist()}
        for o, name in enumerate(dataset.objects):
            number = self.object(name)
            fresh = [
                self._instance(number, e, r, dataset.instance(o, behavior.name, r).features, GIVEN)
                for e, behavior in enumerate(dataset.domain.behaviors)
                for r in range(int(dataset.recording_counts[o, e]))
                if behavior.modalities and (number, e, r) not in places
            ]
            self.labels.values[fresh] = dataset.labels[o]
            known = self.known.values[number]
            self.known.values[number] = self.domain.replace(known, dataset.labels[o])

    def execute(
        self, trial: Key, object_name: str, behavior: int, *, success: int,
        instance: Instance | None = None, levels: Labels | None = None, k: int = 2,
    ) -> None:  # fmt: skip
        """Add an execution, and its instance if it is a new one.

        Parameters
        ----------
        behavior : int
            Its position.
        success : int
            1 succeeded, 0 failed, -1 not known.
        instance : Instance, optional
            What was perceived; of a replayed recording its number tells whether it is new.
        levels : Labels | None
            (P,) its percept levels, of 0 to K - 1; -1 unknown.
        """
        number, place = self.trial(trial), -1
        if levels is not None:
            o = self.object(object_name)
            gathered = self.gathered(o)
            r = UNNUMBERED + len(gathered)
            if instance is not None and instance.object_index >= 0:
                r = instance.recording
            same = (self.instances.values[gathered, 1:3] == (behavior, r)).all(axis=1)
            place = int(gathered[same].max(initial=-1))
            if place < 0:
                features = None if instance is None else instance.features
                place = self._instance(o, behavior, r, features, k)
            self.levels.values[place] = levels
        self.executions.append((number, behavior, place, success))

    def label(self, trial: Key, object_name: str, labels: Labels) -> NDArray[np.intp]:
        """Add labels (P,) of a trial's object, -1 unknown; return instances (k,) that it moves."""
        number, o = self.trial(trial), self.object(object_name)
        columns = np.flatnonzero(labels >= 0)
        changed = (self.known.values[o, columns] != labels[columns]).any()
        for p in columns:
            self.feedback.append((number, o, p, labels[p]))
        shown = self.shown(trial)
        for table, rows in ((self.labels.values, shown), (self.known.values, [o])):
            for row in rows:
                table[row] = self.domain.replace(table[row], labels)
        return self.gathered(o) if changed else shown

    def complete(self, trial: Key) -> None:
        """Give labels that were told during a trial to what it has shown since."""
        labels = self.domain.labels(self.labels_by(trial))
        for row in self.shown(trial):
            self.labels.values[row] = self.domain.replace(self.labels.values[row], labels)

    def forget(self, trial: Key) -> NDArray[np.intp]:
        """Withdraw the labels of a trial; return the instances as `label` does."""
        number, shown = self.trials[trial], self.shown(trial)
        rows, instances = self.feedback.values, self.instances.values
        answers = rows[(rows[:, 0] == number) & (rows[:, 3] >= 0)]
        shows = set(map(tuple, self.executions.values[:, [0, 2]].tolist()))  # trial, instance
        o = int(answers[0, 1])
        named = self.trials.get(told(list(self.objects)[o]))
        # What was given holds again, as recordings that the trial did not show have it.
        pretrained = [i for i in self.gathered(o) if instances[i, 4] == GIVEN and i not in shown]
        for p in dict.fromkeys(answers[:, 2].tolist()):
            self.feedback.append((number, o, p, -1))
        nothing = np.full(len(self.domain.attributes), -1, np.int8)
        given = self.labels.values[pretrained[0]] if pretrained else nothing
        told_rows = self._told(o)
        self.known.values[o] = self._folded(given, [labels for _, labels in told_rows])
        for i in shown:
            of_row = [labels for t, labels in told_rows if t == named or (t, i) in shows]
            before = given if instances[i, 4] == GIVEN else nothing
            self.labels.values[i] = self._folded(before, of_row)
        return self.gathered(o)

    @property
    def sizes(self) -> dict[Context, int]:
        """Number of features of each (behavior, modality) that was perceived."""
        return {context: rows.values.shape[1] for context, rows in self.features.items()}

    def labels_for(self, names: Iterable[str]) -> Labels:
        """Return the labels (O,P) of objects by name; -1 unknown."""
        nothing = np.full(len(self.domain.attributes), -1, np.int8)  # of no object
        rows = np.vstack([self.known.values, nothing])
        return rows[[self.objects.get(name, -1) for name in names]]

    def shown(self, trial: Key) -> NDArray[np.intp]:
        """Return the instances of a trial; where labels are told of an object, all of its own."""
        name = str(trial[-1])
        if trial == told(name):
            return self.gathered(self.objects.get(name, -1))
        rows = self.executions.values
        places: NDArray[np.intp] = rows[rows[:, 0] == self.trials.get(trial, -1), 2]
        return places[places >= 0]

    def gathered(self, o: int) -> NDArray[np.intp]:
        """Return the instances of an object, by its number."""
        return np.flatnonzero(self.instances.values[:, 0] == o)

    def labels_by(self, trial: Key) -> dict[str, bool]:
        """Return the labels that were given in a trial, by attribute."""
        rows = self.feedback.values
        answers = rows[rows[:, 0] == self.trials.get(trial, -1)]
        latest = {int(p): int(value) for p, value in answers[:, 2:].tolist()}
        return {self.domain.attributes[p]: v == 1 for p, v in latest.items() if v >= 0}

    def labels_of(self, rows: Any, *, memory: bool) -> Labels:
        """Return the labels (k,P) of instances: with memory those of the object, in any trial."""
        if memory:
            return np.asarray(self.known.values[self.instances.values[rows, 0]])
        return np.asarray(self.labels.values[rows])

    def labelled(self, *, memory: bool, given: bool = True) -> NDArray[np.int64]:
        """Count the labelled instances of object, behavior, attribute, (O,E,P).

        Labels are as in `labels_of`; those not gathered in trials count if `given`.
        """
        instances = self.instances.values
        rows = np.arange(len(instances)) if given else np.flatnonzero(instances[:, 4] != GIVEN)
        e, p = len(self.domain.behaviors), len(self.domain.attributes)
        counts = np.zeros((len(self.objects), e, p), int)
        labels = self.labels_of(rows, memory=memory) >= 0
        np.add.at(counts, (instances[rows, 0], instances[rows, 1]), labels)
        return counts

    def data(self, *, memory: bool) -> tuple[Dataset, NDArray[np.intp], TrainingSet]:
        """Return D: the instances with features as a data set, where each row is, and their labels.

        Returns
        -------
        dataset : Dataset
            Ragged; of all objects that were met.
        rows : NDArray[np.intp]
            (k,) instances, in the order of the training set.
        gathered : TrainingSet
            All of them, labelled or not.
        """
        instances = self.instances.values
        rows = np.flatnonzero(instances[:, 3] >= 0)
        rows = rows[np.lexsort(instances[rows, 2::-1].T)]  # by object, behavior, recording
        o, e = instances[rows, :2].T.astype(np.int32)
        place = o * len(self.domain.behaviors) + e
        r = (np.arange(len(rows)) - np.searchsorted(place, place)).astype(np.int32)
        objects, most, features = tuple(self.objects), int(r.max(initial=0)) + 1, {}
        for context in self.domain.contexts:
            perceived = self.features.get(context, Rows(np.float32, 1)).values
            values = np.full((len(objects), most, perceived.shape[1]), np.nan, np.float32)
            mask = e == self.domain.behavior_index(context[0])
            values[o[mask], r[mask]] = perceived[instances[rows[mask], 3]]
            features[context] = values
        dataset = Dataset(self.domain, objects, features, self.known.values, partial=True)
        return dataset, rows, TrainingSet(o, e, r, self.labels_of(rows, memory=memory))

    def _instance(
        self, o: int, behavior: int, recording: int,
        features: Mapping[str, NDArray[np.float32]] | None, k: int,
    ) -> int:  # fmt: skip
        """Add an instance without percepts and labels; return its number.

        Features are kept where they are of all the behavior's modalities.
        """
        spec, row = self.domain.behaviors[behavior], -1
        if features and all(modality in features for modality in spec.modalities):
            for modality in spec.modalities:
                values = features[modality]
                empty = Rows(np.float32, len(values))
                row = self.features.setdefault((spec.name, modality), empty).append(values)
        nothing = np.full(len(self.domain.attributes), -1)
        self.levels.append(nothing)
        self.labels.append(nothing)
        return self.instances.append((o, behavior, recording, row, k))

    def _folded(self, row: Labels, told_rows: Iterable[Labels]) -> Labels:
        """Return labels (P,) after others were told, in order.

        Where what a denial referred to was withdrawn, so that none of a group is left, it holds
        alone.
        """
        for labels in told_rows:
            try:
                row = self.domain.replace(row, labels)
            except QueryError:
                groups = map(self.domain.columns, self.domain.groups.values())
                rest = row.copy()
                rest[
                    [p for columns in groups if (labels[columns] >= 0).any() for p in columns]
                ] = -1
                row = self.domain.replace(rest, labels)
        return row

    def _told(self, o: int) -> list[tuple[int, Labels]]:
        """Return trials and the labels (P,) that they gave an object and hold, in order."""
        rows = self.feedback.values[self.feedback.values[:, 1] == o]
        withdrawn = {(t, p): at for at, (t, _, p, value) in enumerate(rows.tolist()) if value < 0}
        told_rows = []
        for t, run in groupby(enumerate(rows.tolist()), key=lambda item: item[1][0]):
            labels = np.full(len(self.domain.attributes), -1, np.int8)
            for at, (_, _, p, value) in run:
                if at > withdrawn.get((t, p), -1):
                    labels[p] = value
            told_rows.append((t, labels))
        return told_rows
