"""A statistician's tour: draws in ArviZ's own plots, and an agent that believes them."""

import json

import arviz as az
import matplotlib as mpl
import numpy as np
import pytest
from click.testing import CliRunner

import meal_bayes as mb
from meal_bayes.cli import main

CLASSIC = az.__version__.startswith("0.")
ROW = {"attribute": ["heavy"], "behavior": ["lift_slow"]}


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("posterior")
    command = ["posterior", "--dataset", "roc36", "--levels", "4", "--draws", "100", "--json"]
    done = CliRunner().invoke(main, [*command, "--out", str(folder)])
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout), folder / "posterior.nc"


@pytest.mark.filterwarnings("ignore")  # ArviZ's own, and those of unreliable objects
def test_arviz_draws_and_checks_the_file(fitted):
    told, path = fitted
    mpl.use("Agg")
    idata = az.from_netcdf(path)
    assert idata["posterior"].attrs["dataset"] == "roc36"
    az.plot_forest(idata, var_names=["mean"], coords={"attribute": ["heavy"]})
    az.plot_trace(idata, var_names=["dispersion"], coords=ROW)
    if CLASSIC:
        az.plot_posterior(idata, var_names=["mean"], coords=ROW)
        az.plot_ppc(idata, num_pp_samples=20)
        az.plot_ppc(idata, group="prior", num_pp_samples=20)
        az.plot_loo_pit(idata, y="yes")
        az.plot_khat(az.loo(idata, pointwise=True))
        sensitivity = az.psens(idata, component="prior", var_names=["dispersion"])
        assert np.isfinite(sensitivity.sel(behavior="lift_slow")).all()
    else:
        az.plot_ppc_dist(idata)
        az.plot_ppc_dist(idata, group="prior_predictive")
        az.plot_ppc_rootogram(idata)
        az.plot_loo_pit(idata)
        az.plot_khat(az.loo(idata, pointwise=True))
        assert len(az.psense_summary(idata, var_names=["dispersion"])) == 10 * 11 * 2
    assert set(told["pareto_k"]) <= set(idata["log_likelihood"]["yes"]["unit"].values.tolist())


def test_an_agent_believes_the_file(fitted):
    _, path = fitted
    learner = mb.Learner("roc36", posterior=path, logs=None).fit(mb.load_percepts("roc36"))
    trial = learner.ask("Is it heavy?", "heavy_blue_beans")
    assert trial.success


def test_a_heavier_prior_draws_rows_to_it(fitted, tmp_path):
    _, path = fitted
    command = ["posterior", "--dataset", "roc36", "--levels", "4", "--draws", "100", "--json"]
    done = CliRunner().invoke(
        main, [*command, "--prior-scale", "20", "--out", str(tmp_path / "heavy")]
    )
    heavy, light = az.from_netcdf(tmp_path / "heavy" / "posterior.nc"), az.from_netcdf(path)
    assert json.loads(done.stdout)["config"]["prior_scale"] == 20
    spread = [
        float(one["posterior"]["mean"].std(("chain", "draw")).mean()) for one in (heavy, light)
    ]
    assert spread[0] < 0.7 * spread[1]
