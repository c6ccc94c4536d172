"""Logs that no accident makes: right checksums around claims that ask for memory or time."""

import dataclasses
import json
import os
import struct
import tracemalloc
import zlib

import numpy as np
import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, Header, Schema
from mcap.writer import MCAP0_MAGIC

from meal_bayes.domain import load_domain
from meal_bayes.errors import LogCorruptError, LogError, SettingsError
from meal_bayes.trial_log import (
    Logs,
    TrialWriter,
    check_log,
    log_info,
    read_header,
    read_trials,
    schema,
    write_trials,
)
from meal_bayes.trial_log.decode import TrialBuilder
from meal_bayes.trial_log.schema import MOMDPS, OUTCOME, RUN, STEP, TRIAL

KINDS = {
    MOMDPS: schema.MomdpMessage, TRIAL: schema.TrialMessage, STEP: schema.StepMessage,
    OUTCOME: schema.OutcomeMessage,
}  # fmt: skip


@pytest.fixture(scope="module")
def messages(make, tmp_path_factory):
    """Topics and data of a log of one trial."""
    path = tmp_path_factory.mktemp("sound") / "a.mcap"
    rng = np.random.default_rng(3)
    momdp = make.momdp(load_domain("toy"), 2, rng)
    write_trials(path, [make.trial(momdp, rng, steps=3, edges=2)], header={"seed": 3})
    with path.open("rb") as file:
        every = make_reader(file).iter_messages(log_time_order=False)
        return [(c.topic, m.data) for _, c, m in every if c.topic in (RUN, *KINDS)]


def packed(*chunks):
    """Write an MCAP file of chunks of messages, without closing records."""
    topics = list(schema.channels(schema.FULL))
    out = RecordBuilder()
    Header(schema.PROFILES[schema.FULL], "").write(out)
    for number, chunk in enumerate(chunks):
        inner = RecordBuilder()
        for index, (topic, name, data) in enumerate(topics if number == 0 else (), 1):
            Schema(data=data, encoding="protobuf", id=index, name=name).write(inner)
            Channel(index, topic, "protobuf", {}, index).write(inner)
        place = {topic: index for index, (topic, _, _) in enumerate(topics, 1)}
        body = inner.end()
        for topic, data in chunk:
            body += struct.pack("<BQHIQQ", 5, len(data) + 22, place[topic], 0, 0, 0) + data
        Chunk("zstd", zstandard.compress(body), 0, 0, zlib.crc32(body), len(body)).write(out)
    return MCAP0_MAGIC + out.end()


def changed(messages, change, steps=None):
    """Change the messages of a trial."""
    made = {topic: [] for topic in KINDS}
    for topic, data in messages:
        if topic in KINDS:
            made[topic].append(KINDS[topic].FromString(data))
    if steps is not None:
        made[STEP] = [
            KINDS[STEP].FromString(made[STEP][0].SerializeToString()) for _ in range(steps)
        ]
        for number, message in enumerate(made[STEP]):
            message.step = number
    for topic, every in made.items():
        for message in every:
            change(topic, message)
    momdp, start = (made[topic][0].SerializeToString() for topic in (MOMDPS, TRIAL))
    between = [message.SerializeToString() for message in made[STEP]]
    outcome = made[OUTCOME][0]
    outcome.steps = len(between)
    rest = [(MOMDPS, momdp), (TRIAL, start), *((STEP, data) for data in between)]
    return [messages[0], *rest, (OUTCOME, outcome.SerializeToString())]


def test_the_maker_makes_logs_that_are_read(messages, tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(packed(changed(messages, lambda *_: None)))
    assert len(list(Logs(path).trials())) == 1


@pytest.mark.parametrize("text", ["[" * 50_000 + "]" * 50_000, "NaN", '"\\ud800"', "1e999"])
def test_a_header_that_is_no_json_is_told_and_costs_no_trial(messages, text, tmp_path):
    run = schema.RunMessage(format_version=schema.FORMAT_VERSION, header=f'{{"config": {text}}}')
    path = tmp_path / "a.mcap"
    path.write_bytes(packed([(RUN, run.SerializeToString())], messages[1:]))
    with pytest.raises(LogCorruptError, match=r"ValueError|UnicodeEncodeError"):
        read_header(path)
    report = check_log(path)
    assert (report.trials, report.whole) == (1, False)


def test_a_header_that_could_not_be_read_is_not_written(tmp_path):
    deep = json.loads("[" * 40 + "]" * 40)
    for value in (deep, "\ud800", float("nan")):
        with pytest.raises(SettingsError, match="header holds JSON"):
            TrialWriter(tmp_path / "a.mcap", {"config": value})


@pytest.mark.parametrize("begin", [8, 60, 1000])
def test_a_hole_ends_the_reading(messages, begin, tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(packed(messages)[:begin] if begin < 1000 else packed(messages))
    os.truncate(path, 1 << 40)
    report = check_log(path)
    assert report.trials == (begin == 1000)
    assert not report.whole
    with pytest.raises(LogCorruptError):
        list(read_trials(path))
    with pytest.raises(LogCorruptError):
        log_info(path)


def long(topic, name, count, value=0):
    return lambda one, m: getattr(m, name).extend([value] * count) if one == topic else None


def tree(count):
    columns = ("level", "parent", "action", "observation_size", "visits", "value")
    names = [f"tree_{name}" for name in (*columns, "observation")]

    def change(topic, message):
        if topic == STEP:
            for name in names:
                getattr(message, name)[:] = [0] * count if name != "tree_observation" else []

    return change


def wide(n):
    """Many attributes: every belief counts percepts of all of them."""

    def change(topic, m):
        if topic == MOMDPS:
            for name in ("confusion", "precision", "prior", "latent_classes", "bonus"):
                values = list(getattr(m, name))
                getattr(m, name)[:] = values[: len(values) // 2] * n
        if topic in (MOMDPS, TRIAL):
            m.attributes[:] = [f"a{i}" for i in range(n)]
        if topic in (TRIAL, STEP):
            m.log_prob[:] = list(m.log_prob)[: len(m.log_prob) // 2] * n
        if topic == TRIAL:
            m.truth[:] = [1] * n
        if topic == STEP:
            del m.observation[:]

    return change


@pytest.mark.parametrize(
    ("change", "steps", "found"),
    [
        (long(STEP, "visits", 900_000), None, "visits, expected"),
        (long(STEP, "values", 100_000), None, "values, expected"),
        (long(TRIAL, "truth", 3_000_000), None, "has 3000002 truths, expected 2"),
        pytest.param(tree(60_000), 6, "more than 250000 tree edges", marks=pytest.mark.long),
        (wide(1000), 500, "counts more than 4000000 percepts"),
    ],
)
def test_a_small_file_asks_for_no_great_memory(messages, change, steps, found, tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(packed(changed(messages, change, steps)))
    tracemalloc.start()
    assert found in " ".join(check_log(path).problems)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 200 << 20


def test_a_file_of_endless_messages_is_refused(messages, tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(packed(messages, *[[(schema.LINES, b"")] * 4000] * 3))
    assert path.stat().st_size < 10_000
    report = check_log(path)
    assert report.trials == 1
    assert "unpacks to far more" in " ".join(report.problems)


def test_a_file_of_endless_bytes_is_refused(tmp_path):
    out = RecordBuilder()
    Header(schema.PROFILES[schema.FULL], "").write(out)
    zeros = bytes(15 << 20)
    for _ in range(8):
        Chunk("zstd", zstandard.compress(zeros), 0, 0, zlib.crc32(zeros), len(zeros)).write(out)
    path = tmp_path / "a.mcap"
    path.write_bytes(MCAP0_MAGIC + out.end())
    assert "unpacks to far more" in " ".join(check_log(path).problems)


def test_the_memory_of_momdps_is_bounded_and_writer_and_reader_agree(make, monkeypatch, tmp_path):
    for module in ("decode", "writer"):
        monkeypatch.setattr(f"meal_bayes.trial_log.{module}.MOMDP_BYTES", 5000)
    rng = np.random.default_rng(2)
    momdps = [make.momdp(load_domain("toy"), 2, rng) for _ in range(6)]
    trials = [make.trial(momdp, rng, steps=1, edges=1) for momdp in (*momdps, *momdps)]
    path = tmp_path / "a.mcap"
    write_trials(path, trials, header={})
    back = list(read_trials(path))
    assert all(map(make.equal, back, trials))
    assert len(back) == 12
    assert log_info(path).momdps > 6  # those that were forgotten are there twice


def test_a_reader_forgets_the_oldest_momdp(messages, monkeypatch):
    monkeypatch.setattr("meal_bayes.trial_log.decode.MOMDP_BYTES", 10)
    builder = TrialBuilder()
    for number in range(3):
        message = KINDS[MOMDPS].FromString(messages[1][1])
        message.id = number
        builder.add(MOMDPS, message.SerializeToString())
    assert list(builder._momdps) == [2]


@pytest.mark.parametrize(
    ("topic", "name", "value"),
    [
        (MOMDPS, "cost", float("nan")), (MOMDPS, "correct", float("inf")),
        (MOMDPS, "bonus", float("inf")), (STEP, "cost", float("nan")),
        (STEP, "reward", -float("inf")), (STEP, "log_prob", float("nan")),
        (TRIAL, "log_prob", float("inf")),
    ],
)  # fmt: skip
def test_numbers_that_nothing_can_cost_are_refused(messages, topic, name, value, tmp_path):
    def change(one, message):
        if one == topic and hasattr(old := getattr(message, name), "append"):
            old[:] = [value] * len(old)
        elif one == topic:
            setattr(message, name, value)

    path = tmp_path / "a.mcap"
    path.write_bytes(packed(changed(messages, change)))
    assert check_log(path).trials == 0


def test_they_are_not_written_either(make, tmp_path):
    (trial,) = make.trials(1)
    first = trial.first_belief
    broken = dataclasses.replace(first, log_prob=np.full_like(first.log_prob, np.nan))
    with (
        TrialWriter(tmp_path / "a.mcap", {}) as log,
        pytest.raises(LogError, match="no logarithms of probabilities"),
    ):
        log.write(
            type(trial)(
                **{f: getattr(trial, f) for f in trial.__slots__} | {"first_belief": broken}
            )
        )
