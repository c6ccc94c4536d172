"""A detector that changes its kind of answer, or its scale, is told in a line with both."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meal_bayes import Outcome, load_domain
from meal_bayes.datasets.percepts import checked_percepts
from meal_bayes.errors import DataError
from meal_bayes.robots.robot import OutcomeChecker

LOOK = 0


@pytest.fixture(scope="module")
def domain():
    return load_domain("examples/kitchen.toml")


def heard(checker, *values):
    return [checker.execute(LOOK, Outcome("table", percepts={"red": value})) for value in values]


numbers = st.one_of(st.floats(allow_nan=False, allow_infinity=False), st.integers(-(2**60), 2**60))


@given(numbers)
@settings(max_examples=50, deadline=None)
def test_every_finite_number_is_a_score(number):
    toy = load_domain("toy")
    for value in (number, np.float64(number), np.array(float(number))):
        assert checked_percepts({"red": value}, toy) == ({}, {"red": float(number)})


@pytest.mark.parametrize("value", [True, np.True_, False, "yes", "surely no"])
def test_words_are_no_scores(value):
    assert checked_percepts({"red": value}, load_domain("toy")).scores == {}


@pytest.mark.parametrize(
    "value", [np.nan, np.inf, -np.inf, np.float32("nan"), 10**400, "0.83", "maybe", [0.5], 1j]
)
def test_what_is_no_score_is_told_in_one_line(domain, value):
    with pytest.raises(DataError, match="'red'") as fault:
        checked_percepts({"red": value}, domain)
    assert "\n" not in str(fault.value)
    (execution,) = heard(OutcomeChecker(domain), value)
    assert execution.instance is None
    assert "look" in execution.warning
    assert "'red'" in execution.warning


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize(
    ("value", "told"),
    [("brown", False), ("brown", "no"), ("brown", "yes"), ("green", True), ("green", 0.1)],
)
def test_a_group_and_its_value_do_not_contradict_each_other(value, told, order):
    roc36 = load_domain("roc36")
    both = dict([("color", value), ("brown", told)][::order])
    with pytest.raises(DataError, match="two things of 'brown'"):
        checked_percepts(both, roc36)
    said = checked_percepts({"color": value, "brown": value == "brown"}, roc36)
    assert said == checked_percepts({"color": value}, roc36)


@pytest.mark.parametrize("value", [None, np.ma.masked])
def test_nothing_is_no_score(domain, value):
    assert checked_percepts({"red": value}, domain) == ({}, {})


def test_a_larger_scale_is_told_with_both_ranges_and_left_aside(domain):
    checker = OutcomeChecker(domain)
    heard(checker, *np.linspace(0.02, 0.97, 12).tolist())
    with pytest.warns(UserWarning, match=r"look.*'red'.*83.*0\.02 to 0\.97"):
        (execution,) = heard(checker, 83.0)
    assert execution.instance is None
    (execution,) = heard(checker, 0.5)
    assert execution.instance.scores == {"red": 0.5}


def test_a_smaller_scale_is_told_with_both_ranges(domain):
    checker = OutcomeChecker(domain)
    heard(checker, *np.linspace(2, 97, 12).tolist())
    with pytest.warns(UserWarning, match=r"look.*'red'.*0\.1 to 0\.9.*2 to 97"):
        heard(checker, 0.9, 0.1, 0.4, 0.7, 0.2)


@given(st.sampled_from(["probability", "logit", "cosine", "percent"]), st.integers(0, 1000))
@settings(max_examples=40, deadline=None)
def test_one_scale_is_not_told_for_two(scale, seed):
    logit = np.random.default_rng(seed).normal(-1, 2, 40)
    share = 1 / (1 + np.exp(-logit))
    values = {"logit": logit, "probability": share, "percent": 100 * share, "cosine": share / 3}
    checker = OutcomeChecker(load_domain("examples/kitchen.toml"))
    assert all(not execution.warning for execution in heard(checker, *values[scale].tolist()))


def test_words_among_scores_and_scores_among_words_are_left_aside(domain):
    checker = OutcomeChecker(domain)
    heard(checker, 0.2)
    with pytest.warns(UserWarning, match=r"look.*'red' is yes or no.*0\.2"):
        assert heard(checker, True)[0].instance is None
    checker = OutcomeChecker(domain)
    heard(checker, True)
    with pytest.warns(UserWarning, match=r"look.*'red' is the score 0\.2"):
        assert heard(checker, 0.2)[0].instance is None
