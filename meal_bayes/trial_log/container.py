"""The bytes of an MCAP file: records and messages with every checksum checked.

The library's readers trust lengths and leave some checksums unread; here a damaged length is
refused before memory is asked for, and a whole file has no byte that no checksum covers.
"""

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from typing import BinaryIO, NamedTuple

import zstandard
from google.protobuf.message import DecodeError
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Footer
from mcap.writer import MCAP0_MAGIC

from meal_bayes.errors import DomainError, LogCorruptError, QueryError, SettingsError
from meal_bayes.trial_log.schema import MESSAGE_LIMIT, RECORD_LIMIT

# What damaged bytes can raise on their way through the libraries and our constructors.
FAULTS = (
    LogCorruptError,
    McapError,
    zstandard.ZstdError,
    DecodeError,
    struct.error,
    ValueError,  # also UnicodeDecodeError, JSONDecodeError
    TypeError,
    LookupError,
    OverflowError,
    DomainError,
    QueryError,
    SettingsError,
)
FOOTER_SIZE = 29  # bytes of the footer record

HEAD = struct.Struct("<BQ")  # opcode, length
_MESSAGE_HEAD = 22  # bytes of a message record before its data
_CHANNEL_ID = struct.Struct("<H")
_FREE_BYTES, _UNPACKING = 64 << 20, 256  # that a file may unpack to, and so often its own size
_FREE_MESSAGES, _PACKED_MESSAGE = 10_000, 8  # of a file, and bytes of it that each more stands for
_CRC = struct.Struct("<I")


class Record(NamedTuple):
    """One record of the file."""

    offset: int
    opcode: int
    content: bytes


def read_records(file: BinaryIO, size: int) -> Iterator[Record]:
    """Yield the records of a file in order; raise `LogCorruptError` at the first fault.

    A file read to its end is whole: closing records, checksums of the data and of the
    summary section, nothing behind them.
    """
    magic = file.read(len(MCAP0_MAGIC))
    if not magic:
        raise LogCorruptError("the file is empty")
    if magic != MCAP0_MAGIC:
        raise LogCorruptError(f"not an MCAP file (it begins with {magic!r})")
    crc, summary_start = zlib.crc32(magic), 0
    while True:
        offset = file.tell()
        record = next_record(file, size)
        head = HEAD.pack(record.opcode, len(record.content))
        if record.opcode == Opcode.DATA_END:
            _compare("data section", crc, _CRC.unpack(record.content)[0])
            crc, summary_start = 0, file.tell()
        elif record.opcode == Opcode.FOOTER:
            _check_end(file, record, zlib.crc32(head, crc), summary_start)
            return
        else:
            crc = zlib.crc32(record.content, zlib.crc32(head, crc))
        yield Record(offset, record.opcode, record.content)


def read_summary(file: BinaryIO, size: int) -> Iterator[Record]:
    """Yield the records of the summary section of a whole file, found from its end."""
    end = size - FOOTER_SIZE - len(MCAP0_MAGIC)
    if end < len(MCAP0_MAGIC):
        raise LogCorruptError(f"the file ends after {size} bytes, without its closing records")
    file.seek(end)
    start = Footer.read(stream(next_record(file, size).content)).summary_start
    if not 0 < start <= end:
        raise LogCorruptError("the footer does not say where the summary begins")
    file.seek(start)
    crc = 0
    while True:
        record = next_record(file, size)
        head = HEAD.pack(record.opcode, len(record.content))
        if record.opcode == Opcode.FOOTER:
            _check_end(file, record, zlib.crc32(head, crc), start)
            return
        crc = zlib.crc32(record.content, zlib.crc32(head, crc))
        yield record


def read_attachment(record: Record) -> tuple[str, bytes]:
    """Return name and data of an attachment, which has a checksum of its own."""
    if record.opcode != Opcode.ATTACHMENT:
        raise LogCorruptError(f"a record of kind {record.opcode} stands where an attachment should")
    (crc,) = _CRC.unpack(record.content[-_CRC.size :])
    _compare("attachment", zlib.crc32(record.content[: -_CRC.size]), crc)
    found = Attachment.read(stream(record.content))
    return found.name, found.data


class Budget:
    """What the chunks of one file may ask for: a small file never unpacks into hours of work."""

    def __init__(self, size: int) -> None:
        self._bytes = _FREE_BYTES + _UNPACKING * size
        self._messages = _FREE_MESSAGES + size // _PACKED_MESSAGE

    def spend(self, unpacked: int = 0, messages: int = 0) -> None:
        """Subtract from what is left; raise `LogCorruptError` where nothing is."""
        self._bytes -= unpacked
        self._messages -= messages
        if self._bytes < 0 or self._messages < 0:
            raise LogCorruptError("the file unpacks to far more than a log of its size holds")


def chunk_messages(
    content: bytes, channels: dict[int, str], budget: Budget | None = None
) -> Iterator[tuple[str, bytes]]:
    """Yield topic and data of every message of a chunk; new channels go into `channels`.

    Parameters
    ----------
    budget : of the file; by default the chunk has one of its own.
    """
    budget = Budget(len(content)) if budget is None else budget
    data = _unpack(Chunk.read(stream(content)), budget)
    position = 0
    while position < len(data):
        opcode, length = HEAD.unpack_from(data, position)
        begin, position = position + HEAD.size, position + HEAD.size + length
        if position > len(data):
            raise LogCorruptError(f"a record of {length} bytes does not fit into its chunk")
        budget.spend(messages=1)
        if opcode == Opcode.MESSAGE:
            if not _MESSAGE_HEAD <= length <= _MESSAGE_HEAD + MESSAGE_LIMIT:
                raise LogCorruptError(f"a message record has {length} bytes")
            (channel,) = _CHANNEL_ID.unpack_from(data, begin)
            if channel not in channels:
                raise LogCorruptError(f"a message on channel {channel}, which does not exist")
            yield channels[channel], data[begin + _MESSAGE_HEAD : position]
        elif opcode == Opcode.CHANNEL:
            new = Channel.read(stream(data[begin:position]))
            channels[new.id] = new.topic
        elif opcode != Opcode.SCHEMA:
            raise LogCorruptError(f"a record of kind {opcode} stands inside a chunk")


def next_record(file: BinaryIO, size: int) -> Record:
    """Read the record that begins here; `size` is the file's, which bounds its length."""
    offset = file.tell()
    head = file.read(HEAD.size)
    if len(head) < HEAD.size:
        raise LogCorruptError(f"the file ends after {size} bytes, without its closing records")
    opcode, length = HEAD.unpack(head)
    if opcode == 0:  # of no record: a region that was never written, which may go on for terabytes
        raise LogCorruptError(f"nothing is written from byte {offset} on, of {size} bytes")
    if length > min(RECORD_LIMIT, size - file.tell()):
        raise LogCorruptError(f"the file ends inside a record of {length} bytes at byte {offset}")
    content = file.read(length)
    if len(content) < length:
        raise LogCorruptError(f"the file became shorter while it was read, at byte {offset}")
    return Record(offset, opcode, content)


def stream(content: bytes) -> ReadDataStream:
    """Return what the library reads a record from."""
    return ReadDataStream(BytesIO(content))


def _compare(what: str, found: int, expected: int) -> None:
    if found != expected:
        raise LogCorruptError(f"the {what} was changed (checksum {found}, expected {expected})")


def _check_end(file: BinaryIO, footer: Record, crc: int, summary_start: int) -> None:
    """Check footer and closing magic; `crc` covers the summary and the footer's head."""
    (expected,) = _CRC.unpack(footer.content[16:])
    _compare("summary section", zlib.crc32(footer.content[:16], crc), expected)
    if Footer.read(stream(footer.content)).summary_start != summary_start:
        raise LogCorruptError("the summary does not begin where the footer says")
    if file.read(len(MCAP0_MAGIC) + 1) != MCAP0_MAGIC:
        raise LogCorruptError("the file does not end with its closing bytes")


def _unpack(chunk: Chunk, budget: Budget) -> bytes:
    if chunk.compression != "zstd":
        raise LogCorruptError(f"a chunk is packed with {chunk.compression!r}, expected 'zstd'")
    size = zstandard.frame_content_size(chunk.data)
    if size != chunk.uncompressed_size or size > RECORD_LIMIT:
        raise LogCorruptError(f"a chunk of {chunk.uncompressed_size} bytes claims to unpack {size}")
    budget.spend(unpacked=size)
    data: bytes = zstandard.ZstdDecompressor().decompress(chunk.data, max_output_size=size)
    _compare("chunk", zlib.crc32(data), chunk.uncompressed_crc)
    return data
