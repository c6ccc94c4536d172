"""Logs of earlier formats are refused; what came with later ones is there for us and others."""

import dataclasses
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from meal_bayes.domain import load_domain
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
from meal_bayes.trial_log.encode import TrialEncoder
from meal_bayes.trial_log.picture import confusion_picture, png, truth_rows
from meal_bayes.trial_log.schema import LINES, PICTURES, STEP, ImageMessage

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


def test_counts_come_back(make, tmp_path):
    (trial,) = make.trials(1, 5)
    shape = (2, trial.momdp.n_behaviors, 2, trial.momdp.levels)
    counts = np.arange(np.prod(shape), dtype=float).reshape(shape)
    trial = dataclasses.replace(trial, counts=counts)
    path = tmp_path / "a.mcap"
    write_trials(path, [trial], header={})
    (back,) = read_trials(path)
    assert make.equal(back, trial)
    assert (back.counts == counts).all()


def test_unknown_truth_warnings_and_the_end_come_back(make, tmp_path):
    trials = []
    for number, truth in enumerate(([-1, -1], [1, -1], [0, 1])):
        trial = make.trials(1, number)[0]
        warned = dataclasses.replace(trial.steps[1], warning="no percept of look: NaN")
        steps = (trial.steps[0], warned, *trial.steps[2:])
        ended = "robot error: hot" * (number == 2)
        trials.append(dataclasses.replace(trial, truth=np.array(truth), steps=steps, ended=ended))
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


def unpacked(data):
    """Read a PNG with a palette, by its chunks: (h,w,3)."""
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    at, parts = 8, {}
    while at < len(data):
        (size,) = struct.unpack_from(">I", data, at)
        kind, content = data[at + 4 : at + 8], data[at + 8 : at + 8 + size]
        (crc,) = struct.unpack_from(">I", data, at + 8 + size)
        assert crc == zlib.crc32(kind + content)
        parts[kind] = content
        at += 12 + size
    width, height = struct.unpack_from(">II", parts[b"IHDR"])
    colors = np.frombuffer(parts[b"PLTE"], np.uint8).reshape(-1, 3)
    lines = np.frombuffer(zlib.decompress(parts[b"IDAT"]), np.uint8).reshape(height, width + 1)
    assert (lines[:, 0] == 0).all()
    return colors[lines[:, 1:]]


def test_the_picture_is_bright_where_a_percept_is_likely(make):
    (trial,) = make.trials(1, 9)
    momdp = trial.momdp
    pixels = unpacked(png(confusion_picture(momdp, 0)))
    n, k = len(momdp.query), momdp.levels
    cell = pixels[: 9 * 2 * n : 9, : 14 * k : 14].astype(int)  # corners: no digit reaches them
    mean, _ = truth_rows(momdp, 0)
    greens = cell[..., 1].ravel()[np.argsort(mean, axis=None)]  # viridis: green grows with it
    assert (np.diff(greens) >= -1).all()


def test_rows_by_truth_are_those_of_drawn_objects(make):
    rng = np.random.default_rng(4)
    momdp = make.momdp(load_domain("toy"), 1, rng)
    while momdp.class_is_truth:
        momdp = make.momdp(load_domain("toy"), 1, rng)
    mean, sd = truth_rows(momdp, 1)
    for truth in (0, 1):
        classes = rng.choice(momdp.n_classes, 20_000, p=momdp.latent_classes[0, truth])
        drawn = []
        for c in classes:
            row, weight = momdp.confusion[0, 1, c], momdp.precision[0, 1, c]
            drawn.append(row if np.isinf(weight) else rng.dirichlet(weight * row))
        assert np.allclose(np.mean(drawn, axis=0), mean[0, truth], atol=0.015)
        assert np.allclose(np.std(drawn, axis=0), sd[0, truth], atol=0.015)


def test_a_picture_comes_with_every_change_of_behavior(make, tmp_path):
    trials = make.trials(4, 2, steps=5)
    path = tmp_path / "a.mcap"
    with TrialWriter(path, {}) as log:
        for trial in trials:
            log.write(trial)
    expected = 0
    for trial in trials:
        done = [step.decision.action for step in trial.steps]
        e = trial.momdp.n_behaviors
        expected += sum(a < e and (i == 0 or done[i - 1] != a) for i, a in enumerate(done))
    with path.open("rb") as file:
        messages = list(make_reader(file).iter_messages(topics=[PICTURES, STEP]))
    found = [one for one in messages if one[1].topic == PICTURES]
    steps = [one for one in messages if one[1].topic == STEP]
    assert len(found) == expected > 0
    times = {message.log_time for _, _, message in steps}
    for schema, _, message in found:
        assert schema.name == "foxglove.CompressedImage"
        image = ImageMessage.FromString(message.data)
        assert image.format == "png"
        assert image.timestamp.seconds * 10**9 == message.log_time
        assert message.log_time in times
        assert unpacked(image.data).shape[0] == 9 * 2 * 2


def test_messages_without_pictures_are_the_same(make):
    (trial,) = make.trials(1)
    assert {message.topic for message in TrialEncoder(0, 0).whole(trial)} == {
        "/trial", "/step", "/log", "/outcome"
    }  # fmt: skip
