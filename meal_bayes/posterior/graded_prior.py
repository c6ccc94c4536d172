"""The prior of rows with more than two levels: two kinds of pairs with their own ratios.

With more than two levels (graded percepts), a level is an interval of class-balanced log-odds, so
its log likelihood ratio l_k is similar for all behaviors and attributes. However, a level is
stronger evidence if it comes from a pair (attribute, behavior) that is almost never wrong.
Therefore there are two kinds of pairs, each with its own ratios l_ck. With q_k the frequency of
level k for the pair, the prior rows of a pair of kind c are

    alpha_ck = 32 q_k expit(+-l_ck) / sum_j q_j expit(+-l_cj).

The kinds are learned by expectation maximization. The probability that a pair belongs to a kind
depends on the Dirichlet-multinomial evidence of its effective counts and on the fraction of pairs
of this kind. The ratios of a kind are those of the summed rows of its pairs, weighted by the counts
of their rarer truth, plus rows with the ratio of all pairs, which have the weight of ten percepts.
The iteration begins with the pairs above and below the median of Youden's J. If there is only one
kind, both ratios become equal.

The weight is 32, because among the powers of two it lets rows that were learned without an object
predict the object's percepts best if all pairs have one ratio (ROC36 and ISPY32: 32; CY101: 128,
with a flat optimum).
"""

from typing import NamedTuple, Self

import numpy as np
from scipy.special import expit, gammaln

from meal_bayes.arrays import Bools, Floats, Ints, tiny_is_zero
from meal_bayes.perception.confusion import youden

_WEIGHT = 32.0  # of a prior row, in percepts
_COMMON = 10.0  # weight of the ratio of all pairs in the ratio of a kind, in percepts
_ROUNDS = 300  # largest number of iterations of expectation maximization
_SAME = 1e-4  # change of log ratios below which the iteration ends
_FLAT = 1.0  # weight of a uniform row that is added to the counts


class GradedPrior(NamedTuple):
    """The Dirichlet prior of rows with more than two levels.

    Attributes
    ----------
    effective : Floats
        (P,E,2,K) effective counts from which the prior was learned.
    log_ratios : Floats
        (C,K) log likelihood ratios of the levels for each of the C = 2 kinds.
    shares : Floats
        (C,) fraction of the pairs that belong to each kind.
    """

    effective: Floats
    log_ratios: Floats
    shares: Floats

    @classmethod
    @tiny_is_zero
    def learn(cls, effective: Floats, votes: Bools) -> Self:
        """Learn the prior from the effective counts of the pairs `votes` (P,E)."""
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
        """Return the change of the parameters (U,2,K) of U pairs if `worth` is subtracted.

        `worth` (U,2,K) is the effective counts of an object; they are subtracted from those that
        determine the kind of each pair.
        """
        counted = self.effective[attribute, behavior]
        alphas, kinds = self._of_kinds(counted)
        _, without = self._of_kinds(np.maximum(counted - worth, 0.0))
        return np.asarray(((without - kinds)[..., None, None] * alphas).sum(axis=0))

    def _of_kinds(self, effective: Floats) -> tuple[Floats, Floats]:
        """Return the parameters for each kind (C,...,2,K), and the probability of each (C,...)."""
        ratios = self.log_ratios.reshape(2, *(1,) * (effective.ndim - 2), 1, -1)
        rows = use_of_levels(effective) * expit(np.concatenate([-ratios, ratios], axis=-2))
        alphas = _WEIGHT * rows / rows.sum(axis=-1, keepdims=True)
        score = (gammaln(alphas + effective) - gammaln(alphas)).sum(axis=(-2, -1))
        score += np.log(self.shares).reshape(2, *(1,) * (effective.ndim - 2))
        kinds = np.exp(score - score.max(axis=0))
        return alphas, kinds / kinds.sum(axis=0)


def use_of_levels(effective: Floats) -> Floats:
    """Return the mean (...,1,K) of the two rows of a pair, from effective counts (...,2,K).

    Both truths have the same weight, so this is the class-balanced frequency of each level.
    """
    return np.asarray(flattened(effective).mean(axis=-2, keepdims=True))


def pooled_log_ratio(effective: Floats, votes: Bools) -> Floats:
    """Return the log ratio (K,) of the frequencies of a level for true and for false objects.

    The frequencies are means over the pairs `votes` (P,E), weighted by the counts of the rarer
    truth of each pair.
    """
    rows = flattened(effective)
    vote = effective.sum(axis=-1, keepdims=True).min(axis=-2, keepdims=True)
    vote = vote * votes[..., None, None]
    pooled = (rows * vote).sum(axis=(-4, -3)) + 1 / rows.shape[-1]  # (2,K)
    return np.asarray(np.log(pooled[1]) - np.log(pooled[0]))


def flattened(effective: Floats) -> Floats:
    """Return rows (...,K) of effective counts plus one percept spread evenly over the levels."""
    n = effective.sum(axis=-1, keepdims=True)
    return np.asarray((_FLAT / effective.shape[-1] + effective) / (_FLAT + n))
