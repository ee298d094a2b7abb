"""Blocks and readings: what acquisition makes of frames (ISO 13374 DA)."""

from __future__ import annotations

import enum
from typing import Final

import msgspec

from firmware_py.records.base import N_CHANNELS, Record
from firmware_py.records.wire import DriveState, NodeState, RigStatus


class Quality(enum.IntFlag):
    """What is known to be wrong with a record; 0 is good."""

    GOOD = 0
    GAP_BEFORE = 1
    CLOCK_UNSETTLED = 2
    NO_MARK = 4
    STALE = 8
    TWO_SENDERS = 16


CAUSE_BITS: Final = 64
"""Bits of one word of causes: those of 16 channels, as many as an encoded integer holds."""


class ChannelCause(enum.IntEnum):
    """Why a channel is not OK (:mod:`firmware_py.acquire.channel_ok`)."""

    OK = 0
    OPEN = 1
    STUCK = 2
    SATURATED = 3
    INTERMITTENT = 4
    BEYOND = 5


def cause_bits(channel: int, cause: ChannelCause) -> int:
    """``cause`` of a channel in its four bits of the word of all channels."""
    return int(cause) << (4 * channel)


def cause_of(word: int, channel: int) -> ChannelCause:
    """The cause of a channel in ``Block.causes``; one of a later version counts as a bad
    contact."""
    return _CAUSES[word >> (4 * channel) & 0xF]


_CAUSES: Final = tuple(
    ChannelCause(value) if value in tuple(ChannelCause) else ChannelCause.INTERMITTENT
    for value in range(16)
)


class Block(Record, frozen=True, tag=True):
    """A gap-free run of samples, time-stamped on the host's clock (ISO 13374 DA).

    ``samples`` holds ``n x channels`` little-endian ``int16``, row = instant.  ``t_acq_ns`` is the
    mapped host time of the first row, ``period_ns`` the sample period on the host's clock.
    ``mark_ticks_us`` are the (unwrapped) node ticks of the once-per-turn marks that fell inside the
    block; ``tick_us`` is the unwrapped node tick of the first row.  Bit ``i`` of ``channel_ok`` is
    channel ``i``: what the diagnosis goes by. ``channel_cause`` holds a :class:`ChannelCause` in
    four bits a channel (``channel_cause_high`` from channel 16 on; :attr:`causes` is both): what
    protection goes by; bit ``i`` of ``unusable`` says that this block of channel ``i`` is not to be
    judged at all.
    """

    seq: int
    t_acq_ns: int
    period_ns: int
    tick_us: int
    sample_period_us: int
    quality: int
    channel_ok: int
    speed_rad_s: float
    turn_count: int
    mark_ticks_us: list[int]
    samples: bytes
    channel_cause: int = 0
    unusable: int = 0
    channels: int = N_CHANNELS
    channel_cause_high: int = 0

    def __post_init__(self) -> None:
        """Refuse what is no whole number of instants; in a decoder this is a
        ``ValidationError``."""
        if self.channels < 1 or not self.samples or len(self.samples) % (2 * self.channels):
            raise ValueError(
                f"{len(self.samples)} bytes of samples are no whole instants of {self.channels} "
                f"channels"
            )

    @property
    def instants(self) -> int:
        """Sampling instants in the block."""
        return len(self.samples) // (2 * self.channels)

    @property
    def causes(self) -> int:
        """The causes of all channels: see :func:`cause_of`."""
        return self.channel_cause | self.channel_cause_high << CAUSE_BITS


class SlowValue(msgspec.Struct, frozen=True):
    """One slow reading: its value in the unit of its kind, its age when it was sent, and a
    :class:`~firmware_py.records.ReadingQuality`."""

    value: float
    age_ms: int
    quality: int


class RigReading(Record, frozen=True, tag=True):
    """A :class:`RigStatus` and the latest :class:`NodeState` with their host time.

    Under wire schema 2 ``values`` holds every reading of the rig by its name, ``drive`` the latest
    account of the drive; ``status`` is made of the standard readings.
    """

    seq: int
    t_acq_ns: int
    quality: int
    status: RigStatus
    node: NodeState | None
    values: dict[str, SlowValue] = msgspec.field(default_factory=dict)
    drive: DriveState | None = None
