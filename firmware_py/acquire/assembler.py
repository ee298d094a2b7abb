"""Sample frames to blocks: gap-free runs with unwrapped ticks, mark ticks and quality."""

from __future__ import annotations

from math import pi
from typing import Final

import msgspec
import numpy as np

from firmware_py.acquire.channel_ok import ChannelOk
from firmware_py.acquire.clock_map import ClockMap
from firmware_py.acquire.counting import CounterTrack, doubled, suspect, take
from firmware_py.acquire.speed import SpeedMeter, Turn
from firmware_py.config import Config
from firmware_py.config.instances import frame_instants, places
from firmware_py.records import Block, Quality, SampleFrame

MARK_VALID: Final = 2
"""Bit of ``SampleFrame.flags``: the once-per-turn mark is good."""

TICK_TOLERANCE_US: Final = 20
"""Most that a node's sample grid may wander from frame to frame."""

_TICK_MASK: Final = 0xFFFFFFFF


class AssemblerState(msgspec.Struct):
    """The block under construction, and where the stream stands."""

    track: CounterTrack
    seq: int = 0
    started: bool = False
    tick_us: int = 0
    arrival_ns: int = 0
    block_tick_us: int = 0
    block_quality: int = 0
    parts: list[bytes] = []
    marks: list[int] = []


class Assembler:
    """Builds blocks of ``frames_per_block`` frames; a gap closes one early and marks the next.

    Notes
    -----
    ``counters`` (shared with the stage that owns this): ``frames_in``, ``frames_lost``,
    ``blocks_lost`` (in whole blocks' worth of lost frames), those of
    :func:`~firmware_py.acquire.counting.take`, ``node_restarts``, ``clock_jumps``.
    """

    def __init__(self, config: Config, clock: ClockMap, counters: dict[str, int]) -> None:
        self._period_us = config.sampling.period_us
        instants = frame_instants(config)
        self._channels = places(config.machine.channel).number
        self._frame_us = instants * self._period_us
        self._last_us = (instants - 1) * self._period_us
        self._frames_per_block = config.sampling.frames_per_block
        self._clock = clock
        self._counters = counters
        self.channel_ok = ChannelOk.of(config)
        self.speed = SpeedMeter(
            config.machine.operating.speed_ramp_max_rpm_s * pi / 30, self._period_us
        )
        self.turns: list[Turn] = []
        self.state = AssemblerState(CounterTrack())

    def step(self, frame: SampleFrame, arrival_ns: int) -> list[Block]:
        """Take in ``frame``; the blocks that it, and one that waited for it, completed."""
        blocks = []
        for taken in take(self.state.track, frame, arrival_ns, self._counters):
            assert isinstance(taken.message, SampleFrame)
            blocks += self._take(taken.message, taken.arrival_ns, taken.lost, taken.restarted)
        return blocks

    def _take(self, frame: SampleFrame, arrival_ns: int, lost: int, restarted: bool) -> list[Block]:
        """A frame that belongs to the stream."""
        s = self.state
        self._counters["frames_in"] += 1
        tick_us = s.tick_us + ((frame.tick_us - s.tick_us) & _TICK_MASK)
        blocks = []
        off_us = abs(tick_us - s.tick_us - self._frame_us)
        if not s.started or lost or restarted or off_us > TICK_TOLERANCE_US:
            blocks = self._gap(lost, restarted, tick_us, arrival_ns)
        s.started, s.tick_us, s.arrival_ns = True, tick_us, arrival_ns
        self._clock.observe(tick_us + self._last_us, arrival_ns)
        self._mark(frame, tick_us)
        if not s.parts:
            s.block_tick_us = tick_us
        s.parts.append(frame.samples)
        if len(s.parts) >= self._frames_per_block:
            blocks.append(self._close())
        return blocks

    def _gap(self, lost: int, restarted: bool, tick_us: int, arrival_ns: int) -> list[Block]:
        """Close the present block, count what is missing, and judge whether the node's clock still
        holds."""
        s = self.state
        blocks = [self._close()] if s.parts else []
        s.block_quality = Quality.GAP_BEFORE if s.started else Quality.GOOD
        self._counters["frames_lost"] += lost
        self._counters["blocks_lost"] += lost // self._frames_per_block
        expected_us = (lost + 1) * self._frame_us
        if restarted:
            self._counters["node_restarts"] += 1
        elif s.started and abs(tick_us - s.tick_us - expected_us) > TICK_TOLERANCE_US * (lost + 1):
            self._counters["clock_jumps"] += 1
            suspect(
                s.track, SampleFrame, 1, arrival_ns
            )  # ticks that go back and forth are of two clocks
        else:
            return blocks
        self._clock.reset()
        self.speed.forget()
        return blocks

    def _mark(self, frame: SampleFrame, tick_us: int) -> None:
        """Take in the frame's once-per-turn mark."""
        if not frame.flags & MARK_VALID:
            self.speed.lose()
            return
        before_us = self.speed.state.mark_us
        turn = self.speed.mark(
            frame.mark_tick_us, frame.turn_count, tick_us + self._frame_us - self._period_us
        )
        if turn is not None:
            self.turns.append(turn)
        if self.speed.state.paired and self.speed.state.mark_us != before_us:
            self.state.marks.append(self.speed.state.mark_us)

    def _close(self) -> Block:
        """The block under construction as a record; the next one starts empty and good."""
        s = self.state
        self.speed.idle(s.tick_us)
        samples = b"".join(s.parts)
        counts = np.frombuffer(samples, "<i2").reshape(-1, self._channels)
        quality = s.block_quality
        if not self._clock.settled:
            quality |= Quality.CLOCK_UNSETTLED
        if not self.speed.state.known:
            quality |= Quality.NO_MARK
        if doubled(s.track, SampleFrame, s.arrival_ns):
            quality |= Quality.TWO_SENDERS
        speed_rad_s = self.speed.state.speed_rad_s if self.speed.state.known else 0.0
        ok = self.channel_ok.step(counts, speed_rad_s, bool(s.block_quality & Quality.GAP_BEFORE))
        block = Block(
            seq=s.seq,
            t_acq_ns=self._clock.host_ns(s.block_tick_us),
            period_ns=self._period_us * 1000,
            tick_us=s.block_tick_us,
            sample_period_us=self._period_us,
            quality=int(quality),
            channel_ok=ok,
            speed_rad_s=self.speed.state.speed_rad_s,
            turn_count=max(self.speed.state.turn, 0),
            mark_ticks_us=s.marks,
            samples=samples,
            channel_cause=self.channel_ok.state.causes,
            unusable=self.channel_ok.state.unusable,
            channels=self._channels,
            channel_cause_high=self.channel_ok.state.causes_high,
        )
        s.seq += 1
        s.block_quality, s.parts, s.marks = 0, [], []
        return block
