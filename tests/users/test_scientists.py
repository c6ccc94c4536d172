"""A statistician's tour, draws in ArviZ's plots; a researcher's, a classifier and a planner."""

import json
from dataclasses import dataclass

import arviz as az
import gymnasium
import matplotlib as mpl
import numpy as np
import pytest
from click.testing import CliRunner
from sklearn.linear_model import LogisticRegression

import meal_bayes as mb
import meal_bayes.gym  # registers the environments
from meal_bayes.cli import main
from meal_bayes.datasets import make_synthetic
from meal_bayes.momdp import MOMDP, best_answer
from meal_bayes.planners import unvalued

CLASSIC = az.__version__.startswith("0.")
ROW = {"attribute": ["heavy"], "behavior": ["lift_slow"]}


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("posterior")
    command = ["posterior", "--dataset", "roc36", "--levels", "4", "--draws", "100", "--json"]
    done = CliRunner().invoke(main, [*command, "--out", str(folder)])
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout), folder / "posterior.nc"


@pytest.mark.long
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
    else:
        az.plot_ppc_dist(idata)
        az.plot_ppc_dist(idata, group="prior_predictive")
        az.plot_ppc_rootogram(idata)
        az.plot_loo_pit(idata)
        az.plot_khat(az.loo(idata, pointwise=True))
    assert set(told["pareto_k"]) <= set(idata["log_likelihood"]["yes"]["case"].values.tolist())


@pytest.mark.long
def test_an_agent_believes_the_file(fitted):
    _, path = fitted
    learner = mb.Learner("roc36", posterior=path, logs=None).fit(mb.load_percepts("roc36"))
    trial = learner.ask("Is it heavy?", "heavy_blue_beans")
    assert trial.success


@pytest.mark.long
def test_a_heavier_prior_draws_rows_to_it(fitted, tmp_path):
    _, path = fitted
    command = ["posterior", "--dataset", "roc36", "--levels", "4", "--draws", "100", "--json"]
    done = CliRunner().invoke(
        main, [*command, "--prior-scale", "20", "--out", str(tmp_path / "heavy")]
    )
    heavy = az.from_netcdf(tmp_path / "heavy" / "posterior.nc")
    light = az.from_netcdf(path)
    assert json.loads(done.stdout)["config"]["prior_scale"] == 20
    spread = [
        float(draws["posterior"]["mean"].std(("chain", "draw")).mean()) for draws in (heavy, light)
    ]
    assert spread[0] < 0.7 * spread[1]


@dataclass(frozen=True)
class Patient:
    """Executes anything legal until it is sure, or has no patience left."""

    patience: int = 8

    def solve(self, momdp, rng):
        return PatientPolicy(momdp, self.patience)


@dataclass(frozen=True)
class PatientPolicy:
    momdp: MOMDP
    patience: int

    def decide(self, history, rng):
        momdp = self.momdp
        belief = history.belief
        if belief.certainty > 0.95 or len(history.actions) >= self.patience:
            return unvalued(momdp, best_answer(momdp, belief))
        return unvalued(momdp, int(rng.choice(np.flatnonzero(momdp.legal[belief.x]))))


@pytest.mark.long
def test_everything_of_my_own(tmp_path, monkeypatch):
    monkeypatch.setenv("MEAL_BAYES_DATA_DIR", str(tmp_path))
    rng = np.random.default_rng(0)
    domain = mb.load_domain("toy")
    recordings = make_synthetic(domain, objects=40, recordings=3, signal=6.0, rng=rng)
    table = mb.build_percept_table(recordings, classifier=LogisticRegression())
    agents = "random_legal", Patient(), "bayes"
    run = mb.run_offline(
        mb.OfflineConfig(table, attributes=1, trials=40, agents=agents), logs=tmp_path / "logs"
    )
    summary = mb.summarize(run)
    assert [row.agent for row in summary] == ["random_legal", "Patient", "bayes"]
    assert summary.compare("bayes", "Patient").estimate > 0
    assert len(run.steps()) == run.outcomes().steps.sum()
    assert "Patient" in repr(summary)
    env = gymnasium.make(
        "meal_bayes/Own-v0",
        dataset=table,
        attributes=1,
        agent=Patient(),
        objects="test",
        logs=tmp_path / "logs",
    )
    _, info = env.reset(seed=0)
    ended = False
    while not ended:
        action = env.unwrapped.decide()
        assert info["action_mask"][action]
        _, reward, terminated, truncated, info = env.step(action)
        ended = terminated or truncated
    assert np.isfinite(reward)
