"""The guard's half of a replay: recorded cycles in, the same frames and events out, bit by bit.

A segment starts at a :class:`Snapshot` and lasts while the cycle numbers follow one another; the
guard is restored there, fed the recorded cycles, and compared with what it did.  Snapshots inside a
segment are compared with the replayed guard's own state.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import msgspec

from firmware_py.config import Config
from firmware_py.guard.core import GuardCore
from firmware_py.guard.state import CoreState
from firmware_py.recording import TOPICS, Recording, RecordingError, decode_exact
from firmware_py.records import Cycle, CycleRecord, Decision, DeviceHeartbeat, Snapshot
from firmware_py.replay.compare import where
from firmware_py.wire.link import codec_for

_CYCLE, _SNAPSHOT = TOPICS[CycleRecord].name, TOPICS[Snapshot].name


class DecisionReport(msgspec.Struct):
    """What came of the comparison; ``first_difference`` is empty or names cycle and field."""

    segments: int = 0
    cycles: int = 0
    cycles_outside_segments: int = 0
    cycles_missing: int = 0
    different: int = 0
    snapshots_compared: int = 0
    snapshots_different: int = 0
    first_difference: str = ""

    @property
    def ok(self) -> bool:
        """Something was compared, and all of it agreed."""
        return self.cycles > 0 and not self.different and not self.snapshots_different


class Replayed(msgspec.Struct, frozen=True):
    """One replayed cycle; ``new_segment`` says that nothing before it is known."""

    cycle: Cycle
    decision: Decision
    new_segment: bool


class DecisionReplay:
    """Replays the guard of one recording.

    Parameters
    ----------
    config
        The recorded configuration.
    """

    def __init__(self, config: Config) -> None:
        self.report = DecisionReport()
        self._config = config
        self._codec = codec_for(config)

    def run(self, recording: Recording) -> Iterator[Replayed]:
        """Replay everything; yields each cycle with the decision that came out this time."""
        session = _Sessions(recording, self._config)
        core: GuardCore | None = None
        pending: Snapshot | None = None
        expected: int | None = None
        for message in recording.messages():
            if message.topic == _SNAPSHOT:
                pending = decode_exact(message, Snapshot)
            if message.topic != _CYCLE:
                continue
            record = decode_exact(message, CycleRecord)
            seq = record.cycle.seq
            follows = core is not None and seq == expected
            starts_here = pending is not None and (pending.seq, pending.now_ns) == (
                seq,
                record.cycle.now_ns,
            )
            if expected is not None and not follows and seq > expected:
                self.report.cycles_missing += seq - expected
            expected = seq + 1
            if follows and core and pending and starts_here:
                self._compare_state(core, pending)
            elif not follows:
                core = (
                    self._restored(pending, session.of(pending))
                    if pending and starts_here
                    else None
                )
            if core is None:
                self.report.cycles_outside_segments += 1
                continue
            decision = core.step(record.cycle)
            self._compare(record, decision)
            yield Replayed(record.cycle, decision, not follows)

    def _restored(self, snapshot: Snapshot, session: int) -> GuardCore:
        self.report.segments += 1
        core = GuardCore(self._config, self._codec, session)
        try:
            core.restore(snapshot)
        except msgspec.DecodeError as error:
            raise RecordingError(
                f"the guard's state before cycle {snapshot.seq} does not fit this version "
                f"({error}); use the orbitd that wrote it"
            ) from error
        return core

    def _compare(self, record: CycleRecord, decision: Decision) -> None:
        report = self.report
        report.cycles += 1
        if (record.frames_out, record.events) == (decision.frames_out, decision.events):
            return
        report.different += 1
        field = "frames_out" if record.frames_out != decision.frames_out else "events"
        self._note(
            f"cycle {record.cycle.seq}: {field}: recorded {getattr(record, field)}, "
            f"replayed {getattr(decision, field)}"
        )

    def _compare_state(self, core: GuardCore, snapshot: Snapshot) -> None:
        report = self.report
        report.snapshots_compared += 1
        recorded = _as_read(snapshot.state)
        replayed = _as_read(core.snapshot(snapshot.seq, snapshot.now_ns).state)
        if recorded != replayed:
            report.snapshots_different += 1
            self._note(f"snapshot before cycle {snapshot.seq}: {where(recorded, replayed)}")

    def _note(self, text: str) -> None:
        self.report.first_difference = self.report.first_difference or text


class _Sessions:
    """The guard's session nonce in force at each snapshot, read from the heartbeats that it
    sent."""

    def __init__(self, recording: Recording, config: Config) -> None:
        codec = codec_for(config)
        self._from: dict[tuple[int, int], int] = {}
        waiting: list[tuple[int, int]] = []
        for message in recording.messages():
            if message.topic == _SNAPSHOT:
                snapshot = decode_exact(message, Snapshot)
                waiting.append((snapshot.seq, snapshot.now_ns))
            elif message.topic == _CYCLE and waiting:
                for frame in decode_exact(message, CycleRecord).frames_out:
                    if isinstance(said := codec.decode(frame), DeviceHeartbeat):
                        self._from |= dict.fromkeys(waiting, said.session)
                        waiting.clear()

    def of(self, snapshot: Snapshot) -> int:
        return self._from.get((snapshot.seq, snapshot.now_ns), 0)


def _as_read(state: bytes) -> Any:
    """A state as this version reads it: fields that are new since have their defaults."""
    return msgspec.to_builtins(msgspec.msgpack.decode(state, type=CoreState))
