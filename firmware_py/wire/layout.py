"""What the frames of one rig look like: computed from its channels and readings, and hashed.

Node and device compute the same layout from the same declaration; ``NODE_INFO`` carries its hash,
and sample and reading frames its low byte, so that frames of another layout are never misread.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final
from zlib import crc32

from firmware_py import signals
from firmware_py.config import Config
from firmware_py.config.instances import FastSignal, SlowSignal, fast_signals, slow_signals

SAMPLES_HEAD_BYTES: Final = 16
READINGS_HEAD_BYTES: Final = 12
SLOTS_MAX: Final = 8
"""Readings in one page."""
SLOT_BYTES: Final = 6
PAGES_MAX: Final = 16
PAYLOADS: Final[tuple[int, ...]] = (*range(9), 12, 16, 20, 24, 32, 48, 64)
"""Payload sizes of CAN FD (ISO 11898-1)."""


def payload_bytes(used: int) -> int:
    """The smallest CAN FD payload that holds ``used`` bytes."""
    return min(size for size in PAYLOADS if size >= used)


@dataclass(frozen=True)
class WireLayout:
    """Layout of the frames of one rig.

    Parameters
    ----------
    schema
        1: fixed; 2: what follows.
    channels, readings
        In wire order.
    period_us
        Sample period.
    """

    schema: int
    channels: tuple[FastSignal, ...]
    readings: tuple[SlowSignal, ...]
    period_us: int = 200

    @classmethod
    def of(cls, config: Config) -> WireLayout:
        """The layout of a configured rig."""
        return cls(
            config.bus.schema,
            fast_signals(config.machine.channel),
            slow_signals(config),
            config.sampling.period_us,
        )

    @property
    def instants(self) -> int:
        """Sampling instants in a sample frame."""
        return signals.instants_per_frame(self.schema, len(self.channels), self.period_us)

    @property
    def samples_bytes(self) -> int:
        """Bytes of samples in a frame."""
        return 2 * len(self.channels) * self.instants

    @property
    def samples_payload(self) -> int:
        """CAN FD payload of a sample frame."""
        return payload_bytes(SAMPLES_HEAD_BYTES + self.samples_bytes)

    @property
    def slots(self) -> int:
        """Readings in the fullest page."""
        return min(len(self.readings), SLOTS_MAX)

    @property
    def pages(self) -> int:
        """Pages of readings."""
        return -(-len(self.readings) // SLOTS_MAX)

    @property
    def readings_payload(self) -> int:
        """CAN FD payload of a page of readings."""
        return payload_bytes(READINGS_HEAD_BYTES + SLOT_BYTES * self.slots)

    def page(self, number: int) -> tuple[SlowSignal, ...]:
        """The readings of one page."""
        return self.readings[number * SLOTS_MAX : (number + 1) * SLOTS_MAX]

    @property
    def text(self) -> str:
        """What the hash is of: a line per channel and reading, in wire order, then the instants."""
        fast = [
            f"channel {c.name} {c.kind.name} {c.kind.wire_unit} {wire_step(c):.9g}\n"
            for c in self.channels
        ]
        slow = [
            f"reading {r.name} {r.kind.name} {r.kind.unit} {r.kind.resolution:.9g}\n"
            for r in self.readings
        ]
        return "".join(
            [f"wire schema {self.schema}\n", *fast, *slow, f"instants {self.instants}\n"]
        )

    @cached_property
    def hash(self) -> int:
        """CRC-32 (ISO-HDLC, as in zlib) of :attr:`text`; 0 under schema 1, never 0 under 2."""
        return 0 if self.schema == 1 else crc32(self.text.encode("ascii")) or 1

    @property
    def tag(self) -> int:
        """Low byte of the hash, in every frame whose layout is computed."""
        return self.hash & 0xFF


def wire_step(channel: FastSignal) -> float:
    """Step of a channel on the wire, in the unit of the DBC."""
    return float(f"{channel.wire_scale * channel.kind.wire_per_si:.9g}")


SCHEMA_1: Final = WireLayout(
    1,
    tuple(
        FastSignal(row.name, signals.FAST[row.kind], signals.FAST[row.kind].wire_scale, row.words)
        for row in signals.CHANNELS
    ),
    tuple(
        SlowSignal(
            row.name,
            signals.SLOW[row.kind],
            signals.SLOW[row.kind].least,
            signals.SLOW[row.kind].greatest,
            row.words,
        )
        for row in signals.READINGS
    ),
)
"""The fixed layout of wire schema 1."""
