import arviz as az
import numpy as np
import pytest
import xarray as xr
from scipy.stats import dirichlet, dirichlet_multinomial

from meal_bayes.domain import load_domain
from meal_bayes.errors import DataError
from meal_bayes.posterior import ConfusionPosterior, idata
from meal_bayes.posterior.checks import cases_of, pointwise_log_likelihood, predict_yes
from meal_bayes.posterior.draws import (
    draw_grid,
    draw_prior,
    draws_of,
    log_prior,
    rows_of,
    summarize_draws,
)
from meal_bayes.posterior.fit import named_counts, telling_of
from meal_bayes.posterior.grid import DISPERSIONS
from meal_bayes.posterior.idata import posterior_from


@pytest.fixture
def draws():
    rng = np.random.default_rng(0)
    mean = rng.dirichlet([2.0, 2.0], (4, 250, 2, 3, 2))
    dispersion = rng.lognormal(size=(4, 250, 2, 3, 2))
    names = ("red", "full"), ("look", "lift", "tap")
    made = draws_of(*names, mean, dispersion, rng.beta(1, 20, (4, 250)))
    return made.assign(mu=(("chain", "draw", "behavior", "truth"), rng.normal(size=(4, 250, 3, 2))))


def test_netcdf_keeps_names_and_groups(draws, tmp_path):
    stats = draws[["misperception"]].rename(misperception="energy")
    made = idata.to_idata(draws, sample_stats=stats)
    path = idata.save_netcdf(made, tmp_path / "new" / "posterior.nc")
    groups = az.from_netcdf(path)
    assert groups["posterior"]["mean"].identical(draws["mean"])
    assert groups["posterior"]["mu"].dims == ("chain", "draw", "behavior", "truth")
    assert "energy" in groups["sample_stats"]
    entry = groups["posterior"]["mean"].sel(
        attribute="full", behavior="tap", truth="true", level="yes"
    )
    np.testing.assert_array_equal(entry, draws["mean"].values[:, :, 1, 2, 1, 1])
    assert [file.name for file in path.parent.iterdir()] == ["posterior.nc"]


def convergence_of(draws):
    return idata.convergence(idata.summary_of(idata.to_idata(draws))).set_index("variable")


@pytest.mark.long
def test_convergence_tells_the_worst(draws):
    told = convergence_of(draws)
    assert told.loc["mean", "entries"] == 24
    assert told.loc["misperception", "entries"] == 1
    assert ((told["r_hat"] < 1.02) & (told["ess_bulk"] > 600)).all()
    lost = draws.copy(deep=True)
    lost["mean"][0, :, 1, 1, 0] = [0.999, 0.001]  # one chain, one row
    lost["mean"][0, ::2, 1, 1, 0] = [0.998, 0.002]
    worst = convergence_of(lost).loc["mean"]
    assert worst["r_hat"] > 1.3
    assert worst["ess_bulk"] < 50


def test_the_summary_names_every_entry(draws):
    lines = idata.summary_of(idata.to_idata(draws)).to_csv().splitlines()
    assert "r_hat" in lines[0]
    assert len(lines) == 1 + 24 + 12 + 1 + 6
    row = next(line for line in lines if line.startswith('"mean[red, look, true, yes]"'))
    value = float(row.split('"')[2].split(",")[1])
    expected = draws["mean"].sel(attribute="red", behavior="look", truth="true", level="yes").mean()
    assert value == pytest.approx(float(expected), abs=1e-12)


DIMS = ("object", "attribute", "behavior", "truth", "level")


@pytest.fixture
def fitted():
    """Return percept counts of six objects in the toy domain, and draws of their posterior."""
    rng = np.random.default_rng(3)
    domain = load_domain("toy")
    truth = np.array([[0, 1], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]])
    shown = rng.binomial(3, np.where(truth, 0.8, 0.3)[:, :, None], (6, 2, 2))
    counts = np.zeros((6, 2, len(domain.behaviors), 2, 2), np.int64)
    o, p, e = np.indices(shown.shape)
    counts[o, p, e, truth[o, p], 1] = shown
    counts[o, p, e, truth[o, p], 0] = 3 - shown
    names = {"attributes": domain.attributes, "behaviors": domain.behavior_names[:2]}
    draws = draw_grid(counts[:, :, :2], rng, **names, draws=100)
    return domain, counts, draws


def grouped(counts, draws, **groups):
    """Return draws with the percepts that they come from."""
    names = {dim: draws[dim].values for dim in DIMS[1:]}
    shown = xr.DataArray(counts, {"object": [str(o) for o in range(len(counts))], **names}, DIMS)
    return idata.to_idata(draws, observed_data=xr.Dataset({"counts": shown}), **groups)


def test_a_posterior_read_back_is_the_agents(fitted, tmp_path):
    domain, counts, draws = fitted
    expected = summarize_draws(draws, counts)
    idata.save_netcdf(grouped(counts[:, :, :2], draws), tmp_path / "p.nc")
    posterior = posterior_from(tmp_path / "p.nc", domain)
    for name in ("counts", "concentration", "dispersion"):
        np.testing.assert_allclose(getattr(posterior, name), getattr(expected, name))


def test_names_count_and_not_the_order(fitted):
    domain, counts, draws = fitted
    made = grouped(counts[:, :, :2], draws)
    expected = posterior_from(made, domain)
    turned = {"truth": ["true", "false"], "level": ["yes", "no"], "attribute": ["heavy", "red"]}
    groups = {
        group: xr.Dataset(made[group].data_vars).sel(turned).transpose(..., "truth", "behavior")
        for group in ("posterior", "observed_data")
    }
    posterior = posterior_from(groups, domain)
    for name in ("counts", "concentration", "dispersion"):
        np.testing.assert_array_equal(getattr(posterior, name), getattr(expected, name))


@pytest.mark.parametrize(
    ("variable", "change", "says"),
    [
        ("mean", lambda m: m - 0.5, "probabilities that sum to 1"),
        ("mean", lambda m: 2 * m, "probabilities that sum to 1"),
        ("mean", lambda m: m.assign_coords(truth=["0", "1"]), "truths 'false', 'true'"),
        ("dispersion", lambda s: -s, "above 0"),
        ("dispersion", lambda s: s * np.nan, "above 0"),
    ],
)
def test_rows_that_mean_nothing_are_refused(fitted, variable, change, says):
    domain, counts, draws = fitted
    made = grouped(counts[:, :, :2], draws)
    posterior = {name: made["posterior"][name] for name in ("mean", "dispersion")}
    groups = {"posterior": {**posterior, variable: change(posterior[variable])}}
    with pytest.raises(DataError, match=says):
        posterior_from({**groups, "observed_data": made["observed_data"]}, domain)


@pytest.fixture
def with_telling(fitted):
    """Return the domain, its counts, and a file's groups with Pr(a pair tells anything)."""
    domain, counts, draws = fitted
    named = named_counts(
        counts,
        objects=[str(o) for o in range(len(counts))],
        attributes=domain.attributes,
        behaviors=domain.behavior_names,
    )
    constant = xr.Dataset({"telling": telling_of(named)})
    return domain, counts, grouped(counts[:, :, :2], draws, constant_data=constant)


def test_the_probability_that_a_pair_tells_is_the_file_s_or_none(with_telling, fitted, tmp_path):
    domain, counts, made = with_telling
    expected = ConfusionPosterior.from_objects(counts).telling
    assert 0 < expected[:, :2].min() < 1
    idata.save_netcdf(made, tmp_path / "p.nc")
    np.testing.assert_allclose(posterior_from(tmp_path / "p.nc", domain).telling, expected)
    _, _, draws = fitted
    own = posterior_from(grouped(counts[:, :, :2], draws), domain)
    assert own.telling is None  # a model of the user's own is believed as it is
    center = draws["mean"].mean(("chain", "draw")).values
    np.testing.assert_allclose(own.mean[:, :2], center)


@pytest.mark.parametrize(
    "change",
    [lambda t: t + 1, lambda t: t - 1, lambda t: t * np.nan, lambda t: t.isel(behavior=slice(1))],
)
def test_a_probability_that_is_none_is_refused(with_telling, change):
    domain, _, made = with_telling
    groups = {name: made[name] for name in ("posterior", "observed_data")}
    telling = change(made["constant_data"]["telling"])
    with pytest.raises(DataError, match="telling"):
        posterior_from({**groups, "constant_data": {"telling": telling}}, domain)


def test_a_file_that_is_none_is_told(fitted, tmp_path):
    (tmp_path / "p.nc").write_text("no netCDF")
    for name in ("p.nc", "q.nc"):
        with pytest.raises(DataError, match="is not a netCDF file of a posterior"):
            posterior_from(tmp_path / name, fitted[0])


def test_what_is_no_posterior_is_told(fitted):
    domain, counts, draws = fitted
    with pytest.raises(DataError, match="is not a posterior of confusion matrices"):
        posterior_from({}, domain)
    with pytest.raises(DataError, match="does not contain the percept counts"):
        posterior_from(idata.to_idata(draws), domain)
    part = grouped(counts[:, :1, :2], draws.sel(attribute=["red"]))
    with pytest.raises(DataError, match="Unknown attribute 'heavy'"):
        posterior_from(part, domain)


@pytest.mark.filterwarnings("ignore:Estimated shape parameter")  # of six objects
def test_log_likelihood_is_that_of_each_object(fitted):
    _, counts, draws = fitted
    cases = cases_of(counts[:, :, :2], [str(o) for o in range(6)], draws["attribute"].values)
    values = pointwise_log_likelihood(draws, cases)["yes"]
    assert values.shape == (4, 100, 12)
    (mean, s, _) = rows_of(draws)
    expected = 0.0
    for e in range(2):
        k = counts[2, 1, e, 1]
        alpha = (s[..., None] * mean)[307, 1, e, 1]
        ways = {0: 1, 1: 3, 2: 3, 3: 1}[int(k[0])]
        expected += dirichlet_multinomial(alpha, 3).logpmf(k) - np.log(ways)
    assert float(values[3, 7].sel(case="2: heavy")) == pytest.approx(expected)
    made = idata.to_idata(draws, log_likelihood=values.to_dataset())
    assert set(idata.unreliable(made)) <= set(cases.names)
    made = idata.to_idata(draws, log_likelihood=(10 * values).to_dataset())  # all too sure
    assert min(idata.unreliable(made).values()) > 0.5


def test_predicted_percepts_vary_as_objects_do(fitted):
    """In n percepts of a row with dispersion s, n m (1 - m) (s + n) / (s + 1) is the variance."""
    _, counts, draws = fitted
    same = draws.isel(draw=[0]).isel(draw=np.zeros(5000, int), chain=[0])
    cases = cases_of(counts[:, :, :2], [str(o) for o in range(6)], draws["attribute"].values)
    yes = predict_yes(same, cases, np.random.default_rng(0))["yes"][0]
    mean, s, _ = (values[0] for values in rows_of(same))
    u = cases.names.index("2: heavy")
    m = mean[1, :, 1, 1]
    s = s[1, :, 1]
    assert float(yes[:, u].mean()) == pytest.approx(3 * m.sum(), abs=0.1)
    variance = (3 * m * (1 - m) * (s + 3) / (s + 1)).sum()
    assert float(yes[:, u].var()) == pytest.approx(variance, rel=0.1)


def test_the_prior_is_that_of_the_rows(fitted):
    *_, draws = fitted
    alpha = np.array([[[2.0, 1.0], [1.0, 3.0]]])  # of false and true objects
    before = draw_prior(draws, alpha, np.random.default_rng(0), size=4000)
    m = before["mean"].mean(("chain", "draw", "attribute", "behavior"))
    np.testing.assert_allclose(m, [[2 / 3, 1 / 3], [1 / 4, 3 / 4]], atol=0.02)
    log_s = np.log(before["dispersion"])
    np.testing.assert_allclose(log_s.mean(), np.log(DISPERSIONS).mean(), atol=0.1)
    alike = np.corrcoef(log_s[0, :, 0, 0, 0], log_s[0, :, 1, 0, 0])[0, 1]
    apart = np.corrcoef(log_s[0, :, 0, 0, 0], log_s[0, :, 0, 1, 0])[0, 1]
    assert alike > 0.8  # attributes of a behavior
    assert abs(apart) < 0.1  # behaviors
    density = log_prior(before, alpha)
    rows = before["mean"].values[0, 5, 1, 0]
    expected = [dirichlet(alpha[0, t]).logpdf(rows[t]) for t in range(2)]
    np.testing.assert_allclose(density["mean"][0, 5, 1, 0], expected)
    assert density["dispersion"].dims == ("chain", "draw", "behavior", "truth")
    # of s on the grid, over all pairs of attributes, probabilities sum to 1
    pairs = np.stack(np.meshgrid(DISPERSIONS, DISPERSIONS), axis=-1).reshape(-1, 2)
    every = draws_of(
        ("red", "heavy"), ("look",), np.full((1, len(pairs), 2, 1, 2, 2), 0.5),
        np.tile(pairs[None, :, :, None, None], (1, 1, 1, 1, 2)),
    )  # fmt: skip
    total = np.exp(log_prior(every, alpha)["dispersion"]).sum(("chain", "draw"))
    np.testing.assert_allclose(total, 1.0)
