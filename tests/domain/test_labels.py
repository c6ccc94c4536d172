"""A group is one value: through every door, against a dictionary of what was told."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meal_bayes import Learner, load_percepts
from meal_bayes.datasets import Dataset, make_synthetic, save_csv_folder
from meal_bayes.datasets.csv_files import load_csv_folder
from meal_bayes.domain import Query, load_domain
from meal_bayes.errors import DataError, QueryError
from meal_bayes.learner.views import labels_for
from meal_bayes.robots import Outcome
from meal_bayes.robots.robot import OutcomeChecker
from meal_bayes.trials import truth_of

GROUPS = {"fill": ["empty", "half", "full"], "size": ["small", "large"]}
CUP = {
    "extends": "toy", "name": "cup", "groups": GROUPS,
    "attributes": ["metal", "full", "small", "empty", "half", "large"],
}  # fmt: skip
LAB = load_domain(CUP)
NOTHING = np.full(len(LAB.attributes), -1, np.int8)


@pytest.mark.parametrize("number", [2.0, np.float32(2), np.int64(2), "2"])
def test_a_value_that_is_a_number_is_its_digits(number, tmp_path):
    sizes = load_domain({**CUP, "attributes": ["1", "2", "3"], "groups": {"size": ["1", "2", "3"]}})
    assert sizes.labels({"size": number}).tolist() == [0, 1, 0]
    with pytest.raises(DataError, match="size"):
        sizes.labels({"size": 4.0})
    rng = np.random.default_rng(0)
    dataset = make_synthetic(sizes, objects=3, recordings=1, rng=rng)
    frame = pd.DataFrame({"size": [2, None, 1]}, index=dataset.objects)  # floats, by the gap
    assert frame["size"].dtype == float
    features = dataset.features
    rows = Dataset.from_frames(sizes, features, frame).labels.tolist()
    assert rows == [[0, 1, 0], [-1, -1, -1], [1, 0, 0]]
    save_csv_folder(dataset, tmp_path)
    frame.rename_axis("object").to_csv(tmp_path / "labels.csv")
    assert load_csv_folder(sizes, tmp_path).labels.tolist() == rows


class Model:
    """What is known of one object: by group the values that it may still have."""

    def __init__(self):
        self.metal = None
        self.possible = {group: set(values) for group, values in GROUPS.items()}

    def told(self, facts):
        """Return whether the facts can be; then they hold, else nothing changes."""
        possible = {}
        for group, values in GROUPS.items():
            said = {name for name in values if facts.get(name) or facts.get(group) == name}
            denied = {name for name in values if facts.get(name) is False}
            named = said or (set(values) - denied if len(denied) == len(values) - 1 else set())
            possible[group] = named - denied or self.possible[group] - denied
            if len(said) > 1 or said & denied or not possible[group]:
                return False
        self.possible = possible
        self.metal = self.metal if facts.get("metal") is None else facts["metal"]
        return True

    @property
    def row(self):
        """Labels in the order of the domain."""
        row = {"metal": -1 if self.metal is None else int(self.metal)}
        for group, values in GROUPS.items():
            sure = len(self.possible[group]) == 1
            for name in values:
                row[name] = int(sure) if name in self.possible[group] else 0
                if name in self.possible[group] and not sure:
                    row[name] = -1
        return [row[name] for name in LAB.attributes]


@st.composite
def facts(draw):
    """Labels by attribute and by group, in any order."""
    by_attribute = st.dictionaries(
        st.sampled_from(LAB.attributes), st.sampled_from([True, False, False, None]), max_size=4
    )
    by_group = {group: st.sampled_from([None, *values]) for group, values in GROUPS.items()}
    items = [*draw(by_attribute).items()]
    items += draw(st.fixed_dictionaries({}, optional=by_group)).items()
    return dict(draw(st.permutations(items)))


@given(st.lists(facts(), max_size=8))
def test_rows_are_those_of_a_dictionary(sequence):
    model = Model()
    row = NOTHING
    for told in sequence:
        if model.told(told):
            row = LAB.replace(row, LAB.labels(told))
        else:
            with pytest.raises(QueryError):
                row = LAB.replace(row, LAB.labels(told))
        assert row.tolist() == model.row


@given(st.lists(facts(), max_size=6))
@settings(max_examples=30)
def test_a_learner_knows_what_the_dictionary_knows(sequence):
    learner = Learner(LAB, agent="greedy", logs=None)
    model = Model()
    for told in sequence:
        if model.told(told):
            learner.tell("jar", told)
        else:
            with pytest.raises(QueryError):
                learner.tell("jar", told)
        assert labels_for(learner.experience, ["jar"])[0].tolist() == model.row


DATA = make_synthetic(LAB, objects=4, recordings=1, rng=np.random.default_rng(0))
ASKING = load_domain(CUP | {
    "behaviors": [{"name": "look", "cost": 1.0, "modalities": ["color"]},
                  {"name": "ask", "cost": 5.0, "answer_accuracy": 0.9}],
    "predefined": [],
    "diagram": {"states": ["x0"], "start": "x0", "illegal": "terminate",
                "effects": [{"from": "x0", "do": "look", "to": "x0"},
                            {"from": "x0", "do": "ask", "to": "x0"}]},
})  # fmt: skip
EQUAL = [  # ways to say what is true of a cup
    [{"half": True}, {"full": False, "empty": False}, {"fill": "Half"}, {"fill": " half "}],
    [{"small": True, "metal": False}, {"size": "small", "metal": False},
     {"large": False, "metal": False}],
]  # fmt: skip
WRONG = [{"half": True, "full": True}, dict.fromkeys(GROUPS["fill"], False), {"fill": "heavy"},
         {"fill": "half", "full": True}, {"fill": "half", "half": False}, {"fill": True},
         {"small": False, "large": False}, {"mettal": True}]  # fmt: skip


def by_attribute(labels):
    """Return what a row of labels says, by name."""
    return {name: v == 1 for name, v in zip(LAB.attributes, labels, strict=True) if v >= 0}


@pytest.mark.filterwarnings("ignore:The agent .* answered without touching anything")
@pytest.mark.parametrize("said", EQUAL)
def test_all_doors_understand_the_same(said):
    expected = LAB.labels(said[0])
    learner = Learner(LAB, agent="greedy", logs=None)
    checker = OutcomeChecker(ASKING)
    query = Query(LAB.attributes)
    for number, values in enumerate(said):
        np.testing.assert_array_equal(LAB.labels(values), expected)
        learner.tell(f"cup {number}", values)
        assert checker.execute(1, Outcome("x0", answers=values)).answers == by_attribute(expected)
        session = learner.begin(query, truth=values)
        np.testing.assert_array_equal(session.trial.truth, expected)
    told = labels_for(learner.experience, [f"cup {number}" for number in range(len(said))])
    np.testing.assert_array_equal(told, [expected] * len(said))
    labels = dict(zip(DATA.objects, said, strict=False))
    frame = pd.DataFrame(
        [values | {"object": name} for name, values in labels.items()],
        columns=["object", "fill", "size", *LAB.attributes],
    )
    for form in (labels, frame):
        data = Dataset.from_frames(LAB, DATA.features, form, objects=DATA.objects)
        np.testing.assert_array_equal(data.labels[: len(said)], [expected] * len(said))
        np.testing.assert_array_equal(data.labels[len(said) :], -1)


def test_a_column_of_a_file_may_be_a_group(tmp_path):
    save_csv_folder(DATA, tmp_path)
    fill = LAB.columns(GROUPS["fill"])
    values = [GROUPS["fill"][row.argmax()] for row in DATA.labels[:, fill]]
    table = pd.read_csv(tmp_path / "labels.csv").drop(columns=[*GROUPS["fill"], "large"])
    table.assign(fill=values).to_csv(tmp_path / "labels.csv", index=False)
    with pytest.raises(DataError, match="'large'"):
        load_csv_folder(LAB, tmp_path)
    table = table.assign(fill=values, large="")
    table.to_csv(tmp_path / "labels.csv", index=False)
    np.testing.assert_array_equal(load_csv_folder(LAB, tmp_path).labels, DATA.labels)
    table.assign(fill=["hull", *values[1:]]).to_csv(tmp_path / "labels.csv", index=False)
    with pytest.raises(DataError, match=r"line 2: .*'hull'.*'full' or 'half'"):
        load_csv_folder(LAB, tmp_path)


@pytest.mark.parametrize("values", WRONG)
def test_no_door_takes_what_cannot_be(values):
    learner = Learner(LAB, agent="greedy", logs=None)
    with pytest.raises(QueryError):
        LAB.labels(values)
    with pytest.raises(QueryError):
        learner.tell("jar", values)
    with pytest.raises(QueryError):
        learner.begin("metal", truth=values)
    with pytest.raises(DataError, match=DATA.objects[0]):
        Dataset.from_frames(LAB, DATA.features, {DATA.objects[0]: values}, objects=DATA.objects)
    said = OutcomeChecker(ASKING).execute(1, Outcome("x0", answers=values))
    assert said.answers is None
    assert "no percept of ask" in said.warning


def test_the_truth_of_one_value_is_that_of_the_others():
    query = Query(("empty", "metal", "half", "full"), ((0, 2, 3),), ("fill",))
    assert truth_of(query, [-1, -1, 1, -1]).tolist() == [0, -1, 1, 0]
    assert truth_of(query, [0, 1, -1, 0]).tolist() == [0, 1, 1, 0]
    with pytest.raises(QueryError, match="exactly one"):
        truth_of(query, [1, -1, 1, -1])


def test_forgetting_leaves_one_value_or_none():
    rng = np.random.default_rng(0)
    for _ in range(30):
        learner = Learner(LAB, agent="greedy", logs=None)
        told = []
        for number in rng.permutation(6).tolist():
            values = {str(rng.choice(LAB.attributes)): bool(rng.integers(2))}
            learner.experience.add_labels((number,), "jar", LAB.labels({}))
            try:
                learner.experience.add_labels((number,), "jar", LAB.labels(values))
                told.append(number)
            except QueryError:
                continue
        for number in told[::2]:
            learner.experience.forget((number,))
            row = labels_for(learner.experience, ["jar"])[0]
            np.testing.assert_array_equal(LAB.replace(NOTHING, row), row)


def test_shipped_data_have_one_value_of_each_group():
    table = load_percepts("roc36")
    for members in table.domain.groups.values():
        assert (table.labels[:, table.domain.columns(members)].sum(axis=1) == 1).all()


def test_what_is_asked_has_the_name_of_its_group():
    query = Query(("empty", "metal", "half", "full"), ((0, 2, 3),), ("fill",))
    assert query.questions == (("fill", (0, 2, 3)), ("metal", (1,)))
    assert query.text == "fill, metal?"
    assert query.by_question([False, True, True, False]) == {"fill": "half", "metal": True}
    unnamed = Query(query.attributes, query.groups)
    assert unnamed == query
    assert unnamed.text == "empty, half or full, metal?"
