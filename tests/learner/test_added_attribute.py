"""Attributes that are added to a learner which has recorded objects before."""

import numpy as np
import pytest

from meal_bayes import load_percepts
from meal_bayes.errors import DomainError, SettingsError
from meal_bayes.learner import Learner, recall
from meal_bayes.posterior import ConfusionPosterior

PLAN = ("look", "lift", "reset", "look", "lift")


@pytest.fixture
def learner(dataset, make, tmp_path):
    """A learner that met twelve cups, and the agent and folder that it was made with."""
    agent = make.agent(*PLAN, **make.ours)
    learner = make.learner(dataset, agent, logs=tmp_path / "logs", refit_every=0.2)
    return learner.fit(dataset)


def tell_heavy(learner, dataset, number):
    """Tell the new word of some cups: those that are full are heavy."""
    for name, row in list(zip(dataset.objects, dataset.labels, strict=True))[:number]:
        learner.tell(name, {"heavy": bool(row[1])})


def test_what_was_sensed_before_teaches_a_new_attribute(learner, dataset, make):
    learner.add_attribute("heavy")
    assert learner.domain.attributes == ("red", "full", "heavy")
    assert learner.knowledge().most_telling(2) is None
    tell_heavy(learner, dataset, 8)  # without a refit by hand
    behavior, youden, _ = learner.knowledge().most_telling(2)
    assert behavior == "lift"
    assert youden > 0.5
    trial = learner.ask("Is it heavy?", make.arm(full=True), learn=False)
    assert trial.answer == {"heavy": True}


def test_a_group_is_one_value(learner):
    learner.add_attribute("size", ["small", "large"])
    learner.tell("cup 1", {"size": "large"})
    assert learner.experience.object_labels.values[1].tolist()[2:] == [0, 1]
    assert learner.knowledge().base_rates[2:].sum() == pytest.approx(1.0)


def knows(learner):
    """Return what a learner knows, as arrays."""
    knowledge = learner.knowledge()
    return [
        knowledge.posterior.concentration,
        knowledge.base_rates,
        learner.experience.object_labels.values,
    ]


def test_a_saved_learner_and_one_that_recalls_know_as_much(make, tmp_path):
    agent = make.agent(*PLAN, **make.ours)
    options = {"agent": agent, "refit_every": 0.5}
    learner = Learner(make.kitchen, logs=tmp_path / "logs", **options)
    for n in range(4):
        arm = make.arm(full=n % 2 == 0, red=n % 3 == 0, seed=n)
        trial = learner.ask("full", arm, object_name=f"cup {n}")
        learner.tell(trial, {"full": arm.full, "red": arm.red})
    learner.add_attribute("heavy")
    learner.add_attribute("size", ["small", "large"])
    for n in range(3):
        learner.tell(f"cup {n}", {"heavy": n % 2 == 0, "size": "small" if n else "large"})
    trial = learner.ask("heavy", make.arm(seed=9), object_name="mug")
    learner.tell(trial, {"heavy": True})
    learner.save(tmp_path / "learner")
    loaded = Learner.load(tmp_path / "learner", agent=agent, logs=None)
    recalled = Learner(make.kitchen, logs=None, **options)
    assert len(recall(recalled, tmp_path / "logs")) == 5
    for other in (loaded, recalled):
        assert other.domain == learner.domain
        for ours, theirs in zip(knows(learner), knows(other), strict=True):
            assert np.array_equal(ours, theirs)
    assert recall(loaded, tmp_path / "logs") == []
    assert loaded.domain == learner.domain


def test_logs_that_are_in_no_order_add_the_attribute_first(make, tmp_path):
    agent = make.agent(*PLAN, **make.ours)
    learner = Learner(make.kitchen, agent=agent, logs=tmp_path)
    learner.tell(
        learner.ask("full", make.arm(), log=tmp_path / "kitchen" / "0.mcap"), {"full": True}
    )
    learner.add_attribute("heavy")
    learner.tell(
        learner.ask("heavy", make.arm(), log=tmp_path / "kitchen" / "1.mcap"), {"heavy": True}
    )
    recalled = Learner(make.kitchen, agent=agent, logs=None)
    assert len(recall(recalled, tmp_path)) == 2
    assert recalled.domain == learner.domain


def test_what_is_added_before_the_first_trial_is_recalled(make, tmp_path):
    agent = make.agent(*PLAN, **make.ours)
    learner = Learner(make.kitchen, agent=agent, logs=tmp_path).add_attribute("heavy")
    learner.add_attribute("size", ["small", "large"])
    learner.tell(learner.ask(["heavy", "size"], make.arm()), {"heavy": True, "size": "small"})
    for domain in (make.kitchen, learner.domain):
        again = Learner(domain, agent=agent, logs=None)
        assert len(recall(again, tmp_path)) == 1
        assert again.domain == learner.domain
        labels = again.experience.object_labels.values
        np.testing.assert_array_equal(labels, learner.experience.object_labels.values)


def test_labels_of_an_attribute_that_a_domain_lacks_are_named(make, tmp_path):
    agent = make.agent(*PLAN, **make.ours)
    with_heavy = {**make.kitchen, "attributes": ["red", "full", "heavy"]}
    learner = Learner(with_heavy, agent=agent, logs=tmp_path)
    learner.tell(learner.ask("full", make.arm()), {"heavy": True})
    with pytest.warns(UserWarning, match="'heavy'"):
        recall(Learner(make.kitchen, agent=agent, logs=None), tmp_path)


def test_a_trial_in_progress_keeps_its_attributes(learner, make):
    arm = make.arm(full=True)
    session = learner.begin("full", "mug", state=arm.start())
    session.observe(arm.execute(session.behavior))
    learner.add_attribute("heavy")
    while not session.over:
        session.observe(arm.execute(session.behavior))
    assert session.trial.task.query.attributes == ("full",)
    learner.tell(session.trial, {"full": True, "heavy": True})
    of_mug = learner.experience.instances_of_object(learner.experience.objects["mug"])
    assert len(of_mug) == len(session.trial.steps) - 2  # neither reset nor report senses
    assert (learner.experience.labels.values[of_mug] == [-1, 1, 1]).all()


@pytest.mark.parametrize("name", ["red", "RED", "with, comma", "not", "", " heavy", "a\nb", 3])
def test_a_name_that_cannot_be_is_refused(learner, name):
    with pytest.raises(DomainError) as refused:
        learner.add_attribute(name)
    assert "\n" not in str(refused.value)
    assert learner.domain.attributes == ("red", "full")


@pytest.mark.parametrize("values", ["large", ["large"], ["large", "red"], ["large", "large"]])
def test_values_that_cannot_be_are_refused(learner, values):
    with pytest.raises(DomainError):
        learner.add_attribute("size", values)
    learner.add_attribute("size", ["small", "large"])
    with pytest.raises(DomainError, match="'size'"):
        learner.add_attribute("size", ["tiny", "huge"])


def test_tables_and_posteriors_know_no_other_attribute(dataset, make):
    with pytest.raises(SettingsError, match="'heavy'"):
        Learner("roc36", logs=None).fit(load_percepts("roc36")).add_attribute("heavy")
    agent = make.agent(*PLAN, **make.ours)
    posterior = ConfusionPosterior.from_counts(np.ones((2, 3, 2, agent.levels)), prior=1.0)
    given = Learner(dataset.domain, agent=agent, posterior=posterior, logs=None)
    with pytest.raises(SettingsError, match="posterior"):
        given.add_attribute("heavy")
