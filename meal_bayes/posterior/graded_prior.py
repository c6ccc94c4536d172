"""The prior of graded rows: what a level is worth to two kinds of pairs.

A level of graded percepts (K > 2) is a range of class-balanced log-odds, so its log likelihood
ratio l_k is about the same whatever the behavior and attribute. But pairs (attribute, behavior)
that are almost never wrong say more by a level than the others. There are two kinds of pairs,
each with a ratio l_ck of its own. With q_k the pair's own use of the levels, the prior rows of a
pair of kind c are

    alpha_ck = 32 q_k expit(+-l_ck) / sum_j q_j expit(+-l_cj).

Kinds are learned by expectation maximization. A pair belongs to a kind by the Dirichlet-multinomial
evidence of its effective counts and the kind's share of the pairs. The ratio of a kind is that of
the summed rows of its pairs, weighted by the count of their rarer truth, and of rows with the ratio
of all pairs, which have the weight of ten percepts. The start is pairs above and below the median
of Youden's J. Where there is only one kind, both ratios become the same.

The weight 32 is, of the powers of two, the one by which the rows learned without an object predict
its percepts best if all pairs have one ratio (ROC36 and ISPY32 32, CY101 128, flat around).
"""

from typing import NamedTuple, Self

import numpy as np
from scipy.special import expit, gammaln

from meal_bayes.arrays import Bools, Floats, Ints, tiny_is_zero
from meal_bayes.perception.confusion import youden

_WEIGHT = 32.0  # of a prior row, in percepts
_COMMON = 10.0  # percepts that a kind's ratio has from that of all pairs
_ROUNDS = 300  # of expectation maximization, at most
_SAME = 1e-4  # log ratios that move by less stay
_FLAT = 1.0  # weight of a flat row beside the counts


class GradedPrior(NamedTuple):
    """The Dirichlet prior of graded rows, learned from effective counts (P,E,2,K).

    Log ratios are (C,K) of each kind, shares (C,) how many of the pairs belong to it.
    """

    effective: Floats
    log_ratios: Floats
    shares: Floats

    @classmethod
    @tiny_is_zero
    def learn(cls, effective: Floats, votes: Bools) -> Self:
        """Learn it from effective counts, and which pairs have a vote (P,E)."""
        rows = flattened(effective)
        vote = votes * effective.sum(axis=-1).min(axis=-1)
        common = pooled_log_ratio(effective, votes)
        of_all = expit(np.stack([-common, common]))
        of_all *= _COMMON / of_all.sum(axis=-1, keepdims=True)
        j = youden(effective)
        above = j > np.median(j[votes]) if votes.any() else np.zeros(votes.shape, bool)
        kinds = np.stack([~above, above]).astype(float)  # (C,P,E)
        prior = cls(effective, np.zeros((2, len(common))), np.full(2, 0.5))
        for _ in range(_ROUNDS):
            pooled = np.einsum("cpe,pevk->cvk", kinds * vote, rows) + of_all
            log_ratios = np.log(pooled[:, 1]) - np.log(pooled[:, 0])
            shares = (kinds * votes).sum(axis=(1, 2)) + 1
            moved = np.abs(log_ratios - prior.log_ratios).max()
            prior = cls(effective, log_ratios, shares / shares.sum())
            if moved < _SAME:
                break
            _, kinds = prior._of_kinds(effective)
        return prior

    @property
    def rows(self) -> Floats:
        """The Dirichlet parameters of all rows, (P,E,2,K)."""
        alphas, kinds = self._of_kinds(self.effective)
        return np.asarray((kinds[..., None, None] * alphas).sum(axis=0))

    def change_without(self, attribute: Ints, behavior: Ints, worth: Floats) -> Floats:
        """Return how the parameters of U pairs change (U,2,K) without counts worth (U,2,K)."""
        counted = self.effective[attribute, behavior]
        alphas, kinds = self._of_kinds(counted)
        _, without = self._of_kinds(np.maximum(counted - worth, 0.0))
        return np.asarray(((without - kinds)[..., None, None] * alphas).sum(axis=0))

    def _of_kinds(self, effective: Floats) -> tuple[Floats, Floats]:
        """Return the parameters in each kind (C,...,2,K), and the probability of each (C,...)."""
        ratios = self.log_ratios.reshape(2, *(1,) * (effective.ndim - 2), 1, -1)
        rows = use_of_levels(effective) * expit(np.concatenate([-ratios, ratios], axis=-2))
        alphas = _WEIGHT * rows / rows.sum(axis=-1, keepdims=True)
        score = (gammaln(alphas + effective) - gammaln(alphas)).sum(axis=(-2, -1))
        score += np.log(self.shares).reshape(2, *(1,) * (effective.ndim - 2))
        kinds = np.exp(score - score.max(axis=0))
        return alphas, kinds / kinds.sum(axis=0)


def use_of_levels(effective: Floats) -> Floats:
    """Return the balanced mean (...,1,K) of a pair's two rows, from effective counts (...,2,K)."""
    return np.asarray(flattened(effective).mean(axis=-2, keepdims=True))


def pooled_log_ratio(effective: Floats, votes: Bools) -> Floats:
    """Return ln of the ratio (K,) in which true and false objects show a level, of all pairs.

    Pairs (P,E) have the weight of their rarer truth.
    """
    rows = flattened(effective)
    vote = effective.sum(axis=-1, keepdims=True).min(axis=-2, keepdims=True)
    vote = vote * votes[..., None, None]
    pooled = (rows * vote).sum(axis=(-4, -3)) + 1 / rows.shape[-1]  # (2,K)
    return np.asarray(np.log(pooled[1]) - np.log(pooled[0]))


def flattened(effective: Floats) -> Floats:
    """Return rows (...,K) of effective counts, with one flat percept more."""
    n = effective.sum(axis=-1, keepdims=True)
    return np.asarray((_FLAT / effective.shape[-1] + effective) / (_FLAT + n))
