"""Names that only a program can tell apart: no domain has two of them."""

import copy

import pytest

from meal_bayes import load_domain
from meal_bayes.domain.words import doubled, look
from meal_bayes.errors import DomainError

TABLE = {
    "name": "k",
    "attributes": ["red", "full"],
    "behaviors": [
        {"name": "look", "cost": 1.0, "modalities": ["color"]},
        {"name": "lift", "cost": 1.0, "modalities": ["force"]},
    ],
    "diagram": {
        "states": ["table", "held"],
        "start": "table",
        "effects": [
            {"from": "table", "do": "look", "to": "table"},
            {"from": "table", "do": "lift", "to": "held"},
            {"from": "held", "do": "lift", "to": "table"},
        ],
    },
}
PAIRS = [
    ("x", "x"),
    ("caf\u00e9", "cafe\u0301"),
    ("a b", "a  b"),
    ("a b", "a\u00a0b"),
    ("ab", "a\u200bb"),
]


def named(kind, pair):
    """Return the table with a pair of names of a kind."""
    table = copy.deepcopy(TABLE)
    first, second = table["behaviors"]
    if kind == "attribute":
        table["attributes"] = [*pair]
    elif kind == "modality":
        first["modalities"] = [*pair]
    elif kind == "behavior":
        first["name"], second["name"] = pair
        for effect in table["diagram"]["effects"]:
            effect["do"] = pair[effect["do"] == "lift"]
    else:
        states = dict(zip(("table", "held"), pair, strict=True))
        table["diagram"] |= {"states": [*pair], "start": pair[0]}
        for effect in table["diagram"]["effects"]:
            effect |= {"from": states[effect["from"]], "to": states[effect["to"]]}
    return table


@pytest.mark.parametrize("pair", PAIRS)
@pytest.mark.parametrize("kind", ["attribute", "behavior", "modality", "state"])
def test_no_two_names_of_a_domain_look_the_same(kind, pair):
    told = r"look the same|listed twice|stands for two|must be distinct|total probability"
    with pytest.raises(DomainError, match=told):
        load_domain(named(kind, pair))
    load_domain(named(kind, ("one", "other")))


def test_signs_that_join_letters_are_seen():
    assert look("a\u200db") != look("ab")
    assert not doubled("object", ["a\u200db", "ab", "Ab"])
