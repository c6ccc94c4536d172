"""How far all percepts of an object err together: a degree that they share.

Behaviors of one object are not independent given the truth: an object that looks a little empty
sounds a little empty too. Each object has, per attribute, a *degree* t: +1 a typical true object,
-1 a typical false one, 0 in between. Degrees are Normal about the truth's +-1 with a spread sigma,
on a grid of M points that both truths share, and every percept depends on t alone:

    Pr(k | t) ~ exp(a_k + t b_k),   a and b such that   sum_t Pr(t | v) Pr(k | t) = Theta(v, k).

as nearly as the spread allows. So a first percept is worth what the confusion matrix says (Eq. 8),
and more of them, by whatever behavior, tell ever more of t, which tells only so much of the truth.
Both truths must share the points: of points of their own, many percepts would single out one, and
with it the truth. To a planner the points are latent classes that truths share. As sigma goes to 0
percepts become independent given the truth.

What repeats of one behavior share beyond the degree is its Dirichlet-multinomial, now about the row
of t. Its precision is half of that given the truth. (The marginal likelihood of training percepts
has it at 1.4 to 2 times, but of .5, .7, 1 and 1.5 the least gives the best calibrated beliefs after
five repeats, and costs the others nothing.)

Sigma is learned from the training objects: the least sum of the mean of -ln Pr(truth | percepts)
over beliefs by all recordings of one behavior, one recording of each, and all recordings of all,
with half-normal(1) as its prior. M, the grid's reach and the least probability of a level were set
while looking at held-out figures of these data. Sigma is about .3 on ROC36, .95 on ISPY32, .6 on
CY101.
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
_WITHIN = 0.5  # precision of rows given the degree, in units of that given the truth
_BOUNDS = (0.1, 2.0)  # of sigma
_DRAWS = 2  # selections of one recording of each behavior
_LEAST = 1e-3  # Pr(a level | t): at any degree a percept may be a slip
_MATCHED, _ROUNDS = 1e-4, 50  # the rows' mixture is the confusion matrix to this, at most so long


@dataclass(frozen=True, slots=True)
class SharedDegree:
    """The degrees of objects: where they lie and how they spread about the truth.

    >>> kinds = SharedDegree.of_spread(0.3).kinds
    >>> bool(np.allclose(kinds.sum(axis=1), 1)), bool(np.allclose(kinds[0], kinds[1, ::-1]))
    (True, True)
    """

    spread: float  # sigma
    points: Array  # (M,) t, rising
    kinds: Array  # (2,M) Pr(t | truth)

    __repr__ = short_repr

    def __post_init__(self) -> None:
        set_frozen(self, points=freeze(self.points), kinds=freeze(self.kinds))

    @classmethod
    def of_spread(cls, spread: float, points: int = POINTS) -> "SharedDegree":
        """Lay the grid for a spread sigma > 0."""
        if not spread > 0 or points < 2:
            raise SettingsError(
                f"A degree needs a spread above 0 and 2 points; found {spread} and {points}."
            )
        t = np.linspace(-1.0, 1.0, points) * (1.0 + _REACH * spread)
        density = -0.5 * ((t - np.array([[-1.0], [1.0]])) / spread) ** 2
        kinds = np.exp(density - logsumexp(density, axis=1, keepdims=True))
        return cls(float(spread), t, kinds / kinds.sum(axis=1, keepdims=True))

    def select(self, confusion: ArrayLike, precision: ArrayLike) -> tuple[Array, Array]:
        """Turn rows of the truth into rows of the degree.

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
        rows = _rows(np.asarray(confusion, dtype=float), self.points, self.kinds)
        return freeze(rows), freeze(np.repeat(within[..., None], len(self.points), axis=-1))


def learn_degree(
    posterior: ConfusionPosterior, levels: ArrayLike, labels: ArrayLike, base_rates: ArrayLike
) -> SharedDegree:
    """Learn how the degrees of objects spread about their truth.

    Parameters
    ----------
    posterior : learned from the same objects.
    levels : (O,P,E,K) how often each object showed each level.
    labels : (O,P) 1 true, 0 false, -1 unknown (left out); objects without percepts tell nothing.
    base_rates : (P,) prior that an attribute is true.
    """
    counts, truth = np.asarray(levels, dtype=np.intp), np.asarray(labels)
    pairs = np.argwhere(posterior.informative)  # (V,2) attribute, behavior
    if not len(pairs):
        return SharedDegree.of_spread(TYPICAL)
    evidence = _Evidence(posterior, counts, truth, np.asarray(base_rates), pairs)
    if not evidence.labelled.any():
        return SharedDegree.of_spread(TYPICAL)
    low, high = np.log(_BOUNDS)
    found = minimize_scalar(
        lambda log: evidence.loss(SharedDegree.of_spread(np.exp(log))),
        bounds=(low, high),
        method="bounded",
        options={"xatol": 0.05},
    )
    return SharedDegree.of_spread(float(np.exp(found.x)))


class _Evidence:
    """What the training objects showed, V informative pairs; scored at any spread."""

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
        # Which count of which level: a table of log factors is summed by one matrix product.
        hit = shown[..., None] == np.arange(self.top + 1)  # (O,V,K,top+1)
        self.hit = hit.reshape(*shown.shape[:2], -1).transpose(1, 0, 2).astype(float)
        rng, cumulative = stream(0, "shared degree"), shown.cumsum(axis=-1)
        picks = [rng.random(total.shape) * np.maximum(total, 1) for _ in range(_DRAWS)]
        self.drawn = [(pick[..., None] >= cumulative).sum(axis=-1).T for pick in picks]  # (V,O)
        self.known = np.zeros(self.sign.shape, np.bool_)  # (P,O)
        np.logical_or.at(self.known, attribute, self.labelled)

    def loss(self, degree: SharedDegree) -> float:
        """Give the sum of the three means, and the prior of sigma.

        Attributes have the weight of their label's variance: of those that hardly any object has,
        every belief is good.
        """
        rows, precision = degree.select(self.confusion, self.precision)
        log_kinds = np.log(np.maximum(degree.kinds, 1e-300))
        seen = self._repeated(rows, precision[:, 0])  # (V,O,M)
        each = self._loss(self.attribute, seen, log_kinds, self.labelled)
        together = self._loss(slice(None), self._add(seen), log_kinds, self.known)
        log_rows = np.log(rows).transpose(0, 2, 1)  # (V,K,M)
        once = [np.take_along_axis(log_rows, np.minimum(drawn, rows.shape[-1] - 1)[..., None], 1)
                for drawn in self.drawn]  # fmt: skip
        first = np.mean(
            [self._loss(slice(None), self._add(s), log_kinds, self.known) for s in once]
        )
        return float(each + together + first + 0.5 * degree.spread**2 / self.known.sum())

    def _repeated(self, rows: Array, precision: Array) -> Array:
        """Dirichlet-multinomial log-likelihood of all recordings at each degree, (V,O,M)."""
        steps = np.arange(self.top)
        s = np.minimum(precision, 1e9)  # where it is inf
        alpha = s[:, None, None] * rows
        factors = np.log(alpha[..., None] + steps).cumsum(axis=-1)  # (V,M,K,top)
        table = np.concatenate([np.zeros((*rows.shape, 1)), factors], axis=-1)
        of_levels = self.hit @ table.transpose(0, 2, 3, 1).reshape(len(rows), -1, rows.shape[1])
        of_total = np.concatenate([np.zeros((len(s), 1)), np.log(s[:, None] + steps).cumsum(1)], 1)
        return np.asarray(of_levels - np.take_along_axis(of_total, self.total, 1)[..., None])

    def _add(self, seen: Array) -> Array:
        """Add up the behaviors of each attribute, (V,O,M) -> (P,O,M)."""
        out = np.zeros((*self.sign.shape, seen.shape[-1]))
        np.add.at(out, self.attribute, np.where(self.labelled[..., None], seen, 0.0))
        return out

    def _loss(
        self, attribute: NDArray[np.intp] | slice, seen: Array, log_kinds: Array,
        use: NDArray[np.bool_],
    ) -> float:  # fmt: skip
        odds = self.prior[attribute] + truth_evidence(seen, log_kinds)
        each = np.logaddexp(0.0, -self.sign[attribute] * odds)
        weight = np.broadcast_to(self.balance[attribute], use.shape)[use]
        return float((each[use] * weight).sum() / weight.sum())


def truth_evidence(seen: Array, log_kinds: Array) -> Array:
    """Log ratio (...) that the truth is "true": ln sum_t Pr(t | v) e^seen[t] of both, (...,M)."""
    peak = seen.max(axis=-1, keepdims=True)
    each = np.exp(seen - peak) @ np.exp(log_kinds).T  # (...,2)
    each = np.log(np.maximum(each, 1e-300))
    return np.asarray(each[..., 1] - each[..., 0])


def _rows(confusion: Array, points: Array, kinds: Array) -> Array:
    """Rows (...,M,K) exponential in the degree whose mixtures (...,2,K) are given."""
    wanted = np.log(confusion)
    middle = (wanted[..., 1, :] + wanted[..., 0, :]) / 2
    slope = (wanted[..., 1, :] - wanted[..., 0, :]) / 2
    for _ in range(_ROUNDS):
        score = middle[..., None, :] + points[:, None] * slope[..., None, :]
        rows = np.exp(score - score.max(axis=-1, keepdims=True))
        rows = np.maximum(rows, _LEAST * rows.sum(axis=-1, keepdims=True))
        rows /= rows.sum(axis=-1, keepdims=True)
        off = wanted - np.log(kinds @ rows)  # (...,2,K)
        if np.abs(confusion * off).max(initial=0.0) < _MATCHED:
            break
        middle = middle + (off[..., 1, :] + off[..., 0, :]) / 2
        slope = slope + (off[..., 1, :] - off[..., 0, :]) / 2
    return np.asarray(rows)
