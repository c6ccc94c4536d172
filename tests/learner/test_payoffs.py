"""What yes and no earn: the call says it, else the learner, else the domain."""

from dataclasses import replace

import pytest

from meal_bayes import Learner, ask, load_percepts
from meal_bayes.domain import Payoffs
from meal_bayes.errors import SettingsError

OF_DOMAIN = Payoffs(100.0, -100.0, 100.0, -200.0)
OF_LEARNER = Payoffs(100.0, -100.0, 100.0, -1000.0)
OF_CALL = Payoffs(10.0, -20.0, 30.0, -40.0)


def learner_with(payoffs, dataset, make):
    """Return a learner with a robot whose domain has payoffs of its own."""
    domain = replace(dataset.domain, payoffs=OF_DOMAIN)
    return make.learner(replace(dataset, domain=domain), "olfc", payoffs=payoffs)


def earned(trial):
    """Return what a trial's answer earned, without its cost."""
    return round(trial.reward + trial.cost, 9)


@pytest.mark.parametrize("question", ["red and full", "red or not full", "red"])
def test_call_before_learner_before_domain(question, dataset, make):
    asked = {"answer": "yes or no"}
    given = learner_with(OF_LEARNER, dataset, make)
    silent = learner_with(None, dataset, make)
    for learner, options, expected in (
        (silent, {}, OF_DOMAIN),
        (given, {}, OF_LEARNER),
        (given, {"payoffs": OF_CALL}, OF_CALL),
    ):
        truth = {"red": True, "full": True}
        trial = learner.ask(question, make.arm(), truth=truth, **asked, **options)
        assert trial.momdp.payoffs == expected
        assert (trial.momdp.correct, trial.momdp.incorrect) == (max(expected), min(expected))
        last = trial.to_frame().iloc[-1]  # one attribute is its own event
        column = "belief_red" if question == "red" else "probability"
        assert last[column] == (trial.probability or trial.last_belief.positive[0])
        assert earned(trial) in expected


def test_values_of_several_attributes_earn_as_ever(dataset, make):
    momdp = learner_with(OF_LEARNER, dataset, make).problem("red, full")
    assert momdp.payoffs is None
    assert momdp.incorrect == -momdp.correct


def test_payoffs_come_back_from_a_file(dataset, make, tmp_path):
    learner_with(OF_LEARNER, dataset, make).save(tmp_path / "a.mind")
    again = Learner.load(tmp_path / "a.mind", logs=None)
    assert isinstance(again.settings.payoffs, Payoffs)
    assert again.problem("red").payoffs == OF_LEARNER


def test_replays_have_them_too():
    table = load_percepts("roc36")
    learner = Learner("roc36", agent="olfc", payoffs=list(OF_LEARNER), logs=None).fit(table)
    asked = {"answer": "yes or no", "payoffs": OF_CALL}
    trial = ask("heavy and blue", dataset=table, object="heavy_blue_beans", logs=None, **asked)
    assert trial.momdp.payoffs == OF_CALL
    trial = learner.ask("heavy and blue", "heavy_blue_beans", answer="yes or no")
    assert earned(trial) in OF_LEARNER
    found = learner.find("heavy", ["heavy_blue_beans"])  # in which "no" claims nothing
    claims = found.trials["heavy_blue_beans"].momdp.payoffs
    assert claims == (OF_LEARNER.right_yes, OF_LEARNER.wrong_yes, 0.0, 0.0)


@pytest.mark.parametrize(
    "payoffs",
    [(1, 2, 3), "four", 5, (1, -1, 1, float("nan")), (0, 9, 0, 9), (5, 5, 5, 5), (2, 0, 0, 2)],
)
def test_what_is_no_payoffs_is_one_line(payoffs):
    with pytest.raises(SettingsError) as fault:
        Learner("roc36", payoffs=payoffs, logs=None)
    assert "\n" not in str(fault.value)
