"""Data sets: recorded features of each object, and labels of its attributes; the paper's D."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, InitVar, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import (
    ByValue,
    check_kind,
    freeze,
    is_whole,
    label_values,
    set_frozen,
    whole_array,
)
from meal_bayes.datasets.feature_checks import checked_features, warn_of_order
from meal_bayes.datasets.frames import dataset_parts
from meal_bayes.digests import digest_of, digest_of_arrays
from meal_bayes.domain import Domain, domain_table, load_domain, unknown
from meal_bayes.domain.words import doubled
from meal_bayes.errors import DataError, QueryError, SettingsError
from meal_bayes.look import facts_repr, listed, short_repr
from meal_bayes.untrusted import name_fault


@dataclass(frozen=True, slots=True)
class Instance(ByValue):
    """The features f_a of one successful execution (Eq. 1), or the percepts of a detector.

    Attributes
    ----------
    object_index : int
        Position of the object in its data set.
    behavior : str
        Name of the behavior.
    recording : int
        Number of the object's recording, counted from 0.
    features : Mapping[str, NDArray[np.float32]] | None
        Feature vector (D,) of each modality.
    percepts : Mapping[str, float] | None
        Percept of each attribute that a detector returned in words, as a number from -1 (surely no)
        to 1 (surely yes).
    scores : Mapping[str, float] | None
        Score of each attribute that a detector returned, on the detector's own scale.
    """

    object_index: int
    behavior: str
    recording: int
    features: Mapping[str, NDArray[np.float32]] | None = None
    percepts: Mapping[str, float] | None = None
    scores: Mapping[str, float] | None = None

    __repr__ = short_repr


@dataclass(frozen=True, slots=True)
class Dataset(ByValue):
    """All recordings of a data set, joined by object, recording, behavior and modality.

    Objects may have different numbers of recordings. If an object has fewer than R recordings of a
    behavior, or none, its last rows are NaN in all modalities of the behavior.

    Attributes
    ----------
    domain : Domain
        Behaviors and attributes.
    objects : tuple[str, ...]
        (O,) names of the objects.
    features : Mapping[tuple[str, str], NDArray[np.float32]]
        Array (O,R,D) of feature vectors for each (behavior, modality).
    labels : NDArray[np.int8]
        (O,P) label of each object and attribute: 1 true, 0 false, -1 unknown.
    recording_counts : NDArray[np.int64]
        (O,E) number of recordings of each object and behavior, computed from the features.
    answers : NDArray[np.int8] | None
        (O,P) another person's answer about each object and attribute, coded as `labels`. Replays
        use these answers when the robot asks a person. None if there are no such answers.

    Raises
    ------
    DataError
        Shapes do not agree, a behavior and modality have no features, features are not finite,
        modalities of a behavior differ in their numbers of recordings, labels are not 1, 0 or -1,
        an object is listed twice, or two values of a group are true for an object.

    Examples
    --------
    >>> import numpy as np
    >>> import meal_bayes
    >>> from meal_bayes.datasets import make_synthetic
    >>> rng = np.random.default_rng(0)
    >>> data = make_synthetic(meal_bayes.load_domain("toy"), objects=4, recordings=2, rng=rng)
    >>> len(data.objects), data.recordings
    (4, 2)
    """

    domain: Domain
    objects: tuple[str, ...]
    features: Mapping[tuple[str, str], NDArray[np.float32]]
    labels: NDArray[np.int8]
    recording_counts: NDArray[np.int64] = field(init=False, repr=False, compare=False)
    partial: bool = field(default=False, kw_only=True, repr=False, compare=False)
    answers: NDArray[np.int8] | None = field(default=None, kw_only=True, repr=False)
    _: KW_ONLY
    rows_checked: InitVar[bool] = False  # whether a reader of rows has warned of their order

    __repr__ = facts_repr

    def __post_init__(self, rows_checked: bool) -> None:
        check_kind("features", self.features, Mapping)
        set_frozen(self, labels=freeze(label_values(self.labels), np.int8))
        if self.labels.shape != (len(self.objects), len(self.domain.attributes)):
            raise DataError(
                f"labels have shape {self.labels.shape}; expected (objects, attributes) = "
                f"({len(self.objects)}, {len(self.domain.attributes)})."
            )
        if self.answers is not None:
            set_frozen(self, answers=freeze(label_values(self.answers), np.int8))
            if self.answers.shape != self.labels.shape:
                raise DataError(
                    f"answers have shape {self.answers.shape}; expected that of the labels, "
                    f"{self.labels.shape}."
                )
        check_objects(self.objects)
        set_frozen(self, labels=complete_labels(self.domain, self.objects, self.labels))
        frozen: dict[tuple[str, str], NDArray[np.float32]] = {}
        counts = np.zeros((len(self.objects), len(self.domain.behaviors)), np.int64)
        for context in self.domain.contexts:
            frozen[context], number = self._recordings(context)
            e = self.domain.behavior_index(context[0])
            first = (context[0], self.domain.behaviors[e].modalities[0])
            if context != first and (number != counts[:, e]).any():
                bad = self.objects[int(np.flatnonzero(number != counts[:, e])[0])]
                raise DataError(
                    f"{bad!r} has another number of recordings of {context} than of {first}; each "
                    "needs all modalities."
                )
            counts[:, e] = number
            if not (number.any() or self.partial):
                raise DataError(
                    f"Features of {context[0]!r} are NaN or infinity for every object; give "
                    "recordings of it, or leave the behavior out of the domain."
                )
        # Arrays have one R; fewer recordings of a behavior are rows of NaN at its end.
        if len({values.shape[1] for values in frozen.values()}) > 1:
            raise DataError(
                "All behaviors and modalities must have arrays for the same number of "
                "recordings; fill them up with rows of NaN, or use Dataset.from_frames, which "
                "does this."
            )
        set_frozen(self, features=frozen, recording_counts=freeze(counts, np.int64))
        for context, values in frozen.items() if not (rows_checked or self.partial) else ():
            there = ~np.isnan(values).any(axis=2)
            rows = values[there]
            warn_of_order(f"Features of {context}", rows, np.nonzero(there)[0])

    def _recordings(
        self, context: tuple[str, str]
    ) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
        """Check features (O,R,D), and count each object's recordings (O,), before rows of NaN."""
        if context not in self.features:
            raise DataError(
                f"Features of {context} are missing; the domain lists this behavior and modality."
            )
        axes = "objects", "recordings", "features"
        try:
            values = freeze(checked_features(self.features[context], axes, absent=True), np.float32)
        except DataError as fault:
            raise DataError(f"Features of {context}: {fault}.") from None
        if len(values) != len(self.objects):
            raise DataError(
                f"Features of {context} have shape {values.shape}; "
                f"expected (objects = {len(self.objects)}, recordings, features)."
            )
        present = ~np.isnan(values).any(axis=2)
        counts = present.sum(axis=1)
        if not (present == (np.arange(values.shape[1]) < counts[:, None])).all():
            raise DataError(
                f"Features of {context} have a recording after a row of NaN; rows of NaN mark "
                "missing recordings and must come last."
            )
        return values, counts

    @classmethod
    def from_frames(
        cls,
        domain: str | Path | Mapping[str, Any] | Domain,
        features: Mapping[tuple[str, str], Any],
        labels: Any,
        *,
        objects: Sequence[str] | None = None,
    ) -> "Dataset":
        """Build a data set from data frames, dictionaries or arrays.

        Parameters
        ----------
        domain : str, path, mapping or Domain
            Domain, as for `Learner`: its behaviors and attributes.
        features : Mapping[tuple[str, str], Any]
            Features of each (behavior, modality), in one of three forms: a data frame (of pandas,
            polars, pyarrow, ...) with a column ``object``, optionally ``recording``, and a column
            for each feature; a dictionary from each object to its recordings (R,D); or an array
            (O,R,D) in the order of `objects`. A row of NaN means that the recording lacks this
            modality; the recording is then left out of the other modalities too.
        labels : Any
            Labels in one of three forms: a data frame with a row for each object (its name in a
            column ``object`` or in the index) and a column for each attribute or group; a
            dictionary from each object to its {attribute: value} or {group: value}; or an array
            (O,P). The label of an attribute is 1 or True, or 0 or False. The label of a group is
            the name of its value. An empty entry, -1, None or NaN means unknown.
        objects : Sequence[str] | None
            (O,) names of the objects. Names are required for arrays; by default they come from the
            labels.

        Raises
        ------
        DataError
            Features or labels are missing, have the wrong size, or are not numbers; or the name of
            a column suggests an index or a date.
        """
        domain = load_domain(domain)
        return cls(domain, *dataset_parts(domain, features, labels, objects), rows_checked=True)

    def _facts(self) -> tuple[str, dict[str, str]]:
        counts = self.recording_counts[:, self.domain.recorded]
        sizes = [values.shape[2] for values in self.features.values()]
        values = {"true": 1, "false": 0, "unknown": -1}
        label_counts = (f"{(self.labels == value).sum()} {name}" for name, value in values.items())
        ragged = (counts < self.recordings).any()
        number = f"{counts.min()} to {self.recordings}" if ragged else f"{self.recordings}"
        return f"Dataset {self.domain.name}", {
            "objects": f"{len(self.objects)}: {listed(self.objects, 3)}",
            "behaviors": f"{counts.shape[1]} that sense, {number} recordings of each",
            "features": f"{len(sizes)} contexts of {min(sizes)} to {max(sizes)}",
            "attributes": f"{len(self.domain.attributes)}: {listed(self.domain.attributes)}",
            "labels": ", ".join(label_counts),
        }

    @property
    def recordings(self) -> int:
        """Largest number R of recordings that any object has of any behavior."""
        return max((values.shape[1] for values in self.features.values()), default=0)

    def digest(self) -> str:
        """Compute a digest of the recordings, the labels and all else on which percepts depend."""
        features = digest_of_arrays(self.features)
        labels = digest_of_arrays({"labels": self.labels})
        return digest_of(domain_table(self.domain), self.objects, features, labels)

    def missing(self) -> list[str]:
        """Return texts that name the objects and behaviors with fewer than R recordings."""
        counts = self.recording_counts.T
        return [
            f"{self.objects[o]} {counts[e, o]} of {self.domain.behavior_names[e]}"
            for e, o in np.argwhere(counts < self.recordings)
            if self.domain.behaviors[e].modalities
        ]

    def instance(self, object_index: int, behavior: str, recording: int) -> Instance:
        """Return the features of one recorded execution of a behavior.

        Parameters
        ----------
        object_index : int
            Position of the object in `objects`.
        behavior : str
            Name of the behavior.
        recording : int
            Number of the recording of this object and behavior, counted from 0.

        Raises
        ------
        DataError
            The object has no such recording.
        """
        check_positions([object_index], len(self.objects), "objects")
        index = self.domain.behavior_index(behavior)
        count = self.recording_counts[object_index, index]
        if not is_whole(recording) or not 0 <= recording < count:
            raise DataError(
                f"{self.objects[object_index]!r} has no recording {recording!r:.60} of "
                f"{behavior!r}; it has {count}, counted from 0."
            )
        features = {
            modality: self.features[behavior, modality][object_index, recording]
            for modality in self.domain.behaviors[index].modalities
        }
        return Instance(object_index, behavior, recording, features)


@dataclass(frozen=True, slots=True)
class TrainingSet(ByValue):
    """The paper's D: the recordings of a robot, and the labels that people gave for them.

    Rows are sorted by object, behavior and recording.

    Attributes
    ----------
    object, behavior, recording : NDArray[np.int32]
        (n,) object, behavior and recording of each instance, as positions counted from 0.
    labels : NDArray[np.int8]
        (n,P) label of each instance and attribute: 1 true, 0 false, -1 unknown.

    Raises
    ------
    DataError
        Lengths do not agree, labels are not 1, 0 or -1, or an instance has two rows.
    """

    object: NDArray[np.int32]
    behavior: NDArray[np.int32]
    recording: NDArray[np.int32]
    labels: NDArray[np.int8]

    __repr__ = short_repr

    def __post_init__(self) -> None:
        names = ("object", "behavior", "recording")
        columns = [whole_array(name, getattr(self, name), len(self.object)) for name in names]
        keys = np.array(columns, dtype=np.int32).reshape(3, -1).T  # (n,3)
        labels = label_values(self.labels)
        if labels.ndim != 2 or len(labels) != len(keys):  # (n,P)
            raise DataError(
                f"Labels have shape {labels.shape}; expected ({len(keys)}, attributes), "
                "a row for each instance."
            )
        unique, rows = np.unique(keys, axis=0, return_index=True)
        if (unique < 0).any():
            raise DataError("Objects, behaviors and recordings must be positions, counted from 0.")
        if len(unique) < len(keys):
            raise DataError("A recording has two rows of labels; give each one.")
        for name, column in zip(names, unique.T, strict=True):
            set_frozen(self, **{name: freeze(column, np.int32)})
        set_frozen(self, labels=freeze(labels[rows], np.int8))

    @classmethod
    def everything(cls, dataset: Dataset, objects: Iterable[int] | None = None) -> "TrainingSet":
        """Return all recordings of some objects (by default all objects), with all known labels."""
        chosen = range(len(dataset.objects)) if objects is None else [*objects]
        check_positions(chosen, len(dataset.objects), "objects")
        sensing = dataset.domain.recorded
        axes = np.meshgrid(sorted({*chosen}), sensing, np.arange(dataset.recordings), indexing="ij")
        keys = np.stack(axes).reshape(3, -1).astype(np.int32)
        keys = keys[:, keys[2] < dataset.recording_counts[keys[0], keys[1]]]
        return cls(keys[0], keys[1], keys[2], dataset.labels[keys[0]])

    def __len__(self) -> int:
        """Return the number of instances, n."""
        return len(self.object)


def check_positions(positions: Iterable[object], count: int, what: str) -> None:
    """Refuse what is no place in a list: a negative one would silently count from its end."""
    for position in positions:
        if not is_whole(position) or not 0 <= position < count:
            raise DataError(
                f"Found {position!r:.60}; expected a position among {count} {what}, from 0."
            )


def complete_labels(
    domain: Domain, objects: Sequence[str], labels: NDArray[np.int8]
) -> NDArray[np.int8]:
    """Return labels (O,P) of objects with what the values of groups imply.

    Raises
    ------
    DataError
        An object with two values of a group, or with none.
    """
    complete = labels.copy()
    nothing = np.full(len(domain.attributes), -1, np.int8)
    for o, name in enumerate(objects if domain.groups else ()):
        try:
            complete[o] = domain.replace(nothing, labels[o])
        except QueryError as fault:
            raise DataError(f"{name!r} is {fault}.") from None
    return freeze(complete, np.int8)


def check_objects(objects: tuple[str, ...]) -> None:
    """Refuse names of objects that files or logs cannot hold, or of which two look the same."""
    for name in objects:
        if fault := name_fault(name):
            raise DataError(f"The object's name {name!a:.60} {fault}; rename it.")
    if fault := doubled("object", objects):
        raise DataError(fault)


def object_index(objects: tuple[str, ...], name: object) -> int:
    """Return the position of an object; raise a `SettingsError` if no object has this name."""
    if not isinstance(name, str) or name not in objects:
        raise SettingsError(unknown("object", name, objects))
    return objects.index(name)
