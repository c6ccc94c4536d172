"""A refit runs behind `tell`: the next call waits for it, and finds all that it has learned."""

import copy
import logging
import os
import pickle
import subprocess
import sys
import threading
import warnings

import cloudpickle
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meal_bayes import recall
from meal_bayes.learner.learner import _Fits
from meal_bayes.look import warn_user
from meal_bayes.trial_log import Logs

USES = {
    "ask": lambda learner, make, folder: learner.ask("red", make.arm(seed=9), object_name="jug"),
    "begin": lambda learner, make, folder: learner.begin("red", "jug").cancel(),
    "tell": lambda learner, make, folder: learner.tell("cup 3", {"red": False}),
    "forget": lambda learner, make, folder: learner.forget("cup 3"),
    "record": lambda learner, make, folder: learner.experience.labels.values,
    "fit": lambda learner, make, folder: learner.fitted(learner.agent),
    "refit": lambda learner, make, folder: learner.refit(),
    "save": lambda learner, make, folder: learner.save(folder / "saved.mbl"),
    "recall": lambda learner, make, folder: recall(learner, folder / "logs"),
    "deepcopy": lambda learner, make, folder: copy.deepcopy(learner),
    "pickle": lambda learner, make, folder: cloudpickle.dumps(learner),
}


class Gate:
    """Holds refits up until it is opened; `fault` is what they raise, `text` of what they warn."""

    def __init__(self, monkeypatch):
        self.opened = threading.Event()
        self.begun = threading.Event()
        self.fault = None
        self.text = ""
        refitted = _Fits.refitted

        def held_up(fits, agents):
            self.begun.set()
            assert self.opened.wait(60)
            if self.text:
                warn_user(self.text)
            if self.fault is not None:
                raise self.fault
            return refitted(fits, agents)

        monkeypatch.setattr(_Fits, "refitted", held_up)


@pytest.fixture
def gate(monkeypatch):
    gate = Gate(monkeypatch)
    yield gate
    gate.opened.set()


@pytest.fixture
def learner(dataset, make, tmp_path):
    agent = make.agent("look", **make.ours)
    return make.learner(dataset, agent, refit_every=1e-9, logs=tmp_path / "logs")


def told(learner, make):
    """Ask about a mug, and tell that it is not red: a refit is due."""
    trial = learner.ask("red", make.arm(), object_name="mug")
    learner.tell(trial, {"red": False})
    return trial


def alpha(learner):
    return learner.knowledge().posterior.concentration


@pytest.mark.parametrize("use", USES)
def test_what_is_called_next_waits_for_the_refit(learner, make, gate, tmp_path, use):
    told(learner, make)
    assert gate.begun.wait(60)
    assert learner.is_refitting
    assert "labels" in repr(learner)  # what a display shows waits for nothing
    ended = threading.Event()

    def call():
        USES[use](learner, make, tmp_path)
        ended.set()

    caller = threading.Thread(target=call, daemon=True)
    caller.start()
    assert not ended.wait(0.2)
    gate.opened.set()
    assert ended.wait(60)
    caller.join()


def test_what_was_told_is_on_disk_before_the_refit_has_ended(learner, make, gate, tmp_path):
    told(learner, make)
    ((_, feedback),) = Logs(tmp_path / "logs").told()
    assert not gate.opened.is_set()
    assert feedback.labels == {"red": False}


def test_a_copy_has_what_the_refit_learned(learner, make):
    told(learner, make)
    twin = pickle.loads(cloudpickle.dumps(learner))  # noqa: S301  of our own
    assert not twin.is_refitting
    np.testing.assert_array_equal(alpha(twin), alpha(learner))


@settings(max_examples=5)
@given(st.lists(st.sampled_from(["red", "full", "forget"]), min_size=1, max_size=5))
def test_a_learner_that_waits_knows_the_same(dataset, make, events):
    learners = [
        make.learner(dataset, make.agent("look", "lift", **make.ours), refit_every=1e-9)
        for _ in range(2)
    ]
    beliefs = []
    for learner, waits in zip(learners, (True, False), strict=True):
        trials = []
        for number, event in enumerate(events):
            trials.append(learner.ask("red, full", make.arm(seed=number), object_name="mug"))
            learner.tell(trials[-1], {"red" if event == "forget" else event: False})
            if event == "forget":
                learner.forget(trials.pop(0), recordings=True)
            if waits:
                learner.fitted(learner.agent)
        beliefs.append([trial.last_belief.log_prob for trial in trials])
    np.testing.assert_array_equal(*map(alpha, learners))
    for pair in zip(*beliefs, strict=True):
        np.testing.assert_array_equal(*pair)


def test_an_error_of_the_refit_is_raised_by_what_is_called_next(learner, make, gate):
    gate.fault = ValueError("the classifier is broken")
    gate.opened.set()
    trial = told(learner, make)
    with pytest.raises(ValueError, match="the classifier is broken"):
        learner.knowledge()
    gate.fault = None
    assert (learner.experience.labels_of_trial(trial.task.key) == [0, -1]).all()
    learner.tell(trial, {"full": True})  # the refit is still due
    assert learner.fitted(learner.agent).n_labels_at_refit[0] == 73


def test_its_warnings_reach_who_calls_next(learner, make, gate):
    gate.text = "the scores are reversed"
    gate.opened.set()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        told(learner, make)
    with pytest.warns(UserWarning, match="the scores are reversed"):
        learner.knowledge()


def test_the_log_of_the_package_says_so(learner, make, caplog):
    with caplog.at_level(logging.INFO, "meal_bayes"):
        told(learner, make)
    assert any("refits" in record.getMessage() for record in caplog.records)


def test_how_numpy_treats_errors_holds_for_the_refit(learner, make, monkeypatch):
    seen = []
    refitted = _Fits.refitted

    def looked_at(fits, agents):
        seen.append(np.geterr()["invalid"])
        return refitted(fits, agents)

    monkeypatch.setattr(_Fits, "refitted", looked_at)
    with np.errstate(invalid="raise"):
        told(learner, make)
    learner.knowledge()
    assert seen == ["raise"]


@pytest.mark.filterwarnings("ignore:.*multi-threaded.*:DeprecationWarning")
def test_a_forked_process_refits_itself(learner, make, gate):
    told(learner, make)
    assert gate.begun.wait(60)
    child = os.fork()
    if not child:
        gate.opened = threading.Event()
        gate.opened.set()
        os._exit(0 if alpha(learner).shape else 1)
    _, status = os.waitpid(child, 0)
    assert status == 0


ENDS = """
import threading
from meal_bayes import Learner
from meal_bayes.learner.learner import _Fits
from meal_bayes.learner.online import Online
_Fits.refitted = lambda fits, agents: threading.Event().wait()
Online.due = True
learner = Learner("toy", agent="greedy", logs=None).refit()
learner.tell("cup", {"red": True})
print(learner.is_refitting)
"""


def test_the_end_of_a_program_does_not_wait_for_a_refit():
    done = subprocess.run(
        [sys.executable, "-c", ENDS], capture_output=True, text=True, timeout=120, check=True
    )
    assert (done.stdout, done.stderr) == ("True\n", "")
