"""The acquisition stage: frames off the link to blocks, readings and the account of what was
lost."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, Protocol

import msgspec

from firmware_py.acquire.assembler import Assembler, AssemblerState
from firmware_py.acquire.channel_ok import ChannelOkState
from firmware_py.acquire.clock_map import ClockMap, ClockMapState, unwrap
from firmware_py.acquire.counting import CounterTrack, doubled, take
from firmware_py.acquire.slow_pages import SlowPages
from firmware_py.acquire.speed import SpeedState, Turn
from firmware_py.acquire.stamps import TICK_AHEAD_MAX_NS, bounded_arrival_ns
from firmware_py.config import Config
from firmware_py.records import (
    Block,
    Command,
    DeviceHeartbeat,
    DriveCommand,
    DriveState,
    NodeFigures,
    NodeInfo,
    NodeState,
    Quality,
    RawFrame,
    ReadingsFrame,
    Rejected,
    RigReading,
    RigStatus,
    SampleFrame,
    SlowValue,
    WireMessage,
)

REJECTS: Final = (
    "unknown_id",
    "length",
    "crc",
    "range",
    "malformed",
    "repeated",
    "conflicting",
    "reordered",
    "masquerade",
    "ahead",
)
REJECTS_2: Final = ("layout",)
"""Beside them, under wire schema 2."""
NEVER_NS: Final = 1 << 62
"""Age of a sample that never came."""

SLOW: Final = {
    RigStatus: "RIG_STATUS",
    NodeState: "NODE_STATE",
    NodeInfo: "NODE_INFO",
    ReadingsFrame: "READINGS",
    NodeFigures: "NODE_FIGURES",
    DriveState: "DRIVE_STATE",
}
"""The slow messages, by the names that people read."""

_TICK_MASK: Final = 0xFFFFFFFF

SlowMessage = RigStatus | NodeState | NodeInfo | ReadingsFrame | NodeFigures | DriveState


class Decoder(Protocol):
    """The half of a codec that acquisition needs."""

    def decode(self, frame: RawFrame) -> WireMessage | Rejected:
        """The record in ``frame``."""


class AcquireState(msgspec.Struct):
    """Everything that the stage remembers (for snapshots)."""

    counters: dict[str, int]
    tracks: dict[str, CounterTrack]
    clock: ClockMapState
    assembler: AssemblerState
    channel_ok: ChannelOkState
    speed: SpeedState
    node: NodeState | None = None
    node_heard_ns: int = -NEVER_NS
    node_info: NodeInfo | None = None
    status: RigStatus | None = None
    status_heard_ns: int = -NEVER_NS
    reading_seq: int = 0
    arrival_ns: int = -NEVER_NS
    figures: NodeFigures | None = None
    drive: DriveState | None = None
    values: dict[str, SlowValue] = {}


class AcquireOutput(msgspec.Struct):
    """What one step brought: new records, and who else was heard speaking as a device.

    ``node_ahead_ns``: the node's clock ran on by this much while the host's stood; 0 as a rule.
    ``clock_jumped``: the node's clock and its counter contradict each other.
    """

    blocks: list[Block]
    readings: list[RigReading]
    foreign: list[DeviceHeartbeat | Command | DriveCommand]
    node_info: NodeInfo | None = None
    figures: NodeFigures | None = None
    restarted: bool = False
    node_ahead_ns: int = 0
    clock_jumped: bool = False
    turns: list[Turn] = []
    node_states: list[NodeState] = []


class Acquire:
    """Frames to blocks and readings.

    Parameters
    ----------
    config
        Sampling, channels and the declared speed ramp are used.
    codec
        Decoder of the configured link.

    Notes
    -----
    ``counters``: ``frames_in`` (good sample frames), ``frames_lost``, ``blocks_lost``,
    ``reject_<name>`` for each name of :data:`REJECTS`, ``messages_lost`` (other messages),
    ``foreign`` (frames that only a device sends, from somebody else), ``node_restarts``,
    ``clock_jumps``, ``clock_leaps`` (the node's clock ran on while the host's stood),
    ``stamps_ahead`` and ``stamps_behind`` (arrivals that cannot be).
    """

    def __init__(self, config: Config, codec: Decoder) -> None:
        self._codec = codec
        self._fresh_age_ns = round(config.sampling.fresh_age_ms * 1e6)
        self._leap_max_ns = config.machine.actuator.time_to_live_ms * 1_000_000
        names = [
            "frames_in",
            "frames_lost",
            "blocks_lost",
            "messages_lost",
            "foreign",
            "node_restarts",
            "clock_jumps",
            "clock_leaps",
            "stamps_ahead",
            "stamps_behind",
        ]
        rejects = REJECTS + (REJECTS_2 if config.bus.schema > 1 else ())
        self.counters = dict.fromkeys(names + [f"reject_{name}" for name in rejects], 0)
        self._pages = SlowPages(config)
        self._clock = ClockMap()
        self._assembler = Assembler(config, self._clock, self.counters)
        self._rest = AcquireState(
            self.counters,
            {},
            self._clock.state,
            self._assembler.state,
            self._assembler.channel_ok.state,
            self._assembler.speed.state,
        )
        self._handlers: dict[type, Callable[[Any, int, AcquireOutput], None]] = {
            RigStatus: self._on_status,
            NodeState: self._on_node,
            NodeInfo: self._on_info,
            DeviceHeartbeat: self._on_foreign,
            Command: self._on_foreign,
            DriveCommand: self._on_foreign,
            ReadingsFrame: self._on_readings,
            NodeFigures: self._on_figures,
            DriveState: self._on_drive,
            Rejected: self._on_rejected,
        }

    @property
    def state(self) -> AcquireState:
        """The stage's memory, gathered from its parts."""
        s = self._rest
        s.clock, s.assembler = self._clock.state, self._assembler.state
        s.channel_ok, s.speed = self._assembler.channel_ok.state, self._assembler.speed.state
        return s

    @state.setter
    def state(self, state: AcquireState) -> None:
        self._rest = state
        self._clock.state, self._assembler.state = state.clock, state.assembler
        self._assembler.channel_ok.state, self._assembler.speed.state = (
            state.channel_ok,
            state.speed,
        )
        self.counters.update(state.counters)
        state.counters = self.counters

    def step(self, frames: list[RawFrame], now_ns: int) -> AcquireOutput:
        """Take in ``frames`` in the order of their arrival."""
        output = AcquireOutput([], [], [])
        decode, s = self._codec.decode, self._rest
        jumps = self.counters["clock_jumps"]
        for frame in frames:
            message = decode(frame)
            arrival_ns = bounded_arrival_ns(frame.arrival_ns, s.arrival_ns, now_ns, self.counters)
            s.arrival_ns = arrival_ns
            if type(message) is SampleFrame:
                restarts = self.counters["node_restarts"]
                output.blocks += self._assembler.step(message, arrival_ns)
                if self.counters["node_restarts"] != restarts:
                    self._forget_node(output)
            else:
                self._handlers[type(message)](message, arrival_ns, output)
        output.turns, self._assembler.turns = self._assembler.turns, []
        output.clock_jumped = self.counters["clock_jumps"] != jumps
        if self._clock.ahead_ns > self._leap_max_ns:
            self.counters["clock_leaps"] += 1
            output.node_ahead_ns = self._clock.ahead_ns
            self._clock.reset()
        return output

    def doubt_speed(self, doubted: bool) -> None:
        """Whether the mark is implausible: blocks say so."""
        if doubted != self.speed.doubted:
            self._assembler.speed.doubt(doubted)

    def hear_motion(self, quiet_s: float, moving_s: float) -> None:
        """For how long the probes have shown a still shaft, or a moving one."""
        self._assembler.speed.hear_motion(quiet_s, moving_s)

    def reset_clock(self) -> None:
        """The link was away: its delays say nothing about the ones to come."""
        self._clock.reset()

    # ------------------------------------------------------------------ what is known now

    @property
    def newest_tick_us(self) -> int:
        """32-bit tick of the newest sample frame taken in (what a command echoes)."""
        return self._assembler.state.tick_us & _TICK_MASK

    @property
    def node(self) -> NodeState | None:
        """The node's latest account of itself."""
        return self._rest.node

    @property
    def node_info(self) -> NodeInfo | None:
        """What the node says it is."""
        return self._rest.node_info

    @property
    def figures(self) -> NodeFigures | None:
        """What the node says it was built with (wire schema 2)."""
        return self._rest.figures

    @property
    def status(self) -> RigStatus | None:
        """The latest slow measurements."""
        return self._rest.status

    @property
    def status_heard_ns(self) -> int:
        """When they arrived."""
        return self._rest.status_heard_ns

    @property
    def speed(self) -> SpeedState:
        """Speed and mark."""
        return self._assembler.speed.state

    @property
    def clock_settled(self) -> bool:
        """Whether node ticks map reliably to host time."""
        return self._clock.settled

    def two_senders(self, now_ns: int) -> list[str]:
        """Messages of the node that have two senders."""
        names = ["SAMPLES"] if doubled(self._assembler.state.track, SampleFrame, now_ns) else []
        for kind, name in SLOW.items():
            track = self._rest.tracks.get(kind.__name__)
            if track is not None and doubled(track, kind, now_ns):
                names.append(name)
        return names

    def sample_age_ns(self, now_ns: int) -> int:
        """The larger of the newest sample's arrival age and mapped age."""
        s = self._assembler.state
        if not s.started:
            return NEVER_NS
        return max(now_ns - s.arrival_ns, now_ns - self._clock.host_ns(s.tick_us))

    def node_age_ns(self, now_ns: int) -> int:
        """Time since the node last gave an account of itself: of state and of status, the older
        one."""
        return now_ns - min(self._rest.node_heard_ns, self._rest.status_heard_ns)

    # ------------------------------------------------------------------ one kind of message each

    def _new(self, message: SlowMessage, arrival_ns: int) -> list[tuple[Any, int]]:
        """What of a slow message's stream counts from now on, with its arrival: nothing, it, or one
        that waited."""
        tick_us = unwrap(message.tick_us, self._assembler.state.tick_us)
        if self._clock.settled and self._clock.host_ns(tick_us) > arrival_ns + TICK_AHEAD_MAX_NS:
            self.counters["reject_ahead"] += 1
            return []
        track = self._rest.tracks.setdefault(type(message).__name__, CounterTrack())
        found = take(track, message, arrival_ns, self.counters)
        self.counters["messages_lost"] += sum(taken.lost for taken in found)
        return [(taken.message, taken.arrival_ns) for taken in found]

    def _on_status(self, message: RigStatus, arrival_ns: int, output: AcquireOutput) -> None:
        for status, heard_ns in self._new(message, arrival_ns):
            self._take_status(status, heard_ns, output)

    def _on_readings(self, message: ReadingsFrame, arrival_ns: int, output: AcquireOutput) -> None:
        """The last page of readings makes a status of them all."""
        for page, heard_ns in self._new(message, arrival_ns):
            self._rest.values = self._rest.values | self._pages.values(page)
            status = self._pages.status(page, self._rest.values)
            if status is not None:
                self._take_status(status, heard_ns, output)

    def _take_status(self, status: RigStatus, heard_ns: int, output: AcquireOutput) -> None:
        s = self._rest
        s.status, s.status_heard_ns = status, heard_ns
        tick_us = unwrap(status.tick_us, self._assembler.state.tick_us)
        t_acq_ns = self._clock.host_ns(tick_us) if self._clock.state.known else heard_ns
        quality = 0 if self._clock.settled else Quality.CLOCK_UNSETTLED
        if heard_ns - t_acq_ns > self._fresh_age_ns:
            quality |= Quality.STALE
        output.readings.append(
            RigReading(s.reading_seq, t_acq_ns, int(quality), status, s.node, s.values, s.drive)
        )
        s.reading_seq += 1

    def _on_figures(self, message: NodeFigures, arrival_ns: int, output: AcquireOutput) -> None:
        for figures, _ in self._new(message, arrival_ns):
            self._rest.figures = output.figures = figures

    def _on_drive(self, message: DriveState, arrival_ns: int, output: AcquireOutput) -> None:
        for drive, _ in self._new(message, arrival_ns):
            self._rest.drive = drive

    def _on_node(self, message: NodeState, arrival_ns: int, output: AcquireOutput) -> None:
        for node, heard_ns in self._new(message, arrival_ns):
            self._rest.node, self._rest.node_heard_ns = node, heard_ns
            output.node_states.append(node)

    def _on_info(self, message: NodeInfo, arrival_ns: int, output: AcquireOutput) -> None:
        for info, _ in self._new(message, arrival_ns):
            self._rest.node_info = output.node_info = info

    def _on_foreign(
        self,
        message: DeviceHeartbeat | Command | DriveCommand,
        arrival_ns: int,
        output: AcquireOutput,
    ) -> None:
        self.counters["foreign"] += 1
        output.foreign.append(message)

    def _on_rejected(self, message: Rejected, arrival_ns: int, output: AcquireOutput) -> None:
        name = f"reject_{message.reason}"
        self.counters[name] = self.counters.get(name, 0) + 1

    def _forget_node(self, output: AcquireOutput) -> None:
        """The node has started again: what it said of itself before no longer counts."""
        for track in self._rest.tracks.values():
            track.last, track.held, track.run, track.beside = -1, None, 0, 0
        self._rest.node, self._rest.node_info, self._rest.status = None, None, None
        self._rest.figures, self._rest.drive, self._rest.values = None, None, {}
        self._rest.node_heard_ns = self._rest.status_heard_ns = -NEVER_NS
        output.restarted = True
