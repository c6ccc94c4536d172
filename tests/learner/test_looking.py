"""Whoever looks at a learner, saves it or tests it changes nothing that it does later."""

import dataclasses

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from meal_bayes.agents import AGENTS
from meal_bayes.domain import domain_from_table
from meal_bayes.learner import Learner
from meal_bayes.planners import OpenLoop, Predefined

LOOKS = {
    "print": lambda learner, trial, make: repr(learner) + repr(trial),
    "notebook": lambda learner, trial, make: learner._repr_html_() + trial._repr_html_(),
    "knowledge": lambda learner, trial, make: learner.knowledge().posterior,
    "table": lambda learner, trial, make: trial.to_frame(),
    "test": lambda learner, trial, make: learner.ask("red", make.arm(seed=7), learn=False),
    "policy": lambda learner, trial, make: learner.policy("red, full"),
    "problem": lambda learner, trial, make: learner.problem("full"),
}
TRIALS = 5


def open_loop(domain, query):
    return OpenLoop()


def by_plan(domain, query):
    return Predefined(("look", "lift", "reset", "look"))


OWN = {
    "own_memory": dataclasses.replace(
        AGENTS["bayes_memory"], name="own_memory", solver=open_loop, discount=0.5
    ),
    "own_plan": dataclasses.replace(AGENTS["morc_itrs"], name="own_plan", solver=by_plan),
}
EVERY = {**AGENTS, **OWN}


def decided(trial):
    """Return all that a trial decided and believed: actions, values, bonus, beliefs, answer."""
    steps = [
        (
            step.decision.action,
            np.asarray(step.decision.values).tobytes(),
            np.asarray(step.decision.bonus).tobytes(),
            step.belief.log_prob.tobytes(),
        )
        for step in trial.steps
    ]
    return steps, trial.last_belief.log_prob.tobytes(), trial.answer


def life(make, folder, agent, seed, looks, *, restart=-1):
    """Return what is decided and learned in a few trials from nothing."""
    learner = Learner(domain_from_table(make.kitchen), agent=EVERY[agent], seed=seed, logs=None)
    all_decided = []
    for n in range(TRIALS):
        truth = {"red": bool((seed + n) % 2), "full": bool((seed + n) // 2 % 2)}
        question = ("red, full", "full", "red")[(seed + n) % 3]
        trial = learner.ask(question, make.arm(**truth, seed=n), object_name=f"mug {n // 2}")
        all_decided.append(decided(trial))
        for look in looks[n]:
            LOOKS[look](learner, trial, make)
        learner.tell(trial, truth)
        if n == restart:
            path = folder / f"{agent}.mind"
            learner.save(path, overwrite=True)
            learner = Learner.load(path, agent=OWN.get(agent), logs=None)
    known = learner.knowledge()
    learned = [
        getattr(known.posterior, name).tobytes()
        for name in ("counts", "concentration", "dispersion")
    ]
    return all_decided, learned, known.base_rates.tolist()


GOING_ON = given(
    agent=st.sampled_from(sorted(EVERY)),
    seed=st.integers(0, 999),
    looks=st.lists(
        st.lists(st.sampled_from(sorted(LOOKS)), max_size=3), min_size=TRIALS, max_size=TRIALS
    ),
    restart=st.integers(0, TRIALS - 1),
)


def check_going_on(make, folder, agent, seed, looks, restart):
    plain = life(make, folder, agent, seed, [()] * TRIALS)
    assert life(make, folder, agent, seed, looks, restart=restart) == plain


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:The agent .* answered without touching")
@pytest.mark.parametrize("agent", sorted(EVERY))
def test_going_on_from_a_file_changes_nothing_for_any_agent(make, tmp_path, agent):
    check_going_on(make, tmp_path, agent, len(agent), [sorted(LOOKS)] * TRIALS, restart=2)


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:The agent .* answered without touching")
@settings(
    max_examples=settings().max_examples // 5,  # 500: pytest --hypothesis-profile=bars
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@GOING_ON
@example(agent="bayes", seed=1, looks=[sorted(LOOKS)] * TRIALS, restart=2)
def test_looking_and_going_on_from_a_file_change_nothing(
    make, tmp_path, agent, seed, looks, restart
):
    check_going_on(make, tmp_path, agent, seed, looks, restart)
