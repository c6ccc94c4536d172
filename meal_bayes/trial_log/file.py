"""One log file: its names, and how it is written, read, checked and recovered.

A log is an MCAP file of the messages in `messages.py`. While it is written it is a draft with a
unique name, such as `run.w4711-a3f9c2.mcap.active` of `run.mcap`, so that no two processes ever
write into one file; it gets its own name when it is whole. The MCAP library checks chunks and the
data section; this module also checks the closing records, and refuses a damaged length before it
asks for memory.
"""

import contextlib
import json
import os
import platform
import re
import secrets
import struct
import zlib
from collections import ChainMap, deque
from collections.abc import Iterable, Iterator, Mapping, MutableMapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from types import SimpleNamespace
from typing import Any, BinaryIO, Self

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode
from mcap.reader import FOOTER_SIZE
from mcap.records import Attachment, Channel, Chunk, Footer, Header, McapRecord, Message
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC, Writer

from meal_bayes.digests import package_version
from meal_bayes.domain import unknown
from meal_bayes.errors import (
    DomainError,
    LogCorruptError,
    LogError,
    LogVersionError,
    OutputError,
    QueryError,
    SettingsError,
)
from meal_bayes.files import (
    checked_path,
    command_line,
    hold,
    make_folder,
    name_new,
    replace_whole,
    write_whole,
)
from meal_bayes.trial_log.feedback import Change, Feedback
from meal_bayes.trial_log.messages import (
    CHANGE,
    FEEDBACK,
    FORMAT_VERSION,
    LINES,
    MESSAGE_LIMIT,
    MOMDPS,
    OUTCOME,
    OUTCOMES,
    RECORD_LIMIT,
    RUN,
    STEP,
    TRIAL,
    TRIAL_LIMIT,
    End,
    MomdpMessage,
    Momdps,
    OutcomeMessage,
    OutcomesMessage,
    Packed,
    RunMessage,
    TrialEncoder,
    TrialMessage,
    as_float,
    decode,
    encode,
    judgment,
    log_time,
    read_trial,
    schema_of,
)
from meal_bayes.trials import Step, Trial, TrialOutcomes
from meal_bayes.trials.outcomes import check_trials
from meal_bayes.trials.text import UNFINISHED
from meal_bayes.untrusted import FREE_BYTES, UNPACKING, open_regular, read_json

FULL = "full"  # the form of a log that holds whole trials
COMPACT = "compact"  # ... that holds their outcomes, and of some of them the whole trial
FEEDBACK_FORM = "feedback"  # ... that holds what a person told of a trial when that was over
PROFILES = {  # in the MCAP header
    FULL: "meal_bayes", COMPACT: "meal_bayes/outcomes", FEEDBACK_FORM: "meal_bayes/feedback",
}  # fmt: skip
_FORMS = {profile: form for form, profile in PROFILES.items()}
_OUTCOMES_ALONE = (RUN, OUTCOMES)
TOPICS = {  # of a form, in the order of their channels' ids
    FULL: (RUN, MOMDPS, TRIAL, STEP, OUTCOME, LINES),
    COMPACT: (*_OUTCOMES_ALONE, MOMDPS, TRIAL, STEP, OUTCOME, LINES),
    FEEDBACK_FORM: (RUN, FEEDBACK, CHANGE),
}
_SCHEMAS = {  # names of the messages of topics
    RUN: "meal_bayes.Run", MOMDPS: "meal_bayes.Momdp", TRIAL: "meal_bayes.Trial",
    STEP: "meal_bayes.Step", OUTCOME: "meal_bayes.Outcome", OUTCOMES: "meal_bayes.Outcomes",
    FEEDBACK: "meal_bayes.Feedback", CHANGE: "meal_bayes.Change", LINES: "foxglove.Log",
}  # fmt: skip
END = "end.json"  # attachment behind the last trial: trials, steps and summed cost (s)
_TIMING = "trial,seconds\n"  # begins a table of seconds
ROWS = 250  # trials in a message of the compact form

SUFFIX = ".mcap"
ACTIVE = ".active"  # ends the name of a file that is still being written
RECOVERED = ".recovered"
FORM_ENDINGS = {".feedback": FEEDBACK_FORM}  # of the stem of a log of such a form
_DRAFT = r"\.w\d+-[0-9a-f]{6}"
_ENDINGS = re.compile(rf"({_DRAFT})?(\.recovered)?({_DRAFT})?$")  # the recovered has drafts, too
_OF_DRAFT = re.compile(rf"{_DRAFT}(\.recovered)?$")

# What damaged bytes can raise on their way through the libraries and our constructors.
FAULTS = (
    LogCorruptError,
    McapError,
    zstandard.ZstdError,
    RuntimeError,  # of lz4; RecursionError
    struct.error,
    ValueError,  # also UnicodeDecodeError, JSON that is none, CRCValidationError
    TypeError,
    LookupError,
    OverflowError,
    DomainError,
    QueryError,
    SettingsError,
)
TORN = (EndOfFile, struct.error)  # raised where the file ends inside a record
CUT_SHORT = "the file ends before its closing records"  # what is said of these
NO_END = "the closing record is missing"
MERGED = (
    "the messages of two logs are mixed by time, as `mcap merge` does; read the logs that were "
    "merged (`cat` leaves each whole, and `meal-bayes log recover` reads all of one header)"
)
_WITH_ITS_CODE = "run its configuration again, or read it with the version that wrote it"
_SEARCHED = 4  # blocks of the record limit
_HEAD = 9  # bytes of a record before its content
_CRC = 4  # bytes of a checksum
_PROBLEMS = 20  # that are kept of one file
_GROUP = 100  # trials whose outcomes are computed at a time


def new_draft(path: Path) -> Path:
    """Choose a name for a log that is to become `path`."""
    return path.with_name(f"{path.stem}.w{os.getpid()}-{secrets.token_hex(3)}{SUFFIX}{ACTIVE}")


def named_form(path: Path) -> str:
    """Return the form that the name of a log or draft says; "" for names of trials."""
    return FORM_ENDINGS.get(Path(stem_of(path)).suffix, "")


def timing_of(path: Path) -> Path:
    """Name the table of seconds beside a log."""
    return path.with_suffix(".timing.csv")


def stem_of(path: Path) -> str:
    """Return the part of the name that a log, its drafts and its recovered file share.

    >>> stem_of(Path("run.mcap")), stem_of(Path("run.w4711-a3f9c2.mcap.active"))
    ('run', 'run')
    """
    return _ENDINGS.sub("", path.name.removesuffix(ACTIVE).removesuffix(SUFFIX), count=1)


def drafts_of(path: Path) -> list[Path]:
    """Find the drafts of a log, the newest first, without those of its recovered file."""
    drafts = dict[Path, float]()
    for file in path.parent.glob(f"*{SUFFIX}{ACTIVE}"):
        if stem_of(file) == path.stem and not _is_recovered(file) and file.is_file():
            with contextlib.suppress(FileNotFoundError):  # it has got its name meanwhile
                drafts[file] = -file.stat().st_mtime
    return sorted(drafts, key=drafts.__getitem__)


def remove_drafts(path: str | Path) -> None:
    """Remove the drafts of a log that no process is writing any more."""
    for draft in drafts_of(checked_path("The log", path)):
        with contextlib.suppress(FileNotFoundError), draft.open("rb") as file:
            if hold(file):
                draft.unlink(missing_ok=True)


def find_log(path: str | Path) -> Path:
    """Return the file with this name; where there is none, the file that holds most of the log.

    That is the largest draft, else the recovered file. For a draft that is gone it is the log,
    as another process may have finished it a moment ago.

    Raises
    ------
    LogError
        There is no such file, or it is a folder.
    """
    path = checked_path("The log", path)
    if path.is_file():
        return path
    if path.is_dir():
        raise LogError(f"{path} is a folder and not a log; name one of its files.")
    stem = stem_of(path) if path.name.endswith(ACTIVE) else path.stem
    found = wholest(path.parent.glob(f"*{SUFFIX}*")).get(path.parent / stem)
    if found is None:
        raise LogError(f"There is no log {path}; expected a {SUFFIX} file, or a folder of them.")
    return found


def wholest(files: Iterable[Path]) -> dict[Path, Path]:
    """Return, for each log, the file that holds most of it."""
    best = dict[Path, tuple[int, int, Path]]()  # how whole, bytes, file
    for file in files:
        if file.name.endswith((SUFFIX, SUFFIX + ACTIVE)) and file.is_file():
            with contextlib.suppress(FileNotFoundError):  # a draft that was renamed meanwhile
                candidate = (_wholeness(file), file.stat().st_size, file)
                log = file.parent / stem_of(file)  # also of a hidden file, such as `.mcap`
                best[log] = max(best.get(log, candidate), candidate)
    return {log: file for log, (_, _, file) in best.items()}


def _wholeness(file: Path) -> int:
    """Return 2 for a finished log, 1 for a draft, 0 for a recovered file."""
    if _is_recovered(file):
        return 0
    return 1 if file.name.endswith(ACTIVE) else 2


def _is_recovered(file: Path) -> bool:
    """Return whether a file is a recovered file, or a draft of one."""
    return RECOVERED in file.name.removeprefix(stem_of(file))


class TrialWriter:
    """Writes trials into one log, which gets the name `path` when it is complete.

    Until then the file is a draft with the name `active_path`, which no other writer has. The
    wall-clock seconds of the trials are written into `<stem>.timing.csv` beside the log, so that
    two equal runs write equal logs. If the `with` block ends by an exception, the draft stays.

    When `write` returns, the trial has left the process, so `salvage` can read it even if the
    process dies. The writer is a `Recorder` as well: `begin`, `step` and `end` each return when
    their message is on disk.

    Parameters
    ----------
    path : str | Path
        File to write, with the ending .mcap. Missing folders are made.
    header : Mapping[str, object]
        Description of the run, such as its settings, seed and Git commit, as JSON values. The
        writer adds the entry `versions`.
    form : str
        "full" for trials, "compact" for their outcomes, or "feedback".
    overwrite : bool
        Whether an existing file with the name `path` is replaced when the log is complete.

    Raises
    ------
    SettingsError
        `path` has another ending or is a name for another form of logs, or JSON cannot represent
        the header.
    LogError
        At the beginning of the block: something already has the name `path`. At the end of the
        block: another writer has made a file with this name meanwhile, and the trials stay in the
        draft.

    Examples
    --------
    >>> import tempfile
    >>> with TrialWriter(Path(tempfile.mkdtemp()) / "run.mcap", {"seed": 3}) as log:
    ...     log.written.trials
    0
    """

    way_out = "give another name, or say overwrite=True"  # where the name is taken

    def __init__(
        self,
        path: str | Path,
        header: Mapping[str, object],
        form: str = FULL,
        *,
        overwrite: bool = False,
    ) -> None:
        self.path = checked_path("The log", path)
        self._overwrite = overwrite
        if form not in PROFILES:
            raise SettingsError(unknown("form", form, PROFILES))
        self._form = form
        if self.path.suffix != SUFFIX:
            raise SettingsError(f"A log's name ends in {SUFFIX}; found {self.path.name!r}.")
        if named_form(self.path) != (form if form in FORM_ENDINGS.values() else ""):
            reserved = " and ".join(f"{ending}{SUFFIX}" for ending in FORM_ENDINGS)
            raise SettingsError(
                f"Names that end in {reserved} are for logs of feedback alone; found "
                f"{self.path.name!r}. Choose another."
            )
        if _OF_DRAFT.search(self.path.stem):
            raise SettingsError(
                f"Names that end as {self.path.name!r} are for drafts of {stem_of(self.path)}"
                f"{SUFFIX}, and are not read beside it. Choose another."
            )
        self.active_path = new_draft(self.path)  # its name while it is being written
        versions = {"meal_bayes": package_version(), "numpy": np.__version__}
        versions["python"] = platform.python_version()
        self.header = {"versions": versions, **header}
        self._text = _json(self.header)
        self._seconds: dict[int, float] = {}  # by trial
        self._open = False  # also where a write was broken off: what follows could not be read
        self._begun = False  # a trial was begun and has no end yet
        self._momdps = Momdps()  # numbers in the file, by digest
        self.written = End()

    def __reduce__(self) -> str | tuple[Any, ...]:
        raise LogError(
            f"{self.path} is being written, and a copy would write it too; copy between trials, or "
            "without logs (logs=None)."
        )

    def __enter__(self) -> Self:
        with self._faults_named():
            make_folder(self.path.parent)
            if self.path.exists() and not self.path.is_file():
                raise OSError(f"{self.path} is not a file")
            if not self._overwrite and os.path.lexists(self.path):  # also a link to nothing
                raise LogError(f"{self.path} exists already, and is not replaced; {self.way_out}.")
            _check_timing(timing_of(self.path))
            self._file: BinaryIO = self.active_path.open("xb")
            hold(self._file)  # nobody else resumes or removes it while this process lives
            self._mcap: Any = Writer(self._file, enable_data_crcs=True)
            self._mcap.start(profile=PROFILES[self._form])
            self._channels = dict[str, int]()
            # Most compact logs hold no whole trial, and need no schemas of its messages.
            self._declare(_OUTCOMES_ALONE if self._form == COMPACT else TOPICS[self._form])
            flat = {
                name: value if isinstance(value, str) else _json(value)
                for name, value in sorted(self.header.items())
            }
            # What the run was: metadata and an attachment for other tools, /run for ours.
            self._mcap.add_metadata("run", {"format_version": str(FORMAT_VERSION), **flat})
            config = _json(self.header.get("config", self.header))
            self._mcap.add_attachment(0, 0, "config.json", "application/json", config.encode())
        self._open = True
        run = RunMessage(format_version=FORMAT_VERSION, header=json.loads(self._text))
        self._put([Packed(RUN, 0, encode(run))])
        return self

    def _declare(self, topics: Sequence[str]) -> None:
        """Write the channels of topics that have none yet."""
        for topic in topics:
            if topic not in self._channels:
                channel = self._mcap.register_channel(topic, "json", self._schema(topic))
                self._channels[topic] = channel

    def _schema(self, topic: str) -> int:
        """Write the schema of a topic's messages; return its number."""
        data = schema_of(topic)
        number: int = self._mcap.register_schema(_SCHEMAS[topic], "jsonschema", data)
        return number

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        whole = kind is None and self._open and not self._begun
        self._open = False
        with self._faults_named():
            with self._file:
                if whole:
                    end = _json(self.written._asdict()).encode()
                    self._mcap.add_attachment(0, 0, END, "application/json", end)
                    self._mcap.finish()
            if whole and self._overwrite:
                self._write_seconds()
                replace_whole(self.active_path, self.path)  # last: with it the log is there
            elif whole:
                try:
                    name_new(self.active_path, self.path)
                except FileExistsError:
                    raise LogError(
                        f"{self.path} was meanwhile written by another process, and is not "
                        f"replaced; the trials are in {self.active_path}. Save them with: "
                        + command_line("meal-bayes log recover", self.active_path)
                    ) from None
                self._write_seconds()

    def _write_seconds(self) -> None:
        """Write the table of seconds beside the log, in place of an earlier log's."""
        rows = [f"{number},{seconds:.6f}\n" for number, seconds in self._seconds.items()]
        if rows:
            write_whole(timing_of(self.path), "".join([_TIMING, *rows]), expected=True)
        else:
            timing_of(self.path).unlink(missing_ok=True)

    def _put(self, messages: Iterable[Packed], *, sync: bool = False) -> None:
        """Write messages; when this returns they have left the process, or (sync) are on disk."""
        if not self._open:
            raise LogError(f"{self.path} is not open; write inside the `with` block of its writer.")
        with self._faults_named():
            packed = list(messages)  # nothing is written where one of them cannot be
            # Broken off in the middle, what follows could not be read: the writer stays closed.
            self._open = False
            for topic, time, data, momdp in packed:
                if topic not in self._channels:
                    self._declare(TOPICS[self._form])
                channel = self._channels[topic]
                self._mcap.add_message(channel, log_time=time, publish_time=time, data=data)
                if momdp is not None:
                    self._momdps.add(*momdp, len(data))
            self._mcap.flush()
            if sync:
                self._file.flush()
                os.fsync(self._file.fileno())
            self._open = True

    @contextlib.contextmanager
    def _faults_named(self) -> Iterator[None]:
        """Turn errors of system and trial into ours, which name the file or the trial."""
        trials = self.written.trials
        try:
            yield
        except OSError as fault:
            draft = f" ({trials} trials are kept in {self.active_path})" if trials else ""
            reason = fault.strerror or fault
            raise LogError(f"{self.path} cannot be written: {reason}{draft}.") from fault
        except OutputError as fault:  # of the folder
            raise LogError(str(fault)) from fault
        except (SettingsError, TypeError, ValueError, OverflowError) as fault:
            # the next one, which no message can hold
            raise LogError(f"Trial {trials} cannot be logged: {fault}.") from fault

    def write(self, trial: Trial, *, seconds: float | None = None) -> None:
        """Append one trial to the log, and its wall-clock seconds to the timing table.

        Raises
        ------
        LogError
            The shapes or values of the trial's arrays do not fit its MOMDP; the file does not
            change. Or the disk is full; the earlier trials stay in the draft.
        """
        self._put(self._next_encoder().whole(trial))
        self._count(trial, seconds)

    def write_outcomes(self, outcomes: TrialOutcomes, seconds: Iterator[float]) -> None:
        """Append outcomes to a compact log, and the wall-clock seconds of each trial.

        To append a trial with its steps, call `write` between two calls of this method.
        """
        if self._form != COMPACT:
            raise LogError(
                f"{self.path} is a {self._form} log, which holds no outcomes; give form='compact'."
            )
        for begin in range(0, len(outcomes), ROWS):
            rows = outcomes.rows(slice(begin, begin + ROWS))
            number = self.written.trials
            data = encode(OutcomesMessage.of(rows, number))
            self._put([Packed(OUTCOMES, log_time(number, 0), data)])
            self._seconds.update(zip(range(number, number + len(rows)), seconds, strict=False))
            self.written = self.written.after(rows)

    def write_feedback(self, feedback: Feedback | Change) -> None:
        """Write labels from a person, or a change of the learner, into a log of feedback."""
        topic = FEEDBACK if isinstance(feedback, Feedback) else CHANGE
        self._put([Packed(topic, 0, feedback.packed())])

    def begin(self, trial: Trial) -> None:
        """Write the start of a trial to disk; its steps follow one by one, then its end."""
        self._encoder = self._next_encoder()
        self._put(self._encoder.begin(trial), sync=True)
        self._begun = True

    def step(self, step: Step) -> None:
        """Write the next step of the trial that was begun to disk."""
        self._put(self._encoder.step(step), sync=True)

    def end(self, trial: Trial, *, sync: bool = True) -> None:
        """Write the outcome of the begun trial; without `sync`, only closing the log syncs it."""
        self._put(self._encoder.end(trial), sync=sync)
        self._begun = False
        self._count(trial)

    def _next_encoder(self) -> TrialEncoder:
        if self._begun:
            raise LogError(
                f"{self.path} accepts no other trial, because the last one has not ended."
            )
        return TrialEncoder(self.written.trials, self._momdps)

    def _count(self, trial: Trial, seconds: float | None = None) -> None:
        if seconds is not None:
            self._seconds[self.written.trials] = seconds
        self.written = self.written.after(trial)


def write_trials(
    path: str | Path,
    trials: Iterable[Trial | TrialOutcomes],
    *,
    header: Mapping[str, object],
    seconds: Sequence[float] = (),
    overwrite: bool = False,
    form: str = "",
) -> None:
    """Write trials into one log file.

    Parameters
    ----------
    path : str | Path
        File to write, with the ending .mcap.
    trials : Iterable[Trial | TrialOutcomes]
        Trials, or outcomes without steps.
    header : Mapping[str, object]
        Description of the run, such as its settings, seed and Git commit, as JSON values.
    seconds : Sequence[float]
        Wall-clock seconds of the first trials, in their order.
    overwrite : bool
        Whether an existing file is replaced.
    form : str
        "full" for trials, or "compact", which holds outcomes and whole trials; by default, what the
        first entry is.

    Raises
    ------
    LogError
        The file exists already or cannot be written, outcomes are to be written into a full log, or
        the shapes or values of a trial's arrays do not fit the MOMDP of the trial.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> write_trials(folder / "run.mcap", [], header={"seed": 3})
    >>> read_header(folder / "run.mcap")["seed"]
    3
    """
    check_trials(trials)
    entries = iter(trials)
    times = iter(seconds)
    first = next(entries, None)
    held = form or (COMPACT if isinstance(first, TrialOutcomes) else FULL)
    with TrialWriter(path, header, held, overwrite=overwrite) as log:
        for entry in chain([] if first is None else [first], entries):
            if isinstance(entry, TrialOutcomes):
                log.write_outcomes(entry, times)
            else:
                log.write(entry, seconds=next(times, None))


def _check_timing(path: Path) -> None:
    """Refuse to replace what is no table of seconds."""
    if os.path.lexists(path):
        if path.is_file():
            with path.open("rb") as file:
                if _TIMING.encode().startswith(file.read(len(_TIMING))):  # or a part of it
                    return
        raise LogError(
            f"{path} is the file for the seconds of the trials, but has other content; give the "
            f"log another name."
        )


def read_seconds(path: str | Path) -> list[float]:
    """Read the wall-clock seconds of a log's trials; none if no complete table is beside it."""
    log = checked_path("The log", path)
    try:
        rows = timing_of(log).read_text(encoding="utf-8").splitlines()[1:]
        return [float(row.split(",")[1]) for row in rows]
    except (FileNotFoundError, IndexError, ValueError):
        return []


def _json(value: object) -> str:
    if isinstance(value, Mapping) and not all(isinstance(name, str) for name in value):
        raise SettingsError(f"Names in a log's header must be text; found {list(value)}.")
    try:
        text = json.dumps(value, sort_keys=True, allow_nan=False)
        read_json(text)  # a reader must take it
    except (TypeError, ValueError) as fault:
        raise SettingsError(
            f"A log's header holds JSON values (text, finite numbers, lists, tables); {fault}."
        ) from fault
    return text


def read_records(file: BinaryIO, *, begin: int = 0) -> Iterator[McapRecord]:
    """Yield the records of the log at the current position of a file; raise at the first fault.

    Chunks are not unpacked. `begin` is 0, or the position of a later record in a file with one log
    only. A file that is read to its end without a fault is whole.
    """
    origin = 0 if begin else file.tell()
    if not begin:
        start = file.read(len(MCAP0_MAGIC))
        file.seek(origin)
        if not MCAP0_MAGIC.startswith(start):
            raise ForeignFileError(f"it is no MCAP file, as it begins with {start!r}")

    def read(size: int) -> bytes:
        """Read no more than a record holds; the library reads one byte where a record begins."""
        if size > RECORD_LIMIT:
            raise LogCorruptError(f"a record declares {size} bytes")
        data = file.read(size)
        if size == 1 and data == b"\0":  # it would be read as empty records, for terabytes perhaps
            raise LogCorruptError(f"nothing is written from byte {file.tell() - 1} on")
        return data

    # The library checks no length before it reads: a damaged one would ask for gigabytes.
    bounded: Any = SimpleNamespace(read=read)  # it calls nothing else
    yield from StreamReader(
        bounded,
        skip_magic=begin > 0,
        emit_chunks=True,
        validate_crcs=True,
        record_size_limit=RECORD_LIMIT,
    ).records
    end = file.tell()
    _check_summary(file, origin, end)
    behind = file.seek(0, os.SEEK_END) - end
    if behind:
        raise LogCorruptError(f"{behind} bytes follow the end of the log at byte {end}")


def next_log(file: BinaryIO, at: int) -> int:
    """Return the position of the first log at or behind byte `at`, else the end of the file.

    The search ends after 256 MB, as a hole in a file may be terabytes long.
    """
    start = MCAP0_MAGIC + bytes([Opcode.HEADER])  # a log ends with the magic bytes, too
    file.seek(at)
    tail = b""
    for _ in range(_SEARCHED):
        block = tail + file.read(RECORD_LIMIT)
        offset = block.find(start)
        if offset >= 0:
            return at - len(tail) + offset
        at += len(block) - len(tail)
        tail = block[1 - len(start) :]
    return file.seek(0, os.SEEK_END)


def chunk_messages(chunk: Chunk, channels: MutableMapping[int, str]) -> Iterator[tuple[str, bytes]]:
    """Yield topic and data of every message of a chunk; new channels go into `channels`."""
    unpacked = replace(chunk, compression="", data=_unpacked(chunk))
    for record in breakup_chunk(unpacked, validate_crc=True):
        if isinstance(record, Channel):
            channels[record.id] = topic_of(record)
        elif isinstance(record, Message):
            yield message_of(record, channels)


def topic_of(channel: Channel) -> str:
    """Return the topic of a channel.

    Raises
    ------
    LogVersionError
        It is a log of version 0.1.0, whose messages were protobuf.
    """
    if channel.topic == RUN and channel.message_encoding == "protobuf":
        raise LogVersionError(
            f"written by meal_bayes 0.1.0 as protobuf, this meal_bayes reads JSON; {_WITH_ITS_CODE}"
        )
    return channel.topic


def message_of(record: Message, channels: MutableMapping[int, str]) -> tuple[str, bytes]:
    """Return topic and data of a message; refuse one that is too large or has no channel."""
    if record.channel_id not in channels or len(record.data) > MESSAGE_LIMIT:
        raise LogCorruptError(f"{len(record.data)} bytes on channel {record.channel_id}")
    return channels[record.channel_id], record.data


def _unpacked(chunk: Chunk) -> bytes:
    """Unpack a chunk; refuse one of another size than it declares, or beyond the limit."""
    declared = chunk.uncompressed_size
    if declared > RECORD_LIMIT:
        raise LogCorruptError(
            f"a chunk of {declared:,} bytes, more than {RECORD_LIMIT:,}; "
            "write smaller ones: mcap compress --chunk-size 1048576"
        )
    data = chunk.data
    if chunk.compression == "zstd":
        size = zstandard.frame_content_size(data)  # what the library would allocate; -1: not said
        if size not in (-1, declared):
            raise LogCorruptError(f"a chunk of {declared} bytes says that it unpacks to {size}")
        data = zstandard.ZstdDecompressor().decompress(data, max_output_size=declared)
    elif chunk.compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=declared + 1)
    elif chunk.compression:
        raise LogCorruptError(
            f"its chunks are packed by {chunk.compression!r:.20}; "
            "pack it again with: mcap compress --compression zstd"
        )
    if len(data) != declared:
        raise LogCorruptError(f"a chunk of {declared} bytes unpacks to {len(data)}")
    return data


def fault_text(fault: Exception) -> str:
    """Return a fault in words."""
    if isinstance(fault, TORN):
        return CUT_SHORT
    return str(fault) if isinstance(fault, LogError) else f"{type(fault).__name__}: {fault}"


def _check_summary(file: BinaryIO, origin: int, end: int) -> None:
    """Check the closing records, which the library does not check."""
    end -= len(MCAP0_MAGIC)
    file.seek(max(end - FOOTER_SIZE + _HEAD, 0))
    footer = Footer.read(ReadDataStream(file))
    crc = None
    if 0 < footer.summary_start < end - origin:
        file.seek(origin + footer.summary_start)
        crc = zlib.crc32(file.read(end - _CRC - origin - footer.summary_start))
    if footer.summary_crc not in (0, crc):  # 0: its writer left it out
        raise LogCorruptError("the closing records were changed, or are not there")


class ForeignFileError(LogCorruptError):
    """A file that is not a log of this package, not even a torn one; the text says what it is."""

    def of(self, path: Path) -> str:
        """Return what is said of the file at a path."""
        return f"{path} is no log of meal_bayes: {self}; give a {SUFFIX} file that it wrote"


def check_size(path: Path, size: int) -> None:
    """Refuse an empty file, unless it is a draft whose writer has just begun."""
    if size == 0 and not path.name.endswith(ACTIVE):
        raise ForeignFileError("it is empty")


def form_of(profile: str) -> str | None:
    """Return the form that the profile in an MCAP header names; None where it is empty.

    Raises
    ------
    ForeignFileError
        The profile of another program.
    LogVersionError
        A form that this version does not know.
    """
    if not profile:  # `mcap merge` leaves it out
        return None
    if profile in _FORMS:
        return _FORMS[profile]
    if profile.startswith(f"{PROFILES[FULL]}/"):
        raise LogVersionError(
            f"written as {profile!r:.60}, which this meal_bayes does not know; {_WITH_ITS_CODE}"
        )
    raise ForeignFileError(f"it is another program's MCAP file, of profile {profile!r:.40}")


def check_topics(topics: Sequence[str]) -> None:
    """Refuse a file without a profile if it has topics, and `/run` is none of them."""
    if topics and RUN not in topics:
        raise ForeignFileError(f"it is another program's MCAP file, of topic {topics[0]!r:.40}")


def _run_header(data: bytes) -> dict[str, object]:
    """Read the header in a run message; refuse another format version."""
    read_json(data)  # within the limits of size and depth
    message = decode(data, RunMessage)
    if message.format_version != FORMAT_VERSION:
        raise LogVersionError(
            f"written in log format {message.format_version}, this meal_bayes reads format "
            f"{FORMAT_VERSION}; {_WITH_ITS_CODE}"
        )
    return message.header


@dataclass
class TrialBuilder:
    """Assembles trials from the records of a file, and counts what they hold."""

    limit: float = np.inf  # bytes that all chunks may unpack to
    form: str = FULL
    header: dict[str, object] | None = None
    read: End = End()  # noqa: RUF009  immutable
    end: End | None = None  # as the writer counted
    feedback: list[Feedback | Change] = field(default_factory=list)  # of a log of that form
    ours: bool = False  # whether a profile says so
    _channels: ChainMap[int, str] = field(default_factory=ChainMap)  # as declared, then as usual
    _runs: int = 0  # headers of runs
    _next: int = 0  # number of the next trial
    _momdps: Momdps = field(default_factory=Momdps)  # by number
    _open: list[bytes] = field(default_factory=list)  # start and steps of the trial under way

    def records(self, record: McapRecord) -> Iterator[Trial | TrialOutcomes]:
        """Read the next record; yield the trials, or the outcomes, that it completes."""
        if isinstance(record, Header):
            form = form_of(record.profile)
            self.ours = form is not None
            self.form = form or FULL
            # Without its first chunk the others still mean what this format says.
            usual = dict(enumerate(TOPICS[self.form], start=1))
            self._channels = ChainMap({}, usual)
        elif isinstance(record, Attachment) and record.name == END:
            counts: Any = read_json(record.data)
            self.end = End(**counts)
        elif isinstance(record, Channel):
            self._channels[record.id] = topic_of(record)
        elif isinstance(record, Chunk | Message):
            try:
                for topic, data in self._messages(record):
                    entry = self.add(topic, data)
                    if entry is not None:
                        yield entry
            except FAULTS:
                self._open = []
                raise

    def _messages(self, record: Chunk | Message) -> Iterable[tuple[str, bytes]]:
        """Return topics and data of a chunk's messages, or of a message outside of chunks."""
        if isinstance(record, Message):
            return [message_of(record, self._channels)]
        self.limit -= record.uncompressed_size
        if self.limit < 0:
            raise LogCorruptError("it unpacks to far more than a log of its size holds")
        return chunk_messages(record, self._channels)

    def add(self, topic: str, data: bytes) -> Trial | TrialOutcomes | None:
        """Add the next message; return the trial, or the outcomes, that it completes."""
        if topic == RUN:
            self._runs += 1
            self.header = self.header or _run_header(data)
        if self._runs > 1:
            raise LogCorruptError(MERGED)
        if topic == MOMDPS:
            message = decode(data, MomdpMessage)
            self._momdps.add(message.id, message.read(), len(data))
        elif topic in (TRIAL, STEP):
            if bool(self._open) == (topic == TRIAL):
                problem = "a trial has no outcome" if self._open else "a step has no trial"
                raise LogCorruptError(problem)
            self._open.append(data)
            if sum(map(len, self._open)) > TRIAL_LIMIT:
                raise LogCorruptError(f"a trial is longer than {TRIAL_LIMIT} bytes")
        elif topic == FEEDBACK:
            self.feedback.append(Feedback.unpacked(data))
        elif topic == CHANGE:
            self.feedback.append(Change.unpacked(data))
        elif topic in (OUTCOME, OUTCOMES):
            entry: Trial | TrialOutcomes
            if topic == OUTCOME:
                first, entry = self._finish(data)
            else:
                columns = decode(data, OutcomesMessage)
                first, entry = columns.first, columns.read()
            if first < self._next:
                raise LogCorruptError(f"trial {first} is there twice, or not in order")
            self.read = self.read.after(entry)
            self._next = first + (1 if isinstance(entry, Trial) else len(entry))
            return entry
        return None

    def check_topics(self) -> None:
        """Refuse the file of another program, which declares no topic of ours."""
        if not self.ours:
            check_topics(list(self._channels.maps[0].values()))

    def check_header(self) -> dict[str, object]:
        """Return the header of the run; refuse a file that was read to its end and has none."""
        if self.header is None:
            self.check_topics()
            raise LogCorruptError("the header of the run is missing")
        return self.header

    def check_end(self) -> None:
        """Compare with what the writer counted when it had written the last trial."""
        self.check_header()
        if self._open:
            steps = len(self._open) - 1
            raise LogCorruptError(f"a trial has no outcome; {steps} of its steps can be recovered")
        if self.end is None:
            raise LogCorruptError(NO_END)
        if self.form == FEEDBACK_FORM and len(self.feedback) != 1:
            raise LogCorruptError(
                f"it holds {len(self.feedback)} messages of feedback, expected one"
            )
        if self.read != self.end:
            raise LogCorruptError(
                f"the trials are not those that were written ({self.read}, {self.end})"
            )

    def unfinished(self) -> Trial | None:
        """Return the trial that has no outcome yet, as far as it went, or None."""
        if not self._open:
            return None
        return read_trial(self._open, None, self._momdps, UNFINISHED)

    def _finish(self, data: bytes) -> tuple[int, Trial]:
        if not self._open:
            raise LogCorruptError("an outcome has no trial")
        outcome = decode(data, OutcomeMessage)
        number = decode(self._open[0], TrialMessage).trial
        steps = len(self._open) - 1
        if (steps, number) != (outcome.steps, outcome.trial):
            raise LogCorruptError(f"trial {number} has {steps} steps, not all of them")
        trial = read_trial(self._open, outcome, self._momdps)
        self._open = []
        written = (outcome.success, outcome.cost, as_float(outcome.reward))
        computed = (judgment(trial), trial.cost, trial.reward)
        if not np.array_equal(computed, written, equal_nan=True):
            raise LogCorruptError(f"the outcome of trial {number} is not that of its steps")
        return number, trial


@dataclass(frozen=True, slots=True)
class LogInfo:
    """Contents and faults of a log."""

    path: Path
    form: str  # "full", "compact" or "feedback"
    trials: int
    steps: int
    cost: float  # s, of all trials
    header: dict[str, object]
    problems: tuple[str, ...] = ()
    unread: int = 0  # bytes that are passed over
    ours: bool = True  # False: no log, torn or not, but another file

    @property
    def whole(self) -> bool:
        """Whether nothing is missing and nothing was changed."""
        return not self.problems


def read_outcomes(path: str | Path) -> TrialOutcomes:
    """Read the outcomes of a complete log, full or compact; errors as for `read_trials`."""
    return TrialOutcomes.join([outcomes for outcomes, _ in grouped(Scan(path))])


def grouped(
    scan: "Scan", *, unfinished: bool = False
) -> Iterator[tuple[TrialOutcomes, tuple[Trial, ...]]]:
    """Yield trials in groups in their order: their outcomes, and the trials that have steps.

    The tuple of trials is as long as the outcomes, or empty; see `Scan.entries`.
    """
    waiting = list[Trial]()
    for entry in scan.entries(unfinished=unfinished):
        if isinstance(entry, Trial):
            waiting.append(entry)
        if waiting and (len(waiting) == _GROUP or not isinstance(entry, Trial)):
            yield TrialOutcomes.of(waiting), tuple(waiting)
            waiting = []
        if not isinstance(entry, Trial):
            yield entry, ()
    if waiting:
        yield TrialOutcomes.of(waiting), tuple(waiting)


def read_header(path: str | Path) -> dict[str, object]:
    """Read the description of a run, also from a damaged log; errors as for `read_trials`."""
    builder = TrialBuilder()
    with opened(find_log(path)) as file:
        for record in read_records(file):
            next(builder.records(record), None)  # it stands in a chunk of its own
            if builder.header is not None:
                break
        return builder.check_header()


def log_info(path: str | Path) -> LogInfo:
    """Check every byte of a complete log, and return its contents; errors as for `read_trials`."""
    path = find_log(path)
    builder = TrialBuilder()
    header = read_header(path)
    with opened(path) as file:
        for record in read_records(file):
            if not isinstance(record, Chunk):
                next(builder.records(record), None)
        if builder.end is None:
            raise LogCorruptError(NO_END)
    return LogInfo(path, builder.form, **builder.end._asdict(), header=header)


class Scan:
    """One reading of a file. A tolerant one records faults and goes on behind them."""

    def __init__(self, path: str | Path, *, tolerant: bool = False) -> None:
        self.path = find_log(path)
        self._tolerant = tolerant
        if not tolerant and self.path.name.endswith(ACTIVE):
            unfinished = f"{self.path} was not finished by its writer"
            raise LogCorruptError(f"{unfinished}; {way_out(self.path)}")
        self.problems: list[str] = []
        self.builder = TrialBuilder()
        self.read = End()  # in all logs of the file
        self.headers: list[tuple[int, dict[str, object] | None]] = []  # and where each log begins
        self._foreign: ForeignFileError | None = None  # why a log in the file is none
        self.unread = 0  # bytes that are passed over

    def entries(self, *, unfinished: bool = False) -> Iterator[Trial | TrialOutcomes]:
        """Yield every whole trial; for a compact log, the outcomes in each message.

        A tolerant reading goes on with the next log in the same file, as `cat` appends logs. With
        `unfinished`, the trial without an outcome at the end of a log is yielded as well.
        """
        with opened(self.path) as file:
            size = os.fstat(file.fileno()).st_size
            begin = 0
            while True:
                offset = begin  # behind the last whole record
                file.seek(begin)
                # A small file may claim to unpack to gigabytes: zeros compress a thousandfold.
                builder = TrialBuilder(limit=FREE_BYTES + UNPACKING * size)
                self.builder = builder if begin == 0 else self.builder
                with self._noting():
                    check_size(self.path, size)
                    for record in read_records(file):
                        offset = file.tell()
                        if isinstance(record, Footer):
                            offset = min(offset + len(MCAP0_MAGIC), size)  # ends it, if not torn
                        with self._noting():
                            yield from self._counted(builder.records(record))
                with self._noting():
                    if self.foreign is None:
                        builder.check_end()
                if unfinished:
                    with self._noting():
                        yield from filter(None, [builder.unfinished()])
                if builder.header is not None or builder.read.trials:
                    self.headers.append((begin, builder.header))
                begin = next_log(file, max(offset, begin + 1)) if self._tolerant else size
                self.unread += begin - offset
                if begin >= size:
                    return

    def salvage(self) -> Iterator[Trial | TrialOutcomes]:
        """Yield every whole trial, and the one without an outcome where a log ends."""
        yield from self.entries(unfinished=True)
        if self.foreign is not None:
            raise LogCorruptError(f"{self.foreign.of(self.path)}.")
        if self.builder.header is None and not self.read.trials:
            raise LogCorruptError(
                f"{self.path} contains no part of a trial log: {self.problems[0]}; expected a "
                f"{SUFFIX} file that meal_bayes wrote."
            )

    @property
    def foreign(self) -> ForeignFileError | None:
        """Why the file holds no log of ours, as far as it was read; None where it holds one."""
        return None if self.read.trials or self.builder.header else self._foreign

    def _counted(self, entries: Iterator[Trial | TrialOutcomes]) -> Iterator[Trial | TrialOutcomes]:
        for entry in entries:
            self.read = self.read.after(entry)
            yield entry

    @contextlib.contextmanager
    def _noting(self) -> Iterator[None]:
        """In a tolerant reading, record a fault of the block instead of raising it."""
        try:
            yield
        except FAULTS as fault:
            if not self._tolerant:
                raise
            if isinstance(fault, ForeignFileError):
                self._foreign = self._foreign or fault
            if len(self.problems) < _PROBLEMS:
                self.problems.append(fault_text(fault))


def check_log(path: str | Path) -> LogInfo:
    """Read a file to its end and report its contents and faults; damage raises no error."""
    scan = Scan(path, tolerant=True)
    deque(scan.entries(), maxlen=0)
    header = scan.builder.header or {}
    form = scan.builder.form
    problems = tuple(scan.problems if scan.foreign is None else [str(scan.foreign)])
    read = scan.read._asdict()
    return LogInfo(
        scan.path,
        form,
        **read,
        header=header,
        problems=problems,
        unread=scan.unread,
        ours=scan.foreign is None,
    )


def salvage(path: str | Path) -> Iterator[Trial | TrialOutcomes]:
    """Read every complete trial of a file, even of a damaged one, and skip damaged parts.

    For a compact log, the function yields the outcomes in each message. If the last trial in the
    file has no outcome, it is yielded with its steps so far; its `ended` says so.

    Raises
    ------
    LogError
        The file or the folder does not exist.
    LogCorruptError
        The file has neither a header nor a trial.
    LogVersionError
        The file has another format version.
    """
    return Scan(path, tolerant=True).salvage()


def recover_log(path: str | Path, out: str | Path | None = None) -> Path:
    """Write the trials that `salvage` reads into a new file, and return the path of this file.

    The new file is `out`, or by default `<stem>.recovered.mcap` beside the damaged file. Its header
    is that of the damaged file, with the additional entry `recovered_from`. The damaged file does
    not change. Readers of a folder use the recovered file only if the log itself and its drafts are
    gone.

    Raises
    ------
    LogError
        `out` exists already, the file holds logs with different headers (as `cat` makes it), or
        `salvage` raises the error.
    """
    scan = Scan(path, tolerant=True)
    beside = scan.path.with_name(f"{stem_of(scan.path)}{RECOVERED}{SUFFIX}")
    out = beside if out is None else checked_path("The log", out)
    if out.exists():
        raise LogError(f"{out} exists already; remove it or name another file to recover into.")
    kinds = {type(entry) for entry in scan.salvage()}
    if not kinds:
        why = scan.problems[0] if scan.problems else "it is whole, and empty"
        raise LogCorruptError(f"{scan.path} holds no whole trial to recover: {why}.")
    (_, found), *others = scan.headers
    if other := next((place for place, header in others if header != found), 0):
        ways = (f"head -c {other}", "first.mcap"), (f"tail -c +{other + 1}", "second.mcap")
        cut = " and ".join(f"{command_line(way, scan.path)} > {name}" for way, name in ways)
        raise LogError(
            f"{scan.path} holds logs with different headers, and one header cannot describe the "
            f"trials of all; the next begins at byte {other}. Cut the file there ({cut}), and "
            "recover each part."
        )
    header = {**(found or {}), "recovered_from": scan.path.name}
    form = COMPACT if scan.builder.form == COMPACT or TrialOutcomes in kinds else FULL
    write_trials(out, salvage(scan.path), header=header, form=form)
    return out


@contextlib.contextmanager
def opened(path: Path) -> Iterator[BinaryIO]:
    """Open a file; turn every fault inside the block into our error with the name of the file."""
    try:
        with _open(path) as file:
            yield file
    except LogVersionError as fault:
        raise LogVersionError(f"{path} was {fault}.") from fault
    except FAULTS as fault:
        raise LogCorruptError(_torn_text(path, fault)) from fault
    except OSError as fault:
        raise LogError(f"{path} cannot be read: {fault}.") from fault


def _open(path: Path) -> BinaryIO:
    """Open a file; use its new name if another process renamed it since it was found."""
    try:
        return open_regular(path)
    except FileNotFoundError:
        return open_regular(find_log(path))


def _torn_text(path: Path, fault: Exception) -> str:
    """Say what is wrong with a file, or which program wrote it, and what to do."""
    try:
        return f"{path}: {fault_text(fault)}; {_mend_text(path, has_run=_has_run(path))}"
    except ForeignFileError as foreign:
        return f"{foreign.of(path)}."


def way_out(path: Path) -> str:
    """Say what to do about a torn file."""
    has_run = False
    with contextlib.suppress(ForeignFileError):
        has_run = _has_run(path)
    return _mend_text(path, has_run=has_run)


def _mend_text(path: Path, *, has_run: bool) -> str:
    """Say what to do about a file: where nothing of a run is left, nothing can be saved."""
    if has_run:
        return f"save its whole trials with: {command_line('meal-bayes log recover', path)}"
    return f"expected a {SUFFIX} file that meal_bayes wrote"


def _has_run(path: Path) -> bool:
    """Return whether a torn file begins as a log of ours; `ForeignFileError` where it is none."""
    check_size(path, path.stat().st_size)
    builder = TrialBuilder()
    try:
        with path.open("rb") as file:
            for record in read_records(file):
                next(builder.records(record), None)
                if builder.ours or builder.header is not None:
                    return True
    except ForeignFileError:
        raise
    except (*FAULTS, LogError):
        pass  # what came before it tells whose it is
    builder.check_topics()
    return False
