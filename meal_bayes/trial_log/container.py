"""The records and messages of an MCAP file, with every checksum checked.

The library checks chunks and the data section; this adds the closing records, and that a damaged
length is refused before memory is asked for.
"""

import os
import struct
import zlib
from collections.abc import Iterator, MutableMapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, BinaryIO

import lz4.frame
import zstandard
from google.protobuf.message import DecodeError
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode
from mcap.reader import FOOTER_SIZE
from mcap.records import Channel, Chunk, Footer, McapRecord, Message
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC

from meal_bayes.errors import DomainError, LogCorruptError, LogError, QueryError, SettingsError
from meal_bayes.trial_log.foreign import ForeignFileError
from meal_bayes.trial_log.schema import MESSAGE_LIMIT, RECORD_LIMIT

# What damaged bytes can raise on their way through the libraries and our constructors.
FAULTS = (
    LogCorruptError,
    McapError,
    zstandard.ZstdError,
    RuntimeError,  # of lz4
    DecodeError,
    struct.error,
    ValueError,  # also UnicodeDecodeError, JSONDecodeError, CRCValidationError
    TypeError,
    LookupError,
    OverflowError,
    DomainError,
    QueryError,
    SettingsError,
)
TORN = (EndOfFile, struct.error)  # raised where the file ends inside a record
CUT_SHORT = "the file ends before its closing records"  # what is said of these
_SEARCHED = 16  # blocks of the record limit
_HEAD = 9  # bytes of a record before its content
_CRC = 4  # bytes of a checksum


def read_records(file: BinaryIO, *, begin: int = 0) -> Iterator[McapRecord]:
    """Yield the records of a log that begins where the file stands; raise at the first fault.

    Chunks come as they are. `begin` is 0, or the place of a later record in the file's only log. A
    file that was read to its end is whole.
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
    """Return the place of the first log that begins at this byte or soon after, or the file's end.

    The search ends after 256 MB: a hole in a file may be terabytes long.
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
            channels[record.id] = record.topic
        elif isinstance(record, Message):
            yield message_of(record, channels)


def message_of(record: Message, channels: MutableMapping[int, str]) -> tuple[str, bytes]:
    """Return topic and data of a message; one that is too large, or of no channel, is refused."""
    if record.channel_id not in channels or len(record.data) > MESSAGE_LIMIT:
        raise LogCorruptError(f"{len(record.data)} bytes on channel {record.channel_id}")
    return channels[record.channel_id], record.data


def _unpacked(chunk: Chunk) -> bytes:
    """Unpack a chunk, whose size is what it declares, within the limit."""
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
    """Check the records behind the data section, which the library leaves unchecked."""
    end -= len(MCAP0_MAGIC)
    file.seek(max(end - FOOTER_SIZE + _HEAD, 0))
    footer = Footer.read(ReadDataStream(file))
    crc = None
    if 0 < footer.summary_start < end - origin:
        file.seek(origin + footer.summary_start)
        crc = zlib.crc32(file.read(end - _CRC - origin - footer.summary_start))
    if footer.summary_crc not in (0, crc):  # 0: its writer left it out
        raise LogCorruptError("the closing records were changed, or are not there")
