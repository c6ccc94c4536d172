"""Levels of percepts: a classifier's log-odds, rounded, in fine bins, which merge to K levels."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.arrays import freeze, tiny_is_zero
from meal_bayes.errors import SettingsError

THRESHOLD = float(np.log(0.501 / 0.499))  # yes/no at .501: .5 +- 1e-16 would leak by rounding
BIN_COUNT = np.dtype("|u1")  # of an object's recordings in a fine bin, in tables and files
STORED = np.dtype("<f2")  # log-odds, in tables and files,
LIMIT = 8.0  # and within +-8, where that is good to .004
BIN_EDGES = freeze(THRESHOLD + np.array([-3.0, -1.5, -0.5, 0.0, 0.5, 1.5, 3.0]))


def lowest_bins(bins: int, levels: int) -> NDArray[np.intp]:
    """Return the lowest of the fine bins of each of K levels, (K,): how bins become levels.

    Each level merges L / K neighboring bins; K is even, so that yes and no are never merged.

    >>> lowest_bins(8, 4).tolist()
    [0, 2, 4, 6]
    """
    if levels < 2 or levels % 2 or bins % levels:
        fitting = [k for k in range(2, bins + 1, 2) if bins % k == 0]
        raise SettingsError(f"Percepts of {levels} levels; expected one of {fitting}.")
    return np.arange(0, bins, bins // levels)


def level_edges(edges: NDArray[np.float64], levels: int) -> NDArray[np.float64]:
    """Return the edges (K-1,) between K levels, of the fine bins' edges (L-1,)."""
    return edges[lowest_bins(len(edges) + 1, levels)[1:] - 1]


def merge_bins(counts: NDArray[np.integer], levels: int) -> NDArray[np.int64]:
    """Sum counts (...,L) in fine bins to counts (...,K) in levels."""
    lowest = lowest_bins(counts.shape[-1], levels)
    return np.add.reduceat(counts, lowest, axis=-1, dtype=np.int64)


def levels_of(log_odds: ArrayLike, edges: NDArray[np.float64], levels: int) -> NDArray[np.int8]:
    """Return the percept levels 0 .. K-1 of log-odds of any shape."""
    return np.searchsorted(level_edges(edges, levels), log_odds).astype(np.int8)


def classifier_levels(log_odds: ArrayLike, levels: int) -> NDArray[np.int8]:
    """Return the percept levels 0 .. K-1 of what a classifier says, live as in a table.

    >>> classifier_levels([-5.0, -1.0, 0.0, 1.0, 5.0], 4).tolist()
    [0, 1, 1, 2, 3]
    """
    return levels_of(round_log_odds(log_odds), BIN_EDGES, levels)


@tiny_is_zero
def round_log_odds(log_odds: ArrayLike) -> NDArray[np.float16]:
    """Clip to +-LIMIT and round as tables store them: percepts do not change by saving."""
    return np.clip(np.asarray(log_odds, dtype=np.float64), -LIMIT, LIMIT).astype(STORED)
