"""Draws of the rows of Theta and of their dispersions, from the grid or from NUTS.

Both are summarized as a `ConfusionPosterior`, and predict new percepts, by the same functions.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import compress
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline
from scipy.special import expit

from meal_bayes.arrays import freeze, set_frozen
from meal_bayes.display import level_names, short_repr
from meal_bayes.domain import Domain, unknown
from meal_bayes.errors import DataError, SettingsError
from meal_bayes.posterior.dirichlet import ConfusionPosterior
from meal_bayes.posterior.dispersion import grid_posterior
from meal_bayes.posterior.grid import DISPERSIONS, RowStatistics, quadrature

Array = NDArray[np.float64]

TRUTHS = ("false", "true")
_ROW = ("attribute", "behavior", "truth")
_DIMENSIONS = 5  # (O,P,E,2,K)
_FLOOR = 1e-100  # of probabilities, whose gamma functions would overflow
_FINER = 8  # points for each of the grid's, where m is drawn


@dataclass(frozen=True, slots=True)
class Draws:
    """Draws from the joint posterior, chain by chain; C chains of S draws.

    E counts the behaviors that sense: the others have no rows here.

    Attributes
    ----------
    attributes : (P,) names.
    behaviors : (E,) names.
    mean : (C,S,P,E,2,K) m of each row.
    dispersion : (C,S,P,E,2) s of each row.
    misperception : (C,S) epsilon, where the model has one.
    others : what else was drawn: (dims after chain and draw, values).
    statistics : (C,S) each, of the sampler.
    """

    attributes: tuple[str, ...]
    behaviors: tuple[str, ...]
    mean: Array
    dispersion: Array
    misperception: Array | None = None
    others: Mapping[str, tuple[tuple[str, ...], Array]] = field(default_factory=dict)
    statistics: Mapping[str, Array] = field(default_factory=dict)

    __repr__ = short_repr

    def __post_init__(self) -> None:
        mean = freeze(np.maximum(self.mean, _FLOOR))
        set_frozen(self, mean=mean, dispersion=freeze(self.dispersion))

    @property
    def coords(self) -> dict[str, tuple[str, ...]]:
        """The names along each dimension: attribute, behavior, truth, level."""
        names = (self.attributes, self.behaviors, TRUTHS, level_names(self.mean.shape[-1]))
        return dict(zip((*_ROW, "level"), names, strict=True))

    @property
    def variables(self) -> dict[str, tuple[tuple[str, ...], Array]]:
        """Everything drawn: its dimensions after chain and draw, and its values."""
        found: dict[str, tuple[tuple[str, ...], Array]] = {
            "mean": ((*_ROW, "level"), self.mean),
            "dispersion": (_ROW, self.dispersion),
        }
        if self.misperception is not None:
            found["misperception"] = ((), self.misperception)
        return {**found, **self.others}

    @property
    def divergences(self) -> int:
        """Number of divergent transitions; 0 for draws that no chain made."""
        return int(np.sum(self.statistics.get("diverging", 0)))

    @property
    def epsilon(self) -> Array:
        """The misperception of each draw (C*S,); 0 where the model has none."""
        size = self.mean.shape[0] * self.mean.shape[1]
        return np.zeros(size) if self.misperception is None else self.misperception.ravel()

    def rows(self) -> tuple[Array, Array]:
        """Return means (C*S,P,E,2,K) and dispersions (C*S,P,E,2), chain after chain."""
        shape = self.dispersion.shape[2:]
        return self.mean.reshape(-1, *shape, self.mean.shape[-1]), self.dispersion.reshape(
            -1, *shape
        )

    @classmethod
    def from_idata(cls, idata: Any) -> "Draws":
        """Read the draws of an InferenceData or DataTree, by the names of its coordinates.

        Parameters
        ----------
        idata : InferenceData or DataTree
            Of `to_idata`, or of a model of one's own: its group posterior has `mean` (chain, draw,
            attribute, behavior, truth, level), `dispersion` without the level, and perhaps
            `misperception` (chain, draw); truths are named "false" and "true", levels as
            `level_names` has them. The order of dimensions and names is free.

        Returns
        -------
        Draws
            Truths and levels in our order.

        Raises
        ------
        DataError
            No such variables, names or values.
        """
        rows = ("chain", "draw", *_ROW)
        try:
            posterior = idata["posterior"]
            names = level_names(posterior["mean"].sizes["level"])
            ordered = {"truth": list(TRUTHS), "level": list(names)}
            mean = posterior["mean"].transpose(*rows, "level").sel(ordered)
            dispersion = posterior["dispersion"].transpose(*rows)
            along = {dim: mean[dim].values for dim in _ROW}
            dispersion = dispersion.sel(along)
        except (KeyError, ValueError, AttributeError, TypeError) as fault:
            raise DataError(
                f"This holds no posterior of confusion matrices ({fault}); expected `mean` "
                "(chain, draw, attribute, behavior, truth, level) and `dispersion` with truths "
                "'false', 'true' and our names of levels; make one with `meal-bayes posterior`, or "
                "fit_hierarchical and to_idata."
            ) from None
        m, s = mean.values, dispersion.values
        epsilon = posterior["misperception"].values if "misperception" in posterior else None
        if not ((m >= 0).all() and np.allclose(m.sum(axis=-1), 1.0, atol=1e-6)):
            raise DataError("Rows of `mean` must be probabilities that sum to 1 over the levels.")
        if not (s > 0).all():  # nor NaN
            raise DataError("`dispersion` must be above 0 everywhere; inf: objects are alike.")
        if epsilon is not None and not ((epsilon >= 0) & (epsilon <= 1)).all():
            raise DataError("`misperception` must be a probability.")
        attributes, behaviors = (tuple(map(str, along[dim])) for dim in _ROW[:2])
        return cls(attributes, behaviors, m, s, epsilon)

    def select(self, attributes: Sequence[str], behaviors: Sequence[str]) -> "Draws":
        """Keep some attributes and behaviors, in this order."""
        p = [self.attributes.index(name) for name in attributes]
        e = [self.behaviors.index(name) for name in behaviors]
        mean, dispersion = self.mean[:, :, p][:, :, :, e], self.dispersion[:, :, p][:, :, :, e]
        return Draws(tuple(attributes), tuple(behaviors), mean, dispersion, self.misperception)

    def posterior(self, counts: ArrayLike) -> ConfusionPosterior:
        """Summarize the draws for agents, given the counts (O,P,E',2,K) that they were drawn from.

        A row keeps its mean, the mean's variance (A, by sum_k m_k (1 - m_k) / (A + 1)), and the
        predictive of a second percept equal to the first (s, as on the grid). Where a fraction
        epsilon of objects shows the other truth's row, it is mixed into the row.
        """
        array = np.asarray(counts)
        whole = ConfusionPosterior.from_objects(array)
        m, s = self.rows()
        unlike = (1 - (m**2).sum(axis=-1)) * s / (s + 1)  # two percepts of one object differ
        epsilon = self.epsilon[:, None, None, None]
        mean = (1 - epsilon[..., None]) * m + epsilon[..., None] * m[..., ::-1, :]
        unlike = (1 - epsilon) * unlike + epsilon * unlike[..., ::-1]
        center, variance = mean.mean(axis=0), mean.var(axis=0).sum(axis=-1)
        weight = (1 - (center**2).sum(axis=-1)) / variance - 1
        ratio = unlike.sum(axis=0) / (1 - (mean**2).sum(axis=-1)).sum(axis=0)  # s / (s + 1)
        columns = sensing(array)
        concentration, dispersion = whole.concentration.copy(), whole.dispersion.copy()
        concentration[:, columns] = weight[..., None] * center
        dispersion[:, columns] = ratio / (1 - ratio)
        return ConfusionPosterior(whole.prior, whole.counts, concentration, dispersion)


def posterior_from(idata: Any, domain: Domain) -> ConfusionPosterior:
    """Summarize a posterior in the order of a domain; see `ConfusionPosterior.from_idata`."""
    draws = Draws.from_idata(idata)
    try:
        observed = idata["observed_data"]["counts"].transpose("object", *_ROW, "level")
        ordered = {"truth": list(TRUTHS), "level": list(draws.coords["level"])}
        observed = observed.sel(ordered)
    except (KeyError, ValueError, AttributeError) as fault:
        raise DataError(
            f"The posterior comes without the percepts it was drawn from ({fault}); give "
            "to_idata the counts (object, attribute, behavior, truth, level) as observed."
        ) from None
    for name in domain.attributes:
        if name not in draws.attributes:
            raise DataError(f"The posterior: {unknown('attribute', name, draws.attributes)}")
    for name in draws.behaviors:
        if name not in domain.behavior_names:
            raise DataError(f"The domain: {unknown('behavior', name, domain.behavior_names)}")
    behaviors = [name for name in domain.behavior_names if name in draws.behaviors]
    try:
        found = observed.sel(attribute=list(domain.attributes), behavior=behaviors).values
    except KeyError as fault:
        raise DataError(f"The percept counts lack what was drawn: {fault}.") from None
    if not ((found >= 0) & (found % 1 == 0)).all():
        raise DataError("Percept counts must be whole numbers >= 0.")
    shape = (len(found), len(domain.attributes), len(domain.behaviors), *found.shape[3:])
    counts = np.zeros(shape, np.int64)
    counts[:, :, [domain.behavior_index(name) for name in behaviors]] = found
    shown = list(compress(behaviors, sensing(found)))
    return draws.select(domain.attributes, shown).posterior(counts)


def sensing(counts: ArrayLike) -> NDArray[np.bool_]:
    """Return which behaviors (E',) of counts (O,P,E',2,K) have a percept."""
    return np.asarray(np.asarray(counts).any(axis=(0, 1, 3, 4)))


def sensed(
    counts: ArrayLike, attributes: Sequence[str], behaviors: Sequence[str]
) -> tuple[NDArray[np.int64], tuple[str, ...], tuple[str, ...]]:
    """Check counts (O,P,E',2,K) and names; keep the behaviors that sense."""
    array = np.asarray(counts)
    if array.ndim != _DIMENSIONS or array.shape[1:3] != (len(attributes), len(behaviors)):
        raise SettingsError(
            f"Counts have shape {array.shape}; expected (objects, {len(attributes)} attributes, "
            f"{len(behaviors)} behaviors, 2, levels)."
        )
    keep = sensing(array)
    if not keep.any():
        raise SettingsError("No object has a percept and a known label; there is nothing to fit.")
    return array[:, :, keep], tuple(attributes), tuple(compress(behaviors, keep))


def draw_grid(
    counts: ArrayLike,
    rng: np.random.Generator,
    *,
    attributes: Sequence[str],
    behaviors: Sequence[str],
    prior: ArrayLike | None = None,
    draws: int = 1000,
    chains: int = 4,
) -> Draws:
    """Draw independently from the posterior that `fit_dispersion` summarizes.

    Exact for two levels, up to the grid's steps; with more, m given s is Dirichlet about the
    effective counts.

    Parameters
    ----------
    counts : (O,P,E',2,K) percepts of each object.
    prior : as in `fit_dispersion`.
    """
    kept, names, sensors = sensed(counts, attributes, behaviors)
    *row, levels = kept.shape[1:]
    size = draws * chains
    rows, alpha, prob, *_ = grid_posterior(kept, prior)
    mean, dispersion = np.empty((size, *alpha.shape)), np.empty((size, len(alpha)))
    for r, each in enumerate(prob):
        steps = rng.choice(len(DISPERSIONS), size=size, p=each)
        dispersion[:, r] = DISPERSIONS[steps]
        if levels == 2:
            mean[:, r] = _two_levels(rows, alpha, r, steps, rng)
        else:
            own = rows._replace(totals=rows.totals[r : r + 1])
            mean[:, r] = draw_dirichlet(rng, alpha[r] + own.effective(dispersion[None, :, r])[0])
    return Draws(
        names,
        sensors,
        mean.reshape(chains, draws, *row, levels),
        dispersion.reshape(chains, draws, *row),
    )


def _two_levels(
    rows: RowStatistics, alpha: Array, r: int, steps: NDArray[np.int64], rng: np.random.Generator
) -> Array:
    """Draw m (S,2) of row r given the steps (S,) of s on the grid, by the inverse of its CDF."""
    nodes, log_width = quadrature(rows.largest)
    i, t = np.arange(rows.tails.shape[-1]), np.linspace(-1.0, 1.0, nodes.shape[1])
    fine = np.linspace(-1.0, 1.0, _FINER * (len(t) - 1) + 1)
    log_odds = CubicSpline(t, np.log(nodes[1]) - np.log(nodes[0]))(fine)
    mean = np.empty((len(steps), 2))
    for g in np.unique(steps):
        rising = np.log(DISPERSIONS[g] * nodes[:, None] + i[:, None])  # (2,I,M)
        score = log_width + alpha[r] @ np.log(nodes)
        score += np.einsum("ki,kim->m", rows.tails[r], rising)
        score = CubicSpline(t, score)(fine)
        density = np.exp(score - score.max())
        cdf = np.cumsum(density) - density / 2  # a point stands in the middle of its width
        here = steps == g
        at = np.interp(rng.random(here.sum()), cdf / density.sum(), log_odds)
        mean[here] = expit(np.stack([-at, at], axis=-1))
    return mean


def replicate(
    draws: Draws, counts: ArrayLike, rng: np.random.Generator, *, size: int = 200
) -> NDArray[np.int64]:
    """Draw percepts of new objects as many as were seen, (size,O,P,E,2,K).

    Each replicate takes one draw of the rows, then an own row theta ~ Dirichlet(s m) for each
    object, then its percepts; with a misperception, an object shows the other truth's row with
    that probability, in all its behaviors alike.

    Parameters
    ----------
    counts : (O,P,E',2,K), the percepts seen: how many there are, and of which truth.
    size : replicates, taken evenly from the draws.
    """
    array = np.asarray(counts)
    kept = array[:, :, sensing(array)]
    number = kept.sum(axis=-1)  # (O,P,E,2)
    mean, s = draws.rows()
    picked = np.linspace(0, len(mean) - 1, size).astype(int)
    found = np.empty((size, *kept.shape), dtype=np.int64)
    for n, index in enumerate(picked):
        alpha = np.broadcast_to(s[index, ..., None] * mean[index], kept.shape)
        swap = rng.random(kept.shape[:2]) < draws.epsilon[index]
        alpha = np.where(swap[:, :, None, None, None], alpha[..., ::-1, :], alpha)
        found[n] = rng.multinomial(number, draw_dirichlet(rng, alpha))
    return found


def draw_dirichlet(rng: np.random.Generator, alpha: Array) -> Array:
    """Draw one point from each Dirichlet distribution of parameters (...,K)."""
    gamma = np.maximum(rng.standard_gamma(alpha), np.finfo(float).tiny)
    return np.asarray(gamma / gamma.sum(axis=-1, keepdims=True))
