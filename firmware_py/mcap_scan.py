"""Reads an MCAP file front to back and goes on behind damage: zeros, holes, flipped bits, junk, a
missing end.

What is given out has been proven: the chunk passed its CRC.  After a place that is not whole, the
scan searches the next whole chunk or metadata record, and tells what it passed over.  It never goes
back, and it holds one chunk at a time: time grows with the length of the file, memory does not.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import IO, Final, NamedTuple, TypeAlias

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.records import Channel, Message, Metadata
from mcap.writer import MCAP0_MAGIC

MAGIC: Final = bytes(MCAP0_MAGIC)
CHUNK_BYTES_MAX: Final = 16 << 20
"""Largest chunk or record that is read, stored or unpacked.  The recorder's chunks have 16 KiB and
one record."""
SEARCHED_PER_BYTE: Final = 16
"""Bytes of false starts that a search may read for each byte of the file: bytes made to mislead
cannot hold it up."""

_HEAD: Final = struct.Struct("<BQ")
_MESSAGE_HEAD: Final = struct.Struct("<HIQQ")
_CHUNK: Final = struct.Struct("<QQQI")
_LENGTH: Final = struct.Struct("<Q")
_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK_OP, _INDEX, _METADATA, _DATA_END = (
    1,
    2,
    3,
    4,
    5,
    6,
    7,
    12,
    15,
)
_KNOWN: Final = range(1, 16)
_BLOCK: Final = 1 << 20
_ZSTD: Final = b"\x04\0\0\0zstd"
_ZSTD_AT: Final = _HEAD.size + _CHUNK.size
_UNREADABLE: Final = (
    McapError,
    zstandard.ZstdError,
    struct.error,
    ValueError,
    OverflowError,
    MemoryError,
)
"""What bytes that are no record raise while they are read as one."""

Content: TypeAlias = Channel | Message | Metadata


class Skipped(NamedTuple):
    """Bytes ``start`` to ``end`` of the file that are not whole, and why."""

    start: int
    end: int
    cause: str


class End(NamedTuple):
    """The scan is over; ``finished`` says that the file was closed properly."""

    finished: bool


class _Damage(Exception):
    """The record here is not whole; the text says why."""


def scan(path: Path, metadata_name: str) -> Iterator[Content | Skipped | End]:
    """Channels, messages and metadata that are whole, in order of writing; what was skipped; the
    end.

    Parameters
    ----------
    path
        The file.
    metadata_name
        Name of the metadata record that the search may go on from.

    Raises
    ------
    OSError
        The file cannot be read.
    """
    with path.open("rb") as stream:
        yield from _Scan(stream, path.stat().st_size, metadata_name).run()


class _Scan:
    def __init__(self, stream: IO[bytes], size: int, metadata_name: str) -> None:
        self._stream = stream
        self._size = size
        name = metadata_name.encode()
        self._search_left = SEARCHED_PER_BYTE * size
        self._metadata = len(name).to_bytes(4, "little") + name

    def run(self) -> Iterator[Content | Skipped | End]:
        at = 0
        if self._bytes(0, len(MAGIC)) == MAGIC:
            at = len(MAGIC)
        elif self._size:
            yield Skipped(0, at := self._next_whole(0), "no MCAP file starts here")
        summary = False
        while at < self._size:
            try:
                opcode, content = self._record(at, summary)
                found = self._contents(opcode, content)
            except _Damage as damage:
                onward = self._next_whole(at + 1)
                yield Skipped(at, onward, str(damage))
                at = onward
                continue
            yield from found
            at += _HEAD.size + len(content)
            summary |= opcode == _DATA_END
            if opcode == _FOOTER:
                finished = self._bytes(at, len(MAGIC)) == MAGIC
                after = at + (len(MAGIC) if finished else 0)
                if after < self._size:
                    yield Skipped(after, self._size, "bytes after the end of the recording")
                yield End(finished)
                return
        yield End(False)

    def _bytes(self, at: int, size: int) -> bytes:
        self._stream.seek(at)
        return self._stream.read(size)

    def _record(self, at: int, summary: bool) -> tuple[int, bytes]:
        """Operation code and content of the record at ``at``.

        Raises
        ------
        _Damage
            No record that a recorder writes there.
        """
        head = self._bytes(at, _HEAD.size)
        if len(head) < _HEAD.size:
            raise _Damage("the file ends within a record")
        opcode, length = _HEAD.unpack(head)
        expected = (
            opcode in _KNOWN
            if summary
            else opcode in (_HEADER, _CHUNK_OP, _INDEX, _METADATA, _DATA_END)
        )
        if not expected:
            raise _Damage("zeros" if not any(head) else "no record starts here")
        if length > self._size - at - _HEAD.size:
            raise _Damage("a record reaches past the end of the file")
        if length > CHUNK_BYTES_MAX:
            raise _Damage(f"a record of {length} bytes, at most {CHUNK_BYTES_MAX} are read")
        return opcode, self._stream.read(length)

    def _contents(self, opcode: int, content: bytes) -> list[Content]:
        """What the record holds for a reader.

        Raises
        ------
        _Damage
            It is not whole.
        """
        try:
            if opcode == _CHUNK_OP:
                return _messages(_unpacked(content))
            if opcode == _METADATA:
                return [_whole(Metadata, content)]
            if opcode == _CHANNEL:
                return [_whole(Channel, content)]
        except _UNREADABLE as error:
            raise _Damage(f"a damaged record ({type(error).__name__})") from error
        if (opcode == _HEADER and not _two_strings(content)) or (
            opcode == _DATA_END and len(content) != 4
        ):
            raise _Damage("a damaged record")
        return []

    def _next_whole(self, at: int) -> int:
        """Where the next whole chunk or metadata record starts at or after ``at``; the file's size
        without one."""
        overlap = _ZSTD_AT + len(_ZSTD) + len(self._metadata)
        while at < self._size and self._search_left > 0:
            block = self._bytes(at, _BLOCK + overlap)
            starts = {
                place - back
                for mark, back in ((_ZSTD, _ZSTD_AT), (self._metadata, _HEAD.size))
                for place in _places(block, mark)
            }
            for start in sorted(place for place in starts if 0 <= place < _BLOCK):
                if block[start] in (_CHUNK_OP, _METADATA) and self._is_whole(at + start):
                    return at + start
            at += _BLOCK
        return self._size

    def _is_whole(self, at: int) -> bool:
        try:
            opcode, content = self._record(at, summary=False)
            self._search_left -= len(content)
            if self._search_left < 0:
                return False
            self._contents(opcode, content)
        except _Damage:
            return False
        self._search_left += len(content)
        return True


def _places(block: bytes, mark: bytes) -> Iterator[int]:
    place = block.find(mark)
    while place >= 0:
        yield place
        place = block.find(mark, place + 1)


def _unpacked(content: bytes) -> bytes:
    """The records of a chunk, proven by its CRC."""
    _, _, size, crc = _CHUNK.unpack_from(content)
    name_end = _CHUNK.size + 4 + int.from_bytes(content[_CHUNK.size : _CHUNK.size + 4], "little")
    compression = content[_CHUNK.size + 4 : name_end]
    (stored,) = _LENGTH.unpack_from(content, name_end)
    data = content[name_end + _LENGTH.size :]
    if stored != len(data) or size > CHUNK_BYTES_MAX:
        raise ValueError("lengths")
    if compression == b"zstd":
        if zstandard.frame_content_size(data) not in (-1, size):
            raise ValueError("length of the zstd frame")
        data = zstandard.ZstdDecompressor().decompress(data, max_output_size=size)
    elif compression:
        raise ValueError("compression")
    if len(data) != size or (crc and zlib.crc32(data) != crc):
        raise ValueError("CRC")
    return data


def _messages(data: bytes) -> list[Content]:
    """Channels and messages in the records of a chunk."""
    found: list[Content] = []
    at = 0
    while at < len(data):
        opcode, length = _HEAD.unpack_from(data, at)
        start, at = at + _HEAD.size, at + _HEAD.size + length
        if at > len(data) or opcode not in (_SCHEMA, _CHANNEL, _MESSAGE):
            raise ValueError("a record in the chunk")
        if opcode == _CHANNEL:
            found.append(_whole(Channel, data[start:at]))
        elif opcode == _MESSAGE:
            channel, sequence, log_ns, publish_ns = _MESSAGE_HEAD.unpack_from(data, start)
            body = data[start + _MESSAGE_HEAD.size : at]
            found.append(Message(channel, log_ns, body, publish_ns, sequence))
    return found


def _whole(kind: type[Channel] | type[Metadata], content: bytes) -> Channel | Metadata:
    """The record of ``kind`` that fills ``content`` exactly."""
    stream = BytesIO(content)
    record = kind.read(ReadDataStream(stream))
    if stream.tell() != len(content):
        raise ValueError("length")
    return record


def _two_strings(content: bytes) -> bool:
    """Whether two strings, each behind its length, fill ``content``: the file's header."""
    first = 4 + int.from_bytes(content[:4], "little")
    return len(content) == first + 4 + int.from_bytes(content[first : first + 4], "little")
