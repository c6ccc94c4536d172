"""Recorded facts: what the robot felt, saw and heard of each object, and what the objects are."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import freeze, set_frozen
from meal_bayes.domain import Domain, Query, unknown
from meal_bayes.errors import DataError, SettingsError


@dataclass(frozen=True, slots=True)
class Instance:
    """The features f_a of one successful execution (Eq. 1)."""

    object_index: int
    behavior: str
    recording: int
    features: Mapping[str, NDArray[np.float32]] | None = None  # modality -> (D,)


@dataclass(frozen=True, slots=True)
class Dataset:
    """All recordings of a data set, joined by object, recording, behavior and modality.

    Raises
    ------
    DataError : shapes that do not agree, a context without features, features that are not finite,
        labels other than 1, 0 and -1, an object that is listed twice.
    """

    domain: Domain
    objects: tuple[str, ...]  # (O,)
    features: Mapping[tuple[str, str], NDArray[np.float32]]  # (behavior, modality) -> (O,R,D)
    labels: NDArray[np.int8]  # (O,P) 1 true, 0 false, -1 unknown

    def __post_init__(self) -> None:
        set_frozen(self, labels=freeze(self.labels, np.int8))
        if self.labels.shape != (len(self.objects), len(self.domain.attributes)):
            raise DataError(
                f"labels have shape {self.labels.shape}; expected (objects, attributes) = "
                f"({len(self.objects)}, {len(self.domain.attributes)})."
            )
        if not np.isin(self.labels, (-1, 0, 1)).all():
            raise DataError("Labels must be 1 (true), 0 (false) or -1 (unknown).")
        for name in self.objects:
            if self.objects.count(name) > 1:
                raise DataError(f"Object {name!r} is listed twice; names must be unique.")
        frozen = {}
        for behavior in self.domain.behaviors:
            for modality in behavior.modalities:
                context = (behavior.name, modality)
                if context not in self.features:
                    raise DataError(f"No features of {context}; the domain promises them.")
                values = freeze(self.features[context], np.float32)
                if values.ndim != 3 or values.shape[0] != len(self.objects):  # noqa: PLR2004
                    raise DataError(
                        f"Features of {context} have shape {values.shape}; "
                        f"expected (objects = {len(self.objects)}, recordings, features)."
                    )
                if not np.isfinite(values).all():
                    raise DataError(f"Features of {context} hold NaN or infinity.")
                frozen[context] = values
        set_frozen(self, features=frozen)
        if len({values.shape[1] for values in frozen.values()}) != 1:
            raise DataError("All contexts must have the same number of recordings an object.")

    @property
    def recordings(self) -> int:
        """R, recordings per object and behavior."""
        return int(next(iter(self.features.values())).shape[1])

    def instance(self, object_index: int, behavior: str, recording: int) -> Instance:
        """One recorded execution."""
        modalities = self.domain.behaviors[self.domain.behavior_index(behavior)].modalities
        features = {
            modality: self.features[behavior, modality][object_index, recording]
            for modality in modalities
        }
        return Instance(object_index, behavior, recording, features)

    def truth(self, object_index: int, query: Query) -> NDArray[np.bool_]:
        """ID(p, o) of Eq. 2: the values of the queried attributes, (N,).

        Raises
        ------
        DataError : a queried attribute whose value for this object is unknown.
        """
        columns = [self.domain.attribute_index(name) for name in query.attributes]
        values = self.labels[object_index, columns]
        for name, value in zip(query.attributes, values, strict=True):
            if value < 0:
                raise DataError(
                    f"Whether {self.objects[object_index]!r} is {name!r} is unknown; "
                    "label it, or ask about objects that are labeled."
                )
        return freeze(values == 1, np.bool_)


def object_index(objects: tuple[str, ...], name: str) -> int:
    """Position of an object; `SettingsError` with the nearest names where there is none."""
    if name not in objects:
        raise SettingsError(unknown("object", name, objects))
    return objects.index(name)
