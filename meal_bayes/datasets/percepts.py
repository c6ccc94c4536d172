"""Percept tables: the outputs of held-out classifiers on every recording, in levels."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.arrays import freeze, label_values, set_frozen
from meal_bayes.display import facts_html, facts_repr, listed
from meal_bayes.domain import Domain
from meal_bayes.errors import DataError, SettingsError

THRESHOLD = float(np.log(0.501 / 0.499))  # yes/no at .501: .5 +- 1e-16 would leak by rounding
LIMIT = 8.0  # log-odds are kept within +-8, where float16 is good to .004
BIN_EDGES = freeze(THRESHOLD + np.array([-3.0, -1.5, -0.5, 0.0, 0.5, 1.5, 3.0]))


def level_edges(edges: NDArray[np.float64], levels: int) -> NDArray[np.float64]:
    """Return the edges (K-1,) between K levels, even, of the fine bins' edges (L-1,)."""
    bins = len(edges) + 1
    if levels < 2 or levels % 2 or bins % levels:
        fitting = [k for k in range(2, bins + 1, 2) if bins % k == 0]
        raise SettingsError(f"Percepts of {levels} levels; expected one of {fitting}.")
    step = bins // levels
    return edges[step - 1 :: step]


def levels_of(log_odds: ArrayLike, edges: NDArray[np.float64], levels: int) -> NDArray[np.int8]:
    """Return the percept levels 0 .. K-1 of log-odds of any shape.

    >>> levels_of([-5.0, -1.0, 0.0, 1.0, 5.0], BIN_EDGES, 4).tolist()
    [0, 1, 1, 2, 3]
    """
    return np.searchsorted(level_edges(edges, levels), log_odds).astype(np.int8)


def round_log_odds(log_odds: ArrayLike) -> NDArray[np.float16]:
    """Clip to +-8 and round as tables store them, so that percepts do not change by saving."""
    return np.clip(np.asarray(log_odds, dtype=np.float64), -LIMIT, LIMIT).astype(np.float16)


_KINDS = {
    "labels": np.int8, "log_odds": np.float16, "edges": np.float64, "training_bins": np.uint8,
    "recording_counts": np.int64, "groups": np.int64,
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class PerceptTable:
    """Held-out percepts of a data set, and the training-side counts for each held-out object.

    Log-odds are class-balanced (prior 1/2): positive speaks for "true". They are cut into L fine
    bins by `edges`; a percept of K levels merges neighboring bins, the middle edge divides yes/no.
    Where nothing was computed (reinit, ask, an attribute left out) they are NaN and bins zero.

    Attributes
    ----------
    domain : Domain
        Behaviors and attributes.
    objects : tuple[str, ...]
        (O,) names.
    labels : NDArray[np.int8]
        (O,P) int8, 1 true, 0 false, -1 unknown.
    log_odds : NDArray[np.float16]
        (O,R,E,P) float16, of o's recordings, by classifiers that never saw o.
    edges : NDArray[np.float64]
        (L-1,) float64, of the fine bins; the middle one is the yes/no threshold.
    training_bins : NDArray[np.uint8]
        (G,O,P,E,L) uint8, [g, o']: how often o' fell in each bin, by classifiers that saw neither
        o' nor group g; zero where o' is of g.
    provenance : Mapping[str, str]
        Versions, settings, checksums and the command that made it.
    recording_counts : NDArray[np.int64]
        (O,E) int64, how many recordings each object has of each behavior; R of all that sense by
        default.
    groups : NDArray[np.int64]
        (O,) int64, which g each object is left out with: one of its own by default, or a fold of
        objects where there are many.

    Raises
    ------
    DataError
        Shapes that do not agree, edges that do not rise.
    """

    domain: Domain
    objects: tuple[str, ...]
    labels: NDArray[np.int8]
    log_odds: NDArray[np.float16]
    edges: NDArray[np.float64]
    training_bins: NDArray[np.uint8]
    provenance: Mapping[str, str]
    recording_counts: NDArray[np.int64] = None  # type: ignore[assignment]
    groups: NDArray[np.int64] = None  # type: ignore[assignment]

    __repr__, _repr_html_ = facts_repr, facts_html

    def __post_init__(self) -> None:
        set_frozen(self, labels=label_values(self.labels))
        o, e, p = len(self.objects), len(self.domain.behaviors), len(self.domain.attributes)
        r = self.recordings
        if self.groups is None:
            set_frozen(self, groups=np.arange(o))
        if self.recording_counts is None:
            counts = np.zeros((o, e), np.int64)
            counts[:, self.domain.recorded] = r
            set_frozen(self, recording_counts=counts)
        for name, kind in _KINDS.items():
            set_frozen(self, **{name: freeze(getattr(self, name), kind)})
        expected = {
            "labels": (o, p),
            "log_odds": (o, r, e, p),
            "groups": (o,),
            "training_bins": (int(self.groups.max(initial=-1)) + 1, o, p, e, len(self.edges) + 1),
            "recording_counts": (o, e),
        }
        for name, shape in expected.items():
            actual = getattr(self, name).shape
            if actual != shape:
                raise DataError(f"Percept table: {name} has shape {actual}; expected {shape}.")
        if not ((self.recording_counts >= 0) & (self.recording_counts <= r)).all():
            raise DataError(f"Percept table: expected recording_counts in 0 to {r}.")
        if self.training_bins[self.groups, np.arange(o)].any():
            raise DataError(
                "Percept table: an object's own recordings stand among what is learned without it; "
                "its training bins must be zero (build the table again)."
            )
        if len(self.edges) % 2 == 0 or not (np.diff(self.edges) > 0).all():
            raise DataError("Percept table: expected an odd number of edges, each above the last.")

    def _facts(self) -> tuple[str, dict[str, str]]:
        names = self.domain.attributes
        return f"PerceptTable {self.domain.name}", {
            "objects": f"{len(self.objects)}: {listed(self.objects, 3)}",
            "behaviors": listed(self.domain.behavior_names),
            "attributes": f"{len(names)}: {listed(names)}",
            "recordings": f"up to {self.recordings} of each object and behavior",
            "made by": self.provenance.get("package", "unknown"),
        }

    @property
    def ragged(self) -> bool:
        """Whether an object has fewer recordings of a behavior that senses than R."""
        return bool((self.recording_counts[:, self.domain.recorded] < self.recordings).any())

    @property
    def recordings(self) -> int:
        """R, the most recordings that an object has of a behavior."""
        return int(self.log_odds.shape[1]) if self.log_odds.ndim > 1 else 0

    def levels_of(self, log_odds: ArrayLike, levels: int) -> NDArray[np.int8]:
        """Return the percept levels 0 .. K-1 of log-odds of any shape."""
        return levels_of(log_odds, self.edges, levels)

    def training_levels(self, held_out: int, levels: int) -> NDArray[np.int64]:
        """Return the counts (O,P,E,K) of each level of objects outside the held-out one's group."""
        level_edges(self.edges, levels)
        bins = self.training_bins[self.groups[held_out]]
        merged = bins.reshape(*bins.shape[:-1], levels, -1).sum(axis=-1)
        return freeze(merged, np.int64)
