"""Algorithm 2: what a robot learns comes from its own trials alone, and never from test objects."""

from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.agents import (
    ONLINE_AGENTS,
    PUBLISHED,
    Experience,
    Feedback,
    MorcItrs,
    OnlineAgent,
    Surroundings,
    Task,
    heard,
    load_online_agent,
)
from meal_bayes.agents.knowledge import knowledge_of
from meal_bayes.agents.morc_itrs import with_success
from meal_bayes.datasets import Dataset, TrainingSet, make_synthetic
from meal_bayes.domain import Query, load_domain
from meal_bayes.errors import SettingsError
from meal_bayes.perception import ConfusionSampler, FittedPercepts, Kernels, fit_and_score

TOY = load_domain("toy")
PRE, TRAIN, TEST = np.arange(6), np.arange(6, 12), np.arange(12, 18)
RECORDINGS = 3
DATASET = make_synthetic(
    TOY, objects=18, recordings=RECORDINGS, signal=8.0, rng=np.random.default_rng(2)
)
EVERY = sorted(ONLINE_AGENTS)


def world_of(dataset, pre=PRE, **options):
    """What every agent meets, and the experience that it begins with."""
    start = Experience.none(dataset, np.random.default_rng(1)).pretrain(dataset, pre)
    facts = {
        "objects": np.concatenate([TRAIN, TEST]),
        "delta": RECORDINGS * 12.0,
        "queries": 40.0,
        "reward": 300.0,
        "feedback": Feedback(),
        "body": dataset.domain,
        **options,
    }
    kernels = Kernels.of(dataset, start.training_set())
    return Surroundings(dataset=dataset, kernels=kernels, **facts), start


def learner_of(name, world, start):
    agent = load_online_agent(name)
    return MorcItrs.learn(agent, world, replace(start, memory=agent.memory), 7)


def task_of(o, *attributes, index=0):
    name = DATASET.objects[o]
    return Task("task", Query(attributes), o, name, ("here", index, name, *attributes))


def trained(name, dataset=DATASET, trials=12, *, pre=PRE, **options):
    """Work through some trials and learn from them; give the trials with the new learner."""
    world, start = world_of(dataset, pre, **options)
    learner, done = learner_of(name, world, start), []
    for k in range(trials):
        attribute = TOY.attributes[k // len(TRAIN) % 2]
        done.append(learner.train(task_of(int(TRAIN[k % len(TRAIN)]), attribute, index=k)))
        learner.absorb(done[-1])
    return done, MorcItrs.learn(learner.agent, world, learner.experience, 7)


def facts(trial):
    last = trial.last_belief
    return (
        [step.decision.action for step in trial.steps],
        [None if s.observation is None else s.observation.tolist() for s in trial.steps],
        None if trial.report is None else trial.report.tolist(),
        trial.cost,
        trial.reward,
        last.weight.tolist(),
    )


def learned(trials, learner):
    """All that a robot has from its work, as plain values."""
    posterior, experience = learner.knowledge.posterior, learner.experience
    trait = learner.knowledge.trait
    return {
        "trials": [facts(trial) for trial in trials],
        "experience": [a.tolist() for a in (experience.labels, experience.told, experience.used)],
        "counts": posterior.counts.tolist(),
        "tables": posterior.concentration.tolist(),
        "dispersion": posterior.dispersion.tolist(),
        "base rates": learner.knowledge.base_rates.tolist(),
        "trait": None if trait is None else trait.latent_classes.tolist(),
        "gain": learner.gain.tolist(),
        "training percepts": learner.percepts.log_odds[TRAIN, :, :2].tolist(),
    }


@pytest.mark.parametrize("name", EVERY)
def test_each_labelled_instance_is_one_count(name):
    trials, learner = trained(name)
    np.testing.assert_array_equal(
        learner.knowledge.posterior.evidence, learner.experience.evidence()
    )
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
        world, start = world_of(DATASET)
        learner = learner_of("bayes_memory", world, start)
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
    world, start = world_of(DATASET)
    learner = learner_of("iterative_random_legal", world, start)
    budget, dearest = TOY.legal_budget[0], max(b.cost for b in TOY.behaviors)
    trials = [learner.test(task_of(int(o), "red")) for o in TEST]
    assert all(budget <= trial.cost < budget + dearest for trial in trials)
    assert len({tuple(facts(trial)[0]) for trial in trials}) == len(trials)


@pytest.mark.parametrize("name", ["iterative_morc", "bayes"])
def test_what_is_not_curious_is_tested_without_bonus(name):
    world, start = world_of(DATASET, published=("shaped_test",))
    plain, _ = world_of(DATASET)
    task = task_of(13, "red")
    trial = learner_of(name, world, start).test(task)
    assert not trial.momdp.bonus.any()
    assert facts(trial) == facts(learner_of(name, plain, start).test(task))
    shaped = learner_of("morc_itrs", world, start).test(task)
    assert shaped.momdp.bonus.any()
    assert not learner_of("morc_itrs", plain, start).test(task).momdp.bonus.any()


def test_experience_repels_from_the_next_trial_on():
    world, start = world_of(DATASET)
    learner = learner_of("morc_itrs", world, start)
    first = learner.train(task_of(7, "red", index=0))
    learner.absorb(first)
    second = learner.train(task_of(8, "red", index=1))
    new = learner.experience.evidence()[0] - start.evidence()[0]
    senses = np.array([bool(behavior.modalities) for behavior in TOY.behaviors])
    assert new.sum() > 0
    lost = (first.momdp.bonus - second.momdp.bonus)[0].mean(axis=-1)
    np.testing.assert_allclose(lost[senses], 30 * new[senses] / world.delta, atol=1e-9)


def test_a_told_object_is_known_again_only_with_memory():
    for name, prior in (("bayes_memory", 0.9), ("morc_itrs", 0.5)):
        world, start = world_of(DATASET, feedback=Feedback("all", 0.1))
        learner = learner_of(name, world, start)
        told = start.told.copy()
        told[7, 0] = 1
        learner.experience = replace(learner.experience, told=told)
        momdp = learner.train(task_of(7, "red")).momdp
        assert momdp.prior == pytest.approx([prior])


class TestPublishedVariants:
    def test_sample_wise_claims_more(self):
        rng = np.random.default_rng(0)
        strange = make_synthetic(
            TOY, objects=18, recordings=RECORDINGS, signal=0.0, object_effect=3.0, rng=rng
        )

        def claimed(*published):
            options = {"published": published, "feedback": Feedback("all")}
            learner = trained("iterative_random_legal", strange, 24, **options)[1]
            yes = learner.knowledge.posterior.mean[:, :2, :, 1]
            return (yes[..., 1] - yes[..., 0]).mean()

        assert claimed("sample_wise") > claimed() + 0.2

    def test_the_joint_label_is_true_where_all_are(self):
        world, start = world_of(DATASET, published=("joint_label",), feedback=Feedback("all"))
        learner = learner_of("iterative_morc", world, start)
        trial = learner.train(task_of(7, "red", "heavy"))
        for truth, labels in (([1, 1], [1, 1]), ([1, 0], [0, 0]), ([0, 0], [0, 0])):
            told = heard(world, replace(trial, truth=np.array(truth, bool)), 7)
            assert told.tolist() == labels

    def test_model_percepts_are_drawn_from_the_tables_without_end(self):
        world, start = world_of(DATASET, published=("model_percepts",))
        learner = learner_of("iterative_morc", world, start)
        assert isinstance(learner.percepts, ConfusionSampler)
        tables, _ = learner.knowledge.posterior.select(range(2), exact=True)
        np.testing.assert_array_equal(learner.percepts.confusion, tables)
        assert np.isinf(learner.test(task_of(13, "red")).momdp.limit).all()
        plain = learner_of("iterative_morc", *world_of(DATASET))
        assert isinstance(plain.percepts, FittedPercepts)

    @pytest.mark.parametrize("name", ["iterative_morc", "morc_itrs", "bayes", "bayes_memory"])
    def test_model_percepts_do_not_run_out_in_training_either(self, name):
        trials, learner = trained(name, published=("model_percepts",))
        assert max(len(trial.steps) for trial in trials) < 100
        evidence = learner.experience.evidence()
        np.testing.assert_array_equal(learner.knowledge.posterior.evidence, evidence)
        assert (learner.experience.gathered[TRAIN].sum(axis=2) <= RECORDINGS).all()

    def test_names_are_checked(self):
        assert world_of(DATASET, published=PUBLISHED)
        with pytest.raises(SettingsError, match="did you mean 'joint_label'"):
            world_of(DATASET, published=("joint_labels",))


class TestSuccess:
    @staticmethod
    def lift(domain):
        (effect,) = (e for e in domain.diagram.effects if e.behavior == "lift")
        return effect.probability

    def test_no_attempts_leave_the_domain_s(self):
        learned = with_success(TOY, np.zeros((3, 2), int))
        assert self.lift(learned) == pytest.approx(0.9)

    def test_means_are_those_of_beta_posteriors(self):
        attempts = np.array([[0, 4], [6, 2], [0, 0]])
        assert self.lift(with_success(TOY, attempts)) == pytest.approx((2 * 0.9 + 2) / 10)
        assert with_success(TOY, attempts).diagram.effects[0].probability == 1.0

    @pytest.mark.statistical
    def test_a_body_that_fails_half_the_time_is_found_out(self):
        effects = tuple(
            replace(effect, probability=0.5) if effect.behavior == "lift" else effect
            for effect in TOY.diagram.effects
        )
        body = replace(TOY, diagram=replace(TOY.diagram, effects=effects))
        _, learner = trained("iterative_random_legal", trials=60, body=body, learn_success=True)
        attempts = learner.experience.attempts
        n = attempts[1].sum()
        assert n > 200
        assert attempts[0, 0] == attempts[2, 0] == 0
        assert abs(self.lift(learner.knowledge.domain) - 0.5) < 4 * np.sqrt(0.25 / n) + 1 / n
        assert learner.train(task_of(7, "red")).momdp.transition[1, 0, 1] == pytest.approx(
            self.lift(learner.knowledge.domain)
        )
        assert self.lift(trained("bayes", trials=2, body=body)[1].knowledge.domain) == 0.9


def test_recipes_are_checked_and_named():
    assert {agent.name for agent in ONLINE_AGENTS.values()} == set(EVERY)
    with pytest.raises(SettingsError, match="did you mean 'bayes_memory'"):
        load_online_agent("bayes_memori")
    some = load_online_agent("bayes")
    with pytest.raises(SettingsError, match="did you mean 'information'"):
        OnlineAgent("odd", some.recipe, curiosity="informations")
