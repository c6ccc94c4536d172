"""Hierarchical models by NUTS (PyMC): the model of `grid`, and one with more parameters.

Both models integrate out each object's row theta ~ Dirichlet(s m), by rising factorials (see
`grid`). This needs a few logarithms per row for all objects; PyMC's BetaBinomial would need six
gamma functions and their derivatives for each object.

`same` is the model of `grid`: the attributes of a behavior share ln s ~ Normal(mu, tau) for each
truth, and m has the prior that the grid learned. `crossed` pools the log-odds of m and ln s over
attributes and over behaviors, with a residual for each pair. In `crossed`, an object is
misperceived with probability epsilon: all behaviors then show the rows of the other truth.

Effects have a non-centered parametrization (spread x standard normal) and sum to zero over the
crossed dimensions, which avoids funnels and ridges in the posterior.
"""

import os
import warnings
from collections.abc import Callable, Sequence
from itertools import count
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy.special import gammaln

from meal_bayes.arrays import Ints
from meal_bayes.cache import scratch_folder, writable_caches
from meal_bayes.look import level_names
from meal_bayes.perception.confusion import informative
from meal_bayes.posterior.draws import ROW, TRUTHS, Sampling
from meal_bayes.posterior.grid import DISPERSIONS, LOG_TAU_PRIOR, TAUS, prior_of
from meal_bayes.processes import ending_context
from meal_bayes.seeds import stream

# PyTensor loads the contents of its compile folder, so other users must not be able to write there.
# It looks for a BLAS, with a warning if there is none; these models do not need one. With Numba,
# the default from PyTensor 3.0 on, newly compiled code and loaded code round differently unless the
# order of sums is kept, so the first run with a seed would differ from later ones.
_folder = scratch_folder("pytensor")
_user = os.environ.get("PYTENSOR_FLAGS", "")
_flags = f"base_compiledir={_folder},blas__ldflags=,numba__fastmath=False"
os.environ["PYTENSOR_FLAGS"] = f"{_flags},{_user}"  # the last wins
with writable_caches(), warnings.catch_warnings():  # ArviZ 0.x announces 1.0 on import
    warnings.filterwarnings("ignore", r"\s*ArviZ is undergoing", FutureWarning)
    import pymc as pm
    import pytensor.tensor
    from pytensor.configdefaults import config
pt: Any = pytensor.tensor  # not typed

ACCEPT = 0.9  # target acceptance: smaller steps than by default, to avoid divergences
_LOG_S = np.log(DISPERSIONS)
_LOG_S_STEP = float(_LOG_S[1] - _LOG_S[0])
# A point of the grid represents a cell around it.
_LOW = float(_LOG_S[0]) - _LOG_S_STEP / 2
_HIGH = float(_LOG_S[-1]) + _LOG_S_STEP / 2
_ROOT_2 = np.sqrt(2.0)
_ROOT_2_PI = np.sqrt(2.0 * np.pi)
_LEAN = 0.7  # prior log-odds of the last level for true objects, and of the first for false ones
_MISPERCEIVED = 0.05  # prior scale of epsilon
_SPREAD = 0.3  # of the logarithm of a width that only helps the sampler
_INNER = "_standard"  # suffix of the names of auxiliary variables

Progress = Callable[[int, int], None]


def fit_hierarchical(
    counts: ArrayLike,
    *,
    attributes: Sequence[str],
    behaviors: Sequence[str],
    model: str = "same",
    prior: ArrayLike | None = None,
    sampling: Sampling | None = None,
    progress: Progress | None = None,
) -> tuple[xr.Dataset, xr.Dataset]:
    """Draw from the posterior of a hierarchical model.

    Parameters
    ----------
    counts : ArrayLike
        (O,P,E,2,K) percepts of each object by the behaviors that sense.
    attributes, behaviors : Sequence[str]
        (P,) and (E,) names.
    model : str
        "same" for the model of `grid`, or "crossed".
    prior : ArrayLike, optional
        Prior of m in the model "same", (P,E,2,K) or an array that broadcasts to this shape. By
        default, the prior that the grid learns.
    sampling : Sampling, optional
        Settings of NUTS.
    progress : Callable[[int, int], None], optional
        Function that is called with the number of finished steps and of all steps.

    Returns
    -------
    draws : xr.Dataset
        The draws (see `posterior.draws`).
    statistics : xr.Dataset
        Statistics of the sampler.

    Raises
    ------
    KeyboardInterrupt
        If sampling was interrupted, because incomplete draws do not represent the posterior.
    """
    built = build_model(np.asarray(counts), attributes, behaviors, model=model, prior=prior)
    trace = sample(built, sampling or Sampling(), progress=progress)
    groups = (trace[name].data_vars for name in ("posterior", "sample_stats"))
    posterior, stats = map(xr.Dataset, groups)  # of PyMC's data sets, from PyMC 6 on trees
    inner = [name for name in posterior.data_vars if str(name).endswith(_INNER)]
    numbers = [
        name
        for name, values in stats.data_vars.items()
        if values.dims == ("chain", "draw") and values.dtype.kind in "biuf"
    ]
    # as in files, without PyMC's notes about the machine
    draws = xr.Dataset(posterior.drop_vars(inner).variables)
    return draws, xr.Dataset(stats[numbers].variables)


def build_model(
    counts: Ints,
    attributes: Sequence[str],
    behaviors: Sequence[str],
    *,
    model: str = "same",
    prior: ArrayLike | None = None,
) -> "pm.Model":
    """Build the PyMC model of counts (O,P,E,2,K) in which every behavior senses."""
    names = attributes, behaviors, TRUTHS, level_names(counts.shape[-1])
    coords = dict(zip((*ROW, "level"), map(list, names), strict=True))
    patterns, pattern_of = _patterns(counts)
    with pm.Model(coords=coords) as built:
        mean, s = _same(counts, prior) if model == "same" else _crossed()
        scores = _score(patterns, mean, s)  # (U,2)
        if model == "same":
            perceived = np.asarray(counts.any(axis=-1))  # (O,P,E,2)
            by_truth = (pattern_of[perceived[..., t]] for t in (0, 1))
            number = [np.bincount(shown_of, minlength=len(patterns)) for shown_of in by_truth]
            pm.Potential("percepts", (np.stack(number, axis=-1) * scores).sum())
        else:
            half = pm.Beta("half_standard", 1.0, 0.5 / _MISPERCEIVED)
            epsilon = pm.Deterministic("misperception", half / 2)  # or false and true could swap
            pm.Potential("percepts", _shared_class(counts, pattern_of, scores, epsilon))
    return built


def _same(counts: Ints, prior: ArrayLike | None) -> tuple[Any, Any]:
    """Build the model of `grid` with continuous s and m; tau is summed over the grid's values."""
    alpha = prior_of(counts, prior)
    votes = informative(counts.sum(axis=0).astype(float))  # the pairs that determine mu
    mu = pm.Uniform("mu", _LOW, _HIGH, dims=("behavior", "truth"))
    # Rows are parametrized relative to mu, in the log-odds of their position between the ends, and
    # scaled by an auxiliary width, so that mu moves all rows together and there is no funnel. The
    # width has its own distribution around the tau that fits the rows; it does not change theirs.
    width = pm.Flat("width_standard", dims=("behavior", "truth"))  # log
    middle = pm.math.logit((mu - _LOW) / (_HIGH - _LOW))
    log_odds = middle + pt.exp(width) * pm.Flat("log_s_standard", dims=ROW)
    log_s = _LOW + (_HIGH - _LOW) * pm.math.sigmoid(log_odds)
    jacobian = (width - pt.softplus(log_odds) - pt.softplus(-log_odds)).sum()
    center = mu[..., None]
    tau = TAUS  # (T,)
    inside = pt.log(
        pt.erf((_HIGH - center) / _ROOT_2 / tau) - pt.erf((_LOW - center) / _ROOT_2 / tau)
    )
    share = -0.5 * ((log_s[..., None] - center) / tau) ** 2 - inside - np.log(tau * _ROOT_2_PI / 2)
    by_tau = (votes[..., None, None] * share).sum(axis=0) + LOG_TAU_PRIOR  # (E,2,T)
    mean_tau = (pm.math.softmax(by_tau, axis=-1) * tau).sum(axis=-1)
    law = -0.5 * ((width - pt.log(mean_tau)) / _SPREAD) ** 2
    pm.Potential("pooling", pm.math.logsumexp(by_tau, axis=-1).sum() + jacobian + law.sum())
    pm.Deterministic("tau", mean_tau, dims=("behavior", "truth"))  # given the rest
    mean = pm.Dirichlet("mean", alpha, dims=(*ROW, "level"))
    return mean, pm.Deterministic("dispersion", pt.exp(log_s), dims=ROW)


def _crossed() -> tuple[Any, Any]:
    """Build crossed effects of attributes and behaviors on the log-odds of m and on ln s."""
    levels = len(pm.modelcontext(None).coords["level"])
    lean = np.linspace(-1.0, 1.0, levels) * [[-_LEAN], [_LEAN]]
    odds = pm.ZeroSumNormal("log_odds_center", 1.5, dims=("truth", "level"))
    center = pm.Normal("log_s_center", np.log(4.0), 1.5, dims="truth")
    log_odds = (lean + odds)[:, None, None] + _effects("log_odds", ("level",))
    log_s = center[:, None, None] + _effects("log_s", ())
    mean = pm.math.softmax(log_odds.transpose(1, 2, 0, 3), axis=-1)
    mean = pm.Deterministic("mean", mean, dims=(*ROW, "level"))
    s = pm.Deterministic("dispersion", pt.exp(log_s.transpose(1, 2, 0)), dims=ROW)
    return mean, s


def _effects(name: str, inner: tuple[str, ...]) -> Any:
    """Add the effects of attributes, of behaviors and of their pairs, (2,P,E,*inner)."""
    coords = pm.modelcontext(None).coords
    total: Any = 0.0
    pairs = ("attribute", "behavior")
    for crossed, absent in (pairs[:1], [2]), (pairs[1:], [1]), (pairs, []):
        if any(len(coords[dim]) < 2 for dim in crossed):  # nothing to compare
            continue
        label = f"{name}_{'_'.join(crossed)}"
        spread = pm.HalfNormal(f"{label}_spread", 1.0, dims="truth")
        dims = (*crossed, *inner)
        z = pm.ZeroSumNormal(f"{label}_standard", dims=("truth", *dims), n_zerosum_axes=len(dims))
        total = total + spread.reshape((2, 1, 1, *(1 for _ in inner))) * pt.expand_dims(z, absent)
    return total


def _patterns(counts: Ints) -> tuple[Ints, Ints]:
    """Find the distinct (p, e, counts) (U,2+K), and the index of each object's pattern (O,P,E).

    An object without percepts of a pair has the index U.
    """
    percepts = counts.sum(axis=3)  # (O,P,E,K)
    o, p, e = np.nonzero(percepts.any(axis=-1))
    rows = np.column_stack([p, e, percepts[o, p, e]])
    patterns, index = np.unique(rows, axis=0, return_inverse=True)
    pattern_of = np.full(percepts.shape[:3], len(patterns))
    pattern_of[o, p, e] = index.ravel()
    return patterns, pattern_of


def _score(patterns: Ints, mean: Any, s: Any) -> Any:
    """Compute the log-probability (U,2) of each pattern under the row of each truth."""
    p = patterns[:, 0]
    e = patterns[:, 1]
    k = patterns[:, 2:]
    n = k.sum(axis=-1)
    log_rising = _rising(s[..., None] * mean, int(k.max()))  # (P,E,2,K,I+1)
    log_total = _rising(s, int(n.max()))  # (P,E,2,J+1)
    level = np.arange(k.shape[-1])
    seen = log_rising[p[:, None], e[:, None], :, level, k].sum(axis=1)  # (U,2)
    ways = gammaln(n + 1) - gammaln(k + 1).sum(axis=-1)  # in which the same counts come about
    return ways[:, None] + seen - log_total[p, e, :, n]


def _rising(x: Any, most: int) -> Any:
    """Return the logarithm of x (x + 1) ... (x + i - 1) for i = 0 .. most, along a last axis."""
    steps = pt.log(x[..., None] + np.arange(most))
    return pt.concatenate([pt.zeros_like(x)[..., None], pt.cumsum(steps, axis=-1)], axis=-1)


def _shared_class(counts: Ints, pattern_of: Ints, scores: Any, epsilon: Any) -> Any:
    """Sum over whether each object is misperceived, which is the same for all its behaviors.

    `checks._misperceived` lists the other functions that use this model.
    """
    by_truth = np.asarray(counts.any(axis=(2, 4)))  # (O,P,2)
    o, p = np.nonzero(by_truth.any(axis=-1))
    truth = by_truth[o, p, 1].astype(int)
    padded = pt.concatenate([scores, pt.zeros((1, 2))])
    evidence = padded[pattern_of[o, p]].sum(axis=1)  # (n,2)
    pair = np.arange(len(o))
    of_truth = evidence[pair, truth]
    of_other = evidence[pair, 1 - truth]
    return pt.logaddexp(pt.log1p(-epsilon) + of_truth, pt.log(epsilon) + of_other).sum()


def sample(
    model: "pm.Model", sampling: Sampling, name: str = "mcmc", progress: Progress | None = None
) -> Any:
    """Run NUTS with the random stream `name`; raise `KeyboardInterrupt` if it is interrupted."""
    total = (sampling.draws + sampling.tune) * sampling.chains
    steps = count(1)
    call = None if progress is None else lambda **_: progress(next(steps), total)
    # Without a C compiler, use Numba, which is a dependency of this package.
    mode = {} if config.cxx else {"compile_kwargs": {"mode": "NUMBA"}}
    with warnings.catch_warnings():
        # Chains in processes: forked ones inherit idle threads only.
        warnings.filterwarnings("ignore", ".*multi-threaded, use of fork", DeprecationWarning)
        try:
            trace = pm.sample(
                sampling.draws,
                tune=sampling.tune,
                chains=sampling.chains,
                # PyMC's own default counts half of the processors
                cores=sampling.jobs or min(sampling.chains, os.cpu_count() or 1),
                mp_ctx=ending_context(),
                random_seed=int(stream(sampling.seed, name).integers(2**31)),
                target_accept=ACCEPT,
                model=model,
                compute_convergence_checks=False,
                nuts_sampler="pymc",
                progressbar=False,
                quiet=True,
                callback=call,
                **mode,
            )
        except ValueError as fault:
            if "Not enough samples" in str(fault):  # PyMC was interrupted early
                raise KeyboardInterrupt from None
            raise
    if trace["posterior"].sizes["draw"] < sampling.draws:
        raise KeyboardInterrupt
    return trace
