"""The flight recording: which record lies on which MCAP topic, and how a file is read back.

Records that only programs read again (cycles, snapshots, blocks) are msgpack, exact to the bit;
those that people look at are JSON, so that any MCAP viewer shows them.  Log times are the host's
monotonic nanoseconds; one :class:`WallClock` a second ties them to the calendar.  The ``orbitd``
metadata record at the start of each file, repeated on the way and at its end, holds the
configuration and the versions that made it.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final, Literal, NamedTuple, TypeVar

import msgspec
from mcap.records import Channel, Message, Metadata

from firmware_py import signals
from firmware_py.errors import OrbitdError
from firmware_py.mcap_scan import Content, End, Skipped, scan
from firmware_py.records import (
    Advice,
    Block,
    BrainSnapshot,
    BrainState,
    BrainStep,
    CommandReply,
    CommandRequest,
    CommissionState,
    CycleRecord,
    Diagnosis,
    Event,
    Forecast,
    GuardState,
    ModelsInUse,
    Normal,
    PeerRecord,
    Record,
    RigReading,
    ShadowDiagnosis,
    Snapshot,
    WindowRecord,
)

METADATA_NAME: Final = "orbitd"
FORMAT: Final = "1"
"""Version of this layout; a reader refuses another one."""
NOTES_MAX: Final = 20
"""Damaged places of a recording that are named one by one."""


class WallClock(Record, frozen=True, tag=True):
    """The calendar's time at one monotonic instant."""

    t_ns: int
    unix_ns: int


Recordable = PeerRecord | WallClock


class Topic(NamedTuple):
    """Where one type of record lies in the file."""

    name: str
    encoding: Literal["msgpack", "json"]


_RECORDS: Final[tuple[type[Record], ...]] = (
    CycleRecord,
    Snapshot,
    Block,
    RigReading,
    GuardState,
    Event,
    CommandRequest,
    CommandReply,
    Diagnosis,
    WindowRecord,
    Forecast,
    Advice,
    BrainState,
    CommissionState,
    Normal,
    WallClock,
    BrainStep,
    BrainSnapshot,
    ShadowDiagnosis,
    ModelsInUse,
)
_ROWS: Final = {row.record: row for row in signals.STREAMS}

TOPICS: Final[dict[type[Record], Topic]] = {
    kind: Topic(_ROWS[kind.__name__].topic, _ROWS[kind.__name__].encoding) for kind in _RECORDS
}
"""Where each record lies, by :data:`firmware_py.signals.STREAMS`."""

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
    """A recording on disk, read front to back; what is whole in a damaged or interrupted one is as
    good as ever.

    Parameters
    ----------
    path
        MCAP file.

    Attributes
    ----------
    interrupted
        The end is missing; known once the messages were read.
    damage
        What the last reading of the messages passed over.

    Raises
    ------
    RecordingError
        The file cannot be read, or no whole record of our metadata is in it.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.interrupted = False
        self.damage = Damage()
        self.metadata = self._read_metadata()
        self._topics = self._read_topics()

    def messages(self) -> Iterator[Stored]:
        """Every whole message in the order of writing.

        Raises
        ------
        RecordingError
            The file cannot be read.
        """
        self.damage = damage = Damage()
        for item in self._scanned():
            if isinstance(item, Message):
                damage.resume(item.log_time)
                topic = self._topics.get(item.channel_id)
                if topic is None:
                    damage.messages_without_topic += 1
                else:
                    yield Stored(topic, item.log_time, item.data)
            elif isinstance(item, Skipped):
                damage.add(item)
            elif isinstance(item, Metadata) and item.metadata != self.metadata:
                if _is_ours(item):
                    damage.note(
                        f"another recording follows in the same file: left out "
                        f"({item.metadata.get('orbitd')})"
                    )
                    return
                damage.note("a copy of the configuration is damaged")
            elif isinstance(item, End):
                self.interrupted = not item.finished

    def _read_metadata(self) -> dict[str, str]:
        """The first copy that is proven; a file of before the digest gives the first that is
        there."""
        unproven: dict[str, str] | None = None
        for item in self._scanned():
            if isinstance(item, Metadata) and _is_ours(item):
                return self._of_this_format(dict(item.metadata))
            if unproven is None and isinstance(item, Metadata) and _is_old(item):
                unproven = dict(item.metadata)
        if unproven is None:
            raise RecordingError(
                f"{self.path.name}: no MCAP file, or damaged all through: no whole "
                f"'{METADATA_NAME}' "
                "metadata is in it; give a file that orbitd recorded"
            )
        return self._of_this_format(unproven)

    def _of_this_format(self, found: dict[str, str]) -> dict[str, str]:
        if found.get("format") != FORMAT:
            raise RecordingError(
                f"{self.path.name}: format {found.get('format')}, this program reads {FORMAT}; use "
                f"the orbitd {found.get('orbitd')} that wrote it"
            )
        return found

    def _read_topics(self) -> dict[int, str]:
        """Topic of every channel number; files of before this stood in the metadata are searched
        for it."""
        if "topics" in self.metadata:
            with contextlib.suppress(msgspec.DecodeError):
                return msgspec.json.decode(self.metadata["topics"], type=dict[int, str])
        return {item.id: item.topic for item in self._scanned() if isinstance(item, Channel)}

    def _scanned(self) -> Iterator[Content | Skipped | End]:
        try:
            yield from scan(self.path, METADATA_NAME)
        except OSError as error:
            raise RecordingError(
                f"{self.path}: cannot be read ({error.strerror}); give the path of a recording"
            ) from error


class Damage:
    """What a reading of a recording passed over, for people; at most :data:`NOTES_MAX` places are
    named."""

    def __init__(self) -> None:
        self.places = 0
        self.skipped_bytes = 0
        self.messages_without_topic = 0
        self._notes: list[str] = []
        self._first_ns: int | None = None
        self._last_ns: int | None = None
        self._open = ""

    def add(self, skipped: Skipped) -> None:
        """Take a place that was skipped; its time span is known at the next message."""
        self._close("the end")
        self.places += 1
        self.skipped_bytes += skipped.end - skipped.start
        self._open = (
            f"bytes {skipped.start} to {skipped.end} skipped ({skipped.cause}), "
            f"from {self._after(self._last_ns)} to "
        )

    def resume(self, t_ns: int) -> None:
        """A message that is whole was written at ``t_ns``."""
        self._first_ns = t_ns if self._first_ns is None else self._first_ns
        self._last_ns = t_ns
        if self._open:
            self._close(self._after(t_ns))

    def note(self, text: str) -> None:
        """Keep ``text`` for the report."""
        if len(self._notes) < NOTES_MAX:
            self._notes.append(text)

    @property
    def notes(self) -> list[str]:
        """Every place with its cause and the time that is missing, in the order of the file."""
        self._close("the end")
        more = [f"and {self.places - NOTES_MAX} places more"] if self.places > NOTES_MAX else []
        lost = self.messages_without_topic
        return [
            *self._notes,
            *more,
            *([f"{lost} messages of an unknown channel left out"] if lost else []),
        ]

    def _close(self, until: str) -> None:
        if self._open:
            self.note(self._open + until)
            self._open = ""

    def _after(self, t_ns: int | None) -> str:
        if t_ns is None or self._first_ns is None:
            return "the start"
        return f"{(t_ns - self._first_ns) * 1e-9:.3f} s"


def with_digest(pairs: Mapping[str, str]) -> dict[str, str]:
    """Metadata with a digest of all its pairs: MCAP protects only chunks."""
    return {**pairs, "digest": _digest(pairs)}


def _digest(pairs: Mapping[str, str]) -> str:
    every = sorted((key, value) for key, value in pairs.items() if key != "digest")
    return hashlib.sha256(msgspec.json.encode(every)).hexdigest()


def _is_ours(record: Metadata) -> bool:
    """Whether ``record`` is a whole head of a recording."""
    return bool(
        record.name == METADATA_NAME and record.metadata.get("digest") == _digest(record.metadata)
    )


def _is_old(record: Metadata) -> bool:
    """Whether ``record`` may be the head of a recording of before the digest."""
    return bool(record.name == METADATA_NAME and "digest" not in record.metadata)


T = TypeVar("T", bound=Record)


def decode_exact(stored: Stored, record_type: type[T]) -> T:
    """The record in a message.

    Raises
    ------
    RecordingError
        Another version wrote it, and this one does not know its fields.
    """
    decode = (
        msgspec.msgpack.decode if TOPICS[record_type].encoding == "msgpack" else msgspec.json.decode
    )
    try:
        return decode(stored.data, type=record_type)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise RecordingError(
            f"a {record_type.__name__} in the recording does not fit this version ({error}); use "
            f"the "
            "orbitd that wrote it"
        ) from error
