"""Numbers, texts and truth values of numpy as settings: taken as what they are, and JSON behind."""

import dataclasses
import json
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from meal_bayes import Learner, load_domain, load_percepts
from meal_bayes.agents import Agent, ITRSBonus
from meal_bayes.agents.named import as_agent
from meal_bayes.arrays import (
    check_amount,
    check_seconds,
    check_whole,
    check_yes_no,
    plain,
    shaped_array,
)
from meal_bayes.datasets.feature_checks import checked_features
from meal_bayes.datasets.percepts import checked_percepts
from meal_bayes.domain import domain_from_table, domain_table
from meal_bayes.errors import QueryError, SettingsError
from meal_bayes.experiments import OfflineConfig, OnlineConfig
from meal_bayes.learner import LearnerSettings
from meal_bayes.perception.settings import PerceptionSettings
from meal_bayes.planners import POMCP, Factored
from meal_bayes.posterior.draws import Sampling

WHOLE = [np.int8, np.int16, np.int32, np.int64, np.uint8, np.uint64, np.intp, np.array]
REAL = [np.float16, np.float32, np.float64, np.longdouble, np.array, Fraction, Decimal]
FORMS = st.sampled_from(WHOLE), st.sampled_from(REAL)


def disguised(value, whole, real):  # noqa: PLR0911  a kind a line
    """Write a value and what is inside it in types of numpy, and the like."""
    if isinstance(value, bool):
        return np.bool_(value)
    if isinstance(value, int):
        return whole(value) if value < 100 else np.int64(value)
    if isinstance(value, float):
        return np.float64(value) if np.isinf(value) else real(value)
    if isinstance(value, str):
        return np.str_(value)
    if type(value) in (list, tuple):
        return type(value)(disguised(part, whole, real) for part in value)
    if type(value) is dict:
        return {key: disguised(part, whole, real) for key, part in value.items()}
    return value


SETTINGS = [
    OfflineConfig("toy", attributes=1, trials=4, agents=("prior",), seed=3, reward=8.0),
    OfflineConfig("toy", agents=("prior",), answer="yes or no", payoffs=(4.0, -2.0, 1.0, -8.0)),
    OnlineConfig("toy", agents=("bayes",), seed=3, alpha=2.0, beta=4.0, split=(1, 1, 2)),
    LearnerSettings(seed=3, reward=8.0, horizon=64.0, refit_every=0.5, learn_success=False),
    PerceptionSettings(levels=4, width=0.5, folds=3),
    Agent("own", as_agent("bayes").solver, levels=4, discount=0.5, abstain=True),
    ITRSBonus(alpha=2.0, beta=4.0),
    POMCP(simulations=7, milliseconds=2.0, exploration=0.5),
    Factored(points=70, tolerance=0.5),
    Sampling(draws=7, seed=3),
]


@pytest.mark.parametrize("settings", SETTINGS, ids=lambda value: type(value).__name__)
@given(*FORMS)
def test_settings_are_taken_as_what_they_are(settings, whole, real):
    for field in dataclasses.fields(settings):
        if not field.init:
            continue
        value = getattr(settings, field.name)
        other = dataclasses.replace(settings, **{field.name: disguised(value, whole, real)})
        assert other == settings
        taken = getattr(other, field.name)
        assert type(taken) is type(value)
        if isinstance(value, bool | int | float | str):
            assert json.dumps(taken) == json.dumps(value)


@given(*FORMS)
def test_tables_of_domains_are_too(whole, real):
    table = domain_table(load_domain("roc36"))
    domain = domain_from_table(disguised(table, whole, np.float64))
    assert domain == load_domain("roc36")
    assert json.dumps(domain_table(domain)) == json.dumps(table)
    behavior = dataclasses.replace(domain.behaviors[0], cost=real(0.5))
    assert json.dumps(behavior.cost) == "0.5"


@given(st.sampled_from(WHOLE), st.integers(0, 99))
def test_checks_of_numbers_take_and_refuse_alike(whole, number):
    assert type(check_whole("seed", whole(number))) is int
    check_seconds("max_cost", whole(number))
    check_amount("reward", whole(number + 1))
    check_yes_no("learn", np.array(True))
    for wrong in (np.float64(0.5), np.bool_(True), np.array([number]), np.str_("3")):
        with pytest.raises(SettingsError, match="seed"):
            check_whole("seed", wrong)
    with pytest.raises(SettingsError, match="reward"):
        check_amount("reward", np.array(np.nan))
    assert plain(np.array([1])).tolist() == [1]


def test_a_learner_acts_the_same_and_is_saved(tmp_path):
    table = load_percepts("roc36")
    name = "heavy_blue_beans"
    expected = Learner("roc36", seed=3, reward=200.0, logs=None).fit(table).ask("red", name)
    learner = Learner("roc36", seed=np.int64(3), reward=np.float32(200), logs=tmp_path / "logs")
    trial = learner.fit(table).ask(np.str_("red"), np.str_(name), max_steps=np.int32(50))
    assert trial.steps[0].decision == expected.steps[0].decision
    assert learner.settings.seed == 3
    learner.save(tmp_path / "learner.zip")


HUGE = st.sampled_from([int, Decimal, Fraction]).flatmap(
    lambda kind: st.tuples(st.integers(309, 900), st.booleans()).map(
        lambda drawn: kind(10 ** drawn[0] * (-1 if drawn[1] else 1))
    )
)


@given(HUGE)
def test_numbers_beyond_floats_are_refused_in_one_line(huge):
    """By an error of the package that names the argument."""
    learner = Learner("toy", agent="prior", logs=None)
    with pytest.raises(SettingsError, match="reward"):
        Learner("toy", reward=huge, logs=None)
    with pytest.raises(QueryError, match="Payoffs"):
        learner.begin("red", payoffs=(huge, -1, 1, -1), answer="yes or no")
    with pytest.raises(SettingsError, match="prior"):
        shaped_array("prior", [huge], 1) if isinstance(huge, int) else check_amount("prior", huge)
    if isinstance(huge, int) or huge < 0:  # the others are as good as no limit
        with pytest.raises(SettingsError, match="max_cost"):
            learner.begin("red", max_cost=huge)


@given(st.sampled_from([Decimal, Fraction]), st.integers(-8, 8))
def test_percepts_and_features_are_numbers_of_any_type(kind, eighths):
    value = kind(eighths) / 8
    assert checked_percepts({"red": value}, load_domain("toy")).scores == {"red": eighths / 8}
    features = checked_features([value, kind(1)])
    np.testing.assert_array_equal(features, np.array([eighths / 8, 1.0], np.float32))
