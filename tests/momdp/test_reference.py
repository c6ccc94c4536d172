"""The reference models are what the file says, and what the published solver values say."""

import json
from itertools import pairwise

import numpy as np
import pytest

from meal_bayes.errors import DataError, SettingsError
from meal_bayes.momdp import MOMDP, Transition, initial_belief, update_belief
from meal_bayes.momdp.reference import load_reference, reference_folder

NAMES = ["A1", "A2", "A3", "A4", "A5"]


def test_every_model_is_what_the_file_says(reference):
    models = load_reference(reference)
    table = json.loads((reference / "planner_reference.json").read_text())["models"]
    assert list(models) == NAMES
    for row, (name, momdp) in zip(table, models.items(), strict=True):
        assert isinstance(momdp, MOMDP)
        assert momdp.query.attributes == tuple(row["attributes"])
        assert len(momdp.query) == int(name[1])
        assert (momdp.discount, momdp.correct, momdp.incorrect) == (0.99, 500.0, -500.0)
        assert momdp.abstain
        assert momdp.x_names == ("x0", "x1", "x2", "x3", "x4", "term")
        assert momdp.x_names[momdp.start] == "x0"
        assert np.isinf(momdp.precision).all()
        assert np.isinf(momdp.limit).all()
        np.testing.assert_array_equal(momdp.prior, 0.5)
        for e, behavior in enumerate(row["behaviors"]):
            source, target = (momdp.x_names.index(behavior[end]) for end in ("source", "target"))
            assert momdp.behavior_names[e] == behavior["behavior"]
            assert momdp.cost[e] == behavior["cost_s"]
            assert momdp.transition[e, source, target] == behavior["success"]
            assert momdp.observation_probability[e, source, target] == behavior["informative"]
            np.testing.assert_array_equal(np.flatnonzero(momdp.legal[:, e]), [source])
            illegal = np.arange(5) != source
            assert (momdp.transition[e, :-1, -1][illegal] == 1).all()
            if behavior["informative"]:
                rates = momdp.confusion[:, e, :, 1]
                np.testing.assert_array_equal(rates[:, 1], behavior["true_positive_rate"])
                np.testing.assert_array_equal(rates[:, 0], behavior["false_positive_rate"])


def test_models_are_nested(reference):
    """A4 asks what A3 asks and one attribute more, by the same rates."""
    models = list(load_reference(reference).values())
    for fewer, more in pairwise(models):
        n = len(fewer.query)
        assert more.query.attributes[:n] == fewer.query.attributes
        np.testing.assert_array_equal(more.confusion[:n], fewer.confusion)


def test_a_percept_moves_the_belief_as_its_rates_say(reference):
    momdp = load_reference(reference)["A1"]
    hold = momdp.behavior_names.index("hold")
    belief = update_belief(
        initial_belief(momdp), momdp, Transition(hold, 3, np.array([1], dtype=np.int8))
    )
    assert belief.positive[0] == pytest.approx(0.549815498155 / (0.549815498155 + 0.046511627907))


def test_the_folder_is_named_or_in_the_environment(reference, tmp_path, monkeypatch):
    monkeypatch.delenv("MEAL_BAYES_REFERENCE", raising=False)
    with pytest.raises(SettingsError, match=r"--reference DIR, or .* MEAL_BAYES_REFERENCE"):
        load_reference()
    monkeypatch.setenv("MEAL_BAYES_REFERENCE", str(reference))
    assert list(load_reference()) == NAMES
    with pytest.raises(SettingsError, match=r"No planner_reference\.json in"):
        reference_folder(tmp_path)
    assert reference_folder(reference) == reference


@pytest.mark.parametrize(
    "change",
    [
        lambda table: table.pop("models"),
        lambda table: table.update(models=3),
        lambda table: table["models"].append("A6"),
        lambda table: table["models"][0].pop("discount"),
        lambda table: table["models"][0].update(discount=2),
        lambda table: table["models"][0].update(prior="by base rate"),
        lambda table: table["models"][0].update(illegal="stays"),
        lambda table: table["models"][0].update(behaviors=[]),
        lambda table: table["models"][0].update(attributes=[]),
        lambda table: table["models"][0].update(attributes=["heavy", "heavy"]),
        lambda table: table["models"][0]["behaviors"][0].update(success=1.5),
        lambda table: table["models"][0]["behaviors"][0].update(source=None),
        lambda table: table["models"][0]["behaviors"][0].update(cost_s="much"),
        lambda table: table["models"][0]["behaviors"][0].update(true_positive_rate=[1.2]),
        lambda table: table["models"][0]["behaviors"][0].update(true_positive_rate=[0.1, 0.2]),
        lambda table: table["models"][0]["behaviors"][0].update(true_positive_rate=[float("nan")]),
    ],
)
def test_a_damaged_file_is_told(reference, tmp_path, change):
    table = json.loads((reference / "planner_reference.json").read_text())
    change(table)
    (tmp_path / "planner_reference.json").write_text(json.dumps(table))
    with pytest.raises(DataError, match=r"planner_reference\.json"):
        load_reference(tmp_path)


@pytest.mark.parametrize("text", ["", "{", "[" * 100_000, "\xff", "null", "[]"])
def test_no_json_is_told(tmp_path, text):
    (tmp_path / "planner_reference.json").write_text(text, encoding="latin-1")
    with pytest.raises(DataError, match=r"planner_reference\.json"):
        load_reference(tmp_path)
