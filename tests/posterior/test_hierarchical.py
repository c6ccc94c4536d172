"""NUTS: the model is the one that is written down, and it draws what the grid integrates."""

import os
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from sbc import simulate
from scipy.special import expit, logit, logsumexp
from scipy.stats import dirichlet_multinomial, norm, truncnorm

from meal_bayes import posterior
from meal_bayes.perception.confusion import youden
from meal_bayes.posterior.draws import Sampling, draw_grid, rows_of, summarize_draws
from meal_bayes.posterior.grid import DISPERSIONS, TAUS
from meal_bayes.posterior.hierarchical import build_model, fit_hierarchical
from meal_bayes.posterior.idata import convergence, summary_of, to_idata

NAMES = {"attributes": ["red", "full"], "behaviors": ["look", "lift"]}
PLAIN = {"mode": "FAST_COMPILE"}  # no C compiler for a single value


def simulated(levels):
    lean = np.stack([np.linspace(3, 1, levels), np.linspace(1, 3, levels)])
    prior = np.broadcast_to(lean, (2, 2, 2, levels))
    return simulate(np.random.default_rng(3), prior, objects=6, recordings=3).counts


def log_scores(counts, mean, s):
    """Log-probability (O,P,E,2) of an object's percepts under the row of each truth."""
    shown = counts.sum(axis=3)
    scores = np.zeros((*shown.shape[:3], 2))
    for o, p, e, t in np.ndindex(scores.shape):
        k = shown[o, p, e]
        alpha = s[p, e, t] * mean[p, e, t]
        if k.any():
            scores[o, p, e, t] = dirichlet_multinomial.logpmf(k, alpha, k.sum())
    return scores


def potential(model, name, point):
    """Value of a potential where the model's variables take the values of `point`."""
    variables = [variable for variable in model.free_RVs if variable.name in point]
    term = next(term for term in model.potentials if term.name == name)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # without a C compiler PyTensor says that it is slow
        compiled = model.compile_fn(
            [term], inputs=variables, point_fn=False, on_unused_input="ignore", **PLAIN
        )
    return float(compiled(*(point[variable.name] for variable in variables))[0])


@pytest.mark.quick(1)
@pytest.mark.parametrize("levels", [2, pytest.param(4, marks=pytest.mark.long)])
def test_same_is_the_grids_model(levels):
    rng = np.random.default_rng(0)
    counts = simulated(levels)
    counts[0, :, 0] = 0  # an object that was never looked at
    model = build_model(counts, **NAMES)
    shift = rng.normal(size=(2, 2, 2))
    (mu, width) = rng.normal(size=(2, 2, 2))
    step = np.log(DISPERSIONS[1] / DISPERSIONS[0])
    low, high = np.log(DISPERSIONS[[0, -1]]) + np.array([-step / 2, step / 2])
    place = expit(logit((mu - low) / (high - low)) + np.exp(width) * shift)
    log_s = low + (high - low) * place
    jacobian = (np.log(place * (1 - place)) + width).sum()
    mean = rng.dirichlet(np.ones(levels), (2, 2, 2))
    point = {"log_s_standard": shift, "width_standard": width, "mu": mu, "mean": mean}
    scores = log_scores(counts, mean, np.exp(log_s))
    truth = counts.any(axis=(2, 4))[..., 1].astype(int)  # (O,P)
    expected = np.take_along_axis(scores, truth[..., None, None], axis=-1).sum()
    assert potential(model, "percepts", point) == pytest.approx(expected, rel=1e-6)
    tau = TAUS
    a, b = ((end - mu[..., None]) / tau for end in (low, high))
    share = truncnorm.logpdf(log_s[..., None], a, b, loc=mu[..., None], scale=tau)  # (P,E,2,T)
    votes = youden(counts.sum(axis=0).astype(float)) > 0
    pooled = (votes[..., None, None] * share).sum(axis=0) - tau**2 / 2
    mean_tau = np.exp(logsumexp(pooled, axis=-1, b=tau) - logsumexp(pooled, axis=-1))
    widths = norm.logpdf(width, np.log(mean_tau), 0.3) - norm.logpdf(0, 0, 0.3)  # up to a constant
    expected = logsumexp(pooled, axis=-1).sum() + jacobian + widths.sum()
    assert potential(model, "pooling", point) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("levels", [2, pytest.param(4, marks=pytest.mark.long)])
def test_crossed_integrates_what_the_object_seems_to_be(levels):
    counts = simulated(levels)
    model = build_model(counts, **NAMES, model="crossed")
    inner = [variable.name for variable in model.free_RVs]
    assert sum(name.endswith("_standard") for name in inner) == 7  # effects, and epsilon
    rng = np.random.default_rng(1)
    point = {v.name: rng.uniform(0.1, 0.9, v.shape.eval(**PLAIN)) for v in model.free_RVs}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        compiled = model.compile_fn(
            [model["mean"], model["dispersion"], model["misperception"]],
            inputs=model.free_RVs, point_fn=False, **PLAIN,
        )  # fmt: skip
    mean, s, epsilon = compiled(*(point[name] for name in inner))
    assert epsilon == pytest.approx(point["half_standard"] / 2)
    odds = np.log(mean[..., 1:] / mean[..., :-1])
    crossed = odds[0, 0] - odds[0, 1] - odds[1, 0] + odds[1, 1]
    assert (np.abs(crossed) > 1e-3).any()  # a pair is more than its attribute and its behavior
    scores = log_scores(counts, mean, s).sum(axis=2)  # (O,P,2)
    truth = counts.any(axis=(2, 4))[..., 1]
    right = np.where(truth, scores[..., 1], scores[..., 0])
    wrong = np.where(truth, scores[..., 0], scores[..., 1])
    expected = np.logaddexp(right + np.log1p(-epsilon), wrong + np.log(epsilon)).sum()
    assert potential(model, "percepts", point) == pytest.approx(expected, rel=1e-6)


@pytest.mark.long
@pytest.mark.statistical
def test_nuts_draws_what_the_grid_integrates():
    """The bar: means to .005, standard deviations to 3 %; here beside the Monte-Carlo error."""
    names = {"attributes": list("abcd"), "behaviors": ["look", "lift"]}
    rng = np.random.default_rng(3)
    m = np.array([0.25, 0.75])
    s = 2.0
    yes = rng.binomial(5, rng.beta(s * m, s * (1 - m), (30, 4, 3, 2)))
    counts = np.stack([5 - yes, yes], axis=-1)
    counts[:15, ..., 1, :] = counts[15:, ..., 0, :] = 0
    counts[:, :, 1] = 0  # asking is not sensing
    steps = []
    draws, statistics = fit_hierarchical(
        counts[:, :, [0, 2]], **names, sampling=Sampling(1000, tune=400, chains=2, jobs=1, seed=4),
        progress=lambda *step: steps.append(step),
    )  # fmt: skip
    exact = draw_grid(counts[:, :, [0, 2]], np.random.default_rng(0), **names, draws=20_000)
    assert statistics["diverging"].sum() == 0
    checks = convergence(summary_of(to_idata(draws)))
    assert set(checks["variable"]) == {"mean", "dispersion", "mu", "tau"}
    assert (checks["r_hat"] < 1.01).all()
    (mean, s, _) = rows_of(draws)
    (exact_mean, exact_s, _) = rows_of(exact)
    assert draws["behavior"].values.tolist() == ["look", "lift"]
    np.testing.assert_allclose(mean.mean(axis=0), exact_mean.mean(axis=0), atol=0.005)
    np.testing.assert_allclose(mean.std(axis=0), exact_mean.std(axis=0), rtol=0.08)
    np.testing.assert_allclose(np.log(s).mean(axis=0), np.log(exact_s).mean(axis=0), atol=0.1)
    np.testing.assert_allclose(np.log(s).std(axis=0), np.log(exact_s).std(axis=0), rtol=0.12)
    assert draws["tau"].dims == ("chain", "draw", "behavior", "truth")
    assert steps[-1] == (2800, 2800)
    posterior = summarize_draws(draws, counts)
    np.testing.assert_allclose(posterior.mean[:, [0, 2]], mean.mean(axis=0))


def test_one_attribute_or_behavior_has_nothing_to_cross():
    model = build_model(simulated(2)[:, :1, :1], ["red"], ["look"], model="crossed")
    assert {v.name for v in model.free_RVs} == {"log_odds_center", "log_s_center", "half_standard"}


@pytest.mark.long
@pytest.mark.parametrize("home", ["cache", "/dev/null/none"])
def test_the_compile_folder_is_the_users_own(tmp_path, home):
    """In the user's own cache, never in a folder that anybody can fill."""
    root = str(Path(posterior.__file__).resolve().parents[2])
    code = "import meal_bayes.posterior.hierarchical as h; print(h.config.base_compiledir)"
    shared = tmp_path / "tmp"
    shared.mkdir()
    cache = tmp_path / home
    environment = {
        **os.environ, "PYTHONPATH": root, "TMPDIR": str(shared), "HOME": str(cache),
        "XDG_CACHE_HOME": str(cache), "XDG_CONFIG_HOME": str(tmp_path / "config"),
    }  # fmt: skip
    for name in ("PYTENSOR_FLAGS", "MEAL_BAYES_CACHE_WARNED"):
        environment.pop(name, None)
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    folder = Path(done.stdout.strip())
    if home == "cache":
        assert folder == cache / "meal_bayes" / "pytensor"
        assert folder.stat().st_mode & 0o777 == 0o700
    else:  # one of the process's own, with a name that nobody can guess
        assert folder.parent == shared
        assert folder.name.startswith("meal_bayes-pytensor-")
        assert not folder.exists()
