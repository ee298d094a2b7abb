"""What the guard remembers over its own death: latched trips, running danger timers, and how it was
started.

Three files in its state folder, each JSON: ``trips.json`` (names), ``starts.json`` and
``timers.json``.  Times are ``CLOCK_BOOTTIME`` (starts) and ``CLOCK_MONOTONIC`` (timers) beside the
id of the host's boot: no calendar is asked. How long the guard was away does not count as danger:
nobody saw it.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Final, TypeVar

import msgspec
from msgspec import Meta

from firmware_py.guard.process.small_file import FileWriter, SmallFileError, read_small
from firmware_py.guard.protection.permit import RESTART_WINDOW_NS, UNREADABLE, Start

TRIPS, STARTS, TIMERS = "trips.json", "starts.json", "timers.json"

BOOT_VARIABLE: Final = "ORBITD_BOOT_ID"
BOOT_FILE: Final = Path("/proc/sys/kernel/random/boot_id")

TIMER_PERIOD_NS: Final = 100_000_000
"""Running timers are handed to the disk at most so often; with the disk's own time a crash forgets
some 0.2 s."""

START_WAIT_S: Final = 0.2
"""A start waits at most so long for its own record to be on the disk."""

TIMER_AGE_MAX_NS: Final = 120_000_000_000
"""Older ones are forgotten: what happened in between is not known."""

AlarmName = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_/]{1,64}\Z")]
"""Channels, and so their alarms, may be named in capitals."""
Names = Annotated[list[AlarmName], Meta(max_length=64)]

T = TypeVar("T")


class StartRecord(msgspec.Struct):
    """``starts.json``: ``running`` until the guard is told to stop."""

    boot: str
    started_ns: int
    running: bool
    restarts_ns: Annotated[list[int], Meta(max_length=64)] = []
    barred: bool = False


class TimerRecord(msgspec.Struct):
    """``timers.json``: how long each danger limit had been exceeded at ``t_ns``, its delay not yet
    over."""

    boot: str
    t_ns: int
    over_ns: Annotated[dict[AlarmName, Annotated[int, Meta(ge=0)]], Meta(max_length=64)]


def boot_id() -> str:
    """Id of this boot of the host; empty when it is not told (then only the clock tells boots
    apart)."""
    if given := os.environ.get(BOOT_VARIABLE):
        return given.replace("-", "")
    try:
        return BOOT_FILE.read_text(encoding="ascii").strip().replace("-", "")
    except (OSError, UnicodeDecodeError):
        return ""


def begin(before: StartRecord | None, boot: str, now_ns: int) -> StartRecord:
    """The record of a run that begins at ``now_ns`` (``CLOCK_BOOTTIME``) after ``before``.

    A *restart* is a start in the same boot of the host after a run that nobody told to stop; every
    other start is cold.  The second restart within :data:`RESTART_WINDOW_NS` bars the permit, over
    cold starts and boots as well.
    """
    if before is None:
        return StartRecord(boot, now_ns, running=True)
    same_boot = before.boot == boot and before.started_ns <= now_ns
    restarts = [t for t in before.restarts_ns if same_boot and 0 <= now_ns - t < RESTART_WINDOW_NS]
    if same_boot and before.running:
        restarts.append(now_ns)
    return StartRecord(boot, now_ns, True, restarts[-8:], before.barred or len(restarts) >= 2)


class Memory:
    """The three files of one guard.

    Parameters
    ----------
    directory
        The guard's state folder.
    prepare
        Called once in the writing thread, for its priority.
    boot, boottime_ns, monotonic_ns
        Id of the boot and the two clocks.

    Attributes
    ----------
    latched, timers, start
        What the run before has left.
    complaints
        What could not be read, for the log.
    """

    def __init__(
        self,
        directory: Path,
        prepare: Callable[[], None] = lambda: None,
        *,
        boot: str | None = None,
        boottime_ns: int | None = None,
        monotonic_ns: int | None = None,
    ) -> None:
        self._boot = boot_id() if boot is None else boot
        self._folder = directory
        self._writer = FileWriter(prepare=prepare)
        self.complaints: list[str] = []
        now_ns = time.clock_gettime_ns(time.CLOCK_BOOTTIME) if boottime_ns is None else boottime_ns
        self.latched = self._read_trips()
        self.timers = self._read_timers(
            time.monotonic_ns() if monotonic_ns is None else monotonic_ns
        )
        self._record = self._begin(now_ns)
        self.start = Start(
            bool(self._record.restarts_ns) and self._record.restarts_ns[-1] == now_ns,
            self._record.barred,
        )
        self._trips_kept: list[str] | None = None
        self._timers_kept: dict[str, int] = dict(self.timers)
        self._timers_ns = 0

    @property
    def fault(self) -> str:
        """Why the last write failed; empty when it did not."""
        return self._writer.fault

    @property
    def failures(self) -> int:
        """Failed writes."""
        return self._writer.failures

    def note(
        self, now_ns: int, tripped: list[str], timers: dict[str, int], barred: bool, probation: bool
    ) -> None:
        """Keep what differs from what was kept last; returns at once.

        Once neither ``barred`` nor on ``probation`` (a person has looked, or 10 min are over)
        restarts count anew.
        """
        if tripped != self._trips_kept:
            self._trips_kept = list(tripped)
            self._keep(TRIPS, self._trips_kept)
        if timers != self._timers_kept and now_ns - self._timers_ns >= TIMER_PERIOD_NS:
            self._timers_kept, self._timers_ns = dict(timers), now_ns
            self._keep(TIMERS, TimerRecord(self._boot, now_ns, self._timers_kept))
        if (self._record.barred or self._record.restarts_ns) and not barred and not probation:
            self._record.barred, self._record.restarts_ns = False, []
            self._keep(STARTS, self._record)

    def close(self) -> None:
        """The guard was told to stop: the next start is a cold one."""
        self._record.running = False
        self._keep(STARTS, self._record)
        self._writer.close()

    def _keep(self, name: str, content: object) -> None:
        self._writer.keep(self._folder / name, msgspec.json.encode(content))

    def _begin(self, now_ns: int) -> StartRecord:
        """Note this start before anything else happens: one that crashes early must count too."""
        try:
            before = self._read(STARTS, StartRecord)
        except SmallFileError as error:
            self.complaints.append(f"{error}; counted as one restart")
            before = StartRecord(self._boot, 0, running=True)
        record = begin(before, self._boot, now_ns)
        self._keep(STARTS, record)
        give_up_s = time.monotonic() + START_WAIT_S
        while (
            not self._writer.kept(self._folder / STARTS)
            and not self.fault
            and time.monotonic() < give_up_s
        ):
            time.sleep(0.001)
        return record

    def _read_trips(self) -> list[str]:
        try:
            return self._read(TRIPS, Names) or []
        except SmallFileError as error:
            self.complaints.append(
                f"{error}; which trips were latched is not known: look at the machine, then `reset`"
            )
            return [UNREADABLE]

    def _read_timers(self, now_ns: int) -> dict[str, int]:
        """Timers that may go on; a file that cannot be read holds none."""
        try:
            record = self._read(TIMERS, TimerRecord)
        except SmallFileError as error:
            self.complaints.append(f"{error}; danger delays begin anew")
            return {}
        if (
            record is None
            or record.boot != self._boot
            or not 0 <= now_ns - record.t_ns <= TIMER_AGE_MAX_NS
        ):
            return {}
        return record.over_ns

    def _read(self, name: str, kind: type[T]) -> T | None:
        """Content of one file, None when there is none; SmallFileError when it is not what we
        write."""
        data = read_small(self._folder / name)
        if data is None:
            return None
        try:
            return msgspec.json.decode(data, type=kind)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise SmallFileError(f"{self._folder / name}: {error}") from error


def complain(memory: Memory) -> None:
    """Put what could not be read into the log."""
    for text in memory.complaints:
        print(f"orbitd guard: {text}", file=sys.stderr, flush=True)
