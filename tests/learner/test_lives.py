"""A life that is saved, and killed in the middle of a later trial, equals an undisturbed one."""

import numpy as np
import pytest

from meal_bayes import Learner
from meal_bayes.learner import recall

TRIALS = 8
PLAN = ("look", "lift", "reset", "look")


def live(make, folder, seed, *, dies):
    """Ask and tell; if it dies, abandon the learner and go on from its file and its logs."""
    rng = np.random.default_rng(seed)
    agent = make.agent(*PLAN, **make.ours)
    learner = Learner(make.kitchen, agent=agent, logs=folder, refit_every=1.0)
    saved = int(rng.integers(TRIALS - 1))
    killed = int(rng.integers(saved, TRIALS))
    step = int(rng.integers(len(PLAN)))
    for number in range(TRIALS):
        red, full, told = rng.random(3) < (0.5, 0.5, 0.7)
        which = int(rng.integers(5))
        if dies and number == saved:
            learner.save(folder / "mind")
        arm = make.arm(bool(red), bool(full), seed=which)
        key = f"k{number}"
        session = learner.begin("red", f"cup {which}", state=arm.start(), key=key)
        while session.behavior is not None:
            if dies and number == killed and len(session.steps) == step:
                dies = False
                session._recorder._file.close()  # as the end of its process does
                learner = Learner.load(folder / "mind", agent=agent, logs=folder)
                recall(learner, folder)
                session = learner.resume(state=arm.state)
                continue
            session.observe(arm.execute(session.behavior))
        if told:
            learner.tell(session.trial, {"red": bool(red), "full": bool(full)})
    return learner


@pytest.mark.quick(5)
@pytest.mark.parametrize("seed", range(20))
def test_a_killed_life_equals_an_undisturbed_one(make, tmp_path, seed):
    whole = live(make, tmp_path / "whole", seed, dies=False)
    heir = live(make, tmp_path / "killed", seed, dies=True)
    assert not list(tmp_path.rglob("*.active"))
    for name in ("executions", "labels", "object_labels"):
        expected = getattr(whole.experience, name).values
        np.testing.assert_array_equal(getattr(heir.experience, name).values, expected)
    known = [learner.knowledge() for learner in (whole, heir)]
    np.testing.assert_array_equal(*(k.posterior.concentration for k in known))
    np.testing.assert_array_equal(*(k.posterior.counts for k in known))
    np.testing.assert_array_equal(*(k.base_rates for k in known))
