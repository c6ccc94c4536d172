"""What evidence on each attribute says of the truth, alone and jointly.

Percepts of different attributes are independent given the truth, so evidence is gathered of each
attribute alone, in N times C numbers. Of a group, exactly one attribute is true; its posterior
needs nothing else than each value's likelihood ratio L_k = Pr(percepts | true) / Pr(percepts |
false):

    Pr(k | percepts) ~ prior_k L_k^((K - 1) / K)

Without the power this is the prior restricted to the joint values that are allowed. But the K
percepts come from the same features, each tells its value from the K - 1 others, and they hold the
evidence of K - 1: the percept of the second of two values is that of the first, and would count
twice. For weak evidence from equal features the power is exact, for two values always.

Where attributes exclude or imply each other, the prior is a table of all values y, and so is the
posterior, by the same ratios (those of a group with their power):

    Pr(y | percepts) ~ prior(y) prod over true attributes of L_i
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.domain.query import value_table
from meal_bayes.momdp.model import MOMDP


def group_power(values: int) -> float:
    """Return the power (K - 1) / K of the likelihood ratios of a group's K values."""
    return 1 - 1 / values


class Truths(NamedTuple):
    """What a belief says of the truth; axes before the last are of any number of beliefs.

    Attributes
    ----------
    log_odds : NDArray[np.float64]
        (...,N) of each attribute.
    joint_table : NDArray[np.float64] | None
        (...,Y) Pr(values) where the prior is a joint one.
    """

    log_odds: NDArray[np.float64]
    joint_table: NDArray[np.float64] | None = None

    @property
    def positive(self) -> NDArray[np.float64]:
        """Pr(attribute is true), (...,N)."""
        from scipy.special import expit  # noqa: PLC0415  light names import no SciPy

        return np.asarray(expit(self.log_odds))

    def factors(self, groups: tuple[tuple[int, ...], ...]) -> list[NDArray[np.float64]]:
        """Return probabilities (...,V) as `Belief.factors` has them, of a query's groups."""
        return (
            by_variable(self.positive, groups) if self.joint_table is None else [self.joint_table]
        )


def by_variable(
    positive: NDArray[np.float64], groups: tuple[tuple[int, ...], ...]
) -> list[NDArray[np.float64]]:
    """Return probabilities (...,V) of each variable's values, of Pr(attribute is true) (...,N)."""
    group_of = {i: group for group in groups for i in group}
    by_truth = np.stack([1.0 - positive, positive], axis=-1)  # (...,N,2)
    return [
        positive[..., list(group_of[i])] if i in group_of else by_truth[..., i, :]
        for i in range(positive.shape[-1])
        if i == min(group_of.get(i, (i,)))  # a group comes once, at its first attribute
    ]


def truths_of(momdp: MOMDP, log_prob: NDArray[np.float64]) -> Truths:
    """Compute what ln Pr(latent class), (...,N,C), says of the truth.

    Percepts and truth are independent given the class, so Pr(truth | class) is the MOMDP's.
    """
    log_joint = log_prob[..., None, :] + momdp.log_truth  # (...,N,2,C)
    with np.errstate(divide="ignore", invalid="ignore"):  # nan where no value is possible
        of_truth = np.logaddexp.reduce(log_joint, axis=-1)  # (...,N,2)
        if momdp.joint is not None:
            return _coupled_truths(momdp, momdp.joint, of_truth)
        odds = np.asarray(of_truth[..., 1] - of_truth[..., 0])
        # Values of a group exclude each other: the odds of each are taken as one of K answers.
        for group in map(list, momdp.query.groups):
            prior = momdp.prior[group]
            log_ratio = odds[..., group] - (np.log(prior) - np.log1p(-prior))
            weight = np.log(prior) + group_power(len(group)) * log_ratio
            weight[..., prior == 0] = -np.inf
            weight[..., prior == 1] = 0.0
            others = np.where(np.eye(len(group), dtype=bool), -np.inf, weight[..., None, :])
            odds[..., group] = weight - np.logaddexp.reduce(others, axis=-1)
    return Truths(odds)


def _coupled_truths(
    momdp: MOMDP, joint: NDArray[np.float64], of_truth: NDArray[np.float64]
) -> Truths:
    """Compute Pr(values) and its margins, from ln Pr(truth) (...,N,2) of each attribute alone."""
    values = value_table(len(momdp.query), momdp.query.groups)  # (Y,N)
    alone = np.log(np.stack([1.0 - momdp.prior, momdp.prior], axis=1))  # (N,2)
    # ln Pr(percepts | truth), but for a constant; a truth that the prior rules out needs none.
    log_likelihood = np.where(np.isneginf(alone), 0.0, of_truth - alone)
    for group in map(list, momdp.query.groups):
        log_likelihood[..., group, :] *= group_power(len(group))
    truth = values.astype(np.intp)  # of each attribute, by values
    attributes = np.arange(len(momdp.query))
    log_joint = np.log(joint) + log_likelihood[..., attributes, truth].sum(axis=-1)  # (...,Y)
    log_joint -= np.logaddexp.reduce(log_joint, axis=-1, keepdims=True)
    # ln of the sums over the values in which each attribute is true, and false, (...,N)
    true = np.logaddexp.reduce(np.where(values, log_joint[..., None], -np.inf), axis=-2)
    false = np.logaddexp.reduce(np.where(values, -np.inf, log_joint[..., None]), axis=-2)
    return Truths(true - false, np.exp(log_joint))
