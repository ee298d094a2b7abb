"""The flight recorder: everything the processes say, in MCAP files, written by a thread of its own.

:meth:`Recorder.write` only appends to a bounded queue: a full or vanished disk costs records,
counted and visible in :attr:`Recorder.trouble`, never time.  Chunks are small, so that whatever is
recorded is on its way to the disk within about a second; a file whose end is missing stays readable
up to its last chunk.
"""

from __future__ import annotations

import contextlib
import os
import re
import threading
from collections import Counter, deque
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Final, NamedTuple

import msgspec
from mcap.writer import CompressionType, IndexType, Writer

from firmware_py.recording import FORMAT, METADATA_NAME, TOPICS, Recordable, serialise, with_digest
from firmware_py.records import Block, CycleRecord, Record

QUEUE_RECORDS: Final = 20_000
"""Some 30 s of records at 10 kHz sampling; beyond it records are lost and counted."""

CHUNK_BYTES: Final = 16_384
FILES_KEPT: Final = 8
"""The allowance is spread over about this many files; the oldest goes first."""

METADATA_EVERY_BYTES: Final = 1 << 19
"""The head of the file is repeated after so much: a file whose first blocks are lost is still
replayed."""

DRAIN_PERIOD_S: Final = 0.05
RETRY_AFTER_S: Final = 2.0
_LAST_DAY_S: Final = 253_402_300_799.0
"""End of the year 9999."""


class _Ticketed(NamedTuple):
    ticket: int
    now_ns: int
    record: Recordable


class Recorder:
    """Writes records to ``directory`` in files ``orbitd-<name>-<number>-<UTC>.mcap``.

    The number grows with every file, across restarts too: it says which was written first when the
    calendar does not.

    Parameters
    ----------
    directory
        Made when absent.
    name
        Part of the file names; only files that are named by this recorder's rule are ever removed.
    metadata
        Text pairs for the head of each file (configuration, versions, models).
    max_bytes
        Allowance for all files of this name together.
    unix_ns
        The calendar's time, for file names.
    raw_frames
        Whether to keep the guard's cycles with all their frames (a replay needs them, and gets the
        blocks from them), or the blocks instead.

    Notes
    -----
    ``counters``: ``recorder_lost`` (records), ``recorder_failures`` (attempts that failed),
    ``recorder_not_removed`` (old files that could not be removed to make room).  ``trouble`` is
    empty, or the reason why nothing is being stored now.  What an error of the disk left unstored
    goes into the next file.
    """

    def __init__(
        self,
        directory: Path,
        name: str,
        metadata: Mapping[str, str],
        max_bytes: int,
        unix_ns: Callable[[], int],
        *,
        raw_frames: bool = True,
    ) -> None:
        self.counters: Counter[str] = Counter()
        self.trouble = ""
        self.stored = 0
        self._directory = directory
        self._name = name
        self._metadata = {**metadata, "format": FORMAT}
        self._names = re.compile(
            rf"orbitd-{re.escape(name)}-(?:(\d{{8,}})-)?\d{{8}}T\d{{6}}\.\d{{6}}Z\.mcap"
        )
        self._number = 0
        self._max_bytes = max_bytes
        self._unix_ns = unix_ns
        self._kept = set(TOPICS) - {Block if raw_frames else CycleRecord}
        self._ticket = 0
        self._queue: deque[_Ticketed] = deque()
        self._file: _McapFile | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    @property
    def path(self) -> Path | None:
        """The file being written, if any."""
        file = self._file
        return file.path if file else None

    def write(self, record: Recordable, now_ns: int) -> int:
        """Take ``record``; never waits.

        Returns
        -------
        Its ticket: the record is in the file once ``stored`` has reached it.  0 when it is not
        kept, or lost.
        """
        if type(record) not in self._kept:
            return 0
        if len(self._queue) >= QUEUE_RECORDS:
            self.counters["recorder_lost"] += 1
            return 0
        self._ticket += 1
        self._queue.append(_Ticketed(self._ticket, now_ns, record))
        return self._ticket

    def close(self) -> None:
        """Write what is queued and finish the file."""
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._stop.wait(DRAIN_PERIOD_S if not self.trouble else RETRY_AFTER_S):
            self._attempt(self._drain)
        self._attempt(self._drain)
        self._attempt(self._finish)

    def _attempt(self, work: Callable[[], None]) -> None:
        """Do ``work``; an error of the disk ends the present file and becomes visible."""
        try:
            work()
            self.trouble = ""
        except OSError as error:
            self.trouble = (
                f"{error.strerror or error} in {self._directory}; free or change the disk"
            )
            self.counters["recorder_failures"] += 1
            if self._file:
                self._queue.extendleft(reversed(self._file.abandon()))
            self._file = None

    def _drain(self) -> None:
        while self._queue:
            file = self._file or self._open()
            try:
                file.add(self._queue.popleft())
            except (ValueError, OverflowError):  # a number or text that no file can hold
                self.counters["recorder_lost"] += 1
            if file.size >= self._max_bytes // FILES_KEPT:
                self._finish()
        if self._file:
            self.stored = self._file.flush() or self.stored

    def _finish(self) -> None:
        if self._file:
            self.stored = self._file.finish() or self.stored
            self._file = None

    def _open(self) -> _McapFile:
        self._directory.mkdir(parents=True, exist_ok=True)
        self._make_room()
        while True:
            self._number += 1
            name = f"orbitd-{self._name}-{self._number:08d}-{_stamp(self._unix_ns())}.mcap"
            with contextlib.suppress(FileExistsError):
                self._file = _McapFile(self._directory / name, self._metadata)
                return self._file

    def _make_room(self) -> None:
        """Remove what was written first until a new file fits; the next number is above every one
        that is there.

        The number in a name says which file was written first, whatever the calendar was.  Names of
        before there were numbers come first, in their order.  What cannot be removed is not part of
        the allowance, counted.
        """
        found: list[tuple[int, str, int]] = []
        for entry in os.scandir(self._directory):
            matched = self._names.fullmatch(entry.name)
            if matched is None:
                continue
            number = int(matched[1] or 0)
            self._number = max(self._number, number)
            with contextlib.suppress(FileNotFoundError):
                if entry.is_file(follow_symlinks=False):
                    found.append((number, entry.name, entry.stat(follow_symlinks=False).st_size))
        total = sum(size for _, _, size in found)
        for _, file, size in sorted(found):
            if total <= self._max_bytes - self._max_bytes // FILES_KEPT:
                return
            total -= size
            try:
                (self._directory / file).unlink(missing_ok=True)
            except OSError:
                self.counters["recorder_not_removed"] += 1


def _stamp(unix_ns: int) -> str:
    """The calendar's time in a file name; a clock beyond what a calendar holds stands at its
    nearest end."""
    seconds = min(max(unix_ns * 1e-9, 0.0), _LAST_DAY_S)
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y%m%dT%H%M%S.%fZ")


class _McapFile:
    """One MCAP file while it is being written."""

    def __init__(self, path: Path, metadata: Mapping[str, str]) -> None:
        self.path = path
        self.size = 0
        self._stream: IO[bytes] = path.open("xb")
        self._unstored: deque[_Ticketed] = deque()
        self._complete = 0
        self._next_metadata = 0
        self._channels = {record_type: number for number, record_type in enumerate(TOPICS, 1)}
        topics = {str(number): TOPICS[kind].name for kind, number in self._channels.items()}
        self._metadata = with_digest({**metadata, "topics": msgspec.json.encode(topics).decode()})
        self._writer = Writer(
            self._stream,
            chunk_size=CHUNK_BYTES,
            compression=CompressionType.ZSTD,
            index_types=IndexType.CHUNK | IndexType.METADATA,
            enable_data_crcs=True,
        )
        try:
            self._begin()
        except OSError:
            self.abandon()
            raise

    def _begin(self) -> None:
        """Head of the file: metadata, schemas, channels in the order of their numbers."""
        self._writer.start(profile="orbitd", library="orbitd")
        self._repeat_metadata()
        for record_type in self._channels:
            self._register(record_type)

    def _register(self, record_type: type[Record]) -> None:
        topic = TOPICS[record_type]
        schema = self._writer.register_schema(
            record_type.__name__,
            "jsonschema",
            msgspec.json.encode(msgspec.json.schema(record_type)),
        )
        self._writer.register_channel(topic.name, topic.encoding, schema)

    def _repeat_metadata(self) -> None:
        self._writer.add_metadata(METADATA_NAME, self._metadata)
        self.size = self._stream.tell()
        self._next_metadata = self.size + METADATA_EVERY_BYTES

    def add(self, item: _Ticketed) -> None:
        """Append a record; when that completes a chunk, all records so far are in the stream."""
        data = serialise(item.record)
        self._unstored.append(item)
        self._writer.add_message(self._channels[type(item.record)], item.now_ns, data, item.now_ns)
        position = self._stream.tell()
        if position != self.size:
            self.size, self._complete = position, item.ticket
            if position >= self._next_metadata:
                self._repeat_metadata()

    def flush(self) -> int:
        """Hand completed chunks to the operating system; the last ticket in them."""
        self._stream.flush()
        while self._unstored and self._unstored[0].ticket <= self._complete:
            self._unstored.popleft()
        return self._complete

    def finish(self) -> int:
        """Write the last chunk, the head again and the summary, down to the disk; the last
        ticket."""
        self._writer.add_metadata(METADATA_NAME, self._metadata)
        self._writer.finish()
        self._stream.flush()
        os.fsync(self._stream.fileno())
        self._stream.close()
        return self._unstored[-1].ticket if self._unstored else self._complete

    def abandon(self) -> list[_Ticketed]:
        """Close after an error of the disk; the records that may not have reached it.  An empty
        file goes."""
        with contextlib.suppress(OSError):
            self._stream.close()
        if not self._complete:
            with contextlib.suppress(OSError):
                self.path.unlink()
        return list(self._unstored)
