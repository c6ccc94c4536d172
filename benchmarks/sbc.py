"""Does every posterior we ship mean what it says? Simulation-based calibration, 200 simulations.

Parameters are drawn from the prior, percepts from the parameters; then the rank of each true value
among 99 posterior draws is uniform. Grid and closed forms take seconds (and 20 times as many
simulations show how far off an approximation is); NUTS takes minutes (the crossed model, a fit for
each simulation, 20 s each), so its parts are run apart.

And do grid and NUTS agree, on the real recordings?

    python benchmarks/sbc.py [--json] [--only closed|same|crossed|agree] [--jobs 2]
"""

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from measuring import options_of, show
from numpy.typing import ArrayLike, NDArray
from scipy.special import chdtrc

from meal_bayes.arrays import Floats
from meal_bayes.datasets import load_percepts
from meal_bayes.errors import SettingsError
from meal_bayes.experiments.parallel import in_parallel
from meal_bayes.momdp.observation import sample_rows
from meal_bayes.perception import table_counts
from meal_bayes.perception.confusion import informative
from meal_bayes.posterior import ConfusionPosterior
from meal_bayes.posterior.draws import (
    Sampling,
    draw_dirichlet,
    draw_grid,
    draws_of,
    replicate,
    rows_of,
)
from meal_bayes.posterior.grid import DISPERSIONS, TAUS
from meal_bayes.seeds import stream


class Simulation(NamedTuple):
    """Parameters drawn from the prior, and percepts drawn from them.

    Attributes
    ----------
    mean : (P,E,2,K).
    dispersion : (P,E,2).
    counts : (O,P,E,2,K).
    """

    mean: Floats
    dispersion: Floats
    counts: NDArray[np.int64]


def simulate(
    rng: np.random.Generator,
    prior: ArrayLike,
    *,
    objects: int,
    recordings: int,
    independent: bool = False,
) -> Simulation:
    """Draw rows from the prior of `from_objects`, and percepts of objects from the rows.

    Parameters
    ----------
    prior : (P,E,2,K) Dirichlet parameters of m; each (behavior, truth) has its own mu and tau.
    objects : of each truth.
    recordings : percepts of each object and behavior.
    independent : all objects alike (s = inf), as `ConfusionPosterior.from_counts` takes them.
    """
    alpha = np.asarray(prior, dtype=float)
    mean = draw_dirichlet(rng, alpha)
    log_s = np.log(DISPERSIONS)
    shape = alpha.shape[1:3]
    tau_weight = np.exp(-0.5 * TAUS**2)
    mu = rng.choice(log_s, size=shape)[..., None]
    tau = rng.choice(TAUS, size=shape, p=tau_weight / tau_weight.sum())[..., None]
    cdf = np.exp(-0.5 * ((log_s - mu) / tau) ** 2).cumsum(axis=-1)  # (E,2,G)
    cdf /= cdf[..., -1:]
    step = (rng.random(alpha.shape[:3])[..., None] > cdf).sum(axis=-1)
    s = DISPERSIONS[step]
    rows = np.broadcast_to(mean, (objects, *mean.shape))
    if not independent:
        rows = draw_dirichlet(rng, np.broadcast_to(s[..., None] * mean, rows.shape))
    counts = np.zeros((2, *rows.shape), dtype=np.int64)  # half of the objects have each truth
    for truth in (0, 1):
        counts[truth, ..., truth, :] = rng.multinomial(recordings, rows[..., truth, :])
    if not independent:  # another row for the objects of the other truth
        other = draw_dirichlet(rng, np.broadcast_to(s[..., None] * mean, rows.shape))
        counts[1, ..., 1, :] = rng.multinomial(recordings, other[..., 1, :])
    return Simulation(mean, s, counts.reshape(-1, *mean.shape))


def rank_statistics(
    truth: ArrayLike, draws: ArrayLike, rng: np.random.Generator
) -> NDArray[np.int64]:
    """Rank each true value (...) among its posterior draws (L,...): 0 .. L, ties at random."""
    true = np.asarray(truth, float)
    drawn = np.asarray(draws, float)
    if drawn.shape[1:] != true.shape:
        raise SettingsError(f"Draws have shape {drawn.shape}; expected (L, *{true.shape}).")
    below = (drawn < true).sum(axis=0)
    equal = (drawn == true).sum(axis=0)
    return np.asarray(below + rng.integers(0, equal + 1))


def uniformity(ranks: ArrayLike, draws: int, *, bins: int = 20) -> float:
    """Return the p-value of the chi-squared test that ranks among L draws are uniform.

    >>> uniformity(range(100), 99) > 0.999, uniformity([50] * 100, 99) < 1e-6
    (True, True)
    """
    if (draws + 1) % bins:
        raise SettingsError(f"{draws} draws make {draws + 1} ranks; give a multiple of {bins}.")
    place = np.asarray(ranks).ravel() * bins // (draws + 1)
    expected = place.size / bins
    statistic = ((np.bincount(place, minlength=bins) - expected) ** 2).sum() / expected
    return float(chdtrc(bins - 1, statistic))


def coverage(
    truth: ArrayLike, draws: ArrayLike, masses: Sequence[float] = (0.5, 0.8, 0.95)
) -> Floats:
    """Return the fraction of true values (...) in the equal-tailed intervals of draws (L,...)."""
    true = np.asarray(truth, float)
    drawn = np.asarray(draws, float)
    tails = [(0.5 - mass / 2, 0.5 + mass / 2) for mass in masses]
    ends = [np.quantile(drawn, tail, axis=0) for tail in tails]
    return np.array([((low <= true) & (true <= high)).mean() for low, high in ends])


RANKED = 99  # posterior draws that a true value is ranked among
SIMULATIONS = 200
MORE = 20  # times as many where they cost nothing
MASSES = (0.5, 0.8, 0.95)
BATCHES = 20  # of draws, for the error of a standard deviation

Row = dict[str, object]


def _drawn(posterior: ConfusionPosterior, rng: np.random.Generator, size: int) -> np.ndarray:
    """Draw mean matrices from a conjugate posterior, (size,P,E,2,K)."""
    weight = posterior.concentration.sum(axis=-1)
    return sample_rows(posterior.mean, weight, np.zeros((size, *posterior.mean.shape)), rng)


def main() -> None:
    """Measure, and print a table or JSON."""
    parts = {"closed": closed, "same": same, "crossed": crossed, "agree": agree}
    parser = options_of(__doc__)
    parser.add_argument("--only", choices=parts, help="one part")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--fits", type=int, default=SIMULATIONS, help="of the crossed model")
    parser.add_argument("--jobs", type=int, default=1, help="processes that fit it")
    options = parser.parse_args()
    report = []
    for name in [options.only] if options.only else parts:
        rows = list(parts[name](options))
        report += rows
        if not options.json:
            show(rows)
    if options.json:
        show([], {"seed": options.seed, "ranked_among": RANKED, "rows": report})


def judged(posterior: str, of: str, truth: object, draws: object, rng: np.random.Generator) -> Row:
    """Rank true values (n) among draws (L,n), test, and count what the intervals cover."""
    drawn = np.asarray(draws, float)
    thin = drawn[np.linspace(0, len(drawn) - 1, RANKED).astype(int)]
    ranks = rank_statistics(truth, thin, rng).ravel()
    ecdf = np.arange(1, ranks.size + 1) / ranks.size
    return {
        "posterior": posterior,
        "of": of,
        "simulations": int(ranks.size),
        "p": round(uniformity(ranks, RANKED, bins=20 if ranks.size >= SIMULATIONS else 10), 4),
        "ecdf_off": round(float(np.abs(np.sort((ranks + 0.5) / (RANKED + 1)) - ecdf).max()), 4),
        "covered": dict(
            zip(map(str, MASSES), coverage(truth, drawn, MASSES).round(3).tolist(), strict=True)
        ),
    }


def leaning(levels: int, weight: float, attributes: int, behaviors: int) -> np.ndarray:
    """Prior rows (P,E,2,K) by which true objects lean to the last level, false ones to the first.

    So that nearly every pair has a vote on its behavior's dispersion.
    """
    up = np.linspace(1.0, 3.0, levels)
    rows = np.stack([up[::-1], up]) * weight / up.sum()
    return np.broadcast_to(rows, (attributes, behaviors, 2, levels)).copy()


def yes(mean: np.ndarray) -> np.ndarray:
    """Pr(upper half of the levels)."""
    return mean[..., mean.shape[-1] // 2 :].sum(axis=-1)


def names(attributes: int, behaviors: int) -> dict[str, list[str]]:
    """Name what has no name."""
    return {
        "attributes": [f"attribute {p}" for p in range(attributes)],
        "behaviors": [f"behavior {e}" for e in range(behaviors)],
    }


def closed(settings: argparse.Namespace) -> Iterator[Row]:
    """Conjugate rows, the grid's exact draws, and the Dirichlets that sum the grid up."""
    for times in (1, MORE):
        behaviors = SIMULATIONS * times // 2
        rng = stream(settings.seed, "sbc", "closed", times)
        prior = leaning(2, 4.0, 1, behaviors)
        made = simulate(rng, prior, objects=20, recordings=5, independent=True)
        posterior = ConfusionPosterior.from_counts(made.counts, prior=prior)
        drawn = _drawn(posterior, rng, 999)
        yield judged("conjugate", "m", yes(made.mean), yes(drawn), rng)
        for levels in (2, 4):
            prior = leaning(levels, 4.0, 4, behaviors)
            made = simulate(rng, prior, objects=20, recordings=5)
            sample = draw_grid(
                made.counts, rng, **names(4, behaviors), prior=prior, chains=1, draws=499
            )
            mean, s, _ = rows_of(sample)
            kind = {2: "grid, exact"}.get(levels, f"grid, {levels} levels")
            yield judged(kind, "m", yes(made.mean)[0], yes(mean)[:, 0], rng)
            yield judged(kind, "s", made.dispersion[0], s[:, 0], rng)
            summed = ConfusionPosterior.from_objects(made.counts, prior=prior)
            drawn = _drawn(summed, rng, 499)
            kind = f"from_objects, {levels} levels"
            yield judged(kind, "m", yes(made.mean)[0], yes(drawn)[:, 0], rng)
            alpha = summed.precision[..., None] * summed.mean
            true = draw_dirichlet(rng, made.dispersion[..., None] * made.mean)
            drawn = draw_dirichlet(rng, np.broadcast_to(alpha, (499, *alpha.shape)))
            yield judged(kind, "a new object's row", yes(true)[0], yes(drawn)[:, 0], rng)


def same(settings: argparse.Namespace) -> Iterator[Row]:
    """NUTS on the grid's hierarchy: behaviors and truths are independent, so one fit is all."""
    from meal_bayes.posterior.hierarchical import fit_hierarchical  # noqa: PLC0415

    behaviors = SIMULATIONS // 2
    for levels in (2, 4):
        rng = stream(settings.seed, "sbc", "same", levels)
        start = time.perf_counter()
        prior = leaning(levels, 4.0, 3, behaviors)
        made = simulate(rng, prior, objects=20, recordings=5)
        sample, of_chains = fit_hierarchical(
            made.counts,
            **names(3, behaviors),
            prior=prior,
            sampling=Sampling(500, 500, 2, seed=settings.seed),
        )
        mean, s, _ = rows_of(sample)
        lost = int(of_chains["diverging"].sum())
        extra = {"divergences": lost, "seconds": round(time.perf_counter() - start)}
        kind = f"NUTS same, {levels} levels"
        yield judged(kind, "m", yes(made.mean)[0], yes(mean)[:, 0], rng) | extra
        yield judged(kind, "s", made.dispersion[0], s[:, 0], rng) | extra


PAIRS = names(2, 2)  # of the crossed model
Fit = tuple[int, int, tuple[np.ndarray, ...]]


def fit_crossed(work: tuple[int, np.ndarray]) -> Fit:
    """Fit one simulation's counts; (number, divergences, draws of m, s and epsilon)."""
    from meal_bayes.posterior.hierarchical import fit_hierarchical  # noqa: PLC0415

    number, counts = work
    sample, of_chains = fit_hierarchical(
        counts, **PAIRS, model="crossed", sampling=Sampling(250, 400, 2, jobs=1, seed=number)
    )
    mean, s, epsilon = rows_of(sample)
    return number, int(of_chains["diverging"].sum()), (yes(mean), s, epsilon)


def crossed(settings: argparse.Namespace) -> Iterator[Row]:
    """NUTS on the crossed hierarchy, small: a fit for each simulation."""
    from meal_bayes.posterior.hierarchical import build_model  # noqa: PLC0415  before PyMC itself

    import pymc as pm  # noqa: PLC0415 isort: skip

    objects = 24
    recordings = 3
    template = np.zeros((objects, 2, 2, 2, 2), dtype=np.int64)
    template[: objects // 2, ..., 0, 0] = template[objects // 2 :, ..., 1, 0] = recordings
    model = build_model(template, **PAIRS, model="crossed")
    prior = pm.draw(
        [model["mean"], model["dispersion"], model["misperception"]],
        settings.fits,
        random_seed=int(stream(settings.seed, "sbc", "prior").integers(2**31)),
    )
    before = draws_of(*PAIRS.values(), *(values[None] for values in prior))
    rng = stream(settings.seed, "sbc", "crossed")
    start = time.perf_counter()
    made = replicate(before, template, rng, size=settings.fits)
    fits: list[Fit] = []
    for fit in in_parallel(fit_crossed, enumerate(made), jobs=settings.jobs):
        fits.append(fit)
        if not len(fits) % 10:
            passed = time.perf_counter() - start
            print(f"{len(fits)}/{settings.fits} fits, {passed:.0f} s", file=sys.stderr, flush=True)
    _, lost, samples = zip(*sorted(fits, key=lambda fit: fit[0]), strict=True)
    drawn = [np.stack(values, axis=1) for values in zip(*samples, strict=True)]  # (L,200,...)
    extra = {"divergences": sum(lost), "seconds": round(time.perf_counter() - start)}
    pair = (0, 0, 1)
    for of, true, values in (
        ("m of a true row", yes(prior[0])[:, *pair], drawn[0][:, :, *pair]),
        ("s of a true row", prior[1][:, *pair], drawn[1][:, :, *pair]),
        ("misperception", prior[2], drawn[2]),
    ):
        yield judged("NUTS crossed", of, true, values, rng) | extra


def spread_error(values: np.ndarray) -> np.ndarray:
    """Relative Monte Carlo error of the standard deviations of chains of draws (L,...).

    By batch means, as draws of a chain depend on each other and squares have heavy tails.
    """
    squares = (values - values.mean(axis=0)) ** 2
    batches = np.stack([part.mean(axis=0) for part in np.array_split(squares, BATCHES)])
    return np.asarray(batches.std(axis=0, ddof=1) / BATCHES**0.5 / (2 * squares.mean(axis=0)))


def agree(settings: argparse.Namespace) -> Iterator[Row]:
    """Grid against NUTS on the same hierarchy: some attributes and behaviors of each data set."""
    from meal_bayes.posterior.hierarchical import fit_hierarchical  # noqa: PLC0415
    from meal_bayes.posterior.idata import convergence, summary_of, to_idata  # noqa: PLC0415

    for dataset in ("roc36", "ispy32", "cy101"):
        table = load_percepts(dataset)
        start = time.perf_counter()
        counts = table_counts(table, 0)[:, :4, :4]
        named = {
            "attributes": table.domain.attributes[:4],
            "behaviors": [behavior.name for behavior in table.domain.behaviors[:4]],
        }
        sampling = Sampling(3000, seed=settings.seed)
        nuts, of_chains = fit_hierarchical(counts, **named, sampling=sampling)
        exact = draw_grid(counts, stream(settings.seed, "agree"), **named, draws=20_000)
        votes = informative(counts.sum(axis=0).astype(float))  # the others' s are free in NUTS
        first, second = (yes(rows_of(sample)[0])[:, votes] for sample in (nuts, exact))
        ratio = first.std(axis=0) / second.std(axis=0)
        error = np.hypot(spread_error(first), spread_error(second))
        s = [1 / (1 + rows_of(sample)[1][:, votes]) for sample in (nuts, exact)]
        told = convergence(summary_of(to_idata(nuts)))
        yield {
            "posterior": "NUTS same",
            "of": dataset,
            "rows": int(ratio.size),
            "mean_off": round(float(np.abs(first.mean(0) - second.mean(0)).max()), 5),
            "sd_ratio": [round(float(ratio.min()), 4), round(float(ratio.max()), 4)],
            "sd_ratio_error": round(float(error.max()), 4),
            "sd_off_in_errors": round(float((np.abs(ratio - 1) / error).max()), 1),
            "sd_off_pooled": round(float(np.average(ratio - 1, weights=error**-2.0)), 4),
            "s_off": round(float(np.abs(s[0].mean(0) - s[1].mean(0)).max()), 5),  # of 1 / (1 + s)
            "r_hat": round(told["r_hat"].max(), 4),
            "ess": round(told[["ess_bulk", "ess_tail"]].min(axis=None)),
            "divergences": int(of_chains["diverging"].sum()),
            "seconds": round(time.perf_counter() - start),
        }


if __name__ == "__main__":
    main()
