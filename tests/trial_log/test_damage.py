import dataclasses
import itertools
import os
import signal
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
import zstandard
from hypothesis import example, given
from hypothesis import strategies as st
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.records import Chunk, Header
from mcap.writer import MCAP0_MAGIC, Writer

import meal_bayes
from meal_bayes.domain import load_domain
from meal_bayes.errors import LogCorruptError, LogError, LogVersionError, SettingsError
from meal_bayes.trial_log import (
    TrialWriter,
    check_log,
    log_info,
    read_header,
    read_outcomes,
    read_trials,
    recover_log,
    salvage,
    write_trials,
)
from meal_bayes.trial_log.file import FULL, PROFILES, Scan, drafts_of, new_draft
from meal_bayes.trial_log.messages import MESSAGE_LIMIT
from meal_bayes.trials import Trial, TrialOutcomes

TRIALS = 8


@pytest.fixture(scope="module", params=["full", "compact"])
def whole(make, tmp_path_factory, request):
    """A log's bytes, and its trials or the outcomes of each message."""
    path = tmp_path_factory.mktemp("whole") / "whole.mcap"
    entries = make.trials(TRIALS, 11, steps=3, edges=1)
    if request.param == "compact":
        entries = [TrialOutcomes.of(entries[: k + 1]) for k in range(TRIALS)]
    write_trials(path, entries, header={"seed": 11})
    return path.read_bytes(), entries


def test_damage_is_never_silently_wrong(whole, make, outcome_of, tmp_path):
    """A cut (without flips) or one to three bits: what is read is right, the rest is a fault."""
    (data, entries) = whole
    path = tmp_path / "damaged.mcap"
    trials = sum(1 if isinstance(entry, Trial) else len(entry) for entry in entries)
    places = st.floats(0, 1, exclude_max=True)

    profile = (data.find(b"/") + 1.5) / len(data)  # the form's first letter
    # A header has no checksum: damaged, the form may be one that a later version writes.
    told = (LogCorruptError, LogVersionError)

    @given(place=places, flips=st.lists(places, max_size=3))
    @example(place=0.0, flips=[profile])
    def check(place, flips):
        changed = bytearray(data if flips else data[: int(place * len(data))])
        for flip in flips:
            changed[int(flip * len(data))] ^= 1 << int(place * 8)
        path.write_bytes(changed)
        read = []
        fault = outcome_of(lambda: read.extend(Scan(path).entries()))
        assert fault is None or isinstance(fault, told)
        written = iter(entries)  # of a torn record the end tells, when later ones have been read
        assert all(any(make.equal(entry, other) for other in written) for entry in read)
        assert fault is not None or len(read) == TRIALS
        saved = outcome_of(lambda: list(salvage(path)))
        if isinstance(saved, list):
            known = iter(entries)
            assert all(any(make.equal(entry, other) for other in known) for entry in saved)
        else:
            assert isinstance(saved, told)
        info = outcome_of(lambda: log_info(path))
        assert isinstance(info, told) or info.trials == trials
        if flips:  # what stands before the first one is not lost
            path.write_bytes(data[: int(min(flips) * len(data))])
            before = outcome_of(lambda: list(filter(is_whole, salvage(path))))
            assert isinstance(before, LogCorruptError) or len(saved) >= len(before)

    check()


def is_whole(entry):
    return not (isinstance(entry, Trial) and entry.ended)


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


@pytest.mark.long
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

    with pytest.raises(LogError, match=f"meal-bayes log recover .*{active.name}"):
        read_trials(path)
    saved = recover_log(active)
    assert saved == tmp_path / "run.recovered.mcap"
    assert all(map(make.equal, trials, read_trials(saved)))
    assert check_log(saved).trials == len(trials)
    assert read_header(saved)["recovered_from"] == active.name
    assert read_header(saved)["seed"] == 3
    assert sorted(file.name for file in tmp_path.iterdir()) == ["run.recovered.mcap", active.name]


def test_recovering_to_the_name_that_was_meant_keeps_the_torn_file(whole, make, tmp_path):
    data, entries = whole
    active = new_draft(tmp_path / "run.mcap")
    active.write_bytes(data[: len(data) // 2])
    with pytest.raises(LogCorruptError, match="log recover"):
        read_outcomes(active)
    saved = recover_log(active, tmp_path / "run.mcap")
    recovered = list(Scan(saved).entries())
    assert 0 < len(recovered) < TRIALS
    assert all(map(make.equal, recovered, entries[: len(recovered)]))
    assert active.read_bytes() == data[: len(data) // 2]
    with pytest.raises(LogError, match="exists already"):
        recover_log(active, saved)


@pytest.mark.parametrize("cut", [0, 40])
def test_a_compact_log_that_begins_with_a_whole_trial_is_recovered(make, tmp_path, cut):
    first, *others = make.trials(6, 2)
    outcomes = TrialOutcomes.of(others)
    write_trials(path := tmp_path / "run.mcap", [first, outcomes], header={}, form="compact")
    path.write_bytes(path.read_bytes()[: -cut or None])
    saved = recover_log(path)
    assert log_info(saved).form == "compact"
    assert make.equal(tuple(Scan(saved).entries()), (first, outcomes))
    assert [file.name for file in tmp_path.iterdir() if file.suffix == ".active"] == []


def test_outcomes_are_not_written_into_a_full_log(make, tmp_path):
    first, *others = make.trials(3, 2)
    with pytest.raises(LogError, match=r"a full log, .* give form='compact'"):
        write_trials(tmp_path / "run.mcap", [first, TrialOutcomes.of(others)], header={})
    with pytest.raises(SettingsError, match="form 'packed'"):
        write_trials(tmp_path / "run.mcap", [first], header={}, form="packed")


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
            with pytest.raises(LogError, match=r"[Nn]o.* log|not a log"):
                read(path)


def test_trials_of_one_log_do_not_pass_in_another_order(make, outcome_of, tmp_path):
    """Whole chunks taken out or put twice, with all checksums of MCAP made right again."""
    path = tmp_path / "a.mcap"
    write_trials(path, make.trials(TRIALS, 11, steps=3, edges=1), header={})
    with path.open("rb") as file:
        reader = make_reader(file)
        stored = [(c.topic, s, m) for s, c, m in reader.iter_messages(log_time_order=False)]
        attached = list(reader.iter_attachments())
    outcomes = [index for index, (topic, _, _) in enumerate(stored) if topic == "/outcome"]
    first = outcomes[0] + 1
    second = outcomes[1] + 1
    topic, kind, message = stored[first]
    long = topic, kind, dataclasses.replace(message, data=message.data + b" " * MESSAGE_LIMIT)
    variants = {
        "same": stored,
        "trial left out": stored[:first] + stored[second:],
        "trial twice": stored[:second] + stored[first:],
        "step left out": stored[: first - 3] + stored[first - 2 :],
        "last trial left out": stored[: outcomes[-2] + 1],
        "message too long": [*stored[:first], long, *stored[first + 1 :]],
    }
    for name, messages in variants.items():
        with path.open("wb") as file:
            out = Writer(file, enable_data_crcs=True)
            known = {}
            out.start(profile=PROFILES[FULL])
            for topic, kind, message in messages:
                if topic not in known:
                    number = out.register_schema(kind.name, kind.encoding, kind.data)
                    known[topic] = out.register_channel(topic, "json", number)
                out.add_message(known[topic], message.log_time, message.data, message.publish_time)
            for entry in attached:
                out.add_attachment(0, 0, entry.name, entry.media_type, entry.data)
            out.finish()
        fault = outcome_of(lambda: list(read_trials(path)))
        assert isinstance(fault, list if name == "same" else LogCorruptError), (name, fault)


@pytest.mark.parametrize(
    ("size", "count", "said"), [(1 << 20, 1, "says that it unpacks"), (60 << 20, 3, "far more")]
)
def test_a_bomb_is_refused(size, count, said, tmp_path):
    """One chunk that unpacks to more than it says, and small ones that come to very much."""
    length = 60 << 20
    unknown = b"\xff" + (length - 9).to_bytes(8, "little") + bytes(length - 9)  # kind of record
    chunk = Chunk("zstd", zstandard.compress(unknown), 0, 0, zlib.crc32(unknown), size)
    path = tmp_path / "a.mcap"
    builder = RecordBuilder()
    for record in (Header(PROFILES[FULL], ""), *[chunk] * count):
        record.write(builder)
    path.write_bytes(MCAP0_MAGIC + builder.end())
    assert said in " ".join(check_log(path).problems)


@pytest.mark.long
def test_a_hole_ends_the_reading(whole, tmp_path):
    data, _ = whole
    path = tmp_path / "a.mcap"
    path.write_bytes(data)
    os.truncate(path, 1 << 40)
    assert len(list(salvage(path))) == TRIALS
    path.write_bytes(data[: len(MCAP0_MAGIC)])
    os.truncate(path, 1 << 40)
    assert "nothing is written from byte 8 on" in check_log(path).problems
    for read in (read_header, log_info, lambda name: list(read_trials(name))):
        with pytest.raises(LogCorruptError):
            read(path)


def test_the_memory_of_momdps_is_bounded_and_writer_and_reader_agree(make, monkeypatch, tmp_path):
    monkeypatch.setattr("meal_bayes.trial_log.messages.MOMDP_BYTES", 5000)
    rng = np.random.default_rng(2)
    momdps = [make.momdp(load_domain("toy"), 2, rng) for _ in range(6)]
    trials = [make.trial(momdp, rng, steps=1, edges=1) for momdp in (*momdps, *momdps)]
    path = tmp_path / "a.mcap"
    write_trials(path, trials, header={})
    back = list(read_trials(path))
    assert all(map(make.equal, back, trials))
    assert len(back) == 12
    with path.open("rb") as file:
        momdps = list(make_reader(file).iter_messages(topics="/momdp"))
    assert len(momdps) > 6  # those that were forgotten are there twice
