"""Logs that other programs wrote again, joined or mixed: all trials, or one line that says why."""

import json
import re
import subprocess
from io import BytesIO

import numpy as np
import pandas as pd
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from meal_bayes.errors import LogCorruptError, LogError
from meal_bayes.trial_log import (
    Feedback,
    check_log,
    log_info,
    read_header,
    read_trials,
    recover_log,
    write_feedback,
    write_trials,
)
from meal_bayes.trials import TrialOutcomes

READ = """
const fs = require("fs");
const { McapStreamReader } = require("@mcap/core");
const reader = new McapStreamReader({
  validateCrcs: true,
  decompressHandlers: { zstd: (bytes) => require("fzstd").decompress(bytes) },
});
reader.append(fs.readFileSync(process.argv[1]));
const text = new TextDecoder(), schemas = new Map(), channels = new Map(), read = {};
for (let record; (record = reader.nextRecord()); ) {
  if (record.type === "Schema") schemas.set(record.id, record);
  if (record.type === "Channel") channels.set(record.id, record);
  if (record.type === "Message") {
    const channel = channels.get(record.channelId);
    const schema = schemas.get(channel.schemaId);
    if (channel.messageEncoding !== "json" || schema.encoding !== "jsonschema")
      throw new Error(channel.messageEncoding);
    read[channel.topic] ??= { schema: JSON.parse(text.decode(schema.data)), messages: [] };
    read[channel.topic].messages.push(JSON.parse(text.decode(record.data)));
  }
}
if (!reader.done()) throw new Error("it does not end");
console.log(JSON.stringify(read));
"""
WRITE = """
const fs = require("fs");
const { McapStreamReader, McapWriter } = require("@mcap/core");
const [source, target, chunks, indexed] = process.argv.slice(1);
const zstd = (bytes) => require("fzstd").decompress(bytes);
const reader = new McapStreamReader({ decompressHandlers: { zstd } });
reader.append(fs.readFileSync(source));
const parts = [], schemas = new Map(), channels = new Map();
let size = 0n;
const writable = {
  position: () => size,
  write: async (bytes) => { parts.push(Buffer.from(bytes)); size += BigInt(bytes.length); },
};
const flag = indexed === "true";
const writer = new McapWriter({
  writable, useChunks: chunks !== "0", chunkSize: Number(chunks), useMessageIndex: flag,
  useChunkIndex: flag, useStatistics: flag, useSummaryOffsets: flag, repeatChannels: flag,
});
(async () => {
  for (let record; (record = reader.nextRecord()); ) {
    if (record.type === "Header") await writer.start(record);
    if (record.type === "Schema") schemas.set(record.id, record);
    if (record.type === "Channel" && !channels.has(record.id)) {
      const schemaId = await writer.registerSchema(schemas.get(record.schemaId));
      channels.set(record.id, await writer.registerChannel({ ...record, schemaId }));
    }
    if (record.type === "Message")
      await writer.addMessage({ ...record, channelId: channels.get(record.channelId) });
    if (record.type === "Attachment") await writer.addAttachment(record);
    if (record.type === "Metadata") await writer.addMetadata(record);
  }
  await writer.end();
  fs.writeFileSync(target, Buffer.concat(parts));
})();
"""


@pytest.fixture(scope="module")
def log(make, tmp_path_factory):
    """A log of two trials, and the trials."""
    path = tmp_path_factory.mktemp("whole") / "whole.mcap"
    trials = make.trials(2, 3, steps=2, edges=1)
    write_trials(path, trials, header={"seed": 3})
    return path, trials


def written_again(sources, path, *, attachments=True, profile=True, **options):
    """Write the messages of logs anew in order of their time, as `mcap compress` and `merge` do."""
    with path.open("wb") as file:
        writer = Writer(file, **options)
        readers = [make_reader(BytesIO(source.read_bytes())) for source in sources]
        writer.start(readers[0].get_header().profile if profile else "")
        ids = {}
        messages = []
        for reader in readers:
            messages += reader.iter_messages()
            for attachment in reader.iter_attachments() if attachments else ():
                writer.add_attachment(
                    attachment.create_time, attachment.log_time, attachment.name,
                    attachment.media_type, attachment.data,
                )  # fmt: skip
        for schema, channel, message in sorted(messages, key=lambda entry: entry[2].log_time):
            if channel.topic not in ids:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                ids[channel.topic] = writer.register_channel(
                    channel.topic, channel.message_encoding, number
                )
            times = message.publish_time, message.sequence
            writer.add_message(ids[channel.topic], message.log_time, message.data, *times)
        writer.finish()
    return path


@given(
    compression=st.sampled_from(list(CompressionType)),
    chunked=st.booleans(),
    size=st.sampled_from([1, 1000, 1 << 20]),
    checked=st.booleans(),
    attachments=st.booleans(),
    profile=st.booleans(),
)
def test_a_log_that_was_written_again_holds_its_trials(
    log, make, tmp_path_factory, compression, chunked, size, checked, attachments, profile
):
    path, trials = log
    again = written_again(
        [path], tmp_path_factory.mktemp("again") / "again.mcap", attachments=attachments,
        profile=profile, compression=compression, use_chunking=chunked, chunk_size=size,
        enable_crcs=checked,
    )  # fmt: skip
    if attachments:
        assert all(map(make.equal, read_trials(again), trials))
        assert log_info(again).trials == len(trials)
        assert check_log(again).whole
    else:
        with pytest.raises(LogCorruptError, match="meal-bayes log recover"):
            list(read_trials(again))
    saved = list(read_trials(recover_log(again)))
    assert len(saved) == len(trials)
    assert all(map(make.equal, saved, trials))


@pytest.fixture(scope="module")
def logs(make, tmp_path_factory):
    """Logs of 0 to 3 trials, and the trials."""
    folder = tmp_path_factory.mktemp("parts")
    logs = []
    for size in range(4):
        path = folder / f"part{size}.mcap"
        trials = make.trials(size, size, steps=2)
        write_trials(path, trials, header={"seed": 3})
        logs.append((path, trials))
    return logs


@pytest.mark.filterwarnings("ignore:Generating overly large repr")  # of the logs, if it fails
@given(
    sizes=st.lists(st.integers(0, 3), min_size=2, max_size=4),
    between=st.binary(max_size=30),
    cut=st.integers(0, 300),
)
@example(sizes=[0, 0], between=b"", cut=1)  # in the magic bytes at the end
def test_every_log_of_a_file_is_recovered(logs, make, tmp_path_factory, sizes, between, cut):
    joined = tmp_path_factory.mktemp("joined") / "joined.mcap"
    parts = [logs[size][0].read_bytes() for size in sizes]
    whole = [trial for size in sizes[:-1] for trial in logs[size][1]]
    joined.write_bytes(between.join([*parts[:-1], parts[-1][: len(parts[-1]) - cut]]))
    with pytest.raises(LogCorruptError):
        list(read_trials(joined))
    info = check_log(joined)
    assert not info.whole
    assert info.trials >= len(whole)
    assert info.unread >= len(between) * (len(parts) - 1)
    if whole:
        saved = list(read_trials(recover_log(joined)))
        assert all(map(make.equal, saved, whole))
        assert len(saved) <= len(whole) + sizes[-1]


def test_logs_with_different_headers_are_not_recovered_as_one(make, tmp_path):
    """Trials of the second would be trials of the first's run, part and batch."""
    joined, trials = tmp_path / "all.mcap", make.trials(3, 1, steps=2)
    parts = {"test": trials[:1], "train": trials[1:]}
    for part, some in parts.items():
        write_trials(tmp_path / f"{part}.mcap", some, header={"part": part})
    joined.write_bytes(b"".join((tmp_path / f"{part}.mcap").read_bytes() for part in parts))
    with pytest.raises(LogError, match="different headers") as caught:
        recover_log(joined)
    place = int(re.search(r"at byte (\d+)", str(caught.value))[1])
    data = joined.read_bytes()
    for part, piece in zip(parts, (data[:place], data[place:]), strict=True):
        (path := tmp_path / f"{part}-cut.mcap").write_bytes(piece)
        saved = recover_log(path)
        assert read_header(saved)["part"] == part
        assert all(map(make.equal, read_trials(saved), parts[part]))


@pytest.mark.parametrize("chunked", [True, False])
@pytest.mark.parametrize(("first", "second"), [(1, 1), (1, 3), (3, 2), (0, 2)])
def test_logs_that_were_mixed_by_time_are_refused(logs, tmp_path, first, second, chunked):
    parts = [logs[first][0], logs[second][0]]
    merged = written_again(parts, tmp_path / "merged.mcap", use_chunking=chunked)
    for read in (lambda path: list(read_trials(path)), recover_log):
        with pytest.raises(LogError, match="mixed by time"):
            read(merged)


def test_compact_logs_are_read_again_too(make, tmp_path):
    outcomes = TrialOutcomes.of(make.trials(4, 5, steps=2))
    path = tmp_path / "compact.mcap"
    write_trials(path, [outcomes], header={"seed": 5})
    again = written_again([path], tmp_path / "again.mcap", compression=CompressionType.LZ4)
    assert check_log(again).trials == log_info(again).trials == 4
    assert check_log(again).form == "compact"


def test_mcap_core_reads_every_message(log, mcap_core):
    """Foxglove's reader: what JavaScript parses is what was written, bit by bit."""
    path, trials = log
    command = [*mcap_core, "-e", READ, path]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    read = json.loads(done.stdout)
    steps = [step for trial in trials for step in trial.steps]
    assert {topic: len(entry["messages"]) for topic, entry in read.items()} == {
        "/run": 1, "/momdp": 1, "/trial": len(trials), "/step": len(steps), "/log": len(steps),
        "/outcome": len(trials),
    }  # fmt: skip
    assert [step["cost"] for step in read["/step"]["messages"]] == [step.cost for step in steps]
    for message, step in zip(read["/step"]["messages"], steps, strict=True):
        values = np.array(message["values"], float)
        assert np.array_equal(values, step.decision.values, equal_nan=True)
    with path.open("rb") as file:
        ours = [json.loads(m.data) for _, _, m in make_reader(file).iter_messages(topics="/step")]
    assert read["/step"]["messages"] == ours
    for entry in read.values():
        for message in entry["messages"]:
            fits(message, entry["schema"])


def test_pandas_makes_a_table_of_the_steps(log):
    path, trials = log
    with path.open("rb") as file:
        messages = make_reader(file).iter_messages(topics="/step")
        table = pd.DataFrame([json.loads(message.data) for _, _, message in messages])
    steps = [step for trial in trials for step in trial.steps]
    assert table["reward"].dtype == float
    assert table["cost"].tolist() == [step.cost for step in steps]
    assert table.groupby("trial")["cost"].sum().tolist() == pytest.approx([t.cost for t in trials])
    values = np.array(table["values"].tolist(), float)  # NaN is null
    assert np.array_equal(values, [step.decision.values for step in steps], equal_nan=True)


def fits(value, schema):
    """Assert that a JSON value fits its schema, and that viewers know the kind of schema.

    Foxglove reads no alternatives, no lists in lists and no references, and takes the "type" that
    stands beside them.
    """
    kind = schema["type"]
    if "$ref" in schema:
        assert schema == {"$ref": "#/definitions/number", "type": "number"} | schema
        assert value is None or value in ("Infinity", "-Infinity") or isinstance(value, int | float)
    elif kind == "object":
        assert set(schema.get("required", ())) <= value.keys()
        for name, entry in value.items() if schema["properties"] else ():
            fits(entry, schema["properties"][name])
    elif kind == "array":
        assert schema["items"]["type"] != "array"
        for entry in value:
            fits(entry, schema["items"])
    else:
        types = {"string": str, "boolean": bool, "integer": int, "number": int | float}
        assert isinstance(value, types[kind])


@pytest.mark.parametrize("form", ["full", "compact", "feedback"])
def test_every_message_fits_its_schema(form, make, tmp_path):
    trials = make.trials(3, 6, steps=3)
    path = tmp_path / "a.mcap"
    if form == "feedback":
        path = write_feedback(tmp_path, Feedback("mug", {"red": 1}, ("a", 3)), header={})
    else:
        write_trials(path, trials if form == "full" else [TrialOutcomes.of(trials)], header={})
    with path.open("rb") as file:
        for schema, _, message in make_reader(file).iter_messages():
            assert schema.encoding == "jsonschema"
            fits(json.loads(message.data), json.loads(schema.data))


@pytest.mark.parametrize("chunks", [0, 1, 4096])
@pytest.mark.parametrize("indexed", ["true", "false"])
def test_what_mcap_core_wrote_again_holds_its_trials(
    log, make, mcap_core, tmp_path, chunks, indexed
):
    """Another implementation, in another language: chunks of its own, with and without indexes."""
    path, trials = log
    again = tmp_path / "again.mcap"
    command = [*mcap_core, "-e", WRITE, path, again, str(chunks), indexed]
    subprocess.run(command, check=True)
    assert again.read_bytes() != path.read_bytes()
    assert all(map(make.equal, read_trials(again), trials))
    assert log_info(again).trials == len(trials)
    assert check_log(again).whole
    saved = list(read_trials(recover_log(again)))
    assert len(saved) == len(trials)
    assert all(map(make.equal, saved, trials))
