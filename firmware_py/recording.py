"""The flight recording: which record lies on which MCAP topic, and how a file is read back.

Records that only programs read again (cycles, snapshots, blocks) are msgpack, exact to the bit; those that
people look at are JSON, so that any MCAP viewer shows them.  Log times are the host's monotonic nanoseconds;
one :class:`WallClock` a second ties them to the calendar.  The ``orbitd`` metadata record at the start of
each file holds the configuration text and the versions that made it.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Final, Literal, NamedTuple, TypeVar

import msgspec
import zstandard
from mcap.exceptions import EndOfFile, McapError
from mcap.records import Channel, McapRecord, Message, Metadata
from mcap.stream_reader import CRCValidationError, StreamReader
from mcap.writer import MCAP0_MAGIC

from firmware_py.errors import OrbitdError
from firmware_py.records import (
    Advice,
    Block,
    BrainState,
    CommandReply,
    CommandRequest,
    CommissionState,
    CycleRecord,
    Diagnosis,
    Event,
    Forecast,
    GuardState,
    Normal,
    Record,
    RigReading,
    RoomRecord,
    Snapshot,
    WindowRecord,
)

METADATA_NAME: Final = "orbitd"
FORMAT: Final = "1"
"""Version of this layout; a reader refuses another one."""


class WallClock(Record, frozen=True, tag=True):
    """The calendar's time at one monotonic instant."""

    t_ns: int
    unix_ns: int


Recordable = RoomRecord | WallClock


class Topic(NamedTuple):
    """Where one type of record lies in the file."""

    name: str
    encoding: Literal["msgpack", "json"]


TOPICS: Final[dict[type[Record], Topic]] = {
    CycleRecord: Topic("guard/cycle", "msgpack"),
    Snapshot: Topic("guard/snapshot", "msgpack"),
    Block: Topic("da/block", "msgpack"),
    RigReading: Topic("da/reading", "json"),
    GuardState: Topic("sd/state", "json"),
    Event: Topic("event", "json"),
    CommandRequest: Topic("cmd/request", "json"),
    CommandReply: Topic("cmd/reply", "json"),
    Diagnosis: Topic("ha/diagnosis", "json"),
    WindowRecord: Topic("ha/window", "json"),
    Forecast: Topic("pa/forecast", "json"),
    Advice: Topic("ag/advice", "json"),
    BrainState: Topic("ha/state", "json"),
    CommissionState: Topic("ha/commission", "json"),
    Normal: Topic("ha/normal", "msgpack"),
    WallClock: Topic("clock", "json"),
}

_to_msgpack = msgspec.msgpack.Encoder().encode
_to_json = msgspec.json.Encoder().encode


def serialise(record: Record) -> bytes:
    """Message bytes of ``record`` in the encoding of its topic."""
    return _to_msgpack(record) if TOPICS[type(record)].encoding == "msgpack" else _to_json(record)


class RecordingError(OrbitdError):
    """The file is no recording of ours; the text says why and what to do."""

    exit_code = 2


class Stored(NamedTuple):
    """One message of a recording."""

    topic: str
    t_ns: int
    data: bytes


class Recording:
    """A recording on disk, read front to back, so that an interrupted one is as good as a finished one.

    Parameters
    ----------
    path
        MCAP file.

    Raises
    ------
    RecordingError
        The file cannot be read, is not MCAP, or does not start with our metadata.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.interrupted = False
        self.metadata = self._read_metadata()

    def messages(self) -> Iterator[Stored]:
        """Every stored message in the order of writing; ``interrupted`` is set when the end is missing."""
        topics: dict[int, str] = {}
        for record in self._records():
            if isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Message):
                yield Stored(topics[record.channel_id], record.log_time, record.data)

    def _read_metadata(self) -> dict[str, str]:
        for record in self._records():
            if isinstance(record, Metadata) and record.name == METADATA_NAME:
                found = dict(record.metadata)
                if found.get("format") != FORMAT:
                    raise RecordingError(f"{self.path.name}: format {found.get('format')}, this program reads "
                                         f"{FORMAT}; use the orbitd {found.get('orbitd')} that wrote it")
                return found
        raise RecordingError(f"{self.path.name}: no '{METADATA_NAME}' metadata; give a file that orbitd recorded")

    def _is_finished(self) -> bool:
        """Whether the closing magic is there."""
        with self.path.open("rb") as stream:
            stream.seek(-min(len(MCAP0_MAGIC), self.path.stat().st_size), os.SEEK_END)
            return bool(stream.read() == MCAP0_MAGIC)

    def _records(self) -> Iterator[McapRecord]:
        try:
            with self.path.open("rb") as stream:
                yield from StreamReader(_WholeReads(stream, self.path), validate_crcs=True).records
        except EndOfFile as error:
            if self._is_finished():
                raise RecordingError(f"{self.path.name}: damaged MCAP file (a length points past its end); "
                                     "use another recording") from error
            self.interrupted = True
        except (McapError, CRCValidationError, zstandard.ZstdError, struct.error, ValueError) as error:
            raise RecordingError(f"{self.path.name}: damaged MCAP file ({error!r}); nothing after the damage "
                                 "can be trusted, use another recording") from error
        except OSError as error:
            raise RecordingError(f"{self.path}: cannot be read ({error.strerror}); give the path of a "
                                 "recording") from error


class _WholeReads:
    """A stream that ends instead of giving less than was asked for: half a chunk is no chunk."""

    def __init__(self, stream: IO[bytes], path: Path) -> None:
        self._stream = stream
        self._left = path.stat().st_size

    def read(self, size: int) -> bytes:
        if size > self._left:
            raise EndOfFile
        self._left -= size
        return self._stream.read(size)


T = TypeVar("T", bound=Record)


def decode_exact(stored: Stored, record_type: type[T]) -> T:
    """The record in a message of a msgpack topic."""
    return msgspec.msgpack.decode(stored.data, type=record_type)
