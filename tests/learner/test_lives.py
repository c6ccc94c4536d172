"""A life that is saved, and killed in the middle of a later trial, equals an undisturbed one.

Hundreds of lives: `pytest --hypothesis-profile lives tests/learner/test_lives.py`.
"""

import contextlib
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meal_bayes import Learner
from meal_bayes.errors import SettingsError
from meal_bayes.learner import recall

TRIALS = 7
_EXAMPLES = settings.default.max_examples
LIVES = _EXAMPLES if _EXAMPLES > 20 else 3  # of the quick profile few: each takes a second
PLAN = ("look", "lift", "reset", "look")


class Life:
    """What a robot's program and a person do, drawn by a seed; it may be killed once."""

    def __init__(self, make, folder, script, seed, *, dies):
        self.make = make
        self.folder = folder
        self.dies = dies
        self.rng = np.random.default_rng(seed)
        self.agents = ["bayes", "bayes_memory", "morc", script, script]
        saved = int(self.rng.integers(TRIALS - 1))
        self.saved = saved
        self.killed = int(self.rng.integers(saved, TRIALS)), int(self.rng.integers(4))
        self.own_at_load = bool(self.rng.integers(2))  # the agent of the end, else of the file
        self.agent = self.saved_agent = self.draw_agent()
        self.learner = Learner(make.kitchen, agent=self.agent, logs=folder, refit_every=0.5)
        self.trials = []

    def draw_agent(self):
        return self.agents[int(self.rng.integers(len(self.agents)))]

    def happens(self, probability):
        return self.rng.random() < probability

    def meddle(self, *, between):
        """Do what a person may do: tell, take back, learn anew; between trials change the agent."""
        kind = self.rng.integers(10)
        told = {"red": self.happens(0.5), "full": self.happens(0.5)}
        name = f"cup {self.rng.integers(5)}"
        number = int(self.rng.integers(TRIALS))
        agent = self.draw_agent()
        if kind < 2:
            self.learner.tell(name, told)
        elif kind < 5 and number < len(self.trials):
            self.learner.tell(self.trials[number], told)
        elif kind == 5 and number < len(self.trials):
            with contextlib.suppress(SettingsError):  # there is nothing to forget
                self.learner.forget(self.trials[number], recordings=told["red"] and told["full"])
        elif kind < 8:
            self.learner.refit()
        elif between:
            self.learner.agent = self.agent = agent

    def live(self):
        for number in range(TRIALS):
            if self.happens(0.4):
                self.meddle(between=True)
            if self.dies and number == self.saved:
                self.learner.save(self.folder / "mind")
                self.saved_agent = self.agent
            red, full = self.happens(0.5), self.happens(0.5)
            which = int(self.rng.integers(5))
            meddled = int(self.rng.integers(8))  # the step at which a person does something
            if number == self.killed[0] and isinstance(self.agent, str):
                meddled = -1  # who resumes the trial would plan with what is known then
            arm = self.make.arm(red, full, seed=number)
            session = self.learner.begin("red", f"cup {which}", state=arm.start())
            while session.behavior is not None:
                if len(session.steps) == meddled:
                    meddled = -1
                    self.meddle(between=False)
                if self.dies and number == self.killed[0] and len(session.steps) >= self.killed[1]:
                    session = self.die(session, arm)
                    continue
                session.observe(arm.execute(session.behavior))
            self.trials.append(session.trial)
            if self.happens(0.6):
                self.learner.tell(session.trial, {"red": red, "full": full})
        return self

    def die(self, session, arm):
        """Abandon the learner, and go on from its file and its logs, as a new process does."""
        self.dies = False
        session._recorder._file.close()  # as the end of its process does
        # An agent of one's own cannot be found by its name.
        own = self.own_at_load or not isinstance(self.agent, str)
        agent = self.agent if own else self.saved_agent
        self.learner = Learner.load(self.folder / "mind", agent=agent, logs=self.folder)
        recall(self.learner, self.folder)
        return self.learner.resume(state=arm.state)


@pytest.mark.filterwarnings("ignore:The agent 'morc' answered", "ignore:There is no recording")
@settings(max_examples=LIVES)
@given(seed=st.integers(0, 10**6))
def test_a_killed_life_equals_an_undisturbed_one(make, seed):
    script = make.agent(*PLAN, **make.ours)
    with tempfile.TemporaryDirectory() as place:
        whole, heir = (
            Life(make, Path(place, str(dies)), script, seed, dies=dies).live()
            for dies in (False, True)
        )
        assert not list(Path(place).rglob("*.active"))
    learners = [whole.learner, heir.learner]
    assert learners[0].agent.name == learners[1].agent.name
    for name in ("executions", "labels", "object_labels"):
        expected, got = (getattr(learner.experience, name).values for learner in learners)
        np.testing.assert_array_equal(got, expected)
    known = [learner.knowledge() for learner in learners]
    np.testing.assert_array_equal(*(k.posterior.concentration for k in known))
    np.testing.assert_array_equal(*(k.posterior.counts for k in known))
    np.testing.assert_array_equal(*(k.base_rates for k in known))
