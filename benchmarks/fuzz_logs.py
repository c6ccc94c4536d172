"""Crafted logs: right checksums around claims that ask for memory, time or trust."""

import json
import random
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import zstandard
from fuzz_cases import Case, sparse, writes
from fuzz_oracles import Wrong
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, Header, Schema
from mcap.writer import MCAP0_MAGIC

from meal_bayes.trial_log import Logs, check_log, log_info, schema

Messages = list[tuple[str, bytes]]  # topic, data
_KINDS = {
    schema.RUN: schema.RunMessage, schema.MOMDPS: schema.MomdpMessage,
    schema.TRIAL: schema.TrialMessage, schema.STEP: schema.StepMessage,
    schema.OUTCOME: schema.OutcomeMessage,
}  # fmt: skip


def logs(log: "Log") -> Iterator[Case]:
    """Yield the logs that have names."""

    def case(told: str, make: Any) -> Case:
        return Case("log", told, "a.mcap", make, read_log)

    for depth in (31, 33, 900, 50_000, 1_000_000):
        yield case(f"header {depth} deep", log.header('{"a":' + "[" * depth + "]" * depth + "}"))
        yield case(f"objects {depth} deep", log.header('{"a":' * depth + "1" + "}" * depth))
    for text in ("NaN", "1e999", "-Infinity", '"\\ud800"', '"\\udcff\\ud800"', "9" * 5000, "[]"):
        yield case(f"header value {text[:12]}", log.header(f'{{"config": {text}, "seed": {text}}}'))
    for text in ("\x1b]0;owned\x07", "a\rb", "\u202e", "\x9b31m", "a\nverdict right", "\u2028"):
        name = json.dumps({"config": {"dataset": text}, text: text})
        yield case(f"header text {text!r}", log.header(name))
        yield case(f"names {text!r}", log.changing(_names(text)))
    yield case("flat header of 4 MB", log.header(json.dumps({str(i): [] for i in range(300_000)})))
    arrays = {
        "visits": 1,
        "values": 0.0,
        "observation": 0,
        "percept_counts": 1,
        "tree_level": 1,
        "log_prob": 0.0,
    }
    for name, value in arrays.items():
        yield case(f"long {name}", log.changing(_long(schema.STEP, name, value, 900_000)))
    yield case("long truth", log.changing(_long(schema.TRIAL, "truth", 1, 7_000_000)))
    yield case("long legal", log.changing(_long(schema.MOMDPS, "legal", True, 7_000_000)))
    for edges, steps in ((100_000, 1), (60_000, 8)):
        yield case(f"{edges} edges, {steps} steps", log.changing(_edges(edges), steps))
    yield case("100,000 steps", log.changing(lambda *_: None, 100_000))
    for n in (20, 60, 1000):
        yield case(f"{n} attributes", log.changing(_wide(n), 50))
    for name in (
        "cost",
        "correct",
        "incorrect",
        "bonus",
        "prior",
        "precision",
        "limit",
        "confusion",
    ):
        for value in (float("nan"), float("inf"), -1.0):
            yield case(f"MOMDP {name} {value}", log.changing(_all(schema.MOMDPS, name, value)))
    for name in ("cost", "reward", "log_prob", "values", "value_se"):
        for value in (float("nan"), float("inf"), -float("inf")):
            yield case(f"step {name} {value}", log.changing(_all(schema.STEP, name, value)))
    yield from _bombs(log, case)


def _bombs(log: "Log", case: Callable[[str, Any], Case]) -> Iterator[Case]:
    trial = log.sealed(lambda *_: None)
    empty = [(schema.LINES, b"")] * 1000
    for times in (10, 400):
        yield case(f"{times * 1000} empty messages", writes(lambda t=times: packed([empty], t)))
    many = [trial, *[trial[1:]] * 1000]
    yield case("1,000 trials in chunks alike", writes(lambda: packed(many)))
    yield case("the run again and again", writes(lambda: packed([[trial[0]] * 1000], 50)))
    big = log.sealed(_long(schema.MOMDPS, "row_counts", 0.0, 900_000))[1]
    yield case("40 MOMDPs of 7 MB", writes(lambda: packed([[trial[0]], *[[big]] * 40])))
    for size in (1 << 20, 1 << 34):
        zeros = zstandard.compress(bytes(15 << 20))
        chunk = RecordBuilder()
        Header(schema.PROFILES[schema.FULL], "").write(chunk)
        for _ in range(200):
            Chunk("zstd", zeros, 0, 0, 0, size).write(chunk)
        data = MCAP0_MAGIC + chunk.end()
        yield case(f"zeros that claim {size}", writes(lambda data=data: data))
    yield case("200 chunks of 15 MB of zeros", writes(lambda: packed([[]] * 200, 1)))
    for begin in (0, 8, 60, 5000):
        whole = packed([trial])
        yield case(f"a hole of 1 TB behind {begin}", sparse(whole[:begin]))
    yield case("1 TB between two halves", sparse(packed([trial]), packed([trial])))


class Log:
    """The messages of a sound log, to be changed."""

    def __init__(self, path: Path) -> None:
        with path.open("rb") as file:
            found = [(c.topic, m.data) for _, c, m in make_reader(file).iter_messages(
                log_time_order=False)]  # fmt: skip
        self.run = next(data for topic, data in found if topic == schema.RUN)
        self.momdp = next(data for topic, data in found if topic == schema.MOMDPS)
        end = [topic for topic, _ in found].index(schema.OUTCOME)
        own = [one for one in found[: end + 1] if one[0] in _KINDS]
        self.trial = [one for one in own if one[0] not in (schema.RUN, schema.MOMDPS)]

    def sealed(self, change: Callable[[str, Any], object], steps: int | None = None) -> Messages:
        """Change the first trial's messages."""
        momdp = self._changed(schema.MOMDPS, self.momdp, change)
        start, *between, (_, last) = self.trial
        if steps is not None:
            between = [between[0]] * steps
        made = [self._changed(*start, change)]
        for number, (topic, data) in enumerate(between):
            message = _KINDS[topic].FromString(data)
            message.step = number if steps is not None else message.step
            made.append(self._changed(topic, message.SerializeToString(), change))
        outcome = schema.OutcomeMessage.FromString(last)
        outcome.steps = len(between)
        change(schema.OUTCOME, outcome)
        topics = [schema.TRIAL, *(topic for topic, _ in between)]
        return [
            (schema.RUN, self.run), (schema.MOMDPS, momdp), *zip(topics, made, strict=True),
            (schema.OUTCOME, outcome.SerializeToString()),
        ]  # fmt: skip

    def changing(self, change: Callable[[str, Any], object], steps: int | None = None) -> Any:
        """Write a log of one such trial."""
        return lambda path: path.write_bytes(packed([self.sealed(change, steps)]))

    def header(self, text: str) -> Any:
        """Write a log with another header."""
        run = schema.RunMessage(format_version=schema.FORMAT_VERSION, header=text)
        trial = self.sealed(lambda *_: None)[1:]
        return lambda path: path.write_bytes(
            packed([[(schema.RUN, run.SerializeToString()), *trial]])
        )

    def garbled(self, rng: random.Random) -> Any:
        """Write a log where some fields of the trial are what they may not be."""
        fields = [(topic, f.name) for topic in _KINDS for f in _KINDS[topic].DESCRIPTOR.fields]
        chosen = rng.sample(fields, rng.choice((1, 1, 1, 2, 5)))

        def change(topic: str, message: Any) -> None:
            for one, name in chosen:
                if one == topic:
                    _garble(message, name, rng)

        return self.changing(change, rng.choice((None, None, 1, 3)))

    @staticmethod
    def _changed(topic: str, data: bytes, change: Callable[[str, Any], object]) -> bytes:
        message = _KINDS[topic].FromString(data)
        change(topic, message)
        return bytes(message.SerializeToString())


def _garble(message: Any, name: str, rng: random.Random) -> None:
    """Set a field to a value that its type allows."""
    field = message.DESCRIPTOR.fields_by_name[name]
    many = isinstance(old := getattr(message, name), (type(message.DESCRIPTOR.fields),)) or (
        hasattr(old, "append")
    )
    kinds = {
        field.TYPE_DOUBLE: (float("nan"), float("inf"), -float("inf"), -1.0, 0.0, 1e308, 5e-324),
        field.TYPE_INT64: (-1, 0, 1, 2, 127, 128, 2**31, 2**62, -(2**63), 2**63 - 1),
        field.TYPE_BOOL: (True, False),
        field.TYPE_STRING: (
            "",
            "\x1b[2J",
            "a" * 5000,
            "\u202ecba",
            "red",
            '["x"]',
            "[1e999]",
            "{}",
        ),
        field.TYPE_BYTES: (b"", b"\xff" * 16),
    }
    value = rng.choice(kinds[field.type])
    if not many:
        setattr(message, name, value)
    elif rng.random() < 0.5 and len(old):  # a coin
        old[rng.randrange(len(old))] = value
    else:
        old.extend([value] * rng.choice((1, 2, 1000)))


def packed(chunks: list[Messages], repeat: int = 1) -> bytes:
    """Write an MCAP file, without its closing records, of chunks whose checksums are right."""
    topics = [(topic, name, data) for topic, name, data in schema.channels(schema.FULL)]
    out = RecordBuilder()
    Header(schema.PROFILES[schema.FULL], "").write(out)
    for number, messages in enumerate(chunks):
        inner = RecordBuilder()
        for index, (topic, name, data) in enumerate(topics if number == 0 else (), 1):
            Schema(data=data, encoding="protobuf", id=index, name=name).write(inner)
            Channel(id=index, topic=topic, message_encoding="protobuf", metadata={},
                    schema_id=index).write(inner)  # fmt: skip
        places = {topic: index for index, (topic, _, _) in enumerate(topics, 1)}
        body = b"".join(_record(places[topic], data) for topic, data in messages)
        plain = inner.end() + body * repeat
        Chunk("zstd", zstandard.compress(plain), 0, 0, zlib.crc32(plain), len(plain)).write(out)
    return MCAP0_MAGIC + out.end()


def _record(channel: int, data: bytes) -> bytes:
    return struct.pack("<BQHIQQ", 5, len(data) + 22, channel, 0, 0, 0) + data


def read_log(path: Path) -> None:
    """Read all that can be read; a log without its closing records must never pass as whole."""
    logs = Logs(path)
    try:
        for trial in logs.trials():
            json.dumps([trial.cost, trial.reward, trial.task.object_name], allow_nan=False)
    finally:
        report = check_log(path)
        if report.whole:
            raise Wrong("it passes as whole")
    log_info(path)


def _names(text: str) -> Any:
    def change(topic: str, message: Any) -> None:
        if topic == schema.TRIAL:
            message.object_name = message.name = message.agent = text
        if topic == schema.MOMDPS:
            message.behavior_names[0] = message.x_names[0] = text

    return change


def _long(topic: str, name: str, value: float, count: int) -> Any:
    return lambda one, message: (
        getattr(message, name).extend([value] * count) if one == topic else None
    )


def _all(topic: str, name: str, value: float) -> Any:
    def change(one: str, message: Any) -> None:
        if one == topic and hasattr(old := getattr(message, name), "append"):
            old[:] = [value] * len(old)
        elif one == topic:
            setattr(message, name, value)

    return change


def _edges(count: int) -> Any:
    columns = ("tree_level", "tree_parent", "tree_action", "tree_observation_size", "tree_visits")

    def change(topic: str, message: Any) -> None:
        if topic == schema.STEP:
            for name in (*columns, "tree_value", "tree_observation"):
                del getattr(message, name)[:]
            for name in (*columns, "tree_value"):
                getattr(message, name).extend([0] * count)

    return change


def _wide(n: int) -> Any:
    """Many attributes, in the MOMDP and in the trial: every belief counts percepts of them all."""
    names = [f"a{i}" for i in range(n)]

    def change(topic: str, message: Any) -> None:
        if topic == schema.MOMDPS:
            e, old = len(message.behavior_names), len(message.attributes)
            for name in ("confusion", "precision", "prior", "latent_classes", "bonus"):
                values = list(getattr(message, name))
                size = len(values) // old
                getattr(message, name)[:] = values[:size] * n
            message.attributes[:] = names
            del message.row_counts[:]
            assert e
        elif topic == schema.TRIAL:
            message.attributes[:] = names
            message.truth[:] = [1] * n
            message.log_prob[:] = list(message.log_prob[:2]) * n
        elif topic == schema.STEP:
            message.log_prob[:] = list(message.log_prob[:2]) * n
            del message.observation[:]

    return change
