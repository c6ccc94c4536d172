"""A group is one variable: in questions, and in labels."""

import numpy as np
import pytest

from meal_bayes import load_percepts
from meal_bayes.datasets import Dataset
from meal_bayes.domain import load_domain, read_query
from meal_bayes.errors import DataError, DomainError, QueryError

ROC36 = load_domain("roc36")
CUP = {"extends": "toy", "name": "cup", "attributes": ["metal", "empty", "half", "full"]}
LAB = load_domain(CUP | {"groups": {"fill": ["empty", "half", "full"]}})
CONTENT = ROC36.groups["content"]


@pytest.mark.parametrize(
    ("question", "domain", "attributes", "groups"),
    [
        ("fill", LAB, ("empty", "half", "full"), ((0, 1, 2),)),
        (["metal", "Fill"], LAB, ("metal", "empty", "half", "full"), ((1, 2, 3),)),
        ("Is it half full?", LAB, ("half",), ()),
        ("Is it half full and metal?", LAB, ("half", "metal"), ()),
        ("half, full", LAB, ("empty", "half", "full"), ((0, 1, 2),)),
        ("What color is it?", ROC36, ("brown", "green", "blue"), ((0, 1, 2),)),
        ("Is the color red?", ROC36, ("brown",), ()),
        ("Is it heavy, and what are its contents?", ROC36, ("heavy", *CONTENT), ((1, 2, 3, 4),)),
        ("Is it heavy, and is it red?", ROC36, ("heavy", "brown"), ()),
    ],
)
def test_questions_about_groups(question, domain, attributes, groups):
    query = read_query(question, domain)
    assert (query.attributes, query.groups) == (attributes, groups)


@pytest.mark.parametrize(
    "groups",
    [{"a": ["metal"]}, {"a": ["empty", "half"], "b": ["half", "full"]}, {"a": ["half", "half"]}],
)
def test_groups_have_values_of_their_own(groups):
    with pytest.raises(DomainError, match=r"two or more|twice"):
        load_domain(CUP | {"groups": groups})


@pytest.mark.parametrize("row", [[1, 1, 0, 1], [0, 0, 0, 0], [-1, 1, 1, -1]])
def test_data_with_other_than_one_value_of_a_group_are_refused(row):
    features = {
        (behavior.name, modality): np.zeros((2, 1, 3))
        for behavior in LAB.behaviors
        for modality in behavior.modalities
    }
    Dataset(LAB, ("cup", "jar"), features, [[1, 0, 1, 0], [0, -1, -1, 0]])
    with pytest.raises(DataError, match=r"'jar' is .* of 'fill' .*exactly one is true"):
        Dataset(LAB, ("cup", "jar"), features, [[1, 0, 1, 0], row])


def test_the_value_of_a_group_labels_all_its_attributes():
    assert LAB.with_values({"fill": "half"}) == {"empty": False, "half": True, "full": False}
    assert LAB.with_values({"metal": True, "full": False}) == {"metal": True, "full": False}


@pytest.mark.parametrize(
    "values",
    [{"half": True, "full": True}, dict.fromkeys(("empty", "half", "full"), False),
     {"fill": "heavy"}, {"fill": "half", "full": 1}],
)  # fmt: skip
def test_labels_that_contradict_a_group_are_refused(values):
    with pytest.raises(QueryError, match=r"exactly one is|Unknown value of 'fill'"):
        LAB.with_values(values)


def test_shipped_data_have_one_value_of_each_group():
    table = load_percepts("roc36")
    assert table.domain.group_misfit(table.labels) is None
