"""Logs of earlier formats are refused; what came with later ones is there for us and others."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from meal_bayes.errors import LogError, LogVersionError
from meal_bayes.trial_log import (
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
from meal_bayes.trial_log.schema import LINES

OLD = (1, 2, 3, 4)  # each with a file that was written by its code


@pytest.mark.parametrize("version", OLD)
@pytest.mark.parametrize(
    "read", [read_header, log_info, check_log, recover_log, lambda p: list(read_trials(p)),
             lambda p: list(salvage(p)), lambda p: list(Logs(p).trials())]
)  # fmt: skip
def test_a_log_of_an_earlier_format_is_refused_in_one_clear_line(read, version):
    says = rf"format {version}, this meal_bayes reads format 5; .*again"
    with pytest.raises(LogVersionError, match=says):
        read(Path(__file__).with_name(f"format{version}.mcap"))


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
    one, other = tmp_path / "one.mcap", tmp_path / "other.mcap"
    write_trials(one, trials, header={})
    with TrialWriter(other, {}) as log:
        for trial in trials:
            log.begin(dataclasses.replace(trial, steps=()))
            for step in trial.steps:
                log.step(step)
            log.end(trial)
    assert all(map(make.equal, read_trials(other), trials))
    assert check_log(other).whole


def test_a_trial_without_its_end_leaves_the_file_unfinished(make, tmp_path):
    path, (whole, trial) = tmp_path / "a.mcap", make.trials(2, 3)
    with TrialWriter(path, {}) as log:
        log.write(whole)
        log.begin(trial)
        log.step(trial.steps[0])
        with pytest.raises(LogError, match="not open"):
            log.write(whole)
    assert not path.exists()
    saved = list(salvage(log.active_path))
    assert make.equal(saved[0], whole)
    assert make.equal(saved[1].steps[0], trial.steps[0])
    assert (len(saved), len(saved[1].steps), saved[1].ended) == (2, 1, "the log ends here")
    assert not check_log(log.active_path).whole
