"""Objects that nobody named, and forgotten ones: no drawn name, no trace moves what is learned."""

import itertools
import random

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from meal_bayes import Learner
from meal_bayes.learner import recall
from meal_bayes.trial_log import Logs

NAMES = st.lists(st.sampled_from((None, "mug", "object 7")), min_size=6, max_size=14)


@pytest.fixture(scope="module")
def agent(make):
    return make.agent("look", "lift", **make.ours)


def taught(make, agent, names, seed, **options):
    """Return a learner that began with nothing, its trials, and what it believed in them."""
    learner = Learner(make.kitchen, agent=agent, **{"logs": None, **options})
    rng = np.random.default_rng(seed)
    trials = []
    for name in names:
        red, full = (bool(value) for value in rng.integers(2, size=2))
        arm = make.arm(red, full, seed=int(rng.integers(2**30)))
        trial = learner.ask("red, full", arm, object_name=name, max_steps=5)
        learner.tell(trial, {"red": red, "full": full})
        trials.append(trial)
    beliefs = [[step.belief.positive.tolist() for step in trial.steps] for trial in trials]
    return learner, trials, beliefs


def learned(learner):
    """Return all numbers that a refit learns."""
    knowledge = learner.refit().knowledge()
    posterior = knowledge.posterior
    arrays = (posterior.counts, posterior.concentration, posterior.dispersion, knowledge.base_rates)
    success = [effect.probability for effect in knowledge.domain.diagram.effects]
    return [*(array.tolist() for array in arrays), knowledge.trait.sd, success]


@pytest.mark.long
@settings(max_examples=max(settings().max_examples // 20, 2), deadline=None)
@given(names=NAMES, seed=st.integers(0, 99))
@example(names=[None] * 14, seed=0)
def test_equal_questions_about_objects_without_names_are_answered_alike(
    make, agent, tmp_path_factory, names, seed
):
    """A name that is drawn for a log is of no meaning, in this process or another."""
    folder = tmp_path_factory.mktemp("logs")
    runs = [taught(make, agent, names, seed, logs=logs) for logs in (folder, None, None)]
    for first, second in itertools.pairwise(runs):
        assert first[2] == second[2]
        assert learned(first[0]) == learned(second[0])
    heir = Learner(make.kitchen, agent=agent, logs=None)
    recall(heir, folder)
    assert learned(heir) == learned(runs[0][0])


@settings(max_examples=max(settings().max_examples // 20, 2), deadline=None)
@given(names=NAMES, later=NAMES, order=st.randoms(use_true_random=False))
@example(names=[None] * 6, later=[None, "mug"] * 3, order=random.Random(0))
@example(names=[], later=[None, "mug", None], order=random.Random(0))
def test_what_was_forgotten_has_never_been(make, dataset, agent, names, later, order):
    learner, _, _ = taught(make, agent, names, 1)
    if names:
        learner.fit(dataset)
    before = learned(learner)
    rng = np.random.default_rng(2)
    trials = []
    for name in later:
        named = f"new {name}" if name else None
        trial = learner.ask("red, full", make.arm(seed=int(rng.integers(99))), object_name=named)
        learner.tell(trial, {"red": bool(rng.integers(2)), "full": True})
        trials.append(trial)
    order.shuffle(trials)
    for trial in trials:
        learner.forget(trial, recordings=True)
    assert learned(learner) == before


@pytest.mark.long
@settings(max_examples=max(settings().max_examples // 10, 3), deadline=None)
@given(
    fates=st.lists(
        st.sampled_from(("told", "untold", "taken back", "forgotten", "forgotten untold")),
        min_size=1,
        max_size=6,
    ),
    saved=st.integers(0, 5),
)
@example(fates=["told", "forgotten", "told"], saved=2)
@example(fates=["forgotten untold"], saved=0)
def test_what_was_forgotten_stays_so_after_a_restart(make, agent, tmp_path_factory, fates, saved):
    """A new learner, and one of an earlier moment, recall nothing of it."""
    folder = tmp_path_factory.mktemp("logs")
    live = Learner(make.kitchen, agent=agent, logs=folder)
    held = set()
    for number, fate in enumerate(fates):
        arm = make.arm(number % 2 == 0, number % 3 == 0, seed=number)
        trial = live.ask("red, full", arm, object_name=f"cup {number % 4}")
        if number == saved:
            live.save(folder / "mind")
        if "untold" not in fate:
            live.tell(trial, {"red": number % 2 == 0, "full": number % 3 == 0})
        if fate == "taken back":
            live.forget(trial)
        elif "forgotten" in fate:
            live.forget(trial, recordings=True)
        if "forgotten" not in fate:
            held.add(trial.task.key)
    heir = Learner(make.kitchen, agent=agent, logs=None)
    assert {trial.task.key for trial in recall(heir, folder)} == held
    heirs = [heir]
    if (folder / "mind").exists():
        heirs.append(Learner.load(folder / "mind", agent=agent, logs=None))
        recall(heirs[1], folder)
    expected = learned(live)
    for each in heirs:
        assert recall(each, folder) == []
        assert learned(each) == expected
    assert [trial.task.key for trial in Logs(folder).trials()] == list(live.experience.trials)
