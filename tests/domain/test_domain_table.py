"""A domain as plain values: it comes back equal, and hostile values are told."""

import json

import pytest

from meal_bayes.domain import domain_from_table, domain_names, domain_table, load_domain
from meal_bayes.errors import DomainError


@pytest.mark.parametrize("name", domain_names())
def test_a_domain_comes_back_equal_through_json(name):
    domain = load_domain(name)
    assert domain_from_table(json.loads(json.dumps(domain_table(domain)))) == domain


def spoiled(*path, value):
    table = domain_table(load_domain("roc36"))
    place = table
    for key in path[:-1]:
        place = place[key]
    if value is None:
        del place[path[-1]]
    else:
        place[path[-1]] = value
    return table


@pytest.mark.parametrize(
    ("table", "found"),
    [
        (None, "found NoneType"),
        ([], "found list"),
        ({}, "has no 'name'"),
        (spoiled("name", value=3), "expected a text"),
        (spoiled("diagram", value=[]), "expected a table"),
        (spoiled("diagram", "effects", value=[1]), "expected rows"),
        (spoiled("diagram", "start", value="x9"), "x9"),
        (spoiled("behaviors", 0, "cost", value=float("nan")), "costs nan"),
        (spoiled("behaviors", 0, "cost", value=10**400), "out of range"),
        (spoiled("asked_minimum", value=float("inf")), "expected a whole number"),
        (spoiled("asked_minimum", value=1.5), "expected a whole number"),
        (spoiled("legal_budget", value=[]), "at least one"),
        (spoiled("behaviors", 0, "cost", value=None), "has no 'cost'"),
        (spoiled("wings", value=2), "Unknown key 'wings'"),
        (spoiled("synonyms", value={"red": 5}), "expected a text"),
    ],
)
def test_tables_that_are_not_well_formed_are_told(table, found):
    with pytest.raises(DomainError, match=found):
        domain_from_table(table)
