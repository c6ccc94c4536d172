"""Whoever looks at a learner, or asks it a test question, changes nothing that it does later."""

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from meal_bayes.domain import domain_from_table
from meal_bayes.learner import Learner

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


def life(make, folder, agent, seed, looks, *, restart=-1):
    """Return what is decided and counted in a few trials from nothing."""
    learner = Learner(domain_from_table(make.kitchen), agent=agent, seed=seed, logs=None)
    decided = []
    for n in range(TRIALS):
        truth = {"red": bool((seed + n) % 2), "full": bool((seed + n) // 2 % 2)}
        trial = learner.ask("red, full", make.arm(**truth, seed=n))
        decided.append(([step.decision.action for step in trial.steps], trial.answer))
        for look in looks[n]:
            LOOKS[look](learner, trial, make)
        learner.tell(trial, truth)
        if n == restart:
            learner.save(folder / f"{agent}.mind", overwrite=True)
            learner = Learner.load(folder / f"{agent}.mind", logs=None)
    return decided, learner.knowledge().posterior.counts.tolist()


@pytest.mark.parametrize("agent", ["random", "bayes", "bayes_memory", "morc", "morc_itrs"])
@settings(max_examples=3)
@given(
    seed=st.integers(0, 99),
    looks=st.lists(
        st.lists(st.sampled_from(sorted(LOOKS)), max_size=3), min_size=TRIALS, max_size=TRIALS
    ),
    restart=st.integers(0, TRIALS - 1),
)
@example(seed=1, looks=[sorted(LOOKS)] * TRIALS, restart=2)
def test_looking_and_going_on_from_a_file_change_nothing(
    make, tmp_path_factory, agent, seed, looks, restart
):
    folder = tmp_path_factory.mktemp("minds")
    plain = life(make, folder, agent, seed, [()] * TRIALS)
    assert life(make, folder, agent, seed, looks, restart=restart) == plain
