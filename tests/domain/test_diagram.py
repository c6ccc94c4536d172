import re
from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.domain import (
    Effect,
    TransitionDiagram,
    domain_from_table,
    domain_names,
    domain_table,
    load_domain,
)
from meal_bayes.errors import DomainError

LOOP = Effect("a", "look", "a", 0.8)


def diagram(*effects, states=("a", "b", "term"), start="a", illegal="terminate"):
    return TransitionDiagram(states, start, effects, illegal)


@pytest.mark.parametrize("name", domain_names())
def test_shipped_rows_are_distributions(name):
    domain = load_domain(name)
    arrays = domain.diagram.compile(domain.behavior_names)
    assert (arrays.transition >= 0).all()
    np.testing.assert_allclose(arrays.transition.sum(axis=2), 1.0)
    assert ((arrays.observation_probability >= 0) & (arrays.observation_probability <= 1)).all()
    assert not arrays.legal[-1].any()
    np.testing.assert_array_equal(arrays.transition[:, -1, -1], 1.0)


def test_failure_keeps_x_and_shows_nothing():
    arrays = diagram(Effect("a", "grasp", "b", 0.9), LOOP).compile(["grasp", "look"])
    np.testing.assert_allclose(arrays.transition[0, 0], [0.1, 0.9, 0.0])
    assert arrays.observation_probability[0, 0, 0] == 0.0
    assert arrays.observation_probability[0, 0, 1] == 1.0
    # The loop's own failure looks the same as its success, so a percept comes only sometimes.
    np.testing.assert_allclose(arrays.transition[1, 0], [1.0, 0.0, 0.0])
    np.testing.assert_allclose(arrays.observation_probability[1, 0, 0], 0.8)


@pytest.mark.parametrize(("illegal", "target"), [("terminate", 2), ("stay", 1)])
def test_illegal_behaviors_end_the_trial_or_stay(illegal, target):
    arrays = diagram(Effect("a", "grasp", "b"), illegal=illegal).compile(["grasp"])
    assert not arrays.legal[1, 0]
    assert arrays.transition[0, 1, target] == 1.0
    assert arrays.observation_probability[0, 1].sum() == 0.0


def test_senseless_arrows_give_no_percept():
    effects = (Effect("a", "shake", "a", 0.95, senses=False), Effect("a", "shake", "b", 0.05))
    arrays = diagram(*effects).compile(["shake"])
    np.testing.assert_allclose(arrays.transition[0, 0], [0.95, 0.05, 0.0])
    np.testing.assert_array_equal(arrays.observation_probability[0, 0], [0.0, 1.0, 0.0])


def test_stars_stand_for_every_state_and_for_staying():
    arrays = diagram(Effect("*", "ask", "*"), Effect("a", "go", "b")).compile(["ask", "go"])
    np.testing.assert_array_equal(arrays.legal[:, 0], [True, True, False])
    np.testing.assert_array_equal(arrays.transition[0], np.eye(3))


def test_probabilities_that_round_above_one_stay_distributions():
    states = ("a", "b", "c", "d", "term")
    shares = {"b": 0.7 + 1e-16, "c": 0.2, "d": 0.1 + 1e-10}
    effects = [Effect("a", "go", target, share) for target, share in shares.items()]
    arrays = diagram(*effects, states=states).compile(["go"])
    assert (arrays.transition >= 0).all()


@pytest.mark.parametrize(
    ("effects", "says"),
    [
        ([Effect("a", "grasp", "b", 1.5)], "probability 1.5; expected one in"),
        ([Effect("a", "grasp", "b", float("nan"))], "probability nan; expected"),
        ([LOOP, Effect("a", "look", "b", 0.3)], "total probability 1.1; lower it to 1"),
        ([LOOP], "No behavior ever leads from 'a' to 'b'; add an effect"),
        ([Effect("a", "grasp", "c")], r"names 'c'; expected one of \['a', 'b'\]"),
        ([Effect("c", "grasp", "b")], r"names 'c'; expected one of"),
        ([Effect("a", "go", "b", 0.5)] * 2, "a --go--> b is listed twice; keep one"),
    ],
)
def test_bad_effects_are_refused_in_one_line(effects, says):
    with pytest.raises(DomainError, match=says) as caught:
        diagram(*effects)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"states": ("a", "b")}, "must be distinct, with 'term' as the last"),
        ({"states": ("a", "a", "term")}, "must be distinct"),
        ({"states": ()}, "must be distinct"),
        ({"start": "term"}, "start = 'term' is none of the states"),
        ({"illegal": "explode"}, "expected 'terminate' or 'stay'"),
    ],
)
def test_bad_states_are_refused(changes, says):
    with pytest.raises(DomainError, match=says):
        diagram(Effect("a", "grasp", "b"), **changes)


@pytest.mark.parametrize("above", [1.0000001, 1.000000002, 1.5])
def test_a_sum_that_is_too_large_is_shown_with_all_its_digits(above):
    effects = (Effect("a", "look", "a", 0.5), Effect("a", "look", "b", above - 0.5))
    with pytest.raises(DomainError) as caught:
        TransitionDiagram(("a", "b", "term"), "a", effects)
    (shown,) = re.findall(r"total probability ([\d.]+);", str(caught.value))
    assert float(shown) > 1
    with pytest.raises(DomainError) as caught:
        TransitionDiagram(("a", "term"), "a", (Effect("a", "look", "a", above),))
    (shown,) = re.findall(r"has probability ([\d.]+);", str(caught.value))
    assert float(shown) > 1


@pytest.mark.parametrize("name", ["toy", "roc36", "cy101", "ispy32"])
def test_each_sensing_behavior_is_executed_where_it_is_legal(name):
    domain = replace(load_domain(name), predefined=())
    arrays = domain.diagram.compile(domain.behavior_names)
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
    table["predefined"] = []
    table["behaviors"][1]["cost"] = 0.5  # lifting is cheap
    table["behaviors"].pop()  # and nothing leads back to look
    table["diagram"]["effects"] = [e for e in table["diagram"]["effects"] if e["do"] != "reinit"]
    assert domain_from_table(table).default_sequence == ("look", "lift")


def test_a_named_sequence_is_taken_as_it_is():
    assert load_domain("roc36").default_sequence == load_domain("roc36").predefined
