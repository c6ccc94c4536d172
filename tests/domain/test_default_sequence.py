"""Without a predefined sequence every sensing behavior is executed, the cheapest first."""

from dataclasses import replace

import pytest

from meal_bayes.domain import domain_from_table, domain_table, load_domain


@pytest.mark.parametrize("name", ["toy", "roc36", "cy101", "ispy32"])
def test_each_sensing_behavior_is_executed_where_it_is_legal(name):
    domain = replace(load_domain(name), predefined=())
    arrays = domain.transitions()
    sequence = domain.default_sequence
    x = domain.diagram.states.index(domain.diagram.start)
    for behavior in sequence:
        e = domain.behavior_index(behavior)
        assert arrays.legal[x, e]
        x = int(arrays.transition[e, x].argmax())
    senses = [b.name for b in domain.behaviors if b.senses]
    assert set(senses) <= set(sequence)


def test_of_two_ways_the_cheaper_is_taken():
    table = domain_table(load_domain("toy"))
    table["predefined"] = []
    assert domain_from_table(table).default_sequence == ("look", "lift")
    table["behaviors"][0]["cost"] = 6.0  # dearer than lifting, which needs reinit afterwards
    assert domain_from_table(table).default_sequence == ("lift", "reinit", "look")


def test_what_leads_nowhere_comes_last():
    table = domain_table(load_domain("toy"))
    table["predefined"], table["behaviors"][1]["cost"] = [], 0.5  # lifting is cheap
    table["behaviors"].pop()  # and nothing leads back to look
    table["diagram"]["effects"] = [e for e in table["diagram"]["effects"] if e["do"] != "reinit"]
    assert domain_from_table(table).default_sequence == ("look", "lift")


def test_a_named_sequence_is_taken_as_it_is():
    assert load_domain("roc36").default_sequence == load_domain("roc36").predefined
