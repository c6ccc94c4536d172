"""The only record of what a robot did and was told: executions, instances, labels.

Everything else is a view of it (`views.py`): the training set D of Algorithm 2, evidence (Eq. 10),
labels by object, success rates. Rows are added at the end, and are written as they are.
"""

from collections.abc import Iterable, Mapping
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import Rows
from meal_bayes.datasets import Dataset, Instance
from meal_bayes.domain import Domain
from meal_bayes.errors import DataError, QueryError

Key = tuple[str | int, ...]
Labels = NDArray[np.int8]
Context = tuple[str, str]  # (behavior, modality)

GIVEN = 0  # an instance's origin: recordings that were given
GATHERED = 1  # or a trial of the robot
NONE = -1  # in place of a row's number
UNNUMBERED = 1 << 20  # recordings of a robot's own, after those that a data set numbers

INSTANCE = np.dtype([
    ("object", np.int64),
    ("behavior", np.int64),
    ("recording", np.int64),
    ("features", np.int64),  # row of its features; NONE: there are none
    ("origin", np.int64),  # GIVEN or GATHERED
    ("scale", np.int64),  # K, of its percepts in the trial; 0 where it was given
])  # fmt: skip
EXECUTION = np.dtype([
    ("trial", np.int64),
    ("behavior", np.int64),
    ("instance", np.int64),  # NONE: nothing was perceived
    ("success", np.int64),  # 1, 0, or -1 where failing and succeeding look the same
])  # fmt: skip
FEEDBACK = np.dtype([
    ("trial", np.int64),
    ("object", np.int64),
    ("attribute", np.int64),
    ("value", np.int64),  # 1, 0, or -1 where a label was withdrawn
])  # fmt: skip


def told(name: str) -> Key:
    """Return what stands for a trial where labels are told of an object by its name."""
    return ("told", name)


class Experience:
    """Executions, instances and labels, of E behaviors and P attributes.

    Attributes
    ----------
    objects, trials : dict
        Names of objects and keys of trials, with their numbers.
    instances : Rows (n,)
        What was perceived or given, `INSTANCE`.
    levels : Rows (n,P)
        Percepts at the time they came; -1 unknown.
    labels : Rows (n,P)
        Of the trials in which an instance was shown; -1 unknown.
    executions : Rows (m,)
        `EXECUTION`.
    feedback : Rows (l,)
        `FEEDBACK`.
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
        self.instances = Rows(INSTANCE)
        self.executions = Rows(EXECUTION)
        self.feedback = Rows(FEEDBACK)
        self.levels = Rows(np.int8, p)
        self.labels = Rows(np.int8, p)
        self.known = Rows(np.int8, p)
        self.features: dict[Context, Rows] = {}

    def __repr__(self) -> str:
        """Return how much there is."""
        rows = self.feedback.values
        columns = (rows[name].tolist() for name in ("trial", "object", "attribute"))
        latest = dict(zip(zip(*columns, strict=True), rows["value"].tolist(), strict=True))
        labels = sum(value >= 0 for value in latest.values())
        return f"{len(self.instances)} recordings of {len(self.objects)} objects, {labels} labels"

    @property
    def sizes(self) -> dict[Context, int]:
        """Number of features of each (behavior, modality) that was perceived."""
        return {context: rows.values.shape[1] for context, rows in self.features.items()}

    def object(self, name: str) -> int:
        """Return the number of an object, a new one where it was not met before."""
        if name not in self.objects:
            self.objects[name] = len(self.objects)
            self.known.append(np.full(len(self.domain.attributes), -1))
        return self.objects[name]

    def trial(self, key: Key) -> int:
        """Return the number of a trial, a new one where it is not known."""
        return self.trials.setdefault(key, len(self.trials))

    def gathered(self, o: int) -> NDArray[np.intp]:
        """Return the instances of an object, by its number."""
        return np.flatnonzero(self.instances.values["object"] == o)

    def shown(self, trial: Key) -> NDArray[np.intp]:
        """Return the instances of a trial; where labels are told of an object, all of its own."""
        name = str(trial[-1])
        if trial == told(name):
            return self.gathered(self.objects.get(name, NONE))
        rows = self.executions.values
        instances: NDArray[np.intp] = rows["instance"][
            rows["trial"] == self.trials.get(trial, NONE)
        ]
        return instances[instances >= 0]

    def told_in(self, trial: Key) -> Labels:
        """Return the labels (P,) that were given in a trial; -1 unknown."""
        rows = self.feedback.values
        rows = rows[rows["trial"] == self.trials.get(trial, NONE)]
        labels = np.full(len(self.domain.attributes), -1, np.int8)
        labels[rows["attribute"]] = rows["value"]  # the latest of each
        return labels

    def give(self, dataset: Dataset) -> None:
        """Add the recordings and labels of a data set; those that are there are not added again."""
        for context, values in dataset.features.items():
            name, size = " ".join(context), values.shape[-1]
            if (before := self.sizes.get(context, size)) != size:
                raise DataError(f"{name}: {size} features, where {before} came before.")
        present = set(self.instances.values[["object", "behavior", "recording"]].tolist())
        for o, name in enumerate(dataset.objects):
            number = self.object(name)
            fresh = [
                self._instance(number, e, r, GIVEN, dataset.instance(o, behavior.name, r).features)
                for e, behavior in enumerate(dataset.domain.behaviors)
                for r in range(int(dataset.recording_counts[o, e]))
                if behavior.modalities and (number, e, r) not in present
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
        number = self.trial(trial)
        row = NONE
        if levels is not None:
            o = self.object(object_name)
            gathered = self.gathered(o)
            recording = UNNUMBERED + len(gathered)
            if instance is not None and instance.object_index >= 0:
                recording = instance.recording
            before = self.instances.values[gathered]
            same = (before["behavior"] == behavior) & (before["recording"] == recording)
            row = int(gathered[same].max(initial=NONE))
            if row == NONE:
                features = None if instance is None else instance.features
                row = self._instance(o, behavior, recording, GATHERED, features, k)
            self.levels.values[row] = levels
        self.executions.append((number, behavior, row, success))

    def label(self, trial: Key, object_name: str, labels: Labels) -> NDArray[np.intp]:
        """Add labels (P,) of a trial's object, -1 unknown; return instances (k,) that it moves."""
        number = self.trial(trial)
        o = self.object(object_name)
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
        labels = self.told_in(trial)
        for row in self.shown(trial):
            self.labels.values[row] = self.domain.replace(self.labels.values[row], labels)

    def forget(self, trial: Key) -> NDArray[np.intp]:
        """Withdraw the labels of a trial; return the instances as `label` does."""
        number = self.trials[trial]
        shown = self.shown(trial)
        rows = self.feedback.values
        answers = rows[(rows["trial"] == number) & (rows["value"] >= 0)]
        executions = self.executions.values[["trial", "instance"]]
        shows = set(executions.tolist())
        origin = self.instances.values["origin"]
        o = int(answers["object"][0])
        named = self.trials.get(told(list(self.objects)[o]))
        # What was given holds again, as recordings that the trial did not show have it.
        pretrained = [i for i in self.gathered(o) if origin[i] == GIVEN and i not in shown]
        for p in dict.fromkeys(answers["attribute"].tolist()):
            self.feedback.append((number, o, p, -1))
        nothing = np.full(len(self.domain.attributes), -1, np.int8)
        given = self.labels.values[pretrained[0]] if pretrained else nothing
        told_rows = self._told(o)
        self.known.values[o] = self._folded(given, [labels for _, labels in told_rows])
        for i in shown:
            of_row = [labels for t, labels in told_rows if t == named or (t, i) in shows]
            before = given if origin[i] == GIVEN else nothing
            self.labels.values[i] = self._folded(before, of_row)
        return self.gathered(o)

    def _instance(
        self, o: int, behavior: int, recording: int, origin: int,
        features: Mapping[str, NDArray[np.float32]] | None, k: int = 0,
    ) -> int:  # fmt: skip
        """Add an instance without percepts and labels; return its number.

        Features are kept where they are of all the behavior's modalities.
        """
        spec = self.domain.behaviors[behavior]
        row = NONE
        if features and all(modality in features for modality in spec.modalities):
            for modality in spec.modalities:
                values = features[modality]
                empty = Rows(np.float32, len(values))
                row = self.features.setdefault((spec.name, modality), empty).append(values)
        nothing = np.full(len(self.domain.attributes), -1)
        self.levels.append(nothing)
        self.labels.append(nothing)
        return self.instances.append((o, behavior, recording, row, origin, k))

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
                denied = (columns for columns in groups if (labels[columns] >= 0).any())
                rest[[p for columns in denied for p in columns]] = -1
                row = self.domain.replace(rest, labels)
        return row

    def _told(self, o: int) -> list[tuple[int, Labels]]:
        """Return trials and the labels (P,) that they gave an object and hold, in order."""
        rows = self.feedback.values[self.feedback.values["object"] == o]
        listed = list(enumerate(rows[["trial", "attribute", "value"]].tolist()))
        withdrawn = {(t, p): at for at, (t, p, value) in listed if value < 0}
        told_rows = []
        for t, run in groupby(listed, key=lambda item: item[1][0]):
            labels = np.full(len(self.domain.attributes), -1, np.int8)
            for at, (_, p, value) in run:
                if at > withdrawn.get((t, p), -1):
                    labels[p] = value
            told_rows.append((t, labels))
        return told_rows
