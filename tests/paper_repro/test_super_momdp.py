"""Fig. 9: irrelevant attributes are in the state, and change nothing for a factored planner."""

import numpy as np
import pytest

import meal_bayes
from meal_bayes.agents import OfflineRunner, load_agent
from meal_bayes.experiments import offline_tasks
from meal_bayes.momdp import flatten


@pytest.fixture(scope="module")
def table():
    return meal_bayes.load_percepts("ispy32")


@pytest.fixture(scope="module")
def morc(table):
    return OfflineRunner(table, load_agent("morc"), 0)


@pytest.fixture(scope="module")
def task(table):
    return offline_tasks(table, 2, 1, 0)[0]


def test_without_irrelevant_attributes_it_is_the_flat_momdp(scripts, table, morc, task):
    problem = scripts.super_momdp.super_momdp(table, morc, task, 0)
    found, expected = scripts.super_momdp.flat_pomdp(problem), flatten(problem.asked)
    for name in ("transition", "observation", "reward", "start"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-12)
    assert found.discount == expected.discount


@pytest.mark.parametrize("irrelevant", [1, 2])
def test_states_double_and_reports_stay(scripts, table, morc, task, irrelevant):
    problem = scripts.super_momdp.super_momdp(table, morc, task, irrelevant)
    flat = scripts.super_momdp.flat_pomdp(problem)
    assert problem.n_states == 6 * 2 ** (2 + irrelevant) + 1
    assert len(flat.action_names) == problem.whole.n_behaviors + 4
    np.testing.assert_allclose(flat.transition.sum(axis=-1), 1)
    np.testing.assert_allclose(flat.observation.sum(axis=-1), 1)
    reports = flat.reward[:-1, problem.whole.n_behaviors :]
    assert (np.sort(reports, axis=1) == [-500, -500, -500, 500]).all()


def test_any_number_of_irrelevant_attributes_leaves_the_trial(scripts, table, morc, task, tmp_path):
    setting = scripts.frame.Setting(logs=tmp_path)
    for protocol in setting.protocols:
        points = {
            ("k", k): scripts.super_momdp.Point("factored", protocol, k, 2, 0.0) for k in (0, 1, 79)
        }
        found = scripts.super_momdp.run_points(points, setting)
        assert list(found) == list(points)
        told = {
            tuple((row["reward"], row["cost"], row["success"]) for row in rows)
            for rows in found.values()
        }
        assert len(told) == 1
        assert found["k", 79][0]["states"] == float(6 * 2**81 + 1)


def test_all_beliefs_are_updated(scripts, table, morc, task):
    problem = scripts.super_momdp.super_momdp(table, morc, task, 5)
    belief = meal_bayes.initial_belief(problem.whole)
    momdp = problem.whole
    step = meal_bayes.momdp.Transition(0, 1, np.ones(7, np.int8))
    after = meal_bayes.update_belief(belief, momdp, step)
    tells = momdp.confusion[:, 0, 0, 1] != momdp.confusion[:, 0, 1, 1]
    assert tells[2:].any()
    np.testing.assert_array_equal(after.positive != belief.positive, tells)
    asked = meal_bayes.update_belief(
        meal_bayes.initial_belief(problem.asked),
        problem.asked,
        step._replace(observation=np.ones(2, np.int8)),
    )
    np.testing.assert_array_equal(problem.narrow(after).weight, asked.weight)
    ask = momdp.behavior_names.index("ask")
    answered = meal_bayes.update_belief(belief, momdp, step._replace(action=ask))
    np.testing.assert_allclose(answered.positive[2:], belief.positive[2:])
    np.testing.assert_allclose(answered.positive[:2], 0.7**0.5)


def test_points_are_resumed_unit_by_unit(scripts, tmp_path, monkeypatch):
    monkeypatch.setattr(scripts.super_momdp, "UNIT", 2)
    setting = scripts.frame.Setting(logs=tmp_path)
    points = {("drawn", 0): scripts.super_momdp.Point("factored", "published", 0, 3, 0.0)}
    once = scripts.super_momdp.run_points(points, setting)
    assert len(once["drawn", 0]) == 3
    assert scripts.super_momdp.run_points(points, setting) == once  # times as well
    _, second = sorted(tmp_path.rglob("trials-*.json"))
    second.unlink()
    again = scripts.super_momdp.run_points(points, setting)["drawn", 0]
    assert again[:2] == once["drawn", 0][:2]
    assert again[2]["reward"] == once["drawn", 0][2]["reward"]
    assert "drawn" in scripts.super_momdp.timing(once)


def test_the_flat_solver_plays_the_super_momdp(scripts, tmp_path):
    setting = scripts.frame.Setting(logs=tmp_path)
    points = {("flat", 1): scripts.super_momdp.Point("flat", "published", 1, 2, 0.2)}
    (trials,) = scripts.super_momdp.run_points(points, setting).values()
    for trial in trials:
        paid = {0.0: (-500.0, 0.0), 1.0: (500.0,)}[trial["success"]]
        assert trial["reward"] + trial["cost"] in paid
        assert trial["states"] == 49
