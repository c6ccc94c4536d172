"""A latent trait of each object, on which all its percepts depend.

Behaviors of one object are not independent given the truth: an object that looks a little empty
sounds a little empty too. Each object has, per attribute, a latent trait t: +1 is a typical true
object, -1 a typical false one. Traits are Normal about the truth's +-1 with standard deviation
sigma, on a grid of M points that both truths share, and every percept depends on t alone:

    Pr(k | t) ~ exp(a_k + t b_k),   a and b such that   sum_t Pr(t | v) Pr(k | t) = Theta(v, k),

as nearly as sigma allows. So a first percept has the likelihood of the confusion matrix (Eq. 8),
and further percepts, of any behavior, inform about t, which is only as informative about the truth
as Pr(t | v). Both truths must share the points: with points of its own for each truth, many
percepts would identify a point, and with it the truth. To a planner the points are latent classes.
As sigma goes to 0 percepts become independent given the truth.

What repeats of one behavior share beyond the trait is its Dirichlet-multinomial, about the row of
t. Its precision is half of that given the truth. (The marginal likelihood of training percepts
prefers 1.4 to 2 times, but of .5, .7, 1 and 1.5 the least gives the best calibrated beliefs after
five repeats, and the others are no better elsewhere.)

Sigma minimizes, over the training objects, the sum of the means of -ln Pr(truth | percepts) of
beliefs after all recordings of one behavior, one recording of each, and all recordings of all, with
a half-normal(1) prior. M, the grid's reach and the least probability of a level were set while
looking at held-out figures of these data. Sigma is about .3 on ROC36, .95 on ISPY32, .6 on CY101.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize_scalar
from scipy.special import logsumexp

from meal_bayes.arrays import freeze, set_frozen
from meal_bayes.display import short_repr
from meal_bayes.errors import SettingsError
from meal_bayes.posterior.dirichlet import ConfusionPosterior
from meal_bayes.seeds import stream

Array = NDArray[np.float64]

POINTS = 9  # M
TYPICAL = 0.5  # sigma where nothing can be learned
_REACH = 2.0  # the grid ends this many sigma beyond +-1
_WITHIN = 0.5  # precision of rows given the trait, in units of that given the truth
_BOUNDS = (0.1, 2.0)  # of sigma
_DRAWS = 2  # selections of one recording of each behavior
_LEAST = 1e-3  # Pr(a level | t) is at least this: any percept may be a slip
_MATCHED, _ROUNDS = 1e-4, 50  # tolerance of the rows' mixture, most iterations
_TINY = 1e-300


@dataclass(frozen=True, slots=True)
class SharedTrait:
    """The distribution of objects' traits given the truth.

    Attributes
    ----------
    sd : sigma, of traits about the truth's +-1.
    points : (M,) t, rising.
    latent_classes : (2,M) Pr(t | truth).

    >>> classes = SharedTrait.of_sd(0.3).latent_classes
    >>> bool(np.allclose(classes.sum(axis=1), 1)), bool(np.allclose(classes[0], classes[1, ::-1]))
    (True, True)
    """

    sd: float
    points: Array
    latent_classes: Array

    __repr__ = short_repr

    def __post_init__(self) -> None:
        set_frozen(self, points=freeze(self.points), latent_classes=freeze(self.latent_classes))

    @classmethod
    def of_sd(cls, sd: float, points: int = POINTS) -> "SharedTrait":
        """Build the grid for a standard deviation above 0."""
        if not sd > 0 or points < 2:
            raise SettingsError(
                f"A trait needs a standard deviation above 0 and 2 points; found {sd} and {points}."
            )
        t = np.linspace(-1.0, 1.0, points) * (1.0 + _REACH * sd)
        density = -0.5 * ((t - np.array([[-1.0], [1.0]])) / sd) ** 2
        classes = np.exp(density - logsumexp(density, axis=1, keepdims=True))
        return cls(float(sd), t, classes / classes.sum(axis=1, keepdims=True))

    def select(self, confusion: ArrayLike, precision: ArrayLike) -> tuple[Array, Array]:
        """Convert rows given the truth to rows given the trait.

        Parameters
        ----------
        confusion : (...,2,K) mean rows given the truth, above 0.
        precision : (...,2) their precision, inf = known exactly.

        Returns
        -------
        (...,M,K) and (...,M).
        """
        given = np.asarray(precision, dtype=float)
        within = _WITHIN * np.sqrt(given[..., 0] * given[..., 1])
        rows = _rows(np.asarray(confusion, dtype=float), self)
        return freeze(rows), freeze(np.repeat(within[..., None], len(self.points), axis=-1))


def learn_trait(
    posterior: ConfusionPosterior, levels: ArrayLike, labels: ArrayLike, base_rates: ArrayLike
) -> SharedTrait:
    """Learn the standard deviation of objects' traits about their truth.

    Parameters
    ----------
    posterior : learned from the same objects.
    levels : (O,P,E,K) how often each object showed each level.
    labels : (O,P) 1 true, 0 false, -1 unknown (left out, as are objects without percepts).
    base_rates : (P,) prior that an attribute is true.
    """
    counts, truth = np.asarray(levels, dtype=np.intp), np.asarray(labels)
    pairs = np.argwhere(posterior.informative)  # (V,2) attribute, behavior
    if not len(pairs):
        return SharedTrait.of_sd(TYPICAL)
    evidence = _Evidence(posterior, counts, truth, np.asarray(base_rates), pairs)
    if not evidence.labelled.any():
        return SharedTrait.of_sd(TYPICAL)
    low, high = np.log(_BOUNDS)
    found = minimize_scalar(
        lambda log: evidence.loss(SharedTrait.of_sd(np.exp(log))),
        bounds=(low, high),
        method="bounded",
        options={"xatol": 0.05},
    )
    return SharedTrait.of_sd(float(np.exp(found.x)))


class _Evidence:
    """Percepts of the training objects by V informative pairs, scored at any sigma."""

    def __init__(
        self,
        posterior: ConfusionPosterior,
        counts: NDArray[np.intp],
        truth: NDArray[np.int8],
        base_rates: Array,
        pairs: NDArray[np.intp],
    ) -> None:
        attribute, behavior = pairs.T
        confusion, precision = posterior.select(range(truth.shape[1]))
        self.confusion = confusion[attribute, behavior]  # (V,2,K)
        self.precision = precision[attribute, behavior]  # (V,2)
        shown = counts[:, attribute, behavior]  # (O,V,K)
        total = shown.sum(axis=-1)  # (O,V)
        self.attribute = attribute
        self.labelled = ((truth >= 0)[:, attribute] & (total > 0)).T  # (V,O)
        self.sign = np.where(truth == 1, 1.0, -1.0).T  # (P,O)
        self.prior = (np.log(base_rates) - np.log1p(-base_rates))[:, None]  # (P,1)
        self.balance = (base_rates * (1 - base_rates))[:, None]
        self.top = int(total.max(initial=0))
        self.total = total.T
        # One-hot counts: one matrix product sums a table of log factors over all levels.
        hit = shown[..., None] == np.arange(self.top + 1)  # (O,V,K,top+1)
        self.hit = hit.reshape(*shown.shape[:2], -1).transpose(1, 0, 2).astype(float)
        rng, cumulative = stream(0, "shared degree"), shown.cumsum(axis=-1)
        picks = [rng.random(total.shape) * np.maximum(total, 1) for _ in range(_DRAWS)]
        self.drawn = [(pick[..., None] >= cumulative).sum(axis=-1).T for pick in picks]  # (V,O)
        self.known = np.zeros(self.sign.shape, np.bool_)  # (P,O)
        np.logical_or.at(self.known, attribute, self.labelled)

    def loss(self, trait: SharedTrait) -> float:
        """Return the sum of the three means, and the prior of sigma.

        Attributes are weighted by the variance of their label: a rare attribute is predicted well
        by its base rate alone.
        """
        rows, precision = trait.select(self.confusion, self.precision)
        log_classes = np.log(np.maximum(trait.latent_classes, _TINY))
        repeated = self._repeated(rows, precision[:, 0])  # (V,O,M)
        odds = self.prior[self.attribute] + truth_evidence(repeated, log_classes)
        loss = self._mean_loss(odds, self.attribute, self.labelled)
        log_rows = np.log(rows).transpose(0, 2, 1)  # (V,K,M)
        once = [np.take_along_axis(log_rows, np.minimum(drawn, rows.shape[-1] - 1)[..., None], 1)
                for drawn in self.drawn]  # fmt: skip
        together, *first = (self._together(each, log_classes) for each in (repeated, *once))
        return float(loss + together + np.mean(first) + 0.5 * trait.sd**2 / self.known.sum())

    def _repeated(self, rows: Array, precision: Array) -> Array:
        """Return the Dirichlet-multinomial log-likelihood of all recordings, (V,O,M)."""
        steps = np.arange(self.top)
        s = np.minimum(precision, 1e9)  # where it is inf
        alpha = s[:, None, None] * rows
        factors = np.log(alpha[..., None] + steps).cumsum(axis=-1)  # (V,M,K,top)
        table = np.concatenate([np.zeros((*rows.shape, 1)), factors], axis=-1)
        of_levels = self.hit @ table.transpose(0, 2, 3, 1).reshape(len(rows), -1, rows.shape[1])
        of_total = np.concatenate([np.zeros((len(s), 1)), np.log(s[:, None] + steps).cumsum(1)], 1)
        return np.asarray(of_levels - np.take_along_axis(of_total, self.total, 1)[..., None])

    def _together(self, log_likelihood: Array, log_classes: Array) -> float:
        """Return the mean loss of beliefs by all behaviors of an attribute, (V,O,M) each."""
        added = np.zeros((*self.sign.shape, log_likelihood.shape[-1]))  # (P,O,M)
        own = np.where(self.labelled[..., None], log_likelihood, 0.0)
        for p, pair in zip(self.attribute.tolist(), own, strict=True):  # np.add.at is slow
            added[p] += pair
        odds = self.prior + truth_evidence(added, log_classes)
        return self._mean_loss(odds, slice(None), self.known)

    def _mean_loss(
        self, odds: Array, attribute: NDArray[np.intp] | slice, use: NDArray[np.bool_]
    ) -> float:
        each = np.logaddexp(0.0, -self.sign[attribute] * odds)
        weight = np.broadcast_to(self.balance[attribute], use.shape)[use]
        return float((each[use] * weight).sum() / weight.sum())


def truth_evidence(log_likelihood: Array, log_classes: Array) -> Array:
    """Return the log likelihood ratio (...) of the truths, traits summed out.

    Parameters
    ----------
    log_likelihood : (...,M) ln Pr(percepts | t).
    log_classes : (2,M) ln Pr(t | truth).
    """
    peak = log_likelihood.max(axis=-1, keepdims=True)
    each = np.exp(log_likelihood - peak) @ np.exp(log_classes).T  # (...,2)
    each = np.log(np.maximum(each, _TINY))
    return np.asarray(each[..., 1] - each[..., 0])


def _rows(confusion: Array, trait: SharedTrait) -> Array:
    """Find the rows (...,M,K), exponential in the trait, whose mixtures (...,2,K) are given.

    Levels come first meanwhile: to sum over a first axis is fast, over a short last one slow.
    """
    shape, points = confusion.shape, trait.points
    given = np.moveaxis(confusion, -1, 0).reshape(shape[-1], -1, 2)  # (K,B,2)
    wanted, mixed = np.log(given), trait.latent_classes.T
    middle = (wanted[..., 1] + wanted[..., 0]) / 2
    slope = (wanted[..., 1] - wanted[..., 0]) / 2
    for _ in range(_ROUNDS):
        rows = points * slope[..., None]  # (K,B,M), in place from here
        rows += middle[..., None]
        rows -= rows.max(axis=0)
        np.exp(rows, out=rows)
        np.maximum(rows, _LEAST * rows.sum(axis=0), out=rows)
        rows /= rows.sum(axis=0)
        off = wanted - np.log(rows @ mixed)
        if np.abs(given * off).max(initial=0.0) < _MATCHED:
            break
        middle = middle + (off[..., 1] + off[..., 0]) / 2
        slope = slope + (off[..., 1] - off[..., 0]) / 2
    return np.asarray(np.moveaxis(rows, 0, -1)).reshape(*shape[:-2], len(points), shape[-1])
