"""A driver that was wrong, or hardware that was broken, and is mended: what is learned of it."""

import sys
import warnings
from dataclasses import replace

import numpy as np
import pytest

from meal_bayes import Learner, read_trials
from meal_bayes.domain import domain_from_table, learn_success
from meal_bayes.errors import SettingsError
from meal_bayes.learner import recall, views
from meal_bayes.learner.experience import Experience
from meal_bayes.robots import Outcome

UNREADABLE = {
    "another name": {"features": {"COLOR": [1.0, 2.0, 3.0]}},
    "another size": {"features": {"color": [1.0, 2.0]}},
    "no numbers": {"features": {"color": "red"}},
    "not finite": {"features": {"color": [np.nan] * 3}},
    "empty": {"features": {"color": []}},
    "no mapping": {"features": [1.0, 2.0, 3.0]},
    "a percept of what is not known": {"percepts": {"blue": True}},
    "answers": {"answers": {"red": True}},
}
BENCH = {
    "name": "bench",
    "attributes": ["metal"],
    "report_reward": 60.0,
    "behaviors": [{"name": "shake", "cost": 1.0, "modalities": ["audio"]}],
    "diagram": {
        "states": ["table"],
        "start": "table",
        "effects": [{"from": "table", "do": "shake", "to": "table", "probability": 0.67}],
    },
}


def ask(learner, robot, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return learner.ask("red", robot, **options)


@pytest.mark.parametrize("outcome", UNREADABLE.values(), ids=UNREADABLE)
def test_what_cannot_be_read_is_no_failure(dataset, make, tmp_path, outcome):
    agent = make.agent("look", **make.ours)
    learner = make.learner(dataset, agent, logs=tmp_path)
    trial = ask(learner, make.faulty(Outcome("table", **outcome)), object_name="mug")
    assert [step.unread for step in trial.steps] == [True, False]
    assert not views.attempts(learner.experience).any()
    again = make.learner(dataset, agent)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        recall(again, tmp_path)
    assert len(again.experience.executions) == 1
    assert not views.attempts(again.experience).any()
    ask(learner, make.faulty(Outcome("table")))  # nothing came: a failure
    assert views.attempts(learner.experience)[0].tolist() == [1, 0]


def test_a_forgotten_trial_has_never_been(dataset, make):
    """Its failures are taken back, too, and the trials since are as many as without it."""
    agent = make.agent("look", "look", "look", **make.ours)
    whole = make.learner(dataset, agent)
    without = make.learner(dataset, agent)
    for number, broken in enumerate([False, True, False, True]):
        for learner in (whole, without)[: 1 if broken else 2]:
            robot = make.faulty(Outcome("table")) if broken else make.arm(seed=number)
            trial = ask(learner, robot, object_name=f"mug {number}", key=number)
            if learner is whole and broken:
                learner.tell(trial, {"red": True})
            elif number:
                ask(learner, make.faulty(Outcome("table")), object_name="pot", key=f"pot {number}")
        if broken:
            if number == 3:
                assert views.attempts(whole.experience)[0, 0] > 3
            whole.forget(trial, recordings=True)
    without.refit()
    np.testing.assert_array_equal(
        views.attempts(whole.experience), views.attempts(without.experience)
    )
    ours = whole.knowledge()
    theirs = without.knowledge()
    assert ours.domain == theirs.domain
    assert ours.domain != dataset.domain  # the pot's failures are learned
    np.testing.assert_array_equal(ours.posterior.counts, theirs.posterior.counts)
    np.testing.assert_array_equal(ours.base_rates, theirs.base_rates)
    with pytest.raises(SettingsError, match="has no labels or recordings"):
        whole.forget(trial, recordings=True)


def test_a_trial_of_failures_alone_can_be_forgotten(dataset, make):
    learner = make.learner(dataset, make.agent("look", "look", "look", **make.ours))
    trial = ask(learner, make.faulty(Outcome("table")))
    assert learner.knowledge().domain != dataset.domain
    learner.forget(trial, recordings=True)
    assert learner.knowledge().domain == dataset.domain


def test_what_was_broken_is_believed_again_by_and_by():
    domain = domain_from_table(BENCH)
    record = Experience(domain)
    for trial in range(6):
        for _ in range(3):
            record.add_execution((trial,), "cup", 0, success=0)

    def believed():
        return learn_success(domain, views.attempts(record)).diagram.effects[0].probability

    rates = [believed()]
    for trial in range(6, 30):
        record.trial_number((trial,))
        record.trial_number(("told", f"cup {trial}"))  # no trial
        rates.append(believed())
    assert rates[0] < 0.12
    assert (np.diff(rates) > 0).all()
    assert rates[12] > 0.28
    assert rates[24] > 0.5


class Shaker:
    """Shakes that sense something or not, in turn."""

    def __init__(self, *works):
        self.works = list(works)

    def start(self):
        return "table"

    def execute(self, behavior):
        return Outcome("table", {"audio": [1.0]} if self.works.pop(0) else None)


def test_failures_that_the_diagram_explains_are_no_warnings(make):
    def warned(probability, *works):
        effect = {**BENCH["diagram"]["effects"][0], "probability": probability}
        table = {**BENCH, "diagram": {**BENCH["diagram"], "effects": [effect]}}
        learner = Learner(table, agent=make.agent(*["shake"] * len(works)), logs=None)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            trial = learner.ask("metal", Shaker(*works))
        return [bool(step.warning) for step in trial.steps[:-1]]

    assert warned(0.67, False, True, False, False) == [False] * 4
    assert warned(0.67, False, False, True)[:2] == [False, False]
    assert warned(0.01, *[False] * 9) == [False] * 9
    assert warned(1.0, False) == [True]
    assert warned(0.9, False, False) == [False, True]


def test_a_name_that_may_be_a_typo_is_warned_of(dataset, make):
    learner = make.learner(dataset)
    with pytest.warns(UserWarning, match=r"no recording of 'cup10'.*'cup 10'") as caught:
        learner.tell("cup10", {"full": True})
    if sys.version_info >= (3, 12):  # which can pass over the lines of a package
        assert caught[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        learner.tell("cup10", {"full": False})
        learner.tell("cup 99", {"full": True})


def test_what_there_is_to_forget_is_said(dataset, make, tmp_path):
    learner = make.learner(dataset, make.agent("look", **make.ours), logs=tmp_path)
    trial = ask(learner, make.arm(), object_name="mug")
    learner.tell(trial, {"red": True, "full": False})
    with pytest.raises(SettingsError, match=r"2 of its trials have labels.*read_trials\(log\)"):
        learner.forget("mug")
    with pytest.raises(SettingsError, match="did you mean 'mug'"):
        learner.forget("mugg")
    (log,) = (tmp_path / "kitchen").glob("*.mcap")
    learner.forget(next(iter(read_trials(log))))
    with pytest.raises(SettingsError, match=r"has no labels\."):
        learner.forget("mug")


def test_what_joined_is_said_of_the_last_call_alone(dataset, make):
    learner = make.learner(dataset, make.agent("look", **make.ours))
    first = repr(learner)
    again = repr(learner)
    assert "72 joined" in first
    assert again == first
    assert "0 joined, 72 were known" in repr(learner.fit(dataset))
    ask(learner, make.arm())
    assert "joined" not in repr(learner)


def test_warnings_point_at_the_line_that_asked(dataset, make):
    learner = make.learner(dataset, make.agent("look", "look", "look"))
    odd = Outcome("table", {"color": [1.0, 2.0, 3.0], "sound": [1.0]}, percepts={"red": True})
    for outcome in (Outcome("table"), replace(odd, features={"color": [np.nan] * 3})):
        with pytest.warns(UserWarning, match="percept of|yielded nothing") as caught:
            learner.ask("red", make.faulty(outcome))
        if sys.version_info >= (3, 12):
            assert {warning.filename for warning in caught} == {__file__}


@pytest.mark.long
@pytest.mark.parametrize("fault", ["unread", "broken"])
def test_a_robot_that_was_mended_works_again(make, fault):
    """From nothing: a driver that names another modality, or a sensor that is dead, five times."""

    class Faulty(make.arm):
        def execute(self, behavior):
            outcome = super().execute(behavior)
            if fault == "broken" or outcome.features is None:
                return Outcome(outcome.state)
            return replace(outcome, features={k.upper(): v for k, v in outcome.features.items()})

    learner = Learner(make.kitchen, horizon=100, logs=None)
    executed = []
    for number in range(16):
        cup = {"red": bool(number % 2), "full": bool(number % 3)}
        arm = (Faulty if number < 5 else make.arm)(**cup, seed=number)
        learner.tell(ask(learner, arm, object_name=f"mug {number}", key=number), cup)
        executed.append(arm.executed)
    assert all(names.count("look") <= 2 for names in executed[:5])
    assert all("look" in names for names in executed[-4:])
    if fault == "unread":
        assert "look" in executed[5]
