"""A trial counts once, however many copies of its log lie in a folder, and whatever their names."""

import dataclasses
import shutil
import warnings

import pytest

from meal_bayes.agents import Agent
from meal_bayes.domain import load_domain
from meal_bayes.learner import Learner, recall
from meal_bayes.planners import Predefined
from meal_bayes.robots import Outcome
from meal_bayes.trial_log import Follower, Logs, log_files, read_trials, write_trials
from meal_bayes.trials import TrialOutcomes

CONFIG = {"config": {"dataset": "toy", "agents": ["bayes"], "seed": 3}}
NAMES = [  # of a copy, as programs that copy, synchronize, unpack and edit files make them
    "run (1).mcap", "run copy.mcap", "Copy of run.mcap", "run - Copy.mcap", "kopie/run.mcap",
    "run.sync-conflict-20260131-142507-K3JX5HQ.mcap", "old/run.mcap", "a/b/run.mcap",
    "run (conflicted copy 2026-01-31).mcap", "z.mcap", "_run.mcap", "0.mcap",
    "run.w4711-a3f9c2 (1).mcap.active",
]  # fmt: skip
NO_LOGS = ["._run.mcap", ".run.mcap", "__MACOSX/._run.mcap", ".stversions/run.mcap", "run.mcap~",
           "run.mcap.bak", ".run.mcap.swp", "run.mcap.part"]  # fmt: skip


def read(folder):
    """Return the trials of a folder, and what was warned of."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        trials = list(read_trials(folder))
    return trials, [str(warning.message) for warning in caught]


@pytest.fixture
def log(tmp_path):
    return tmp_path / "logs" / "run.mcap"


@pytest.mark.quick(9)
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("form", ["full", "compact"])
def test_a_copy_is_counted_once_and_named(make, log, name, form):
    trials = make.trials(3)
    entries = trials if form == "full" else [TrialOutcomes.of(trials)]
    write_trials(log, entries, header=CONFIG)
    copy = log.parent / name
    copy.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(log, copy)
    logs = Logs(log.parent)
    assert sum(len(group.outcomes) for group in logs.groups()) == 3
    assert copy.name in logs.copies
    assert log.name in logs.copies
    if form == "full" and not name.endswith(".active"):
        again, warned = read(log.parent)
        assert all(map(make.equal, again, trials))
        assert len(again) == 3
        (text,) = warned
        assert copy.name in text
        follower = Follower(log.parent)
        assert len([*follower.poll(), *follower.poll()]) == 3
        follower.close()


@pytest.mark.parametrize("name", NO_LOGS)
def test_what_is_hidden_or_no_log_is_passed_over(make, log, name):
    write_trials(log, make.trials(2), header=CONFIG)
    other = log.parent / name
    other.parent.mkdir(exist_ok=True)
    for content in (log.read_bytes(), b"\0\x05\x16\x07 of a Mac"):
        other.write_bytes(content)
        assert log_files(log.parent) == [log]
        trials, warned = read(log.parent)
        assert (len(trials), warned) == (2, [])


def test_a_part_of_a_run_is_counted_once(make, log):
    """As where a copy was made while the run went on, or logs were put together."""
    trials = make.trials(6)
    write_trials(log, trials, header=CONFIG)
    write_trials(log.with_name("a.mcap"), trials[1:4], header={**CONFIG, "recovered_from": "x"})
    write_trials(log.with_name("z.mcap"), [TrialOutcomes.of(trials[:2])], header=CONFIG)
    logs = Logs(log.parent)
    keys = [key for group in logs.groups() for key in group.outcomes.key]
    assert len(keys) == 6


@pytest.mark.parametrize("other", ["seed", "agent", "trial", "repeat"])
def test_other_trials_with_equal_keys_all_count(make, log, other):
    first, second = make.trials(2)
    second = dataclasses.replace(second, task=first.task)
    header = dict(CONFIG)
    if other == "seed":
        second = first
        header = {"config": {**CONFIG["config"], "seed": 4}}
    elif other == "agent":
        second = dataclasses.replace(first, agent="another")
    elif other == "repeat":
        second = first
        header["repeat"] = 1
    write_trials(log, [first], header=CONFIG)
    write_trials(log.with_name("b.mcap"), [second], header=header)
    logs = Logs(log.parent)
    assert sum(len(group.outcomes) for group in logs.groups()) == 2
    assert logs.copies == ""
    trials, warned = read(log.parent)
    assert (len(trials), warned) == (2, [])


def test_a_trial_is_recalled_once_and_as_far_as_it_went(tmp_path):
    toy = load_domain("toy")
    agent = Agent("script", lambda domain, query: Predefined(toy.behavior_names[:1]))
    learner = Learner(toy, agent=agent, logs=tmp_path)

    def end(session):
        while session.behavior is not None:
            session.observe(Outcome(toy.diagram.start))
        return session.trial

    session = learner.begin("Is it red?", "a cup")
    (draft,) = tmp_path.rglob("*.active")
    shutil.copy(draft, draft.with_name("0.w1-abcdef.mcap.active"))
    trial = end(session)
    learner.tell(trial, {"red": True})
    (log,) = draft.parent.glob("*.mcap")
    shutil.copy(log, log.with_name("1.mcap"))
    end(learner.begin("Is it red?", "a cup"))
    restarted = Learner(toy, agent=agent, logs=None)
    recalled = recall(restarted, tmp_path)
    assert [len(trial.steps) for trial in recalled] == [len(trial.steps)] * 2
    follower = Follower(tmp_path)
    assert len(list(follower.poll())) == 2
    follower.close()
    logs = Logs(tmp_path)
    assert sum(len(group.outcomes) for group in logs.begun()) == 2
    assert "0.w1-abcdef.mcap.active" in logs.copies
    assert "1.mcap" in logs.copies
