"""The records and messages of an MCAP file, with every checksum checked.

The library checks chunks and the data section; this adds the closing records, and that a damaged
length is refused before memory is asked for.
"""

import os
import struct
import zlib
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any, BinaryIO

import zstandard
from google.protobuf.message import DecodeError
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError
from mcap.reader import FOOTER_SIZE
from mcap.records import Channel, Chunk, Footer, McapRecord, Message
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC

from meal_bayes.errors import DomainError, LogCorruptError, LogError, QueryError, SettingsError
from meal_bayes.trial_log.schema import MESSAGE_LIMIT, RECORD_LIMIT

# What damaged bytes can raise on their way through the libraries and our constructors.
FAULTS = (
    LogCorruptError,
    McapError,
    zstandard.ZstdError,
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
_HEAD = 9  # bytes of a record before its content
_CRC = 4  # bytes of a checksum


def read_records(file: BinaryIO, *, begin: int = 0) -> Iterator[McapRecord]:
    """Yield the records of a file from `begin` on, where it stands; raise at the first fault.

    Chunks come as they are. A file that was read from 0 to its end is whole.
    """

    def read(size: int) -> bytes:
        """Read no more than a record holds; the library reads one byte where a record begins."""
        if size > RECORD_LIMIT:
            raise LogCorruptError(f"a record claims to hold {size} bytes")
        data = file.read(size)
        if size == 1 and data == b"\0":  # it would be read as empty records, for terabytes perhaps
            raise LogCorruptError(f"nothing is written from byte {file.tell() - 1} on")
        return data

    bounded: Any = SimpleNamespace(read=read)  # it calls nothing else
    yield from StreamReader(
        bounded,
        skip_magic=begin > 0,
        emit_chunks=True,
        validate_crcs=True,
        record_size_limit=RECORD_LIMIT,
    ).records
    _check_summary(file)


def chunk_messages(chunk: Chunk, channels: dict[int, str]) -> Iterator[tuple[str, bytes]]:
    """Yield topic and data of every message of a chunk; new channels go into `channels`."""
    size = zstandard.frame_content_size(chunk.data)  # what the library would allocate
    if chunk.compression != "zstd" or not size == chunk.uncompressed_size <= RECORD_LIMIT:
        raise LogCorruptError(f"a chunk of {chunk.uncompressed_size} bytes claims to unpack {size}")
    for record in breakup_chunk(chunk, validate_crc=True):
        if isinstance(record, Channel):
            channels[record.id] = record.topic
        elif isinstance(record, Message):
            if record.channel_id not in channels or len(record.data) > MESSAGE_LIMIT:
                channel = record.channel_id
                raise LogCorruptError(f"{len(record.data)} bytes on channel {channel}")
            yield channels[record.channel_id], record.data


def fault_text(fault: Exception) -> str:
    """Return a fault in words."""
    if isinstance(fault, TORN):
        return "the file ends before its closing records"
    return str(fault) if isinstance(fault, LogError) else f"{type(fault).__name__}: {fault}"


def _check_summary(file: BinaryIO) -> None:
    """Check the records behind the data section, which the library leaves unchecked."""
    end = file.seek(0, os.SEEK_END) - len(MCAP0_MAGIC)
    file.seek(max(end - FOOTER_SIZE + _HEAD, 0))
    footer = Footer.read(ReadDataStream(file))
    crc = None
    if 0 < footer.summary_start < end:
        file.seek(footer.summary_start)
        crc = zlib.crc32(file.read(end - _CRC - footer.summary_start))
    if crc != footer.summary_crc:
        raise LogCorruptError("the closing records were changed, or are not there")
