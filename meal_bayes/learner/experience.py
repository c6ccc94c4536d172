"""The record of a robot's experience: executions, instances and labels.

Everything else is computed from this record (`views.py`): the training set D of Algorithm 2, the
experience of Eq. 10, success rates. An instance is a recording of an object by a behavior. Two
recordings of an object and behavior with equal features are two instances if they are in the same
data set, and one instance if they are in two data sets. Rows are only added at the end.

A label belongs to a trial, or to an object that is named, like the labels of a data set. The labels
of an instance or of an object are the result of `Domain.replace` for all its labels, in order.

Feedback is never deleted: a row with the value -1 withdraws the earlier rows of its trial.

`record_step`, at the end of the module, adds the rows of a step of a trial.
"""

import hashlib
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.arrays import Rows, lowest_yes
from meal_bayes.datasets import Dataset, Instance
from meal_bayes.datasets.percepts import detected_levels, scores_of
from meal_bayes.domain import Domain
from meal_bayes.errors import QueryError
from meal_bayes.look import warn_user
from meal_bayes.momdp import MOMDP
from meal_bayes.momdp.belief import percepts_left
from meal_bayes.seeds import Key
from meal_bayes.trial_log.feedback import Change, Feedback
from meal_bayes.trials import Step, Task, Trial

Labels = NDArray[np.int8]
Objects = tuple[int, ...]  # by their rows in a percept table
Context = tuple[str, str]  # (behavior, modality)

FROM_DATASET = 0  # origin of an instance: a data set that was fitted
FROM_TRIAL = 1  # origin of an instance: a trial of the robot
WITHDRAWN = 2  # origin of a forgotten instance, and success of a forgotten execution
NONE = -1  # no row

_NAME_KEY = "told"  # first part of the key of labels for a named object


class InstanceRow(NamedTuple):
    """A row of the table of instances."""

    object: int
    behavior: int
    digest: int  # digest of the features; 0 if there are none
    copy: int  # number of earlier instances with this digest
    recording: int  # number in the data set that is replayed; NONE otherwise
    origin: int
    scale: int  # number K of levels of its percepts in the trial; 0 for a data set


class ExecutionRow(NamedTuple):
    """A row of the table of executions."""

    trial: int
    behavior: int
    instance: int  # NONE if there was no percept
    success: int  # 1, 0, or -1 if success cannot be distinguished from failure; WITHDRAWN


class FeedbackRow(NamedTuple):
    """A row of the table of feedback: one label."""

    trial: int
    call: int  # number of the call; labels that were given together have the same
    object: int
    attribute: int
    value: int  # 1, 0, or -1 to withdraw earlier labels of the trial
    given: int  # 1 for a label of a data set, 0 for a label of a person


class AnswerRow(NamedTuple):
    """A row of the table of answers: one answer of a person who was asked by a behavior."""

    trial: int
    behavior: int
    object: int
    attribute: int
    value: int  # 1 yes, 0 no


INSTANCE = np.dtype([(name, np.int64) for name in InstanceRow._fields])
EXECUTION = np.dtype([(name, np.int64) for name in ExecutionRow._fields])
FEEDBACK = np.dtype([(name, np.int64) for name in FeedbackRow._fields])
ANSWER = np.dtype([(name, np.int64) for name in AnswerRow._fields])


def features_digest(features: Mapping[str, NDArray[np.float32]] | None) -> int:
    """Compute the digest of a recording's features by modality; 0 without features."""
    if not features:
        return 0
    digest = hashlib.blake2b(digest_size=8)
    for modality in sorted(features):
        values = np.ascontiguousarray(features[modality], "<f4")
        digest.update(f"{modality}\0{len(values)}\0".encode())
        digest.update(values.tobytes())
    return int.from_bytes(digest.digest()) >> 1 or 1


def unnamed(identity: str) -> str:
    """Return the name of an object that nobody named, from 16 hexadecimal digits.

    The digits are random, because the names in different programs must differ. `nobody_named`
    recognizes such a name, and `views.in_order` ignores it.
    """
    return f"object {identity}"


def nobody_named(name: str) -> bool:
    """Return whether the name of an object is random.

    >>> nobody_named(unnamed("30a0d9a3fcdbb969")), nobody_named("object 3")
    (True, False)
    """
    return re.fullmatch("object [0-9a-f]{16}", name) is not None


def key_of_name(name: str) -> Key:
    """Return the key of labels for a named object, in place of the key of a trial."""
    return (_NAME_KEY, name)


def is_key_of_name(key: Key) -> bool:
    """Return whether a key is that of a named object, and not that of a trial.

    >>> is_key_of_name(key_of_name("cup")), is_key_of_name(("toy", "ask", "cup", "heavy"))
    (True, False)
    """
    return key == key_of_name(str(key[-1]))


class LabelCall(NamedTuple):
    """Labels (P,) that were given together for a trial; -1 unknown."""

    trial: int
    labels: Labels
    given: bool = False  # together with recordings


def no_labels(domain: Domain) -> Labels:
    """Return labels (P,) that are all unknown."""
    return np.full(len(domain.attributes), -1, np.int8)


def calls_that_hold(domain: Domain, feedback: NDArray[Any]) -> list[LabelCall]:
    """Return the labels in the feedback (l,) of an object that are not withdrawn, in order."""
    rows = [FeedbackRow(*row) for row in feedback.tolist()]
    withdrawn: dict[tuple[int, int], int] = {}  # position of the last withdrawal
    for position, row in enumerate(rows):
        if row.value < 0:
            withdrawn[row.trial, row.attribute] = position
    calls: dict[int, LabelCall] = {}
    # A label is valid if no withdrawal of its trial follows.
    for position, row in enumerate(rows):
        if row.value < 0 or position < withdrawn.get((row.trial, row.attribute), -1):
            continue
        if row.call not in calls:
            calls[row.call] = LabelCall(row.trial, no_labels(domain), bool(row.given))
        calls[row.call].labels[row.attribute] = row.value
    return list(calls.values())


def fold(domain: Domain, calls: Iterable[LabelCall]) -> Labels:
    """Return the labels (P,) after calls, in order.

    If a label denies the last possible value of a group, because other labels were withdrawn, the
    earlier labels of the group are dropped.
    """
    folded = no_labels(domain)
    for call in calls:
        labels = call.labels
        try:
            folded = domain.replace(folded, labels)
        except QueryError:
            groups = map(domain.columns, domain.groups.values())
            denied = [columns for columns in groups if (labels[columns] >= 0).any()]
            rest = folded.copy()
            rest[[p for columns in denied for p in columns]] = -1
            folded = domain.replace(rest, labels)
    return folded


def fold_by_trial(domain: Domain, calls: Iterable[LabelCall]) -> Labels:
    """Return the labels (trials,P) of each trial after its calls, in order."""
    calls_of: dict[int, list[LabelCall]] = {}
    for call in calls:
        calls_of.setdefault(call.trial, []).append(call)
    rows = [fold(domain, of_trial) for of_trial in calls_of.values()]
    return np.array(rows, np.int8).reshape(-1, len(domain.attributes))


class Experience:
    """Executions, instances and labels, of E behaviors and P attributes.

    Attributes
    ----------
    first_attributes : int
        Number of attributes that the domain had at first; the others were added later.
    objects, trials : dict
        Number of each object, by its name, and number of each trial, by its key.
    instances, executions, feedback, answers : Rows
        Tables with a row for each instance (n,), execution (m,), label (l,) and answer (a,). Their
        columns are `INSTANCE`, `EXECUTION`, `FEEDBACK` and `ANSWER`.
    levels : Rows (n,P)
        Percept level of each instance and attribute at the time of the execution; -1 unknown.
    detected : Rows (n,P)
        Level that the robot's own detector returned for each instance and attribute; -1 if none.
    scores : Rows (n,P)
        Score that a detector returned for each instance and attribute; NaN if none. The levels of
        scores are computed at each refit.
    labels, object_labels : Rows (n,P), (O,P)
        Labels of each instance, from the trials that showed it, and labels of each object; -1
        unknown.
    features : dict
        Feature vector (D,) of each instance, by (behavior, modality) and then by the number of the
        instance; D may differ between instances.
    feedback_logs : dict
        Names of the logs of the feedback, in order.
    unlogged : list
        Feedback that could not be logged yet, with the folder of its log; None is the learner's.
    warned_of : set
        Problems for which a warning was given already.
    """

    def __init__(self, domain: Domain) -> None:
        p = len(domain.attributes)
        self.domain = domain
        self.first_attributes = p
        self.objects: dict[str, int] = {}
        self.trials: dict[Key, int] = {}
        self.instances = Rows(INSTANCE)
        self.executions = Rows(EXECUTION)
        self.feedback = Rows(FEEDBACK)
        self.answers = Rows(ANSWER)
        self.levels = Rows(np.int8, p)
        self.detected = Rows(np.int8, p)
        self.scores = Rows(np.float64, p)
        self.labels = Rows(np.int8, p)
        self.object_labels = Rows(np.int8, p)
        self.features: dict[Context, dict[int, NDArray[np.float32]]] = {
            context: {} for context in domain.contexts
        }
        self.feedback_logs: dict[str, None] = {}
        self.unlogged = list[tuple[Path | None, Feedback | Change]]()
        self.warned_of = set[str]()

    def __repr__(self) -> str:
        """Return the numbers of recordings, objects and labels."""
        recordings = int((self.instances.values["origin"] != WITHDRAWN).sum())
        told = [self.labels_by_trial(o) for o in self.objects.values()]
        labels = sum(int((rows >= 0).sum()) for rows in told)
        both = [(rows == 1).any(axis=0) & (rows == 0).any(axis=0) for rows in told]
        against = sum(int(attributes.sum()) for attributes in both)
        contradicted = f", {against} of them contradicted" if against else ""
        return f"{recordings} recordings of {len(self.met)} objects, {labels} labels{contradicted}"

    @property
    def is_empty(self) -> bool:
        """Whether there are no instances, executions or labels."""
        return not (len(self.instances) or len(self.executions) or len(self.feedback))

    @property
    def met(self) -> dict[str, int]:
        """Number of each object, by its name, without objects that were forgotten completely."""
        return self.met_without(np.empty(0, np.intp))

    def met_without(self, apart: NDArray[np.intp]) -> dict[str, int]:
        """Return `met` as it would be without the instances `apart` (k,)."""
        rows = self.instances.values
        withdrawn = rows["origin"] == WITHDRAWN
        withdrawn[apart] = True
        labeled = np.flatnonzero((self.object_labels.values >= 0).any(axis=1))
        left = {*rows["object"][~withdrawn].tolist(), *labeled.tolist()}
        forgotten = {*rows["object"][withdrawn].tolist(), *self.feedback.values["object"].tolist()}
        return {name: o for name, o in self.objects.items() if o in left or o not in forgotten}

    def add_attributes(self, domain: Domain) -> None:
        """Replace the domain by one with more attributes at the end; their labels are unknown."""
        more = len(domain.attributes) - len(self.domain.attributes)
        for rows in (self.levels, self.detected, self.labels, self.object_labels):
            rows.widen(more, -1)
        self.scores.widen(more, np.nan)
        self.domain = domain

    def object_number(self, name: str) -> int:
        """Return the number of an object; an object that was not met before gets a new number."""
        if name not in self.objects:
            number = len(self.objects)
            try:
                self.object_labels.append(self.no_labels)
                self.objects[name] = number
            except BaseException:  # Ctrl-C between the two
                self.object_labels.cut(number)
                self.objects.pop(name, None)
                raise
        return self.objects[name]

    def trial_number(self, key: Key) -> int:
        """Return the number of a trial; a trial that is not known gets a new number."""
        return self.trials.setdefault(key, len(self.trials))

    @property
    def no_labels(self) -> Labels:
        """Labels (P,) that are all unknown."""
        return no_labels(self.domain)

    def instances_of_object(self, o: int) -> NDArray[np.intp]:
        """Return the instances (k,) of an object, by its number."""
        return np.flatnonzero(self.instances.values["object"] == o)

    def instances_of_trial(self, trial: Key) -> NDArray[np.intp]:
        """Return the instances (k,) of a trial that were not withdrawn.

        For the key of a named object, return all instances of the object.
        """
        if is_key_of_name(trial):
            return self.instances_of_object(self.objects.get(str(trial[-1]), NONE))
        rows = self.executions.values
        of_trial = rows["trial"] == self.trials.get(trial, NONE)
        instances: NDArray[np.intp] = rows["instance"][of_trial]
        instances = instances[instances >= 0]
        withdrawn: NDArray[np.bool_] = self.instances.values["origin"][instances] == WITHDRAWN
        return instances[~withdrawn]

    def add_dataset(self, dataset: Dataset) -> int:
        """Add new recordings and labels of a data set; return the number of new recordings."""
        names = ["object", "behavior", "digest", "copy"]
        rows = self.instances.values
        present = set(rows[names][rows["origin"] != WITHDRAWN].tolist())
        n_before = len(self.instances)
        recorded = dataset.domain.recorded
        for o, name in enumerate(dataset.objects):
            number = self.object_number(name)
            copies = Counter[tuple[int, int]]()
            recordings = [(e, r) for e in recorded for r in range(dataset.recording_counts[o, e])]
            for e, r in recordings:
                features = dataset.instance(o, dataset.domain.behavior_names[e], r).features
                digest = features_digest(features)
                copy = copies[e, digest]
                copies[e, digest] += 1
                if (number, e, digest, copy) in present:
                    continue
                row = InstanceRow(
                    number, e, digest, copy, recording=r, origin=FROM_DATASET, scale=0
                )
                self._add_instance(row, features, self.no_labels, self.no_labels)
            key = key_of_name(name)
            labels = dataset.labels[o]
            # What was given before may have been corrected since.
            new = np.where(labels == self._given_last(key), -1, labels)
            if (new >= 0).any():
                self.add_labels(key, name, new, given=True)
        return len(self.instances) - n_before

    def add_execution(
        self,
        trial: Key,
        object_name: str,
        behavior: int,
        *,
        success: int,
        instance: Instance | None = None,
        levels: Labels | None = None,
        detected: Labels | None = None,
        n_levels: int = 2,
    ) -> None:
        """Add an execution, and its instance if it is a new one.

        Parameters
        ----------
        trial : Key
            Key of the trial.
        object_name : str
            Name of the object.
        behavior : int
            Position of the behavior in the domain.
        success : int
            1 if the execution succeeded, 0 if it failed, -1 if this is unknown.
        instance : Instance, optional
            What was sensed. For a replayed recording, `instance.recording` shows whether it is new;
            if this is NONE, it is the next recording of the data set.
        levels, detected : Labels | None
            (P,) percept level of each attribute, from 0 to K - 1, and the level from the robot's
            own detector; -1 unknown.
        n_levels : int
            Number K of levels.
        """
        number = self.trial_number(trial)
        row = NONE
        if levels is not None:
            o = self.object_number(object_name)
            features = None if instance is None else instance.features
            digest = features_digest(features)
            recording = NONE
            if instance is not None and instance.object_index >= 0:  # a replay may show it again
                recording = instance.recording
                row = self._replayed_row(o, behavior, digest, recording, number)
            if row == NONE:
                copy = int(self._of_digest(o, behavior, digest).sum())
                fields = InstanceRow(
                    o, behavior, digest, copy, recording, origin=FROM_TRIAL, scale=n_levels
                )
                scores = None if instance is None else instance.scores
                row = self._add_instance(fields, features, levels, detected, scores)
            self.levels.values[row] = levels
        self.executions.append(ExecutionRow(number, behavior, row, success))
        if row != NONE:
            self._relabel([row])

    def add_answers(self, trial: Key, object_name: str, behavior: int, answers: Labels) -> None:
        """Add a person's answers (P,) about the object of a trial: 1 yes, 0 no, -1 none."""
        number = self.trial_number(trial)
        o = self.object_number(object_name)
        for p in np.flatnonzero(answers >= 0).tolist():
            self.answers.append(AnswerRow(number, behavior, o, p, int(answers[p])))

    def _replayed_row(self, o: int, behavior: int, digest: int, recording: int, trial: int) -> int:
        """Return the instance of a recording that is replayed again; NONE if it is new."""
        if recording == NONE:
            return self._next_of_dataset(o, behavior, trial)
        rows = self.instances.values
        same = self._of_digest(o, behavior, digest)
        same &= (rows["recording"] == recording) | (rows["origin"] == FROM_DATASET)
        return int(np.flatnonzero(same).max(initial=NONE))

    def _of_digest(self, o: int, behavior: int, digest: int) -> NDArray[np.bool_]:
        """Return the instances (n,) of an object and behavior whose features have this digest."""
        rows = self.instances.values
        same: NDArray[np.bool_] = (rows["object"] == o) & (rows["behavior"] == behavior)
        same &= (rows["digest"] == digest) & (rows["origin"] != WITHDRAWN)
        return same

    def _next_of_dataset(self, o: int, behavior: int, trial: int) -> int:
        """Return the first recording of a data set that a trial has not used; NONE without one."""
        rows = self.instances.values
        matching = (rows["object"] == o) & (rows["behavior"] == behavior)
        matching &= rows["origin"] == FROM_DATASET
        executions = self.executions.values
        instances = executions["instance"][executions["trial"] == trial]
        new = np.setdiff1d(np.flatnonzero(matching), instances)
        return int(new[0]) if len(new) else NONE

    def add_labels(
        self, trial: Key, object_name: str, labels: Labels, *, given: bool = False
    ) -> NDArray[np.intp]:
        """Add labels (P,) of a trial's object, -1 unknown; return the instances of the object."""
        number = self.trial_number(trial)
        o = self.object_number(object_name)
        call = len(self.feedback)
        for p in np.flatnonzero(labels >= 0):
            value = int(labels[p])
            self.feedback.append(FeedbackRow(number, call, o, int(p), value=value, given=given))
        self._relabel(self.instances_of_trial(trial), [o])
        return self.instances_of_object(o)

    def forget(self, trial: Key, *, recordings: bool = False) -> NDArray[np.intp]:
        """Withdraw the labels of a trial, and with `recordings` also its executions.

        Return the instances of the trial's object.
        """
        number = self.trials[trial]
        instances = self.instances_of_trial(trial)
        if recordings:
            self._withdraw_executions(number, instances)
        told_of: list[int] = self._objects_told_in(number).tolist()
        objects = {*told_of, *self.instances.values["object"][instances].tolist()}
        for p in np.flatnonzero(self.labels_of_trial(trial) >= 0):
            call = len(self.feedback)
            self.feedback.append(FeedbackRow(number, call, told_of[0], int(p), value=-1, given=0))
        moved = np.flatnonzero(np.isin(self.instances.values["object"], list(objects)))
        self._relabel(moved, objects)
        return moved

    def _withdraw_executions(self, trial: int, instances: NDArray[np.intp]) -> None:
        """Withdraw the executions of a trial, and the instances (k,) of no other trial."""
        rows = self.executions.values
        others = (rows["trial"] != trial) & (rows["success"] != WITHDRAWN)
        shown_elsewhere = np.isin(instances, rows["instance"][others])
        of_trials = self.instances.values["origin"][instances] == FROM_TRIAL
        for i in instances[of_trials & ~shown_elsewhere].tolist():
            self.instances.values["origin"][i] = WITHDRAWN
            self.levels.values[i] = -1
            self.detected.values[i] = -1
            self.scores.values[i] = np.nan
            for by_instance in self.features.values():
                by_instance.pop(i, None)
        rows["success"][rows["trial"] == trial] = WITHDRAWN
        if trial not in rows["trial"]:  # without executions, a new row marks it as forgotten
            self.executions.append(ExecutionRow(trial, 0, NONE, WITHDRAWN))

    def _objects_told_in(self, trial: int) -> NDArray[np.int64]:
        """Return the objects (l,) of the feedback of a trial, by their numbers."""
        rows = self.feedback.values
        objects: NDArray[np.int64] = rows["object"][rows["trial"] == trial]
        return objects

    def labels_of_trial(self, trial: Key) -> Labels:
        """Return the valid labels (P,) of a trial; -1 unknown."""
        number = self.trials.get(trial, NONE)
        objects = self._objects_told_in(number)
        calls = self._calls(int(objects[0])) if len(objects) else []
        return fold(self.domain, (call for call in calls if call.trial == number))

    def _given_last(self, trial: Key) -> Labels:
        """Return the labels (P,) that data sets gave last for a named object; -1 unknown."""
        rows = self.feedback.values
        rows = rows[(rows["trial"] == self.trials.get(trial, NONE)) & (rows["given"] == 1)]
        labels = self.no_labels
        labels[rows["attribute"]] = rows["value"]
        return labels

    def labels_by_trial(self, o: int) -> Labels:
        """Return the labels of an object from each trial, (trials,P); -1 unknown."""
        return fold_by_trial(self.domain, self._calls(o))

    def labels_beside(self, name: str, labels: Labels) -> Labels:
        """Return the labels (P,) of an object that has `labels` in a percept table.

        Labels that people gave replace them; labels of data sets fill in the unknown ones.
        """
        calls = self._calls(self.objects.get(name, NONE))
        given = [call for call in calls if call.given]
        told = [call for call in calls if not call.given]
        return fold(self.domain, [*given, LabelCall(NONE, labels), *told])

    def _calls(self, o: int) -> list[LabelCall]:
        """Return the valid labels of an object, in order."""
        rows = self.feedback.values
        return calls_that_hold(self.domain, rows[rows["object"] == o])

    def _relabel(self, instances: ArrayLike, objects: Iterable[int] = ()) -> None:
        """Compute the labels of instances (k,) and of objects from all feedback."""
        executions = self.executions.values
        names = list(self.objects)
        rows = np.asarray(instances, np.intp)
        owners = self.instances.values["object"][rows].tolist()
        calls = {o: self._calls(o) for o in {*owners, *objects}}
        for i, o in zip(rows.tolist(), owners, strict=True):
            trials = {*executions["trial"][executions["instance"] == i].tolist()}
            # Labels for the named object are valid for its instances in all trials.
            trials.add(self.trials.get(key_of_name(names[o]), NONE))
            told = (call for call in calls[o] if call.trial in trials)
            self.labels.values[i] = fold(self.domain, told)
        for o in objects:
            self.object_labels.values[o] = fold(self.domain, calls[o])

    def _add_instance(
        self,
        fields: InstanceRow,
        features: Mapping[str, NDArray[np.float32]] | None,
        levels: Labels,
        detected: Labels | None,
        scores: Mapping[str, float] | None = None,
    ) -> int:
        """Add an instance; return its number.

        Features are stored only if they are complete for the modalities of the behavior.
        """
        row = len(self.instances)
        try:
            self.instances.append(fields)
            spec = self.domain.behaviors[fields.behavior]
            if features and all(modality in features for modality in spec.modalities):
                for modality in spec.modalities:
                    self.features[spec.name, modality][row] = np.array(
                        features[modality], np.float32
                    )
            self.levels.append(levels)
            self.detected.append(self.no_labels if detected is None else detected)
            self.scores.append(scores_of(scores, self.domain))
            self.labels.append(self.no_labels)
        except BaseException:  # Ctrl-C between two tables, whose rows belong together
            tables = (self.instances, self.levels, self.detected, self.scores, self.labels)
            for rows in tables:
                rows.cut(row)
            for by_instance in self.features.values():
                by_instance.pop(row, None)
            raise
        self._relabel([row])
        return row


def record_steps(record: Experience, trial: Trial, steps: Sequence[Step]) -> None:
    """Record steps of another learner's trial, or of a log; warn once of unusable features."""
    for step in steps:
        perceived = None
        if step.sensed is not None:
            perceived = step.sensed, record.no_labels
            _warn_of_modalities(record, step.sensed)
        record_step(record, trial.task, trial.momdp, step, perceived)


def _warn_of_modalities(record: Experience, sensed: Instance) -> None:
    """Warn once of features whose behavior has other modalities in this domain."""
    spec = record.domain.behaviors[record.domain.behavior_index(sensed.behavior)]
    modalities = ", ".join(sorted(sensed.features or ()))
    case = f"{spec.name} {modalities}"
    if (
        not modalities
        or {*(sensed.features or ())} == {*spec.modalities}
        or case in record.warned_of
    ):
        return
    record.warned_of.add(case)
    warn_user(
        f"The features of {spec.name} have the modalities {modalities}; the domain "
        f"{record.domain.name!r} has {', '.join(spec.modalities) or 'none'}. "
        "The features are ignored, and the percepts of the log are used. Load the domain of "
        "that log to learn from them."
    )


def record_step(
    record: Experience,
    task: Task,
    momdp: MOMDP,
    step: Step,
    perceived: tuple[Instance, NDArray[np.int8]] | None = None,
) -> None:
    """Record an executed behavior, with the instance and its levels (P,) if these are known.

    Otherwise, the percepts of the queried attributes in the step are recorded. Reports are ignored.
    """
    domain = record.domain
    e = step.decision.action
    if e >= momdp.n_behaviors:
        return
    instance, levels = perceived or (None, None)
    if levels is not None:  # attributes may have been added since the execution
        more = len(domain.attributes) - len(levels)
        levels = np.pad(levels, (0, more), constant_values=-1)
    if instance is None and task.object_index >= 0:  # a replay whose log has only percepts
        instance = Instance(task.object_index, domain.behaviors[e].name, NONE)
    percepts = None if instance is None else instance.percepts
    detected = detected_levels(percepts, domain, momdp.levels)
    if percepts is not None and (levels is None or (levels < 0).all()):
        levels = detected  # attributes that the detector did not name have no percept
    shows = step.observation is not None or (levels is not None and (levels >= 0).any())
    shows |= instance is not None and bool(instance.scores)
    unperceived = levels is None or (levels < 0).all()
    if step.observation is not None and unperceived and domain.behaviors[e].modalities:
        levels = record.no_labels
        levels[domain.columns(momdp.query.attributes)] = step.observation
    if step.observation is not None and domain.behaviors[e].asks:
        answers = record.no_labels
        said = np.asarray(step.observation)
        yes = said >= lowest_yes(momdp.levels)
        answers[domain.columns(momdp.query.attributes)] = np.where(said >= 0, yes, -1)
        record.add_answers(task.key, task.object_name, e, answers)
    # If all recordings are used or features cannot be read, success looks like failure for a
    # behavior that does not change the state.
    left_before = percepts_left(momdp, step.belief)[e] + shows
    unread = step.unread and not shows and step.next_x == step.x
    success = -1
    if momdp.legal[step.x, e] and left_before > 0 and not unread:
        # A transition that is not in the diagram is not a success.
        meant = momdp.transition[e, step.x, step.next_x] > 0
        success = int(shows or (step.next_x != step.x and meant))
    record.add_execution(
        task.key,
        task.object_name,
        e,
        success=success,
        instance=instance,
        levels=levels,
        detected=detected,
        n_levels=momdp.levels,
    )
