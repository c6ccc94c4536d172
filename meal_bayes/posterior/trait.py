"""A latent trait of each object, on which all its percepts depend.

The percepts of one object by different behaviors are not independent given the truth: an object
that looks a little empty sounds a little empty too. Each object has, for each attribute, a latent
trait t, which is +1 for a typical true object and -1 for a typical false one. Traits are Normal
about +-1 with standard deviation sigma, on a grid of M points that both truths share, and every
percept depends only on t:

    Pr(k | t) ~ exp(a_k + t b_k),   a and b such that   sum_t Pr(t | v) Pr(k | t) = Theta(v, k),

as nearly as sigma allows. So the first percept has the likelihood of the confusion matrix (Eq. 8).
Further percepts, of any behavior, only determine t more precisely, and even a known t leaves the
uncertainty Pr(t | v) about the truth. Both truths must share the points: if each truth had its own
points, many percepts would identify a point, and with it the truth. For a planner, the points are
latent classes. As sigma goes to 0, percepts become independent given the truth.

Repeated percepts of one behavior are dependent even given the trait: they are
Dirichlet-multinomial, with the row of t as the mean. Their precision is half of that given the
truth. (The marginal likelihood of training percepts is largest for a factor of 1.4 to 2. But among
.5, .7, 1 and 1.5, the factor .5 gives the best calibrated beliefs after five repeats, and the
others are not better after other percepts.)

Sigma minimizes the sum of three means of -ln Pr(truth | percepts) over the training objects, with a
half-normal(1) prior: after all recordings of one behavior, after one recording of each behavior,
and after all recordings. The belief about an object uses rows from which its own percepts were
removed. M, the reach of the grid and the smallest probability of a level were chosen while looking
at held-out results on these data sets. Sigma is about .3 on ROC36, .9 on ISPY32, .6 on CY101.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize_scalar

from meal_bayes.arrays import Floats, FrozenArrays, freeze, tiny_is_zero
from meal_bayes.look import short_repr
from meal_bayes.perception.confusion import by_truth
from meal_bayes.posterior.dirichlet import ConfusionPosterior
from meal_bayes.posterior.graded_prior import GradedPrior
from meal_bayes.posterior.grid import AS_INFINITE, effective_counts, row_statistics
from meal_bayes.seeds import stream

Floating = NDArray[np.floating[Any]]

_POINTS = 9  # M
TYPICAL = 0.5  # sigma if it cannot be learned
_REACH = 2.0  # the grid ends this many sigma beyond +-1
_WITHIN = 0.5  # precision of rows given the trait, in units of that given the truth
_BOUNDS = (0.1, 2.0)  # of sigma
_SCALE = 1.0  # of its half-normal prior
_DRAWS = 2  # selections of one recording of each behavior
_LEAST = 1e-3  # smallest Pr(level | t), because any percept may be an error
_MATCHED = 1e-4  # tolerance of the mixture of rows
_ROUNDS = 50  # largest number of iterations that match the mixture
_SCORED = 10  # the same while sigma is optimized; more change sigma by less than its tolerance
_TINY = 1e-300


@dataclass(frozen=True, slots=True)
class SharedTrait(FrozenArrays):
    """The distribution of objects' traits given the truth.

    Attributes
    ----------
    sd : float
        Standard deviation sigma of traits about +-1.
    points : Floats
        (M,) values of the trait t, in increasing order.
    latent_classes : Floats
        (2,M) Pr(t | truth).

    Examples
    --------
    >>> classes = SharedTrait.of_sd(0.3).latent_classes
    >>> bool(np.allclose(classes.sum(axis=1), 1)), bool(np.allclose(classes[0], classes[1, ::-1]))
    (True, True)
    """

    sd: float
    points: Floats
    latent_classes: Floats

    __repr__ = short_repr

    @classmethod
    def of_sd(cls, sd: float) -> "SharedTrait":
        """Build the grid for a standard deviation above 0."""
        t = np.linspace(-1.0, 1.0, _POINTS) * (1.0 + _REACH * sd)
        density = -0.5 * ((t - np.array([[-1.0], [1.0]])) / sd) ** 2
        classes = np.exp(density - density.max(axis=1, keepdims=True))
        return cls(float(sd), t, classes / classes.sum(axis=1, keepdims=True))

    def select(
        self, confusion: ArrayLike, precision: ArrayLike, *, rounds: int = _ROUNDS
    ) -> tuple[Floats, Floats]:
        """Convert rows given the truth to rows given the trait.

        Parameters
        ----------
        confusion : ArrayLike
            (...,2,K) rows given the truth, all above 0.
        precision : ArrayLike
            (...,2) precision of these rows; inf if they are known exactly.
        rounds : int
            Largest number of iterations.

        Returns
        -------
        rows : Floats
            (...,M,K) rows given the trait, exponential in the trait; their mixtures over the trait
            are the rows given the truth.
        precision : Floats
            (...,M) precision of these rows.
        """
        of_truth = np.asarray(confusion)
        of_truth = of_truth.astype(np.result_type(of_truth, np.float32), copy=False)
        points = self.points.astype(of_truth.dtype)
        m = len(points)
        # Levels come first: to sum over a first axis is fast, over a short last one slow.
        mixture = np.moveaxis(of_truth, -1, 0).reshape(of_truth.shape[-1], -1, 2)  # (K,B,2)
        wanted = np.log(mixture)
        classes = self.latent_classes.T.astype(of_truth.dtype)
        middle = (wanted[..., 1] + wanted[..., 0]) / 2
        slope = (wanted[..., 1] - wanted[..., 0]) / 2
        # Rows softmax(middle + slope t); Newton-like steps until their mixtures are the given ones.
        for _ in range(rounds):
            rows = points * slope[..., None]  # (K,B,M), in place from here
            rows += middle[..., None]
            rows -= rows.max(axis=0)
            np.exp(rows, out=rows)
            np.maximum(rows, _LEAST * rows.sum(axis=0), out=rows)
            rows /= rows.sum(axis=0)
            off = wanted - np.log(rows @ classes)
            if np.abs(mixture * off).max(initial=0.0) < _MATCHED:
                break
            middle = middle + (off[..., 1] + off[..., 0]) / 2
            slope = slope + (off[..., 1] - off[..., 0]) / 2
        of_trait = np.moveaxis(rows, 0, -1).reshape(*of_truth.shape[:-2], m, of_truth.shape[-1])
        within = _WITHIN * np.sqrt(np.asarray(precision, dtype=float).prod(axis=-1, keepdims=True))
        return freeze(of_trait), freeze(np.repeat(within, m, axis=-1))


@tiny_is_zero
def learn_trait(
    posterior: ConfusionPosterior, levels: ArrayLike, labels: ArrayLike, base_rates: ArrayLike
) -> SharedTrait:
    """Learn the standard deviation sigma of the traits of objects.

    Parameters
    ----------
    posterior : ConfusionPosterior
        Posterior that was learned from the same objects.
    levels : ArrayLike
        (O,P,E,K) how often each object showed each level.
    labels : ArrayLike
        (O,P) 1 true, 0 false, -1 unknown. Unknown labels and objects without percepts are left out.
    base_rates : ArrayLike
        (P,) prior probability that an attribute is true.
    """
    counts = np.asarray(levels, dtype=np.intp)
    truth = np.asarray(labels)
    if not posterior.informative.any():
        return SharedTrait.of_sd(TYPICAL)
    evidence = _Evidence(posterior, counts, truth, np.asarray(base_rates))
    if not evidence.n_perceived:
        return SharedTrait.of_sd(TYPICAL)
    best = minimize_scalar(
        lambda log: evidence.loss(SharedTrait.of_sd(np.exp(log))),
        bounds=np.log(_BOUNDS),
        method="bounded",
        options={"xatol": 0.1},
    )
    return SharedTrait.of_sd(float(np.exp(best.x)))


class _Evidence:
    """Percepts of the training objects by V informative pairs; computes the loss at any sigma.

    The rows for an object exclude its own percepts. Otherwise these would fit the rows better than
    the percepts of a new object, and sigma would be too small. Objects with the same truth and the
    same percepts of a pair have the same rows, so only U distinct rows are computed.

    Losses are in single precision, which changes sigma by less than its tolerance. Attributes are
    weighted by the variance of their label, because a rare attribute is predicted well by its base
    rate alone.
    """

    def __init__(
        self,
        posterior: ConfusionPosterior,
        counts: NDArray[np.intp],
        truth: NDArray[np.int8],
        base_rates: Floats,
    ) -> None:
        attribute, behavior = np.nonzero(posterior.informative)  # (V,); A attributes have a pair
        percepts = counts[:, attribute, behavior].swapaxes(0, 1)  # (V,O,K)
        true = truth.T[attribute] == 1  # (V,O)
        total = percepts.sum(axis=-1)
        labeled = (truth >= 0).T[attribute] & (total > 0)  # (V,O)
        present = np.unique(attribute)  # (A,)
        pairs_of_attribute = present[:, None] == attribute  # (A,V)
        perceived = pairs_of_attribute @ labeled  # (A,O)
        self.pairs_of_attribute = pairs_of_attribute.astype(np.float32)
        self.n_perceived = int(perceived.sum())
        # Percepts of an object for a pair, with its truth: U distinct combinations.
        pair = np.broadcast_to(np.arange(len(attribute))[:, None], labeled.shape)
        shown = np.dstack([pair, true & labeled, percepts * labeled[..., None]])
        distinct, which = np.unique(shown.reshape(-1, shown.shape[-1]), axis=0, return_inverse=True)
        self.which = which.reshape(labeled.shape)  # (V,O)
        shown = distinct[:, 2:]  # (U,K)
        own = np.zeros((len(distinct), 2, shown.shape[-1]), np.intp)
        own[np.arange(len(distinct)), distinct[:, 1]] = shown
        of_pair = attribute[distinct[:, 0]], behavior[distinct[:, 0]]
        prior = _learned_prior(posterior, counts, truth)
        confusion, self.precision = posterior.without(*of_pair, own, prior)  # (U,2,K), (U,2)
        self.confusion = confusion.astype(np.float32)
        # Row, level, and the number of earlier ones of that level, of each of T percepts.
        top = np.arange(shown.max(initial=0))
        row, level, earlier = np.nonzero(shown[..., None] > top)
        self.factors = row, level, earlier
        # Single recordings: of each object and pair one percept, drawn in proportion to its counts.
        rng = stream(0, "shared degree")
        cumulative = percepts.cumsum(axis=-1)
        pick = rng.random((_DRAWS, *total.T.shape)).swapaxes(1, 2) * np.maximum(total, 1)
        level = (pick[..., None] >= cumulative).sum(axis=-1)  # (D,V,O)
        self.single_level = np.minimum(level, percepts.shape[-1] - 1)
        self.labeled = labeled.astype(np.float32)
        odds = (np.log(base_rates) - np.log1p(-base_rates)).astype(np.float32)
        sign = np.where(truth == 1, 1, -1).T.astype(np.float32)
        balance = (base_rates * (1 - base_rates))[:, None]
        by_behavior = _normalized(balance[attribute] * labeled)
        joint = _normalized(balance[present] * perceived)
        # All recordings together, then each draw of single ones; the draws share one weight.
        joint = np.concatenate([joint, *(joint / _DRAWS for _ in range(_DRAWS))], axis=1)
        self.by_behavior = odds[attribute], sign[attribute], by_behavior
        self.joint = odds[present], np.tile(sign[present], 1 + _DRAWS), joint

    def loss(self, trait: SharedTrait) -> float:
        """Return the sum of the three means, plus the negative log prior of sigma."""
        rows, precision = trait.select(self.confusion, self.precision, rounds=_SCORED)
        log_classes = np.log(np.maximum(trait.latent_classes, _TINY)).astype(np.float32)
        # Dirichlet-multinomial log-likelihoods of all recordings, up to a constant in t:
        # sum_k ln alpha_k (alpha_k + 1) ... (alpha_k + n_k - 1), a factor for each of T percepts.
        row, level, earlier = self.factors
        weight = np.minimum(precision[:, 0], AS_INFINITE)[row, None]
        log_factors = np.log(weight * rows[row, :, level] + earlier[:, None])  # (T,M)
        log_shown = np.zeros(rows.shape[:2], log_factors.dtype)
        first = np.flatnonzero(np.diff(row, prepend=-1))
        log_shown[row[first]] = np.add.reduceat(log_factors, first)
        repeated = log_shown.astype(np.float32)[self.which]  # (V,O,M)
        log_rows = np.log(rows).astype(np.float32).swapaxes(1, 2)  # (U,K,M)
        single = log_rows[self.which, self.single_level] * self.labeled[..., None]  # (D,V,O,M)
        # Behaviors are independent given the trait: the pairs of an attribute add up.
        log_percepts = np.concatenate([repeated, *single], axis=1)  # (V,(1+D) x O,M)
        summed = self.pairs_of_attribute @ log_percepts.reshape(len(repeated), -1)
        joint = summed.reshape(-1, *log_percepts.shape[1:])  # (A,(1+D) x O,M)
        loss = _loss(repeated, log_classes, *self.by_behavior)
        loss += _loss(joint, log_classes, *self.joint)
        return loss + 0.5 * (trait.sd / _SCALE) ** 2 / self.n_perceived


def _learned_prior(
    posterior: ConfusionPosterior, counts: NDArray[np.intp], truth: NDArray[np.int8]
) -> GradedPrior | None:
    """Learn the prior of graded rows again, so that single objects can be removed from it."""
    if posterior.telling is None or counts.shape[-1] == 2:
        return None
    rows, votes = row_statistics(by_truth(counts, truth))
    return GradedPrior.learn(effective_counts(rows, votes), votes)


def _loss(
    log_likelihood: NDArray[np.float32],
    log_classes: NDArray[np.float32],
    prior: NDArray[np.float32],
    sign: NDArray[np.float32],
    weight: Floats,
) -> float:
    """Sum the weighted -ln Pr(truth | percepts) of log-likelihoods (B,O,M).

    The prior log-odds (B,) are of each belief; sign and weight (B,O) of its truth, each object's.
    """
    odds = prior[:, None] + truth_evidence(log_likelihood, log_classes)
    odds *= sign
    loss = np.log(1 + np.exp(-np.abs(odds))) - np.minimum(odds, 0)  # logaddexp is slow
    return float((loss * weight).sum())


@tiny_is_zero
def truth_evidence(log_likelihood: Floating, log_classes: Floating) -> Floating:
    """Return the log likelihood ratio (...) of true against false, summed over the trait.

    The arguments are ln Pr(percepts | t) (...,M) and ln Pr(t | truth) (2,M).
    """
    peak = log_likelihood.max(axis=-1, keepdims=True)
    marginal = np.exp(log_likelihood - peak) @ np.exp(log_classes).T  # (...,2)
    log_marginal = np.log(np.maximum(marginal, np.finfo(marginal.dtype).tiny))
    return np.asarray(log_marginal[..., 1] - log_marginal[..., 0])


def _normalized(weight: Floats) -> Floats:
    """Return weights that sum to 1, or to 0 where all are 0."""
    return np.asarray(weight / max(weight.sum(), _TINY))
