"""Algorithm 2: what a robot learns comes from its own trials alone, and never from test objects."""

from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.agents import (
    AGENTS,
    Experience,
    Feedback,
    OnlineLearner,
    PublishedVariants,
    RunContext,
    Task,
    load_agent,
)
from meal_bayes.agents.knowledge import knowledge_of
from meal_bayes.datasets import Dataset, TrainingSet, make_synthetic
from meal_bayes.domain import Query, learn_success, load_domain
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import observation_entropy
from meal_bayes.perception import ConfusionSampler, Kernels, ScoredPercepts, fit_and_score

TOY = load_domain("toy")
PRE, TRAIN, TEST = np.arange(6), np.arange(6, 12), np.arange(12, 18)
RECORDINGS, RNG = 3, np.random.default_rng(2)
DATASET = make_synthetic(TOY, objects=18, recordings=RECORDINGS, signal=8.0, rng=RNG)
EVERY = sorted(AGENTS.keys() - {"random", "predefined", "predefined_plus", "olfc"})


def context_of(dataset, pre=PRE, **options):
    """What every agent meets, and the experience that it begins with."""
    start = Experience.none(dataset, np.random.default_rng(1)).pretrain(dataset, pre)
    facts = {
        "scored": np.concatenate([TRAIN, TEST]),
        "counted": TRAIN,
        "queries": 40.0,
        "reward": 300.0,
        "feedback": Feedback(),
        "true_dynamics": dataset.domain,
        **options,
    }
    kernels = Kernels.of(dataset, start.training_set())
    return RunContext(dataset=dataset, kernels=kernels, **facts), start


def learner_of(name, context, start):
    agent = load_agent(name)
    return OnlineLearner.fit(agent, context, replace(start, memory=agent.memory), 7)


def task_of(o, *attributes, index=0):
    name = DATASET.objects[o]
    return Task("task", Query(attributes), o, name, ("here", index, name, *attributes))


def trained(name, dataset=DATASET, trials=12, *, pre=PRE, **options):
    """Work through some trials and learn from them; give the trials with the new learner."""
    context, start = context_of(dataset, pre, **options)
    learner, done = learner_of(name, context, start), []
    for k in range(trials):
        attribute = TOY.attributes[k // len(TRAIN) % 2]
        done.append(learner.train(task_of(int(TRAIN[k % len(TRAIN)]), attribute, index=k)))
        learner.tell(done[-1])
    return done, OnlineLearner.fit(learner.agent, context, learner.experience, 7)


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


def learned(trials, learner):
    """All that a robot has from its work, as plain values."""
    posterior, experience = learner.knowledge.posterior, learner.experience
    trait = learner.knowledge.trait
    return {
        "trials": [facts(trial) for trial in trials],
        "experience": [
            getattr(experience, name).tolist() for name in ("labels", "object_labels", "used")
        ],
        "counts": posterior.counts.tolist(),
        "tables": posterior.concentration.tolist(),
        "dispersion": posterior.dispersion.tolist(),
        "base rates": learner.knowledge.base_rates.tolist(),
        "trait": None if trait is None else trait.latent_classes.tolist(),
        "value": learner.valued().tolist(),
        "training percepts": learner.perceiver.perceiver.log_odds[TRAIN, :, :2].tolist(),
    }


@pytest.mark.parametrize("name", EVERY)
def test_each_labelled_instance_is_one_count(name):
    trials, learner = trained(name)
    counts = learner.knowledge.posterior.counts
    np.testing.assert_array_equal(counts.sum(axis=(2, 3)), learner.experience.evidence())
    assert learner.experience.evidence().sum() > 24  # more than pretraining gave
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
    @pytest.mark.parametrize("name", EVERY)
    def test_test_objects_change_nothing(self, altered, name):
        assert learned(*trained(name)) == learned(*trained(name, altered))

    @pytest.mark.parametrize("name", ["bayes", "morc_itrs"])
    def test_the_check_finds_a_leak(self, altered, name):
        leaky = np.append(PRE, TEST[0])
        first = learned(*trained(name, pre=leaky))
        second = learned(*trained(name, altered, pre=leaky))
        same = {key for key in first if first[key] == second[key]}
        assert not same & {"experience", "counts", "tables", "training percepts"}

    def test_testing_teaches_nothing(self):
        context, start = context_of(DATASET)
        learner = learner_of("bayes_memory", context, start)
        before = learner.experience
        tests = [facts(learner.test(task_of(int(o), "red"))) for o in TEST]
        assert learner.experience is before
        assert [facts(learner.test(task_of(int(o), "red"))) for o in TEST] == tests


@pytest.mark.statistical
def test_shuffled_labels_teach_nothing():
    def skill(seed, *, shuffled):
        rng = np.random.default_rng(seed)
        data = make_synthetic(TOY, objects=60, recordings=4, rng=rng)
        labels = data.labels[rng.permutation(60)] if shuffled else data.labels
        data = Dataset(TOY, data.objects, data.features, labels)
        everything = TrainingSet.everything(data)
        counts = fit_and_score(Kernels.of(data, everything), everything, np.arange(60))[1]
        yes = knowledge_of(TOY, counts, labels).posterior.mean[:, :2, :, 1]
        return np.abs(yes[..., 1] - yes[..., 0]).mean()

    seeds = range(8)
    assert np.mean([skill(seed, shuffled=True) for seed in seeds]) <= 0.03
    assert np.mean([skill(seed, shuffled=False) for seed in seeds]) > 0.1


def test_random_legal_keeps_to_its_budget_and_draws_anew():
    context, start = context_of(DATASET)
    learner = learner_of("iterative_random_legal", context, start)
    budget, dearest = TOY.legal_budget[0], max(b.cost for b in TOY.behaviors)
    trials = [learner.test(task_of(int(o), "red")) for o in TEST]
    assert all(budget <= trial.cost < budget + dearest for trial in trials)
    assert len({tuple(facts(trial)[0]) for trial in trials}) == len(trials)


@pytest.mark.parametrize("name", ["iterative_morc", "bayes"])
def test_what_is_not_curious_is_tested_without_bonus(name):
    context, start = context_of(DATASET, published=PublishedVariants(shaped_test=True))
    plain, _ = context_of(DATASET)
    task = task_of(13, "red")
    trial = learner_of(name, context, start).test(task)
    assert not trial.momdp.bonus.any()
    assert facts(trial) == facts(learner_of(name, plain, start).test(task))
    shaped = learner_of("morc_itrs", context, start).test(task)
    assert shaped.momdp.bonus.any()
    assert not learner_of("morc_itrs", plain, start).test(task).momdp.bonus.any()


def test_experience_repels_from_the_next_trial_on():
    context, start = context_of(DATASET)
    learner = learner_of("morc_itrs", context, start)
    first = learner.train(task_of(7, "red", index=0))
    learner.tell(first)
    second = learner.train(task_of(8, "red", index=1))
    new = learner.experience.evidence()[0] - start.evidence()[0]
    senses = np.array([bool(behavior.modalities) for behavior in TOY.behaviors])
    assert new.sum() > 0
    lost = (first.momdp.bonus - second.momdp.bonus)[0]
    lost = lost - 6 * (observation_entropy(first.momdp) - observation_entropy(second.momdp))[0]
    repelled = 30 * new[senses] / (RECORDINGS * len(TRAIN))
    np.testing.assert_allclose(lost[senses].mean(axis=-1), repelled, atol=1e-9)


class TestLearningFromATrial:
    @staticmethod
    def after_a_trial(name, context, start, o=7):
        """Return the learner after a trial, the trial, and the posterior before."""
        learner = learner_of(name, context, start)
        before = learner.knowledge.posterior
        trial = learner.train(task_of(o, "red"))
        learner.tell(trial)
        return learner, trial, before

    @pytest.mark.parametrize("name", ["iterative_morc", "morc_itrs", "bayes", "bayes_memory"])
    def test_percepts_of_a_new_object_are_one_row_of_counts(self, name):
        context, start = context_of(DATASET, feedback=Feedback("all"))
        learner, trial, before = self.after_a_trial(name, context, start)
        shown = np.zeros(before.counts.shape)
        for step in trial.steps:
            if step.observation is not None:
                truth, level = DATASET.labels[7, 0], step.observation[0]
                shown[0, step.decision.action, truth, level] += 1
        assert shown.sum() > 0
        expected = before.replace_object(np.zeros(shown.shape), shown)
        posterior = learner.knowledge.posterior
        np.testing.assert_array_equal(posterior.counts, expected.counts)
        np.testing.assert_array_equal(posterior.concentration, expected.concentration)

    def test_percepts_of_what_classifiers_have_seen_wait_for_the_refit(self):
        context, start = context_of(DATASET, np.append(PRE, 7), feedback=Feedback("all"))
        learner, _, before = self.after_a_trial("bayes", context, start)
        assert learner.experience.evidence()[0].sum() > start.evidence()[0].sum()
        np.testing.assert_array_equal(learner.knowledge.posterior.counts, before.counts)

    def test_later_answers_are_planned_with_it(self):
        context, start = context_of(DATASET, feedback=Feedback("all"))
        learner = learner_of("iterative_morc", context, start)
        test, other = task_of(13, "red"), task_of(13, "heavy")
        first, kept = learner.test(test).momdp, learner.test(other).momdp
        learner.tell(learner.train(task_of(7, "red")))
        assert (learner.test(test).momdp.rows != first.rows).any()
        assert learner.test(other).momdp is kept

    def test_base_rates_follow_the_labels(self):
        context, start = context_of(DATASET, feedback=Feedback("all"))
        learner, _, _ = self.after_a_trial("bayes", context, start)
        labels = [*start.object_labels[PRE, 0].tolist(), DATASET.labels[7, 0]]
        assert learner.knowledge.base_rates[0] == (sum(labels) + 1) / (len(labels) + 2)
        assert learner.test(task_of(13, "red")).momdp.prior == learner.knowledge.base_rates[:1]


def test_a_labelled_object_is_known_again_only_with_memory():
    for name, prior in (("bayes_memory", 0.9), ("morc_itrs", 0.5)):
        context, start = context_of(DATASET, feedback=Feedback("all", 0.1))
        learner = learner_of(name, context, start)
        told = start.object_labels.copy()
        told[7, 0] = 1
        learner.experience = replace(learner.experience, object_labels=told)
        momdp = learner.train(task_of(7, "red")).momdp
        assert momdp.prior == pytest.approx([prior])


class TestPublishedVariants:
    def test_sample_wise_claims_more(self):
        rng = np.random.default_rng(0)
        strange = make_synthetic(
            TOY, objects=18, recordings=RECORDINGS, signal=0.0, object_effect=3.0, rng=rng
        )

        def claimed(*published):
            options = {
                "published": PublishedVariants.named(*published),
                "feedback": Feedback("all"),
            }
            learner = trained("iterative_random_legal", strange, 24, **options)[1]
            yes = learner.knowledge.posterior.mean[:, :2, :, 1]
            return (yes[..., 1] - yes[..., 0]).mean()

        assert claimed("sample_wise") > claimed() + 0.2

    def test_the_joint_label_is_true_where_all_are(self):
        context, start = context_of(
            DATASET, published=PublishedVariants(joint_label=True), feedback=Feedback("all")
        )
        learner = learner_of("iterative_morc", context, start)
        trial = learner.train(task_of(7, "red", "heavy"))
        for truth, labels in (([1, 1], [1, 1]), ([1, 0], [0, 0]), ([0, 0], [0, 0])):
            told = context.labels_of(replace(trial, truth=np.array(truth, bool)), 7)
            assert told.tolist() == labels

    def test_model_percepts_are_drawn_from_the_tables_without_end(self):
        context, start = context_of(DATASET, published=PublishedVariants(model_percepts=True))
        learner = learner_of("iterative_morc", context, start)
        assert isinstance(learner.perceiver.perceiver, ConfusionSampler)
        tables, _ = learner.knowledge.posterior.select(range(2), exact=True)
        np.testing.assert_array_equal(learner.perceiver.perceiver.confusion, tables)
        assert np.isinf(learner.test(task_of(13, "red")).momdp.limit).all()
        plain = learner_of("iterative_morc", *context_of(DATASET))
        assert isinstance(plain.perceiver.perceiver, ScoredPercepts)

    @pytest.mark.parametrize("name", ["iterative_morc", "morc_itrs", "bayes", "bayes_memory"])
    def test_model_percepts_do_not_run_out_in_training_either(self, name):
        every = np.append(PRE, TRAIN)  # else nothing repels from the first trial on
        published = PublishedVariants(model_percepts=True)
        trials, learner = trained(name, published=published, counted=every)
        assert max(len(trial.steps) for trial in trials) < 100
        counts = learner.knowledge.posterior.counts
        np.testing.assert_array_equal(counts.sum(axis=(2, 3)), learner.experience.evidence())
        assert (learner.experience.gathered[TRAIN].sum(axis=2) <= RECORDINGS).all()

    def test_names_are_checked(self):
        every = PublishedVariants(True, True, True, True)
        assert PublishedVariants.named("all") == every
        assert PublishedVariants.named("joint_label") == PublishedVariants(joint_label=True)
        with pytest.raises(SettingsError, match="did you mean 'joint_label'"):
            PublishedVariants.named("joint_labels")


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

    @pytest.mark.statistical
    def test_true_success_of_one_half_is_learned(self):
        effects = tuple(
            replace(effect, probability=0.5) if effect.behavior == "lift" else effect
            for effect in TOY.diagram.effects
        )
        true = replace(TOY, diagram=replace(TOY.diagram, effects=effects))
        _, learner = trained(
            "iterative_random_legal", trials=60, true_dynamics=true, learn_success=True
        )
        attempts = learner.experience.attempts
        n = attempts[1].sum()
        assert n > 200
        assert attempts[0, 0] == attempts[2, 0] == 0
        assert abs(self.lift(learner.knowledge.domain) - 0.5) < 4 * np.sqrt(0.25 / n) + 1 / n
        assert learner.train(task_of(7, "red")).momdp.transition[1, 0, 1] == pytest.approx(
            self.lift(learner.knowledge.domain)
        )
        assert self.lift(trained("bayes", trials=2, true_dynamics=true)[1].knowledge.domain) == 0.9
