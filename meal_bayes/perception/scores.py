"""Scores of a detector (a probability, a logit or a similarity), and their division into levels.

A score may have any scale; a higher score must mean that "true" is more probable. The edges between
levels are found in two ways:

- Until there are labels of true and of false objects, edges are quantiles of all observed scores.
- Then an isotonic (monotone) regression of the label on the score, with equal total weights of both
  truths, divides the scores into blocks. A block with a of A true and b of B false objects has the
  log-odds ln((a + 1/2) / (A + 1)) - ln((b + 1/2) / (B + 1)) at its mean score. Between blocks,
  log-odds are interpolated linearly. The edges are at two thirds of the log-odds of a classifier's
  edges.

The same detector gives the scores of all attributes of a behavior, on one scale. Therefore
quantiles are those of all attributes, and the labels of all attributes are used in the fit of each
one, with the weight of a few objects. An object counts once for each attribute, however often it
was scored.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.arrays import Bools, Floats, Levels
from meal_bayes.datasets.percepts import BIN_EDGES, level_edges

_NEARER = 2 / 3  # factor of a classifier's edges, because few labels give no large log-odds
_POOLED = 16.0  # largest weight of the labels of all attributes, in objects of each truth
_POINTS = 64  # number of scores that represent these labels
_REVERSED = 0.2  # area under the ROC curve below which scores are reversed,
_CLEAR = 5  # if there are at least this many objects of each truth


def scored_levels(scores: ArrayLike, edges: ArrayLike) -> Levels:
    """Return the levels (...) of scores (...) by edges (...,K-1); -1 where either is missing.

    >>> scored_levels([0.1, 0.4, np.nan], [[0.2, 0.5, 0.7]] * 3).tolist()
    [0, 1, -1]
    """
    score = np.asarray(scores, float)[..., None]
    edge = np.asarray(edges, float)
    missing = np.isnan(score[..., 0]) | np.isnan(edge).any(axis=-1)
    return np.where(missing, -1, (score > edge).sum(axis=-1)).astype(np.int8)


def first_levels(scores: ArrayLike, levels: int) -> Levels:
    """Return the levels (...) of the first scores (...) of a behavior; -1 if a score is missing.

    A score between 0 and 1 is read as a probability and any other score as a logit, and the level
    is no or yes. Such levels are only displayed; they do not change the belief.

    >>> first_levels([0.2, 0.7, 3.0, -3.0], 4).tolist()
    [1, 2, 2, 1]
    """
    score = np.asarray(scores, float)
    yes = score > np.where((score >= 0) & (score <= 1), 0.5, 0.0)
    return np.where(np.isnan(score), -1, levels // 2 - 1 + yes).astype(np.int8)


def edges_by_rank(scores: ArrayLike, levels: int) -> Floats:
    """Return edges (K-1,) at quantiles of scores (n,); NaN if there are no scores.

    A new score has the rank (less + equal / 2 + 1/2) / (n + 1), so the extreme levels are only
    possible with four scores or more.

    >>> edges_by_rank([0.3], 4).tolist()
    [-inf, 0.3, inf]
    >>> edges_by_rank([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7], 4).round(3).tolist()
    [0.2, 0.4, 0.6]
    """
    values, counts = np.unique(np.asarray(scores, float), return_counts=True)
    n = counts.sum()
    if not n:
        return np.full(levels - 1, np.nan)
    below = np.concatenate([[0], counts.cumsum()])  # scores below each gap between values
    # Ranks of gap, value, gap, value, ..., gap, times n + 1.
    ranks = np.empty(2 * len(values) + 1)
    ranks[0::2] = below + 0.5
    ranks[1::2] = below[:-1] + counts / 2 + 0.5
    # A new score is above an edge from `first` on: a value itself, or all that is above a value.
    ends = np.empty(len(ranks) + 1)
    ends[0] = -np.inf
    ends[1:-1:2] = np.nextafter(values, -np.inf)
    ends[2:-1:2] = values
    ends[-1] = np.inf
    share = np.arange(1, levels) / levels * (n + 1)
    low = share < (n + 1) / 2  # a rank of exactly 1/4 or 3/4 is not an extreme level
    first = np.where(low, np.searchsorted(ranks, share), np.searchsorted(ranks, share, "right"))
    return np.asarray(ends[first])


def edges_by_labels(scores: Floats, objects: Floats, levels: int) -> Floats:
    """Return edges (K-1,) from an isotonic regression of the truth on scores (n,).

    `objects` (2,n) is the number of false and true objects with each score; both must occur.

    >>> import numpy as np
    >>> true = np.array([0, 0, 1, 0, 1, 1]) * 9
    >>> edges_by_labels(np.arange(6) / 10, np.stack([9 - true, true]), 4).round(2).tolist()
    [0.19, 0.25, 0.31]
    """
    from sklearn.isotonic import isotonic_regression  # noqa: PLC0415  loads all of sklearn

    values, place = np.unique(scores, return_inverse=True)
    sums = np.zeros((2, len(values)))
    np.add.at(sums.T, place, objects.T)
    held = sums.any(axis=0)
    values, sums = values[held], sums[:, held]
    total = sums.sum(axis=1, keepdims=True)
    share = sums / total
    both = share.sum(axis=0)
    fitted = isotonic_regression(share[1] / both, sample_weight=both, y_min=0.0, y_max=1.0)
    first = np.flatnonzero(np.diff(fitted, prepend=-1.0) > 0)  # of each block
    blocks = np.log((np.add.reduceat(sums, first, axis=1) + 0.5) / (total + 1.0))
    log_odds = np.sort(blocks[1] - blocks[0])
    # Blocks are placed at their mean scores; between them, log-odds are interpolated linearly.
    centers = np.add.reduceat(both * values, first) / np.add.reduceat(both, first)
    wanted = _NEARER * level_edges(BIN_EDGES, levels)
    return np.asarray(np.interp(wanted, log_odds, centers, left=-np.inf, right=np.inf))


def cut_scores(
    scores: Floats, labels: NDArray[np.int8], behavior: NDArray[np.intp], objects: NDArray[np.intp],
    *, behaviors: int, levels: int,
) -> tuple[Floats, Bools]:  # fmt: skip
    """Find the edges that divide scores into levels.

    Parameters
    ----------
    scores : Floats
        (n,P) scores of instances; NaN if there is none.
    labels : NDArray[np.int8]
        (n,P) 1 true, 0 false, -1 unknown.
    behavior, objects : NDArray[np.intp]
        (n,) behaviors and objects of the instances.
    behaviors, levels : int
        Number E of behaviors and number K of levels.

    Returns
    -------
    edges : Floats
        (P,E,K-1) increasing edges for each attribute and behavior; NaN if there is no score.
    reversed : Bools
        (P,E) whether false objects clearly have higher scores than true ones.
    """
    edges = np.full((scores.shape[1], behaviors, levels - 1), np.nan)
    falling = np.zeros(edges.shape[:2], np.bool_)
    seen = ~np.isnan(scores)
    for e in np.unique(behavior[seen.any(axis=1)]).tolist():
        rows = np.flatnonzero((behavior == e) & seen.any(axis=1))
        model = _Scored(scores[rows], labels[rows], objects[rows], levels)
        for p in np.flatnonzero(seen[rows].any(axis=0)).tolist():
            edges[p, e] = model.edges(p)
            falling[p, e] = model.falls(p)
    return edges, falling


def object_means(scores: Floats, objects: NDArray[np.intp]) -> Floats:
    """Return the mean scores (m,) of each object and attribute, from scores of instances (n,P)."""
    i, p = np.nonzero(~np.isnan(scores))
    _, place, counts = np.unique(
        np.stack([objects[i], p]), axis=1, return_inverse=True, return_counts=True
    )
    sums = np.zeros(len(counts))
    np.add.at(sums, place.ravel(), scores[i, p])
    return np.asarray(sums / counts)


class _Scored:
    """The scores (n,P) of the instances of one behavior, with their labels."""

    def __init__(
        self, scores: Floats, labels: NDArray[np.int8], objects: NDArray[np.intp], levels: int
    ) -> None:
        self.scores = scores
        self.levels = levels
        self.truth = np.where(np.isnan(scores), -1, labels)  # (n,P)
        _, self.object = np.unique(objects, return_inverse=True)
        told = (self.truth >= 0).astype(float)
        per_object = np.zeros((self.object.max() + 1, scores.shape[1]))
        np.add.at(per_object, self.object, told)
        self.weight = told / np.maximum(per_object[self.object], 1.0)
        self.by_rank = edges_by_rank(object_means(scores, objects), levels)
        # Labels of all attributes together, at a few scores: (2,m) objects of each truth.
        i, p = np.nonzero(told)
        values = scores[i, p]
        shares = np.linspace(0, 1, _POINTS)
        self.points = np.unique(np.quantile(values, shares, method="nearest") if len(i) else [])
        near = np.searchsorted((self.points[1:] + self.points[:-1]) / 2, values)
        self.pooled = np.zeros((2, len(self.points)))
        np.add.at(self.pooled, (self.truth[i, p], near), self.weight[i, p])

    def edges(self, p: int) -> Floats:
        """Return edges (K-1,) of an attribute, by labels of both truths or else by quantiles."""
        total = self.pooled.sum(axis=1, keepdims=True)
        if not total.all():
            return self.by_rank
        rows = np.flatnonzero(self.truth[:, p] >= 0)
        own = np.zeros((2, len(rows)))
        own[self.truth[rows, p], np.arange(len(rows))] = self.weight[rows, p]
        pooled = _POOLED * self.pooled / np.maximum(total, _POOLED)
        scores = np.concatenate([self.scores[rows, p], self.points])
        return edges_by_labels(scores, np.concatenate([own, pooled], axis=1), self.levels)

    def falls(self, p: int) -> bool:
        """Return whether false objects clearly have higher scores than true ones."""
        told = self.truth[:, p] >= 0
        per_object = np.zeros((3, self.object.max() + 1))
        of_object = [np.nan_to_num(self.scores[:, p]), self.truth[:, p], np.ones(len(told))]
        for row, values in zip(per_object, of_object, strict=True):
            np.add.at(row, self.object[told], self.weight[told, p] * values[told])
        mean, true, known = per_object
        of_true, of_false = mean[true >= 0.5], mean[(true < 0.5) & (known > 0)]
        if min(len(of_true), len(of_false)) < _CLEAR:
            return False
        difference = of_true[:, None] - of_false
        return bool((np.sign(difference).mean() + 1) / 2 < _REVERSED)
