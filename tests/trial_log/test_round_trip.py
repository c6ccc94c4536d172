"""What is written comes back; earlier formats are refused; other tools can read it."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader

from meal_bayes.arrays import freeze
from meal_bayes.datasets import Instance
from meal_bayes.domain import load_domain
from meal_bayes.errors import LogError, LogVersionError, SettingsError
from meal_bayes.momdp import Belief, Transition, belief_of, initial_belief, update_belief
from meal_bayes.planners import Decision, unvalued
from meal_bayes.trial_log import (
    FORMAT_VERSION,
    Logs,
    TrialWriter,
    check_log,
    log_info,
    read_header,
    read_trials,
    recover_log,
    salvage,
    write_trials,
)
from meal_bayes.trial_log.messages import FEATURE_LIMIT, LINES
from meal_bayes.trials import Step, Task, Trial
from meal_bayes.untrusted import name_fault

ODD = (np.nan, np.inf, -np.inf, 1e300, -0.0, 5e-324, 0.1)  # numbers
COUNTS = (0, 7, 2**62)
TEXTS = st.text(max_size=12)
NAMES = TEXTS.filter(lambda text: not name_fault(text))  # of objects
KEYS = st.lists(TEXTS | st.integers(-(2**70), 2**70), max_size=3).map(tuple)


def odd_instance(behavior, rng):
    """Return what a robot sensed: features of some modalities, a detector's percepts, or both."""
    sizes = rng.integers(1, 5, rng.integers(3))
    features = {
        f"sensor {n}": freeze(rng.choice((1e38, -0.0, 0.1), size), np.float32)
        for n, size in enumerate(sizes)
    }
    percepts = dict.fromkeys(
        rng.choice(("red", "a b"), rng.integers(3), replace=False).tolist(), -0.5
    )
    return Instance(-1, behavior, int(rng.integers(-1, 3)), features or None, percepts or None)


def odd(trial, rng):
    """Return a trial whose numbers mean nothing, but whose shapes fit."""
    steps = []
    momdp = trial.momdp
    for step in trial.steps:
        size = momdp.n_behaviors + 1
        counts = rng.choice(COUNTS, step.belief.percept_counts.shape)
        log_prob = -rng.exponential(size=step.belief.log_prob.shape)
        tree = [
            edge._replace(value=float(rng.choice(ODD)), bonus=float(rng.choice(ODD)))
            for edge in step.decision.tree[:3]
        ]
        decision = Decision(
            int(rng.integers(momdp.n_actions)), rng.choice(ODD, size), rng.choice(ODD, size),
            rng.choice(COUNTS, size), tuple(tree), int(rng.choice(COUNTS)),
            gap=float(rng.choice(ODD)) if rng.integers(2) else None,
            bonus=rng.choice(ODD, size) if rng.integers(2) else None,
        )  # fmt: skip
        x = int(rng.integers(len(momdp.x_names)))
        cost, reward = rng.choice(ODD[3:], 2).tolist()
        belief = belief_of(momdp, x, log_prob, counts)
        sensed = None
        if decision.action < momdp.n_behaviors and rng.integers(2):
            sensed = odd_instance(momdp.behavior_names[decision.action], rng)
        steps.append(
            Step(x, decision, momdp.terminal, step.observation, cost, reward, belief, sensed=sensed)
        )
    return dataclasses.replace(trial, steps=tuple(steps))


@given(seed=st.integers(0, 2**32), text=TEXTS, name=NAMES, key=KEYS)
def test_any_trials_come_back_equal(seed, text, name, key, make, tmp_path_factory):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 3))
    levels = int(rng.choice([2, 4]))
    momdp = make.momdp(load_domain("toy"), n, rng, levels)
    momdp = dataclasses.replace(momdp, abstain=bool(rng.integers(2)))
    trials = [odd(make.trial(momdp, rng, steps=int(rng.integers(4))), rng) for _ in range(2)]
    task = Task(text, momdp.query, 999, name, key)
    trials[0] = dataclasses.replace(trials[0], task=task, agent=text)
    path = tmp_path_factory.getbasetemp() / "any.mcap"
    write_trials(path, trials, header={}, overwrite=True)
    back = list(read_trials(path))
    assert len(back) == 2
    assert all(map(make.equal, trials, back))


def test_features_beyond_what_a_log_holds_stay_out_of_it(make, tmp_path):
    (trial,) = make.trials(1, 3)
    many = {"camera": np.ones(FEATURE_LIMIT + 1, np.float32)}
    first, *others = trial.steps
    behavior = trial.momdp.behavior_names[first.decision.action]
    for percepts in (None, {"red": 1.0}):
        sensed = Instance(-1, behavior, -1, many, percepts)
        steps = (dataclasses.replace(first, sensed=sensed), *others)
        large = dataclasses.replace(trial, steps=steps)
        write_trials(tmp_path / "a.mcap", [large], header={}, overwrite=True)
        (back,) = read_trials(tmp_path / "a.mcap")
        left = None if percepts is None else dataclasses.replace(sensed, features=None)
        assert back.steps[0].sensed == left
        assert back.cost == trial.cost


def test_a_report_of_81_attributes_comes_back(make, tmp_path):
    trials = make.trials(3, 5, domain="ispy32", n=81)
    actions = [step.decision.action for trial in trials for step in trial.steps]
    assert max(actions) > 2**64
    write_trials(tmp_path / "a.mcap", trials, header={})
    assert all(map(make.equal, trials, list(read_trials(tmp_path / "a.mcap"))))


def test_arrays_come_back_read_only_and_momdps_shared(make, tmp_path):
    trials = make.trials(4, 1)
    write_trials(tmp_path / "a.mcap", trials, header={})
    back = list(read_trials(tmp_path / "a.mcap"))
    assert back[0].momdp is back[1].momdp
    assert back[1].momdp is not back[2].momdp
    assert len(messages(tmp_path / "a.mcap", "/momdp")) == 2
    assert not back[0].steps[0].belief.percept_counts.flags.writeable
    percepts = [s.observation for t in back for s in t.steps if s.observation is not None]
    assert percepts
    assert not any(percept.flags.writeable for percept in percepts)


def test_percept_counts_are_stored_only_where_replay_differs(make, tmp_path):
    trial = make.trials(1, 2, steps=5)[0]
    belief = trial.steps[2].belief
    strange = dataclasses.replace(belief, x=0, percept_counts=belief.percept_counts + 3)
    steps = list(trial.steps)
    steps[2] = dataclasses.replace(steps[2], belief=strange)
    odd = Trial(trial.task, "odd", trial.momdp, trial.first_belief, tuple(steps), trial.truth, None)
    write_trials(tmp_path / "a.mcap", [trial, odd], header={})
    back = list(read_trials(tmp_path / "a.mcap"))
    assert all(map(make.equal, [trial, odd], back))
    told = ["percept_counts" in step["belief"] for step in messages(tmp_path / "a.mcap", "/step")]
    n = len(trial.steps)
    assert told == [False] * n + [i in (2, 3) for i in range(n)]


def test_a_percept_of_a_part_of_the_question_is_replayed(make, tmp_path):
    (trial,) = make.trials(1, 2, steps=1)
    first = trial.first_belief
    action = trial.steps[0].decision.action
    percept = np.array([-1, 2], np.int8)
    belief = update_belief(first, trial.momdp, Transition(action, 0, percept))
    step = dataclasses.replace(trial.steps[0], next_x=0, observation=percept, belief=belief)
    part = dataclasses.replace(trial, steps=(step,), report=None)
    write_trials(tmp_path / "a.mcap", [part], header={})
    (back,) = read_trials(tmp_path / "a.mcap")
    assert make.equal(back, part)
    (message,) = messages(tmp_path / "a.mcap", "/step")
    assert "percept_counts" not in message["belief"]


def test_equal_runs_give_byte_identical_files(make, header, tmp_path):
    for name, seconds in (("a", 0.1), ("b", 77.0)):
        with TrialWriter(tmp_path / f"{name}.mcap", header) as log:
            for trial in make.trials(5, 8):
                log.write(trial, seconds=seconds)
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()
    assert (tmp_path / "b.timing.csv").read_text().splitlines()[:2] == [
        "trial,seconds",
        "0,77.000000",
    ]


def messages(path, topic):
    """Decode with the MCAP library and Python's JSON alone, as other tools do."""
    with path.open("rb") as file:
        read = make_reader(file, validate_crcs=True).iter_messages(topics=topic)
        return [json.loads(message.data) for _, _, message in read]


def test_other_tools_read_steps_and_lines(make, header, tmp_path):
    path = tmp_path / "a.mcap"
    trials = make.trials(2, 4)
    write_trials(path, trials, header=header)
    steps = [step for trial in trials for step in trial.steps]
    read = messages(path, "/step")
    assert [step["action_name"] for step in read] == [
        trial.momdp.action_name(step.decision.action) for trial in trials for step in trial.steps
    ]
    for message, step in zip(read, steps, strict=True):
        assert message["belief"]["positive"] == step.belief.positive.tolist()
        assert [edge["value"] for edge in message["tree"]] == [e.value for e in step.decision.tree]
    lines = messages(path, "/log")
    assert len(lines) == len(steps)
    assert lines[0]["name"] == "bayes"
    assert lines[0]["level"] == 2
    assert lines[0]["message"].startswith("trial 0 step 0: ")
    assert [o["success"] for o in messages(path, "/outcome")] == [t.success for t in trials]


def test_metadata_attachment_and_header(make, header, tmp_path):
    path = tmp_path / "a.mcap"
    write_trials(path, make.trials(1), header=header)
    with path.open("rb") as file:
        reader = make_reader(file)
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
        attachment, end = reader.iter_attachments()
    assert metadata["run"]["format_version"] == str(FORMAT_VERSION)
    assert metadata["run"]["seed"] == "7"
    assert set(json.loads(metadata["run"]["versions"])) == {"meal_bayes", "numpy", "python"}
    assert json.loads(attachment.data) == header["config"]
    assert json.loads(end.data).keys() == {"trials", "steps", "cost"}
    header_read = read_header(path)
    assert {name: header_read[name] for name in header} == header
    assert header_read["versions"]["numpy"] == np.__version__
    info = log_info(path)
    report = check_log(path)
    assert (info.trials, info.header) == (1, header_read)
    assert report == info
    assert report.whole


def test_a_trial_that_does_not_fit_is_refused_and_the_log_stays_good(make, tmp_path):
    good = make.trials(1)[0]
    momdp = good.momdp
    first = initial_belief(good.momdp)
    percept = np.array([0, 9], np.int8)
    counted = first.percept_counts
    odds = first.log_odds
    nothing = unvalued(momdp, 0)
    bad = [
        Step(0, unvalued(momdp, momdp.n_actions), 0, None, 0.0, 0.0, first),
        Step(0, Decision(0, [0.0], [0.0], [0]), 0, None, 0.0, 0.0, first),
        Step(0, nothing, 99, None, 0.0, 0.0, first),
        Step(0, nothing, 0, percept, 0.0, 0.0, first),
        Step(0, nothing, 0, percept[:1], 0.0, 0.0, first),
        Step(0, nothing, 0, None, "free", 0.0, first),
        *(Step(0, nothing, 0, None, 0.0, 0.0, Belief(0, *parts)) for parts in (
            ([[0.0]], counted, odds), (first.log_prob, [1], odds),
            (first.log_prob + np.nan, counted, odds))),
    ]  # fmt: skip
    path = tmp_path / "a.mcap"
    with TrialWriter(path, {}) as log:
        for step in bad:
            trial = Trial(good.task, "a", momdp, first, (step,), good.truth, None)
            with pytest.raises(LogError, match="Trial 0 cannot be logged"):
                log.write(trial)
        log.write(good)
        other = make.trials(1, 9)[0]
        with pytest.raises(LogError, match="Trial 1 cannot be logged"):
            log.write(dataclasses.replace(other, steps=(bad[2],)))
        log.write(good)
    assert all(make.equal(good, back) for back in read_trials(path))
    assert check_log(path).whole


def test_writer_says_what_it_needs(make, tmp_path):
    with pytest.raises(SettingsError, match=r"ends in \.mcap"):
        TrialWriter(tmp_path / "a.log", {})
    for header in ({"when": float("nan")}, {"where": tmp_path}, {3: "x"}):
        with pytest.raises(SettingsError, match="header"):
            TrialWriter(tmp_path / "a.mcap", header)
    with pytest.raises(LogError, match="inside the `with"):
        TrialWriter(tmp_path / "a.mcap", {}).write(make.trials(1)[0])
    (tmp_path / "file").write_text("")
    with pytest.raises(LogError, match="cannot be written"):
        TrialWriter(tmp_path / "file" / "a.mcap", {}).__enter__()


@pytest.mark.parametrize(
    "read", [read_header, log_info, check_log, recover_log, lambda p: list(read_trials(p)),
             lambda p: list(salvage(p)), lambda p: list(Logs(p).groups())]
)  # fmt: skip
def test_a_log_of_version_0_1_0_is_refused_in_one_clear_line(read):
    """The file was written by that version, as protobuf, and holds no trial."""
    says = r"written by meal_bayes 0\.1\.0 as protobuf, .*reads JSON; .*again"
    with pytest.raises(LogVersionError, match=says) as refused:
        read(Path(__file__).with_name("version-0.1.0.mcap"))
    assert "\n" not in str(refused.value)


def test_unknown_truth_warnings_counts_and_the_end_come_back(make, tmp_path):
    trials = []
    for number, truth in enumerate(([-1, -1], [1, -1], [0, 1])):
        trial = make.trials(1, number)[0]
        warned = dataclasses.replace(trial.steps[1], warning="no percept of look: NaN")
        steps = (trial.steps[0], warned, *trial.steps[2:])
        ended = "robot error: hot" * (number == 2)
        shape = (2, trial.momdp.n_behaviors, 2, trial.momdp.levels)
        counts = np.arange(np.prod(shape), dtype=float).reshape(shape)
        trials.append(dataclasses.replace(
            trial, truth=np.array(truth), steps=steps, ended=ended, counts=counts
        ))  # fmt: skip
    path = tmp_path / "a.mcap"
    write_trials(path, trials, header={})
    back = list(read_trials(path))
    assert all(map(make.equal, back, trials))
    assert [trial.success for trial in back] == [None] * 3
    assert [trial.judged for trial in back] == [False] * 3
    with path.open("rb") as file:
        lines = [message.data for _, _, message in make_reader(file).iter_messages(topics=[LINES])]
    assert sum(b"no percept of look: NaN" in line for line in lines) == 3


def test_steps_told_one_by_one_are_the_whole_trial(make, tmp_path):
    trials = make.trials(4, 3)
    whole = tmp_path / "one.mcap"
    stepwise = tmp_path / "other.mcap"
    write_trials(whole, trials, header={})
    with TrialWriter(stepwise, {}) as log:
        for trial in trials:
            log.begin(dataclasses.replace(trial, steps=()))
            for step in trial.steps:
                log.step(step)
            log.end(trial)
    assert all(map(make.equal, read_trials(stepwise), trials))
    assert check_log(stepwise).whole


def test_a_trial_without_its_end_leaves_the_file_unfinished(make, tmp_path):
    path = tmp_path / "a.mcap"
    (whole, trial) = make.trials(2, 3)
    with TrialWriter(path, {}) as log:
        log.write(whole)
        log.begin(trial)
        log.step(trial.steps[0])
        with pytest.raises(LogError, match="has not ended"):
            log.write(whole)
    assert not path.exists()
    saved = list(salvage(log.active_path))
    assert make.equal(saved[0], whole)
    assert make.equal(saved[1].steps[0], trial.steps[0])
    assert (len(saved), len(saved[1].steps), saved[1].ended) == (2, 1, "the log ends here")
    assert not check_log(log.active_path).whole
