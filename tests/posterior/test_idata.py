import arviz as az
import numpy as np
import pytest
from scipy.stats import dirichlet_multinomial

from meal_bayes.domain import load_domain
from meal_bayes.errors import DataError, SettingsError
from meal_bayes.posterior import ConfusionPosterior, draw_grid, idata
from meal_bayes.posterior.draws import Draws
from meal_bayes.posterior.pointwise import pointwise_log_likelihood


@pytest.fixture
def draws():
    rng = np.random.default_rng(0)
    mean = rng.dirichlet([2.0, 2.0], (4, 250, 2, 3, 2))
    dispersion = rng.lognormal(size=(4, 250, 2, 3, 2))
    return Draws(
        ("red", "full"),
        ("look", "lift", "tap"),
        mean,
        dispersion,
        rng.beta(1, 20, (4, 250)),
        {"mu": (("behavior", "truth"), rng.normal(size=(4, 250, 3, 2)))},
        {"diverging": np.zeros((4, 250), dtype=bool), "energy": rng.normal(size=(4, 250))},
    )


def test_every_dimension_has_its_names(draws):
    found = idata.to_idata(draws)
    entry = found["posterior"]["mean"].sel(
        attribute="full", behavior="tap", truth="true", level="yes"
    )
    assert entry.dims == ("chain", "draw")
    np.testing.assert_array_equal(entry.values, draws.mean[:, :, 1, 2, 1, 1])
    assert found["posterior"]["dispersion"].dims == (
        "chain", "draw", "attribute", "behavior", "truth",
    )  # fmt: skip
    assert found["posterior"]["mu"].dims == ("chain", "draw", "behavior", "truth")
    assert found["posterior"]["misperception"].dims == ("chain", "draw")
    assert found["sample_stats"]["diverging"].values.sum() == 0


def test_netcdf_keeps_everything(draws, tmp_path):
    observed = {"yes": (("truth", "number"), np.arange(12).reshape(2, 6))}
    predicted = {"yes": (("truth", "number"), np.ones((1, 9, 2, 6), dtype=int))}
    made = idata.to_idata(
        draws, observed=observed, predicted=predicted, coords={"number": range(6)}
    )
    path = idata.save_netcdf(made, tmp_path / "new" / "posterior.nc")
    found = az.from_netcdf(path)
    np.testing.assert_array_equal(found["posterior"]["mean"].values, draws.mean)
    assert found["posterior"]["mean"].coords["attribute"].values.tolist() == ["red", "full"]
    assert found["posterior"]["mean"].coords["level"].values.tolist() == ["no", "yes"]
    assert found["observed_data"]["yes"].dims == ("truth", "number")
    assert found["posterior_predictive"]["yes"].dims == ("chain", "draw", "truth", "number")
    assert [file.name for file in path.parent.iterdir()] == ["posterior.nc"]


def test_convergence_tells_the_worst(draws):
    told = {one.variable: one for one in idata.convergence(idata.to_idata(draws))}
    assert told["mean"].entries == 24
    assert told["misperception"].entries == 1
    assert all(one.r_hat < 1.02 and one.ess_bulk > 600 for one in told.values())
    shifted = draws.mean.copy()
    shifted[0, :, 1, 1, 0] = [0.999, 0.001]  # one chain, one row
    shifted[0, ::2, 1, 1, 0] = [0.998, 0.002]
    lost = Draws(draws.attributes, draws.behaviors, shifted, draws.dispersion)
    worst = idata.convergence(idata.to_idata(lost))[0]
    assert worst.r_hat > 1.3
    assert worst.ess_bulk < 50


def test_the_summary_names_every_entry(draws):
    lines = idata.summary_csv(idata.to_idata(draws)).splitlines()
    assert "r_hat" in lines[0]
    assert len(lines) == 1 + 24 + 12 + 1 + 6
    row = next(line for line in lines if line.startswith('"mean[red, look, true, yes]"'))
    value = float(row.split('"')[2].split(",")[1])
    assert value == pytest.approx(draws.mean[:, :, 0, 0, 1, 1].mean(), abs=1e-12)


def test_netcdf_needs_a_library(draws, tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(SettingsError, match="pip install h5netcdf h5py"):
        idata.save_netcdf(idata.to_idata(draws), tmp_path / "posterior.nc")
    assert list(tmp_path.iterdir()) == []


DIMS = ("object", "attribute", "behavior", "truth", "level")


@pytest.fixture
def fitted():
    """Return percept counts of six objects in the toy domain, and draws of their posterior."""
    rng, domain = np.random.default_rng(3), load_domain("toy")
    truth = np.array([[0, 1], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]])
    shown = rng.binomial(3, np.where(truth, 0.8, 0.3)[:, :, None], (6, 2, 2))
    counts = np.zeros((6, 2, len(domain.behaviors), 2, 2), np.int64)
    o, p, e = np.indices(shown.shape)
    counts[o, p, e, truth[o, p], 1], counts[o, p, e, truth[o, p], 0] = shown, 3 - shown
    draws = draw_grid(
        counts, rng, attributes=domain.attributes, behaviors=domain.behavior_names, draws=100
    )
    return domain, counts, draws


def saved(counts, draws, path, **groups):
    objects = [f"object {o}" for o in range(len(counts))]
    made = idata.to_idata(
        draws,
        observed={"counts": (DIMS, counts[:, :, :2])},
        coords={"object": objects, **groups.pop("coords", {})},
        **groups,
    )
    return az.from_netcdf(idata.save_netcdf(made, path))


def test_a_posterior_read_back_is_the_agents(fitted, tmp_path):
    domain, counts, draws = fitted
    expected = draws.posterior(counts)
    found = ConfusionPosterior.from_idata(saved(counts, draws, tmp_path / "p.nc"), domain)
    for name in ("prior", "counts", "concentration", "dispersion"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name))
    turned = draws.select(("heavy", "red"), ("lift", "look"))
    swapped = saved(counts[:, ::-1, 1::-1], turned, tmp_path / "q.nc")
    found = ConfusionPosterior.from_idata(swapped, domain)  # laid out for the domain again
    np.testing.assert_allclose(found.concentration, expected.concentration)


def test_names_count_and_not_the_order(fitted, tmp_path):
    domain, counts, draws = fitted
    made = saved(counts, draws, tmp_path / "p.nc")
    expected = ConfusionPosterior.from_idata(tmp_path / "p.nc", domain)
    turned = {"truth": ["true", "false"], "level": ["yes", "no"], "attribute": ["heavy", "red"]}
    groups = {
        group: made[group].sel(turned).transpose(..., "truth", "behavior")
        for group in ("posterior", "observed_data")
    }
    found = ConfusionPosterior.from_idata(groups, domain)
    for name in ("prior", "counts", "concentration", "dispersion"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


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
def test_rows_that_mean_nothing_are_refused(fitted, tmp_path, variable, change, says):
    domain, counts, draws = fitted
    made = saved(counts, draws, tmp_path / "p.nc")
    posterior = {name: made["posterior"][name] for name in ("mean", "dispersion")}
    groups = {"posterior": {**posterior, variable: change(posterior[variable])}}
    with pytest.raises(DataError, match=says):
        ConfusionPosterior.from_idata({**groups, "observed_data": made["observed_data"]}, domain)


def test_a_file_that_is_none_is_told(fitted, tmp_path):
    (tmp_path / "p.nc").write_text("no netCDF")
    for name in ("p.nc", "q.nc"):
        with pytest.raises(DataError, match="is no posterior in netCDF"):
            ConfusionPosterior.from_idata(tmp_path / name, fitted[0])


def test_what_is_no_posterior_is_told(fitted):
    domain, counts, draws = fitted
    with pytest.raises(DataError, match="holds no posterior of confusion matrices"):
        ConfusionPosterior.from_idata({}, domain)
    with pytest.raises(DataError, match="without the percepts it was drawn from"):
        ConfusionPosterior.from_idata(idata.to_idata(draws), domain)
    part = idata.to_idata(
        draws.select(("red",), ("look", "lift")), observed={"counts": (DIMS, counts[:, :1, :2])}
    )
    with pytest.raises(DataError, match="Unknown attribute 'heavy'"):
        ConfusionPosterior.from_idata(part, domain)


def test_log_likelihood_is_that_of_each_object(fitted):
    _, counts, draws = fitted
    values, units = pointwise_log_likelihood(draws, counts, [str(o) for o in range(6)])
    assert values.shape == (4, 100, 12)
    unit = units.index("2: heavy")
    expected = 0.0
    for e in range(2):
        k, alpha = counts[2, 1, e, 1], (draws.dispersion[..., None] * draws.mean)[3, 7, 1, e, 1]
        ways = {0: 1, 1: 3, 2: 3, 3: 1}[int(k[0])]
        expected += dirichlet_multinomial(alpha, 3).logpmf(k) - np.log(ways)
    assert values[3, 7, unit] == pytest.approx(expected)


@pytest.mark.filterwarnings("ignore:Estimated shape parameter")  # of six objects
def test_arviz_leaves_one_out(fitted, tmp_path):
    _, counts, draws = fitted
    values, units = pointwise_log_likelihood(draws, counts, [str(o) for o in range(6)])
    found = saved(
        counts, draws, tmp_path / "p.nc",
        log_likelihood={"percepts": (("unit",), values)}, coords={"unit": units},
    )  # fmt: skip
    loo = idata.az.loo(found)
    assert loo.n_data_points == 12
    assert np.isfinite(float(getattr(loo, "elpd", getattr(loo, "elpd_loo", np.nan))))
