"""Which objects teach and which are asked about: always whole objects, never samples."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import freeze, set_frozen
from meal_bayes.datasets.dataset import Dataset
from meal_bayes.display import short_repr
from meal_bayes.errors import SettingsError

PARTS = 3  # pre, train, test


@dataclass(frozen=True, slots=True)
class ObjectSplit:
    """Obj^pre, Obj^train and Obj^test: three disjoint sets of object indices, sorted."""

    pre: NDArray[np.intp]
    train: NDArray[np.intp]
    test: NDArray[np.intp]

    __repr__ = short_repr

    def __post_init__(self) -> None:
        parts = [freeze(np.sort(part), np.intp) for part in (self.pre, self.train, self.test)]
        joined = np.concatenate(parts)
        if len(np.unique(joined)) != len(joined):
            raise SettingsError("An object is in two parts of the split; expected disjoint parts.")
        set_frozen(self, pre=parts[0], train=parts[1], test=parts[2])

    @classmethod
    def random(
        cls,
        dataset: Dataset,
        rng: np.random.Generator,
        *,
        sizes: Sequence[int] | None = None,
        minimum: int = 0,
        attributes: Sequence[str] | None = None,
        tries: int = 10_000,
    ) -> "ObjectSplit":
        """Draw a split, anew until each part has `minimum` positives of each attribute.

        Parameters
        ----------
        sizes : Sequence[int] | None
            Objects in pre, train, test; by default three parts as equal as can be.
        attributes : Sequence[str] | None
            Those that must have positives; by default all of the domain.

        Raises
        ------
        SettingsError
            Sizes that do not fit, or a minimum that no draw met.
        """
        count = len(dataset.objects)
        if sizes is None:
            sizes = [len(part) for part in np.array_split(np.arange(count), PARTS)]
        if len(sizes) != PARTS or min(sizes) < 1 or sum(sizes) > count:
            raise SettingsError(
                f"Split sizes {list(sizes)} do not fit {count} objects; "
                "expected three numbers, each at least 1, that add to no more."
            )
        names = dataset.domain.attributes if attributes is None else tuple(attributes)
        columns = dataset.domain.columns(names)
        positive = (dataset.labels[:, columns] == 1).astype(np.intp)  # (O,P)
        for name, total in zip(names, positive.sum(axis=0), strict=True):
            if total < PARTS * minimum:
                raise SettingsError(
                    f"Only {total} objects are {name!r}; {minimum} in each of three parts need "
                    f"{PARTS * minimum}; lower the minimum, or leave the attribute out."
                )
        ends = np.cumsum(sizes)
        fewest, worst = -1, ""
        for _ in range(tries):
            order = rng.permutation(count)
            counts = np.add.reduceat(positive[order[: ends[-1]]], [0, *ends[:-1]])  # (3,P)
            least = int(counts.min(initial=minimum))
            if least >= minimum:
                return cls(*np.split(order, ends)[:PARTS])
            if least > fewest:
                fewest, worst = least, names[int(counts.min(axis=0).argmin())]
        raise SettingsError(
            f"No split of {tries} has {minimum} objects of every attribute in each part; the best "
            f"has {fewest} of {worst!r}; lower the minimum, or leave the attribute out."
        )
