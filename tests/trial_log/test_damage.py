import itertools
import random
import signal
import subprocess
import sys
import tracemalloc
import zlib
from pathlib import Path

import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.records import Chunk, Header
from mcap.writer import MCAP0_MAGIC, Writer

import meal_bayes
from meal_bayes.errors import LogCorruptError, LogError, LogVersionError
from meal_bayes.trial_log import (
    TrialWriter,
    check_log,
    log_file,
    log_info,
    read_header,
    read_trials,
    recover_log,
    salvage,
    schema,
    write_trials,
)
from meal_bayes.trial_log.names import drafts_of, timing_of

TRIALS = 8


@pytest.fixture(scope="module")
def whole(make, tmp_path_factory):
    """A log's bytes and its trials."""
    path = tmp_path_factory.mktemp("whole") / "whole.mcap"
    trials = make.trials(TRIALS, 11, steps=3, edges=1)
    write_trials(path, trials, header={"seed": 11})
    return path.read_bytes(), trials


def damages(data, count, seed):
    """Half truncations, half changes of one to three bits."""
    rng = random.Random(seed)
    for index in range(count):
        if index % 2:
            yield f"cut {index}", data[: rng.randrange(len(data))]
            continue
        changed = bytearray(data)
        for _ in range(rng.randint(1, 3)):
            changed[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        yield f"flip {index}", bytes(changed)


def test_400_damages_are_never_silently_wrong(whole, make, outcome_of, tmp_path):
    data, trials = whole
    path, silent, saved = tmp_path / "d.mcap", [], 0
    for name, changed in damages(data, 400, seed=2024):
        path.write_bytes(changed)
        given = []
        fault = outcome_of(lambda given=given: given.extend(read_trials(path)))
        if changed == data:
            continue
        # What was given before the fault must be right, and a fault there must be.
        right = all(map(make.equal, given, trials[: len(given)]))
        if fault is None or not right:
            silent.append(name)
        else:
            assert isinstance(fault, LogCorruptError), (name, fault)
        rescued = outcome_of(lambda: list(salvage(path)))
        if isinstance(rescued, list):
            saved += len(rescued)
            known = iter(trials)
            assert all(any(make.equal(one, other) for other in known) for one in rescued), name
        else:
            assert isinstance(rescued, LogCorruptError), (name, rescued)
        info = outcome_of(lambda: log_info(path))
        assert isinstance(info, LogCorruptError) or info.trials == TRIALS, (name, info)
    assert len(silent) <= 1, silent
    assert not check_log(path).whole
    # A flip costs one chunk, a cut at a random place half of the file.
    assert saved > 400 * TRIALS * 0.6


def test_every_single_bit_of_a_small_log_is_covered(make, outcome_of, tmp_path):
    path = tmp_path / "a.mcap"
    write_trials(path, make.trials(1, 3, steps=0, edges=None), header={})
    data = path.read_bytes()
    for position in range(0, len(data), 19):
        changed = bytearray(data)
        changed[position] ^= 1 << (position % 8)
        path.write_bytes(changed)
        fault = outcome_of(lambda: list(read_trials(path)))
        assert isinstance(fault, LogCorruptError), position


def test_every_cut_keeps_the_whole_trials_before_it(whole, make, outcome_of, tmp_path):
    data, _ = whole
    path, found = tmp_path / "cut.mcap.active", []
    for size in range(0, len(data), 997):
        path.write_bytes(data[:size])
        rescued = outcome_of(lambda: list(salvage(path)))
        found.append(0 if isinstance(rescued, LogCorruptError) else len(rescued))
    assert found == sorted(found)
    assert found[0] == 0
    assert found[-1] == TRIALS


KILLED = """
import itertools, sys
sys.path.insert(0, {folder!r})
from conftest import make_trials
from meal_bayes.trial_log import TrialWriter
with TrialWriter({path!r}, {{"seed": 3}}) as log:
    for trial in itertools.cycle(make_trials(20, 3)):
        log.write(trial, seconds=0.5)
        sys.stdout.write("x")
        sys.stdout.flush()
"""


def test_kill_9_loses_no_finished_trial(make, tmp_path):
    path = tmp_path / "run.mcap"
    code = KILLED.format(folder=str(Path(__file__).parent), path=str(path))
    root = Path(meal_bayes.__file__).parents[1]
    command = [sys.executable, "-c", code]
    with subprocess.Popen(command, stdout=subprocess.PIPE, cwd=root) as child:
        assert child.stdout.read(57) == b"x" * 57
        child.send_signal(signal.SIGKILL)
        finished = 57 + len(child.stdout.read())
    assert child.returncode == -signal.SIGKILL
    assert not path.exists()
    (active,) = drafts_of(path)
    trials = list(salvage(active))
    assert len(trials) in (finished, finished + 1)  # the last may lack its sign only
    assert all(map(make.equal, trials, itertools.cycle(make.trials(20, 3))))
    report = check_log(active)
    assert (report.trials, report.whole) == (len(trials), False)
    timing = timing_of(active).read_text().splitlines()
    assert len(timing) in (finished + 1, finished + 2)

    with pytest.raises(LogError, match=f"meal-bayes log recover .*{active.name}"):
        read_trials(path)
    saved = recover_log(active)
    assert saved == tmp_path / "run.recovered.mcap"
    assert all(map(make.equal, trials, read_trials(saved)))
    assert check_log(saved).trials == len(trials)
    assert read_header(saved)["recovered_from"] == active.name
    assert read_header(saved)["seed"] == 3
    assert sorted(file.name for file in tmp_path.iterdir()) == [
        "run.recovered.mcap",
        active.name,
        timing_of(active).name,
    ]


def test_recovering_to_the_name_that_was_meant_keeps_the_torn_file(whole, make, tmp_path):
    data, trials = whole
    active = tmp_path / "run.mcap.active"
    active.write_bytes(data[: len(data) // 2])
    saved = recover_log(active, tmp_path / "run.mcap")
    kept = list(read_trials(saved))
    assert 0 < len(kept) < TRIALS
    assert all(map(make.equal, kept, trials[: len(kept)]))
    assert active.read_bytes() == data[: len(data) // 2]
    with pytest.raises(LogError, match="exists already"):
        recover_log(active, saved)


def write_then_fail(log, trial):
    log.write(trial)
    raise LogError


def test_an_exception_leaves_the_unfinished_name(make, tmp_path):
    path = tmp_path / "a.mcap"
    with pytest.raises(LogError), TrialWriter(path, {}) as log:
        write_then_fail(log, *make.trials(1))
    assert not path.exists()
    active = log.active_path
    assert active.name.startswith("a.w")
    with pytest.raises(LogCorruptError, match=rf"meal-bayes log recover {active}"):
        read_trials(active)
    assert len(list(salvage(active))) == 1


def test_an_active_name_is_refused_even_when_its_bytes_are_whole(whole, tmp_path):
    path = tmp_path / "a.mcap.active"
    path.write_bytes(whole[0])
    with pytest.raises(LogCorruptError, match="log recover"):
        read_trials(path)


def test_a_damaged_chunk_costs_only_its_own_trials(whole, make, tmp_path):
    data, trials = whole
    for position in (300, len(data) // 2):  # the header's chunk, one in the middle
        changed = bytearray(data)
        changed[position] ^= 16
        path = tmp_path / "a.mcap"
        path.write_bytes(changed)
        rescued = list(salvage(path))
        assert TRIALS - 2 <= len(rescued) <= TRIALS
        known = iter(trials)
        assert all(any(make.equal(one, other) for other in known) for one in rescued)
        assert not check_log(path).whole


def test_another_version_is_refused_with_the_way_out(make, monkeypatch, tmp_path):
    path = tmp_path / "a.mcap"
    monkeypatch.setattr(log_file, "FORMAT_VERSION", schema.FORMAT_VERSION + 1)
    write_trials(path, make.trials(1), header={"versions": {"meal_bayes": "9.1"}})
    monkeypatch.undo()
    for read in (
        lambda: list(read_trials(path)),
        lambda: list(salvage(path)),
        lambda: read_header(path),
        lambda: log_info(path),
        lambda: check_log(path),
        lambda: recover_log(path),
    ):
        with pytest.raises(LogVersionError, match=r"format 6.*reads format 5.*meal_bayes 9\.1"):
            read()


@pytest.mark.parametrize("content", [b"", b"hello, world", b"\x89MCAP", bytes(100_000)])
def test_a_file_that_is_no_log(content, tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(content)
    for read in (read_trials, salvage):
        with pytest.raises(LogCorruptError, match=r"a\.mcap"):
            list(read(path))
    for read in (read_header, log_info, recover_log):
        with pytest.raises(LogCorruptError, match=r"a\.mcap"):
            read(path)
    report = check_log(path)
    assert (report.trials, report.whole) == (0, False)
    assert report.problems


def test_a_file_that_is_not_there(tmp_path):
    for read in (read_trials, salvage, read_header, log_info, check_log, recover_log):
        for path in (tmp_path / "none.mcap", tmp_path):
            with pytest.raises(LogError, match="no log"):
                read(path)


def records(*made):
    builder = RecordBuilder()
    for record in made:
        record.write(builder)
    return MCAP0_MAGIC + builder.end()


def chunk(packed, size, crc=0):
    return Chunk("zstd", packed, 0, 0, crc, size)


def test_an_mcap_file_of_another_program(tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(records(Header("ros2", "someone")))
    with pytest.raises(LogCorruptError, match="'ros2'"):
        list(read_trials(path))


@pytest.mark.parametrize("size", [1 << 34, 1 << 20, 0])
def test_a_decompression_bomb_asks_for_no_memory(size, tmp_path):
    zeros = zstandard.ZstdCompressor().compressobj(size=1 << 30)
    parts = [zeros.compress(bytes(1 << 20)) for _ in range(1 << 10)]
    packed = b"".join([*parts, zeros.flush()])
    path = tmp_path / "a.mcap"
    path.write_bytes(records(Header(schema.PROFILES[schema.FULL], ""), chunk(packed, size)))
    tracemalloc.start()
    with pytest.raises(LogCorruptError, match="claims to unpack"):
        list(read_trials(path))
    with pytest.raises(LogCorruptError):
        list(salvage(path))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 4 << 20


def test_a_chunk_of_nonsense_with_right_checksums(tmp_path):
    rng = random.Random(5)
    for length in (1, 8, 9, 31, 200):
        nonsense = rng.randbytes(length)
        packed = zstandard.compress(nonsense)
        path = tmp_path / "a.mcap"
        path.write_bytes(
            records(
                Header(schema.PROFILES[schema.FULL], ""),
                chunk(packed, length, zlib.crc32(nonsense)),
            )
        )
        with pytest.raises(LogCorruptError):
            list(read_trials(path))
        assert not check_log(path).whole


def test_trials_of_one_log_do_not_pass_in_another_order(whole, outcome_of, tmp_path):
    """Whole chunks taken out or put twice, with all checksums of MCAP made right again."""
    path = tmp_path / "a.mcap"
    path.write_bytes(whole[0])
    with path.open("rb") as file:
        reader = make_reader(file)
        found = [(c.topic, s, m) for s, c, m in reader.iter_messages(log_time_order=False)]
        metadata = list(reader.iter_metadata())
        attached = list(reader.iter_attachments())
    outcomes = [index for index, (topic, _, _) in enumerate(found) if topic == "/outcome"]
    first, second = outcomes[0] + 1, outcomes[1] + 1
    variants = {
        "same": found,
        "trial left out": found[:first] + found[second:],
        "trial twice": found[:second] + found[first:],
        "step left out": found[: first - 3] + found[first - 2 :],
        "last trial left out": found[: outcomes[-2] + 1],
    }
    for name, messages in variants.items():
        with path.open("wb") as file:
            out, known = Writer(file, enable_data_crcs=True), {}
            out.start(profile=schema.PROFILES[schema.FULL])
            for topic, kind, message in messages:
                if topic not in known:
                    number = out.register_schema(kind.name, kind.encoding, kind.data)
                    known[topic] = out.register_channel(topic, "protobuf", number)
                out.add_message(known[topic], message.log_time, message.data, message.publish_time)
            for record in metadata:
                out.add_metadata(record.name, record.metadata)
            for one in attached:
                out.add_attachment(0, 0, one.name, one.media_type, one.data)
            out.finish()
        fault = outcome_of(lambda: list(read_trials(path)))
        assert isinstance(fault, list if name == "same" else LogCorruptError), (name, fault)
