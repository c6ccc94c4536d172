"""Algorithm 2: what a robot learns comes from its own trials alone, and never from test objects."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from meal_bayes.agents import AGENTS
from meal_bayes.agents.base_rates import learn_base_rates
from meal_bayes.agents.exploration import as_equation_11
from meal_bayes.agents.knowledge import knowledge_of
from meal_bayes.datasets import Dataset, TrainingSet, make_synthetic
from meal_bayes.domain import (
    Query,
    domain_from_table,
    domain_table,
    learn_success,
    load_domain,
)
from meal_bayes.experiments import OnlineConfig
from meal_bayes.experiments.online import Environment, Protocol, _learner
from meal_bayes.learner.views import labeled
from meal_bayes.momdp import observation_entropy
from meal_bayes.perception import fit_and_validate
from meal_bayes.trials import Task

TOY = load_domain("toy")
PRE = np.arange(6)
TRAIN = np.arange(6, 12)
TEST = np.arange(12, 18)
RECORDINGS = 3
RNG = np.random.default_rng(2)
DATASET = make_synthetic(TOY, objects=18, recordings=RECORDINGS, signal=8.0, rng=RNG)
EVERY = sorted(AGENTS.keys() - {"random", "predefined", "predefined_plus", "olfc"})


class Run:
    """One agent in its environment, between two refits."""

    def __init__(self, name, dataset=DATASET, pre=PRE, **options):
        options = {"seed": 7, "reward": 300.0, "horizon": 80, **options}
        config = OnlineConfig("toy", agents=(name,), **options)
        split = SimpleNamespace(pre=pre, train=TRAIN, test=TEST)  # may overlap, for leaks
        protocol = Protocol(dataset, split, 1, 7, 0)
        self.learner = _learner(config, protocol)
        self.environment = Environment(config, protocol)

    @property
    def posterior(self):
        return self.learner.knowledge().posterior

    @property
    def evidence(self):
        memory = self.learner.agent.memory
        return labeled(self.learner.experience, memory=memory).sum(axis=0).T

    def test(self, task):
        return self.environment.ask(self.learner, task, learn=False)

    def train(self, task):
        return self.environment.ask(self.learner, task, learn=True)


def task_of(o, *attributes, index=0):
    name = DATASET.objects[o]
    return Task("task", Query(attributes), o, name, ("here", index, name, *attributes))


def trained(name, dataset=DATASET, trials=12, *, pre=PRE, **options):
    """Work through some trials and learn from them; give the trials with the refitted run."""
    run = Run(name, dataset, pre, **options)
    done = []
    for k in range(trials):
        attribute = TOY.attributes[k // len(TRAIN) % 2]
        done.append(run.train(task_of(int(TRAIN[k % len(TRAIN)]), attribute, index=k)))
    run.learner.refit()
    return done, run


@cache
def trained_once(name):
    """Train on the plain data once for all tests that change nothing of it."""
    return trained(name)


def facts(trial):
    last = trial.last_belief
    return (
        [step.decision.action for step in trial.steps],
        [None if s.observation is None else s.observation.tolist() for s in trial.steps],
        None if trial.report is None else trial.report.tolist(),
        trial.cost,
        trial.reward,
        last.log_prob.tolist(),
    )


def learned(trials, run):
    """All that a robot has from its work, as plain values."""
    knowledge = run.learner.knowledge()
    experience = run.learner.experience
    fit = run.learner.fitted(run.learner.agent)
    return {
        "trials": [facts(trial) for trial in trials],
        "experience": [
            getattr(experience, name).values.tolist()
            for name in ("instances", "labels", "object_labels")
        ],
        "counts": knowledge.posterior.counts.tolist(),
        "tables": knowledge.posterior.concentration.tolist(),
        "dispersion": knowledge.posterior.dispersion.tolist(),
        "base rates": knowledge.base_rates.tolist(),
        "trait": None if knowledge.trait is None else knowledge.trait.latent_classes.tolist(),
        "percepts": fit.levels.values.tolist(),
    }


@pytest.mark.quick(3)
@pytest.mark.parametrize("name", EVERY)
def test_each_labelled_instance_is_one_count(name):
    trials, run = trained_once(name)
    np.testing.assert_array_equal(run.posterior.counts.sum(axis=(2, 3)), run.evidence)
    gained = run.evidence.sum() - 24  # over pretraining
    assert (gained > 0) == (name != "prior")  # which touches nothing, and so learns nothing
    assert sum(trial.success for trial in trials) > 0
    assert max(len(trial.steps) for trial in trials) < 100  # none went round until it was stopped


@pytest.fixture(scope="module")
def altered():
    """Return the data with everything about the test objects changed."""
    rng = np.random.default_rng(9)
    features = {key: values.copy() for key, values in DATASET.features.items()}
    for values in features.values():
        values[TEST] = 50 * rng.normal(size=values[TEST].shape)
    labels = DATASET.labels.copy()
    labels[TEST] = 1 - labels[TEST]
    return Dataset(TOY, DATASET.objects, features, labels)


class TestLeaks:
    @pytest.mark.quick(3)
    @pytest.mark.parametrize("name", EVERY)
    def test_test_objects_change_nothing(self, altered, name):
        assert learned(*trained_once(name)) == learned(*trained(name, altered))

    @pytest.mark.parametrize("name", ["bayes", "morc_itrs"])
    def test_the_check_finds_a_leak(self, altered, name):
        leaky = np.append(PRE, TEST[0])
        first = learned(*trained(name, pre=leaky))
        second = learned(*trained(name, altered, pre=leaky))
        same = {key for key in first if first[key] == second[key]}
        assert not same & {"experience", "counts", "tables", "percepts"}

    def test_testing_teaches_nothing(self):
        run = Run("bayes_memory")
        before = len(run.learner.experience.executions)
        tests = [facts(run.test(task_of(int(o), "red"))) for o in TEST]
        assert len(run.learner.experience.executions) == before == 0
        assert [facts(run.test(task_of(int(o), "red"))) for o in TEST] == tests


@pytest.mark.long
@pytest.mark.statistical
def test_shuffled_labels_teach_nothing():
    def skill(seed, *, shuffled):
        rng = np.random.default_rng(seed)
        data = make_synthetic(TOY, objects=60, recordings=4, rng=rng)
        labels = data.labels[rng.permutation(60)] if shuffled else data.labels
        data = Dataset(TOY, data.objects, data.features, labels)
        everything = TrainingSet.everything(data)
        counts = fit_and_validate(data, everything)[1]
        yes = knowledge_of(TOY, counts, labels).posterior.mean[:, :2, :, 1]
        return np.abs(yes[..., 1] - yes[..., 0]).mean()

    seeds = range(8)
    assert np.mean([skill(seed, shuffled=True) for seed in seeds]) <= 0.03
    assert np.mean([skill(seed, shuffled=False) for seed in seeds]) > 0.1


def test_random_legal_keeps_to_its_budget_and_draws_anew():
    learner = Run("iterative_random_legal")
    budget = TOY.legal_budget[0]
    dearest = max(b.cost for b in TOY.behaviors)
    trials = [learner.test(task_of(int(o), "red")) for o in TEST]
    assert all(budget <= trial.cost < budget + dearest for trial in trials)
    assert len({tuple(facts(trial)[0]) for trial in trials}) == len(trials)


@pytest.mark.parametrize("second_rater", [True, False])
def test_a_person_says_what_the_second_rater_said(second_rater):
    said = 1 - DATASET.labels
    said[:, 1] = -1  # of the second attribute nothing
    rated = Dataset(TOY, DATASET.objects, DATASET.features, DATASET.labels, answers=said)
    environment = Run("prior", rated, second_rater=second_rater).environment
    for o in range(3):
        task = Task("both", Query(TOY.attributes), o, DATASET.objects[o], ("toy", o))
        person = environment._robot(task, learn=False)._person
        answers = [person(1.0)[name] == 1 for name in TOY.attributes]
        right = DATASET.labels[o] == 1
        assert answers == [right[0] != second_rater, right[1]]


@pytest.mark.parametrize("answers", ["verdict", "joint"])
def test_every_bonus_of_ours_is_by_equation_11(answers):
    """From the first question on, and though people tell nothing but what was asked."""
    run = Run("bayes", answers=answers)
    bonuses = 0
    for k in range(12):
        task = task_of(int(TRAIN[k % len(TRAIN)]), TOY.attributes[k % 2], index=k)
        known = run.learner.fitted(run.learner.agent).progress(task, task.object_name)
        terms = as_equation_11(known)
        each = terms.weight * terms.entropy - terms.weight * terms.experience
        told = np.where(
            np.array(TOY.attributes) == task.query.attributes[0], 1, known.told_fraction
        )
        expected = (each * told[:, None] * known.fresh).sum(axis=0)
        paid = run.train(task).momdp.bonus[0, :, 0]
        np.testing.assert_allclose(paid, expected, atol=1e-9)
        bonuses += bool(paid.any())
    assert bonuses == 12


@pytest.mark.parametrize("name", ["iterative_morc", "bayes"])
def test_what_is_not_curious_is_tested_without_bonus(name):
    shaped = {"learning": (("shaped_answers", True),)}
    task = task_of(13, "red")
    trial = Run(name, **shaped).test(task)
    assert not trial.momdp.bonus.any()
    assert facts(trial) == facts(Run(name).test(task))
    assert Run("morc_itrs", **shaped).test(task).momdp.bonus.any()
    assert not Run("morc_itrs").test(task).momdp.bonus.any()


def test_experience_repels_from_the_next_trial_on():
    run = Run("morc_itrs")
    start = run.evidence[0]
    first = run.train(task_of(7, "red", index=0))
    second = run.train(task_of(8, "red", index=1))
    after = run.evidence[0] - start
    last = sum(step.observation is not None for step in second.steps)
    new = after.copy()
    for step in second.steps:
        if step.observation is not None:
            new[step.decision.action] -= 1
    senses = np.array([bool(behavior.modalities) for behavior in TOY.behaviors])
    assert new.sum() == after.sum() - last > 0
    lost = (first.momdp.bonus - second.momdp.bonus)[0]
    lost = lost - 6 * (observation_entropy(first.momdp) - observation_entropy(second.momdp))[0]
    repelled = 30 * new[senses] / (RECORDINGS * len(TRAIN))
    np.testing.assert_allclose(lost[senses].mean(axis=-1), repelled, atol=1e-9)


class TestLearningFromATrial:
    @pytest.mark.parametrize("name", ["iterative_morc", "morc_itrs", "bayes", "bayes_memory"])
    def test_percepts_of_a_new_object_are_one_row_of_counts(self, name):
        run = Run(name)
        before = run.posterior
        trial = run.train(task_of(7, "red"))
        shown = np.zeros(before.counts.shape)
        for step in trial.steps:
            if step.observation is not None:
                truth = DATASET.labels[7, 0]
                level = step.observation[0]
                shown[0, step.decision.action, truth, level] += 1
        assert shown.sum() > 0
        expected = before.update(shown)
        np.testing.assert_array_equal(run.posterior.counts, expected.counts)
        np.testing.assert_array_equal(run.posterior.concentration, expected.concentration)

    def test_percepts_of_what_classifiers_have_seen_wait_for_the_refit(self):
        run = Run("bayes", pre=np.append(PRE, 7))
        before = run.posterior
        evidence = run.evidence[0].sum()
        run.train(task_of(7, "red"))
        assert run.evidence[0].sum() > evidence
        np.testing.assert_array_equal(run.posterior.counts, before.counts)

    def test_base_rates_follow_the_labels(self):
        run = Run("bayes")
        run.train(task_of(7, "red"))
        labels = np.vstack([DATASET.labels[PRE], [DATASET.labels[7, 0], -1]])
        # One label more of sixteen: how far rates are pooled is as it was.
        weights = learn_base_rates(TOY, DATASET.labels[PRE]).weights
        rates = run.learner.knowledge().base_rates
        np.testing.assert_allclose(rates, learn_base_rates(TOY, labels, weights).mean)
        assert run.test(task_of(13, "red")).momdp.prior == rates[:1]


def test_a_labelled_object_is_known_again_only_with_memory():
    for name, prior in (("bayes_memory", 0.99), ("morc_itrs", 0.5)):
        run = Run(name)
        run.learner.tell(DATASET.objects[7], {"red": True})
        momdp = run.train(task_of(7, "red")).momdp
        assert momdp.prior == pytest.approx([prior])


class TestPublishedVariants:
    def test_the_joint_label_is_true_where_all_are(self):
        run = Run("iterative_morc", answers="joint")
        judged = 0
        for o in TRAIN.tolist():
            trial = run.train(task_of(o, "red", "heavy"))
            known = run.learner.experience.object_labels.values[o]
            assert known.tolist() == [int(DATASET.labels[o].all()) if trial.success else -1] * 2
            judged += trial.success
        assert judged

    @pytest.mark.quick(2)
    @pytest.mark.parametrize("name", ["iterative_morc", "morc_itrs", "bayes", "bayes_memory"])
    def test_model_percepts_do_not_run_out_in_training_either(self, name):
        trials, run = trained(name, percepts="model", normalizer="all")
        assert max(len(trial.steps) for trial in trials) < 100
        np.testing.assert_array_equal(run.posterior.counts.sum(axis=(2, 3)), run.evidence)
        places = run.learner.experience.instances.values[["object", "behavior", "recording"]]
        assert len(np.unique(places, axis=0)) == len(places)


class TestSuccess:
    @staticmethod
    def lift(domain):
        (effect,) = (e for e in domain.diagram.effects if e.behavior == "lift")
        return effect.probability

    def test_no_attempts_leave_the_domain_s(self):
        learned = learn_success(TOY, np.zeros((3, 2), int))
        assert self.lift(learned) == pytest.approx(0.9)

    def test_means_are_those_of_beta_posteriors(self):
        attempts = np.array([[0, 4], [6, 2], [0, 0]])
        assert self.lift(learn_success(TOY, attempts)) == pytest.approx((2 * 0.9 + 2) / 10)
        assert learn_success(TOY, attempts).diagram.effects[0].probability == 1.0

    def test_outcomes_of_a_success_keep_their_fractions(self):
        table = domain_table(TOY)
        (lift,) = (row for row in table["diagram"]["effects"] if row["do"] == "lift")
        table["diagram"]["effects"] += [{**lift, "to": lift["from"], "probability": 0.05}]
        learned = learn_success(domain_from_table(table), np.array([[0, 0], [8, 0], [0, 0]]))
        after = [e.probability for e in learned.diagram.effects if e.behavior == "lift"]
        assert after == pytest.approx([0.9 * 2 / 10, 0.05 * 2 / 10])
