"""Told trials are conjugate updates: at once, in any order, and taken back exactly."""

import dataclasses
import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from meal_bayes.agents import knowledge_without
from meal_bayes.agents.base_rates import learn_base_rates
from meal_bayes.datasets import TrainingSet, load_percepts
from meal_bayes.errors import LogError, QueryError, SettingsError
from meal_bayes.learner import Learner, recall
from meal_bayes.perception import fit_and_validate
from meal_bayes.posterior import ConfusionPosterior
from meal_bayes.robots import Outcome


@pytest.fixture(scope="module")
def met(dataset, make):
    """A learner with trials about four objects, one of which it meets twice."""
    learner = make.learner(dataset, make.agent("look", "lift", **make.ours))
    trials = []
    for number, (name, red) in enumerate([("a", 1), ("b", 0), ("a", 1), (None, 0), ("cup 3", 1)]):
        arm = make.arm(red=bool(red), full=number % 2 == 0, seed=number)
        trials.append(learner.ask("red, full", arm, object_name=name))
    return learner, trials


def alpha(learner):
    return learner.knowledge().posterior.concentration


VALUES = st.dictionaries(st.sampled_from(["red", "full"]), st.booleans(), min_size=1)
WORDS = st.lists(st.tuples(st.integers(0, 3), st.none() | VALUES), max_size=10)


@given(words=WORDS)
def test_evidence_is_delta_times_experience_and_all_is_taken_back(met, words):
    """`evidence == delta * IE` (Eq. 10) after every word; forgetting restores the posterior."""
    learner, trials = met
    fitted = alpha(learner)
    rates = learner.knowledge().base_rates
    base = learner.knowledge().posterior.counts.sum(axis=(2, 3))
    told = {}
    try:
        for number, values in words:
            if values is None and number in told:
                learner.forget(trials[number])
                del told[number]
            elif values is not None:
                learner.tell(trials[number], values)
                told[number] = {**told.get(number, {}), **values}
            more = np.zeros_like(base)
            for n, given_labels in told.items():
                for step in trials[n].steps[:2]:
                    for name in given_labels:
                        p = learner.domain.attribute_index(name)
                        more[p, step.decision.action] += step.observation is not None
            counts = learner.knowledge().posterior.counts
            np.testing.assert_array_equal(counts.sum(axis=(2, 3)) - base, more)
    finally:
        for number in told:
            learner.forget(trials[number])
    np.testing.assert_allclose(alpha(learner), fitted, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(learner.knowledge().base_rates, rates)


@given(order=st.permutations(range(4)))
def test_the_order_of_words_does_not_matter(met, order):
    learner, trials = met
    truth = [{"red": bool(n != 1), "full": n % 2 == 0} for n in range(5)]
    truth[2] = truth[0]  # the same object
    results = []
    for numbers in (range(4), order):
        for n in numbers:
            learner.tell(trials[n], truth[n])
        results.append(alpha(learner))
        for n in numbers:
            learner.forget(trials[n])
    np.testing.assert_allclose(results[0], results[1], rtol=0, atol=1e-9)


def test_an_object_s_trials_together_are_one_row(met):
    """n percepts of one object are worth n (s + 1) / (n + s), over all its trials."""
    learner, trials = met
    before = learner.knowledge().posterior
    for n in (0, 2):
        learner.tell(trials[n], {"red": True})
    after = learner.knowledge().posterior
    levels = [t.steps[0].observation[0] for t in (trials[0], trials[2])]  # of look, of red
    s = before.dispersion[0, 0, 1]
    expected = before.concentration[0, 0, 1] + (s + 1) / (2 + s) * np.bincount(levels, minlength=4)
    np.testing.assert_allclose(after.concentration[0, 0, 1], expected, rtol=1e-12)
    for n in (0, 2):
        learner.forget(trials[n])


def test_eq_8_equals_a_fit_from_all_data(dataset, make):
    """Without differences between objects nothing but counts is learned: equal to 1e-9."""
    agent = make.agent("look", "lift", "reset", "look")
    learner = make.learner(dataset, agent)
    rows = []
    for n in range(6):
        trial = learner.ask("red, full", make.arm(red=n % 2 == 0, seed=n))
        learner.tell(trial, {"red": n % 2 == 0, "full": True})
        row = np.zeros((2, 3, 2, 2), int)
        for step in trial.steps:
            if step.observation is not None:
                for p, v in enumerate((int(n % 2 == 0), 1)):
                    row[p, step.decision.action, v, step.observation[p]] += 1
        rows.append(row)
    _, counts = fit_and_validate(dataset, TrainingSet.everything(dataset))
    expected = ConfusionPosterior.from_counts(np.concatenate([counts, rows]))
    np.testing.assert_allclose(alpha(learner), expected.concentration, rtol=0, atol=1e-9)


def test_labels_that_are_told_couple_attributes(dataset, make, tmp_path):
    """Of the recorded objects neither attribute tells of the other; of those told both do."""
    learner = make.learner(dataset, make.agent("look", co_occurrence=True, **make.ours))
    trials = []
    for n in range(28):
        same = n % 2 == 0
        trials.append(learner.ask("red, full", make.arm(red=same, full=same, seed=n)))
        learner.tell(trials[-1], {"red": same, "full": same})
    assert trials[0].momdp.joint is None
    joint = learner.ask("red, full", make.arm()).momdp.joint
    assert min(joint[[0, 3]]) > 2 * max(joint[[1, 2]])
    learner.save(tmp_path / "kitchen.learner")
    again = type(learner).load(tmp_path / "kitchen.learner", agent=learner.agent)
    np.testing.assert_array_equal(again.ask("red, full", make.arm()).momdp.joint, joint)
    for trial in trials[:14]:
        learner.forget(trial)
    assert learner.ask("red, full", make.arm()).momdp.joint is None


def test_who_recognizes_an_object_believes_its_labels_of_it_only(dataset, make):
    learner = make.learner(dataset, make.agent("look", memory=True, **make.ours))
    trial = learner.ask("red", make.arm(), object_name="mug")
    learner.tell(trial, {"red": True})
    prior = learner.ask("red", make.arm(), object_name="mug").momdp.prior
    assert prior[0] == pytest.approx(0.99, abs=1e-6)
    for name in (None, "glass"):
        prior = learner.ask("red", make.arm(), object_name=name).momdp.prior
        np.testing.assert_array_equal(prior, learner.knowledge().base_rates[:1])
    learner.agent = make.agent("look", **make.ours)
    prior = learner.ask("red", make.arm(), object_name="mug").momdp.prior
    np.testing.assert_array_equal(prior, learner.knowledge().base_rates[:1])


def test_labels_of_one_object_from_several_trials_are_evidence_each(make):
    learner = Learner(make.kitchen, agent="bayes_memory", logs=None)

    def told(*values):
        """Tell an object's label after each of several trials; return the next prior."""
        name = f"cup {values}"
        for n, value in enumerate(values):
            trial = learner.ask("red", make.arm(seed=n), object_name=name)
            learner.tell(trial, {"red": value})
        return learner.problem("red", name).prior[0]

    assert told(True, True) == pytest.approx(0.99**2 / (0.99**2 + 0.01**2))
    assert told(False, False) == pytest.approx(0.01**2 / (0.99**2 + 0.01**2))
    assert told(True, False, False) == pytest.approx(0.01)
    assert told(True, False) == pytest.approx(learner.knowledge().base_rates[0])


def test_labels_count_by_how_far_they_are_said_to_be_right(make, tmp_path):
    believing = Learner(make.kitchen, agent="bayes_memory", logs=None)
    doubting = Learner(make.kitchen, agent="bayes_memory", logs=None, label_accuracy=0.8)
    for learner in (believing, doubting):
        for n in range(20):
            learner.tell(f"cup {n}", {"red": n == 0, "full": n < 14})
    assert believing.problem("red", "cup 0").prior[0] == pytest.approx(0.99)
    assert doubting.problem("red", "cup 0").prior[0] == pytest.approx(0.8)
    rare, common = doubting.knowledge().base_rates < believing.knowledge().base_rates
    assert rare
    assert not common
    doubting.save(tmp_path / "kitchen.learner")
    again = Learner.load(tmp_path / "kitchen.learner", agent="bayes_memory")
    for learner in (doubting, again):
        learner.tell("mug", {"red": False})
    rates = doubting.knowledge().base_rates
    np.testing.assert_array_equal(again.knowledge().base_rates, rates)


def test_what_ask_does_with_a_robot_is_what_it_does_offline(dataset, make):
    """4 levels, a shared trait, base rates, unknown labels unknown."""
    labels = np.array(dataset.labels)
    labels[:4, 0] = -1
    learner = make.learner(dataclasses.replace(dataset, labels=labels))
    knowledge = learner.knowledge()
    momdp = learner.ask("red, full", make.arm()).momdp
    assert momdp.levels == 4
    assert momdp.n_classes == len(knowledge.trait.points)
    rates = learn_base_rates(dataset.domain, labels).mean
    np.testing.assert_array_equal(momdp.prior, rates)
    known = labels[:, 0] >= 0
    counted = knowledge.posterior.counts[0, 0].sum()
    assert counted == known.sum() * dataset.recordings


class TestRefitting:
    def test_a_refit_learns_from_the_features_of_labelled_trials(self, dataset, make):
        learner = make.learner(dataset, make.agent("look", "lift", **make.ours))
        trial = learner.ask("red, full", make.arm(), object_name="mug")
        learner.tell(trial, {"red": False, "full": True})
        conjugate = learner.knowledge().posterior.counts.sum(axis=(2, 3))
        learner.refit()
        again = learner.knowledge().posterior.counts.sum(axis=(2, 3))
        np.testing.assert_array_equal(again, conjugate)
        perception = learner.fitted(learner.agent).perception
        assert perception.classifiers["look"].spaces["color"].rows.shape[0] == 37
        learner.forget(trial)
        fresh = make.learner(dataset, make.agent("look", "lift", **make.ours))
        np.testing.assert_array_equal(alpha(learner), alpha(fresh))

    def test_when_labelled_instances_have_grown_by_a_fraction(self, dataset, make):
        learner = make.learner(dataset, make.agent("look", **make.ours), refit_every=0.05)
        fits = []
        for n in range(8):  # an instance each; there are 144 labels of instances, then 152
            before = learner.fitted(learner.agent)
            learner.tell(learner.ask("red", make.arm(seed=n)), {"red": False})
            if learner.fitted(learner.agent) is not before:
                fits.append(n)
        assert fits == [7]


class TestAPerceptTable:
    @pytest.fixture(scope="class")
    @staticmethod
    def table():
        return load_percepts("roc36")

    def test_a_label_teaches_of_all_other_objects(self, table):
        labels = np.array(table.labels)
        weights = table.domain.groups["weight"]
        name = table.objects[0]
        columns = table.domain.columns(weights)
        labels[0, columns] = -1
        hidden = dataclasses.replace(table, labels=labels)
        learner = Learner("roc36", agent="predefined", logs=None).fit(hidden)
        trial = learner.ask("heavy", name)
        assert trial.success is None
        learner.tell(trial, {"weight": weights[table.labels[0, columns].argmax()]})
        expected = knowledge_without(table, 5, levels=2, object_level=False)
        knowledge = learner.knowledge(table.objects[5])
        np.testing.assert_allclose(
            knowledge.posterior.concentration, expected.posterior.concentration, rtol=0, atol=1e-9
        )
        learner.forget(trial)
        before = knowledge_without(hidden, 5, levels=2, object_level=False)
        np.testing.assert_array_equal(
            learner.knowledge(table.objects[5]).posterior.concentration,
            before.posterior.concentration,
        )

    def test_a_robot_needs_recordings_and_a_name_a_table(self, table, dataset, make):
        learner = Learner("roc36", agent="predefined", logs=None).fit(table)
        with pytest.raises(SettingsError, match="holds no classifiers"):
            learner.ask("heavy", make.arm())
        with pytest.raises(SettingsError, match="build_percept_table"):
            make.learner(dataset).ask("red", "cup 1")


class TestFromNothing:
    @pytest.mark.quick(1)
    @pytest.mark.parametrize("agent", ["bayes", "bayes_memory", "morc_itrs"])
    def test_an_agent_that_explores_learns_from_the_first_label_on(self, dataset, make, agent):
        learner = Learner(dataset.domain, agent=agent, logs=None)
        trials = []
        for n in range(24):
            red = n % 2 == 0
            full = n // 2 % 2 == 0
            asked = "red" if n % 3 else "full"
            arm = make.arm(red=red, full=full, seed=n)
            truth = {asked: red if asked == "red" else full}
            trials.append(learner.ask(asked, arm, truth=truth))
            learner.tell(trials[-1], {"red": red, "full": full})
        assert len(trials[0].steps) > 1  # it tries what it knows nothing of
        counts = learner.knowledge().posterior.counts
        assert counts.sum() > 0
        if agent != "morc_itrs":  # whose exploring ends with its experience
            assert sum(bool(trial.success) for trial in trials[12:]) >= 9

    def test_one_that_does_not_explore_executes_nothing(self, dataset, make):
        learner = Learner(dataset.domain, agent="bayes_no_bonus", logs=None)
        with pytest.warns(
            UserWarning, match="'bayes_no_bonus' answered without .*use the agent 'bayes'"
        ):
            assert len(learner.ask("red", make.arm()).steps) == 1
        learner.ask("red", make.arm())  # warned once


class TestTheAgentCanBeChanged:
    def test_another_learns_from_the_same_experience(self, dataset, make):
        learner = make.learner(dataset, "bayes")
        trial = learner.ask("red", make.arm())
        learner.tell(trial, {"red": False})
        learner.agent = "morc"
        assert learner.ask("red", make.arm()).momdp.levels == 2
        fresh = make.learner(dataset, "morc")
        before = fresh.knowledge().posterior.counts.sum(axis=(2, 3))
        counts = learner.knowledge().posterior.counts.sum(axis=(2, 3))
        shown = len(learner.experience.instances_of_trial(trial.task.key))
        assert (counts - before)[0].sum() == shown > 0
        with pytest.raises(SettingsError):
            learner.agent = "bayse"


def test_success_rates_are_learned_from_executions(dataset, make):
    learner = make.learner(dataset, make.agent("lift", "reset", **make.ours))
    learner.fit(dataset)
    before = len(learner.experience.instances)
    for _ in range(8):
        session = learner.begin("red")
        session.fail()  # lift
        session.cancel()
    learner.refit()
    lift = next(e for e in learner.knowledge().domain.diagram.effects if e.behavior == "lift")
    weights = 0.5 ** (np.arange(8) / 5)  # halved by five trials
    assert lift.probability == pytest.approx(2 * 0.9 / (2 + weights.sum()))
    assert len(learner.experience.instances) == before  # equal recordings are given once


def test_a_motion_that_never_works_is_learned_of_at_once_and_left_after_two(dataset, make):
    """As lift at .05 instead of .9: no refit is needed, and it is tried twice a trial at most."""
    learner = make.learner(dataset, "bayes")
    lifts = []
    for number in range(6):
        arm = make.arm(seed=number)
        arm.execute = lambda behavior, look=arm.execute: (
            look(behavior) if behavior == "look" else Outcome("table")
        )
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            trial = learner.ask("full", arm)
        lifts.append(sum(step.decision.action == 1 for step in trial.steps))
        assert bool(caught) == (lifts[-1] == 2)
    assert max(lifts) == 2
    assert learner.ask("full", arm, max_steps=1).momdp.transition[1, 0, 1] < 0.45


def test_a_test_trial_is_no_experience(dataset, make):
    learner = make.learner(dataset, "bayes")
    trial = learner.ask("red", make.arm(), learn=False)
    assert not trial.momdp.bonus.any()
    assert len(learner.experience.executions) == 0
    assert learner.ask("red", make.arm()).momdp.bonus.any()


def test_mistakes_are_told(dataset, make):
    learner = make.learner(dataset)
    trial = learner.ask("red", make.arm())
    for values, error, says in (
        ({"rd": True}, QueryError, "did you mean 'red'"),
        ({"red": "yes"}, SettingsError, "1 or True, 0 or False, or None"),
    ):
        with pytest.raises(error, match=says):
            learner.tell(trial, values)
    learner.tell(trial, {"red": None})
    with pytest.raises(SettingsError, match="has no labels"):
        learner.forget(trial)
    with pytest.raises(SettingsError, match="differ from"):
        Learner("roc36").fit(dataset)
    for wrong in (
        {"seed": -1}, {"refit_every": 0}, {"refit_every": "x"}, {"agent": 7}, {"reward": "6"},
        {"horizon": "5"}, {"horizon": True}, {"learn_success": "no"},
        {"label_accuracy": 0.5}, {"label_accuracy": 83}, {"label_accuracy": "often"},
    ):  # fmt: skip
        with pytest.raises(SettingsError):
            Learner(dataset.domain, logs=None, **wrong)
    for wrong in ({"learn": "no"}, {"max_cost": "x"}, {"max_cost": True}):
        with pytest.raises(SettingsError, match="give"):
            learner.ask("red", make.arm(), **wrong)
    with pytest.raises(LogError, match="No log was named"):
        recall(learner)
