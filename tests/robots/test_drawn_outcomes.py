"""What any driver may return: an outcome of the wrong kinds is refused, or read as none."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from meal_bayes.domain import load_domain
from meal_bayes.errors import RobotError
from meal_bayes.robots import Outcome, OutcomeChecker
from meal_bayes.robots.robot import NO_PERCEPT

DOMAIN = load_domain("ispy32")
CHECKER = OutcomeChecker(DOMAIN)
NAMES = ("red", "full", "nobody", "look", "haptic", "audio")  # attributes, or not; modalities
PLAIN = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=3),
    st.binary(max_size=3),
    st.complex_numbers(max_magnitude=9), st.builds(object), st.just(Outcome), st.just(print),
    st.builds(np.zeros, st.sampled_from([(), (0,), (3,), (3, 2), (2, 0)])),
    st.builds(np.ma.array, st.just([1.0, 2.0]), mask=st.just([0, 1])),
    st.builds(np.datetime64, st.just("2020-01-01")), st.builds(np.array, st.just(["1", "2"])),
)  # fmt: skip
VALUES = st.one_of(
    PLAIN,
    st.lists(PLAIN, max_size=3),
    st.dictionaries(
        st.one_of(st.sampled_from(NAMES), st.integers(), st.none()),
        st.one_of(PLAIN, st.lists(PLAIN, max_size=3)),
        max_size=2,
    ),
)
STATES = DOMAIN.diagram.states[:-1]
FIELDS = ("features", "answers", "recording", "percepts")


@pytest.mark.parametrize("behavior", ["look", "lift", "reinit", "ask"])
@given(fields=st.dictionaries(st.sampled_from(FIELDS), VALUES, min_size=1))
@example(fields={"features": np.zeros(3)})  # whose truth is no single one
@example(fields={"percepts": np.zeros((2, 3))})
@example(fields={"answers": np.zeros((2, 3))})
@example(fields={"recording": np.zeros((2, 3))})  # which is shown on two lines
def test_what_is_no_percept_is_a_warning_of_one_line(behavior, fields):
    execution = CHECKER.execute(DOMAIN.behavior_index(behavior), Outcome("x1", **fields))
    assert execution.next_x == 1
    assert len(execution.warning.splitlines()) < 2
    if execution.warning.startswith(NO_PERCEPT):
        assert execution.answers is None
        assert execution.instance is None
    features = {} if execution.instance is None else execution.instance.features or {}
    for values in features.values():
        assert values.dtype == np.float32
        assert np.isfinite(values).all()


@given(
    said=st.dictionaries(st.sampled_from(DOMAIN.attributes), st.sampled_from([True, False, None]))
)
def test_what_a_person_left_open_hides_no_answer(said):
    ungrouped = {name: value for name, value in said.items() if not DOMAIN.group_of(name)}
    execution = CHECKER.execute(DOMAIN.behavior_index("ask"), Outcome("x1", answers=ungrouped))
    given_answers = {name: value for name, value in ungrouped.items() if value is not None}
    assert execution.answers == given_answers
    assert not execution.warning


@given(state=VALUES.filter(lambda value: not (isinstance(value, str) and value in STATES)))
def test_a_state_of_another_kind_is_refused_in_one_line(state):
    with pytest.raises(RobotError, match="state") as caught:
        CHECKER.execute(0, Outcome(state))
    assert len(str(caught.value).splitlines()) == 1


@given(outcome=VALUES)
def test_what_is_no_outcome_is_refused(outcome):
    with pytest.raises(RobotError, match=r"return an Outcome\(state, features\)"):
        CHECKER.execute(0, outcome)
