"""`posterior`: what it writes, what it tells, and that other tools can read it."""

import json

import arviz as az
import pytest

FILES = {
    "forest.png", "posterior.nc", "predictive.png", "reliability_each.png",
    "reliability_together.png", "summary.csv",
}  # fmt: skip
GRID = ("posterior", "--attributes", "heavy,beans", "--draws", "200", "--json")


@pytest.mark.long
def test_the_grid_writes_everything(run, tmp_path):
    result = run(*GRID, "--out", "fit")
    assert result.exit_code == 0
    assert result.stdout.count("\n") == 1
    told = json.loads(result.stdout)
    assert {path.name for path in (tmp_path / "fit").iterdir()} == FILES
    saved = az.from_netcdf(tmp_path / "fit" / "posterior.nc")["posterior"]
    assert saved["mean"].dims == ("chain", "draw", "attribute", "behavior", "truth", "level")
    assert saved["mean"].coords["attribute"].values.tolist() == ["heavy", "beans"]
    assert saved["mean"].shape[:2] == (4, 200)
    likelihood = az.from_netcdf(tmp_path / "fit" / "posterior.nc")["log_likelihood"]["yes"]
    assert likelihood.shape == (4, 200, 36 * 2)
    assert (tmp_path / "fit" / "summary.csv").read_text().count("\n") == 1 + 2 * 11 * 2 * 3
    yes = saved["mean"].sel(attribute="heavy", behavior="lift_slow", level="yes")
    assert float(yes.sel(truth="true").mean()) > 0.9
    assert float(yes.sel(truth="false").mean()) < 0.1
    assert [row["variable"] for row in told["convergence"]] == ["mean", "dispersion"]
    assert told["divergences"] == 0
    assert told["belief"]["together"]["nll"] < told["belief"]["each"]["nll"] < 0.6
    assert all(0 < p < 1 for p in told["predictive_p"])


@pytest.mark.long
def test_it_is_told_in_words(run):
    result = run("posterior", "--attributes", "heavy", "--draws", "150", "--levels", "4")
    for word in ("R-hat", "ESS bulk", "independent", "ECE"):
        assert word in result.stdout
    assert max(map(len, result.stdout.splitlines())) <= 80
    assert "draws, summary and figures in" in result.stderr


@pytest.mark.long
def test_nuts_writes_the_same_files(run, tmp_path, table):
    result = run(
        "posterior", "--dataset", tmp_path / "kitchen.npz", "--method", "pymc", "--chains", "2",
        "--draws", "150", "--tune", "150", "--out", "fit", "--json",
    )  # fmt: skip
    assert result.exit_code == 0
    told = json.loads(result.stdout)
    assert {path.name for path in (tmp_path / "fit").iterdir()} == FILES
    variables = {row["variable"] for row in told["convergence"]}
    assert variables == {"mean", "dispersion", "mu", "tau"}
    assert told["divergences"] == 0
    assert told["misperception"] is None
    saved = az.from_netcdf(tmp_path / "fit" / "posterior.nc")
    assert "diverging" in saved["sample_stats"]
    yes = saved["posterior"]["mean"].sel(attribute="red", behavior="look", level="yes")
    assert float(yes.sel(truth="true").mean()) > 0.8
    assert float(yes.sel(truth="false").mean()) < 0.2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--levels", "3"), "expected one of [2, 4, 8]"),
        (("--model", "crossed"), "--model crossed needs --method pymc"),
    ],
)
def test_what_cannot_be_is_told_in_a_line(fails, tmp_path, arguments, message):
    assert message in fails("posterior", *arguments)
    assert not (tmp_path / "posteriors").exists()
