"""A posterior of one's own is the agent's, every field of an agent acts, keys name streams."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import meal_bayes
from meal_bayes.agents import Agent, NoBonus, load_agent
from meal_bayes.datasets import load_percepts
from meal_bayes.errors import DataError, SettingsError
from meal_bayes.learner import Learner
from meal_bayes.planners import Predefined
from meal_bayes.posterior.draws import draw_grid
from meal_bayes.posterior.idata import posterior_from, save_netcdf, to_idata

ROOT = Path(__file__).resolve().parents[2]
SAMPLE = "pm.sample(100, tune=200, chains=2, cores=1, random_seed=0, progressbar=False)"


@pytest.fixture(scope="module")
def table():
    return load_percepts("roc36")


def drawn(dataset, levels, objects):
    """An InferenceData of the grid's posterior of yes/no or graded percepts of some objects."""
    rng = np.random.default_rng(4)
    p = 2
    e = 3
    labels = dataset.labels[:objects]
    counts = np.zeros((objects, p, e, 2, levels), np.int64)
    for o, i, b in np.ndindex(objects, p, 2):
        speaks = levels - 1 if labels[o, i] == (rng.random() < 0.9) else 0
        counts[o, i, b, labels[o, i], speaks] += 3
    domain = dataset.domain
    names = {"attributes": domain.attributes, "behaviors": domain.behavior_names[:2]}
    draws = draw_grid(counts[:, :, :2], rng, **names, draws=50)
    dims = ("object", "attribute", "behavior", "truth", "level")
    names = {dim: draws[dim].values for dim in dims[1:]}
    shown = xr.DataArray(counts[:, :, :2], names, dims)
    return to_idata(draws, observed_data=xr.Dataset({"counts": shown}))


class TestAPosteriorOfOnesOwn:
    def test_is_what_the_agent_believes_and_labeled_trials_are_added(self, dataset, make):
        idata = drawn(dataset, 4, 8)
        learner = make.learner(dataset, posterior=idata)
        posterior = posterior_from(idata, dataset.domain)
        np.testing.assert_array_equal(learner.knowledge().posterior.mean, posterior.mean)
        trial = learner.ask("red", make.arm())
        learner.tell(trial, {"red": True})
        learner.refit()
        after = learner.knowledge().posterior
        assert (after.counts.sum() > posterior.counts.sum()) == any(
            step.observation is not None for step in trial.steps
        )
        learner.forget(trial)
        np.testing.assert_allclose(learner.knowledge().posterior.mean, posterior.mean, atol=1e-12)

    @pytest.mark.parametrize("right", [0.0, 0.5, 0.9, 1.0])
    @pytest.mark.parametrize("number", [1, 50])
    def test_may_be_certain_of_its_rows(self, dataset, make, right, number):
        """Rows of 0 and 1, draws that are all equal, one draw: the belief is that."""
        idata = drawn(dataset, 4, 8)
        group = idata["posterior"].isel(draw=slice(number))
        likely = np.array([right, 0.0, 0.0, 1 - right])
        mean = xr.zeros_like(group["mean"]) + np.stack([likely, likely[::-1]])
        group = group.assign(mean=mean.transpose(*group["mean"].dims))
        posterior = {"posterior": group, "observed_data": idata["observed_data"]}
        learner = make.learner(dataset, posterior=posterior)
        found = learner.knowledge().posterior.mean[:, :2]
        np.testing.assert_allclose(found[..., 0, 0], right, atol=1e-9)
        np.testing.assert_allclose(found[..., 1, 0], 1 - right, atol=1e-9)
        assert learner.ask("red", make.arm()).report is not None

    def test_without_draws_is_told(self, dataset, make):
        idata = drawn(dataset, 4, 8)
        empty = idata["posterior"].isel(draw=slice(0))
        with pytest.raises(DataError, match="no draws"):
            make.learner(
                dataset, posterior={"posterior": empty, "observed_data": idata["observed_data"]}
            )

    def test_other_levels_than_the_agent_s_are_told(self, dataset, make):
        with pytest.raises(SettingsError, match="levels of the agent"):
            make.learner(dataset, posterior=drawn(dataset, 2, 8))

    def test_replays_believe_it_too(self, table):
        knowledge = (
            Learner(table.domain, agent="greedy", logs=None).fit(table).knowledge(table.objects[0])
        )
        learner = Learner(table.domain, agent="greedy", logs=None, posterior=knowledge.posterior)
        posterior = learner.fit(table).knowledge(table.objects[3]).posterior
        np.testing.assert_array_equal(posterior.mean, knowledge.posterior.mean)


@pytest.mark.long
@pytest.mark.filterwarnings("ignore")  # of PyMC, about few draws
def test_a_model_of_ones_own_is_a_page_of_pymc(dataset, tmp_path):
    """The page of the how-to: names of dimensions, truths and levels are the whole contract."""
    import pymc  # noqa: PLC0415  slow

    page = (ROOT / "docs/how-to/posterior.md").read_text()
    (code,) = (block.split("```")[0] for block in page.split("```py\n") if "pm.Model" in block)
    code = code.replace("pm.sample()", SAMPLE)
    counts = np.zeros((8, 2, 2, 2, 2), np.int64)
    labels = dataset.labels[:8]
    for o, i, b in np.ndindex(8, 2, 2):
        counts[o, i, b, labels[o, i], labels[o, i]] = 3
    objects = [f"object {o}" for o in range(8)]
    space = {"np": np, "mb": meal_bayes, "pm": pymc, "domain": dataset.domain}
    exec(code, space | {"counts": counts, "objects": objects}, space)
    posterior = space["learner"].settings.posterior
    assert posterior.counts.sum() == counts.sum()
    assert (posterior.mean[:, :2, 1, 1] > 0.6).all()
    assert (posterior.mean[:, :2, 0, 1] < 0.4).all()
    path = save_netcdf(space["idata"], tmp_path / "own.nc")
    again = Learner(dataset.domain, agent="greedy", logs=None, posterior=path).settings.posterior
    np.testing.assert_array_equal(again.mean, posterior.mean)


def test_a_key_names_the_random_stream_of_a_question(table):
    learner = Learner(table.domain, agent="random_legal", logs=None).fit(table)
    asked = [learner.ask("heavy", table.objects[0], key=key) for key in ("a", "a", "b", None)]
    actions = [[step.decision.action for step in trial.steps] for trial in asked]
    assert actions[0] == actions[1]
    assert asked[0].task.key != asked[2].task.key
    assert asked[3].task.key == (table.domain.data, "ask", table.objects[0], "heavy")


def tables(knowledge, columns):
    """An observation model of one's own: all percepts are fair coins."""
    shape = (len(columns), len(knowledge.domain.behaviors), 2)
    return np.full((*shape, 4), 0.25), np.full(shape, 9.0), None


CHANGES = {
    "name": "another", "solver": lambda domain, query: Predefined(domain.behavior_names[1:2]),
    "object_level": False, "shared_trait": False, "base_rates": False, "levels": 2,
    "abstain": False, "discount": 0.9, "observation_model": tables, "exploration": NoBonus(),
    "memory": True, "whiten": False, "trained_by": load_agent("morc"), "co_occurrence": False,
}  # fmt: skip
ALONE = set(CHANGES) - {"co_occurrence"}  # which needs coupled attributes: `test_learner.py`


def trials_of(dataset, make, agent):
    """Two trials about one object, labeled in between."""
    learner = make.learner(dataset, agent)
    first = learner.ask("red", make.arm(), object_name="mug", key="a")
    learner.tell(first, {"red": True, "full": True})
    learner.refit()
    return first, learner.ask("full", make.arm(), object_name="mug", key="b")


def replays_of(table, agent):
    """The same with an object of a percept table."""
    learner = Learner("roc36", agent=agent, logs=None).fit(table)
    name = table.objects[0]
    learner.tell(name, {"heavy": False, "blue": False})
    return [learner.ask(q, name, max_steps=3) for q in ("heavy", "blue")]


def signature(trials):
    """What the trials depend on."""
    return [
        (
            trial.agent, trial.momdp.rows.tobytes(), trial.momdp.precision.tobytes(),
            trial.momdp.prior.tobytes(), trial.momdp.bonus.tobytes(), trial.momdp.discount,
            trial.momdp.n_actions, [step.decision.action for step in trial.steps],
        )
        for trial in trials
    ]  # fmt: skip


def test_no_field_is_forgotten_here():
    assert set(CHANGES) == {field.name for field in dataclasses.fields(Agent)}


@pytest.mark.quick(2)
@pytest.mark.parametrize("field", sorted(ALONE))
def test_with_a_robot(dataset, make, field):
    ours = load_agent("bayes")
    changed = dataclasses.replace(ours, **{field: CHANGES[field]})
    first, second, again = (
        signature(trials_of(dataset, make, agent)) for agent in (ours, changed, ours)
    )
    assert first == again != second


@pytest.mark.quick(2)
@pytest.mark.parametrize("field", sorted(ALONE - {"exploration", "trained_by", "whiten"}))
def test_on_a_percept_table_whose_classifiers_are_fitted(field):
    ours = load_agent("bayes")
    table = load_percepts("roc36")
    changed = dataclasses.replace(ours, **{field: CHANGES[field]})
    first, second = (signature(replays_of(table, agent)) for agent in (ours, changed))
    assert first != second
