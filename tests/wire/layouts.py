"""Rigs of several sizes, as layouts and as configurations."""

from __future__ import annotations

import msgspec

from firmware_py import signals
from firmware_py.config import SHIPPED, Config, load
from firmware_py.machine import FastChannel, SlowChannel
from firmware_py.records import CHANNELS
from firmware_py.wire.layout import WireLayout

BENCH: Config = load(SHIPPED / "bench")[0]
STANDARD = {channel.name: channel for channel in BENCH.machine.channel}
EXTRA_KINDS = ("velocity", "acceleration", "displacement", "temperature", "force", "torque")


def channels(n: int) -> list[FastChannel]:
    """The first ``n`` standard channels, then others of every kind."""
    rows = [STANDARD[name] for name in CHANNELS[:n]]
    for k in range(n - len(rows)):
        kind = signals.FAST[EXTRA_KINDS[k % len(EXTRA_KINDS)]]
        reach = 32_000 * kind.wire_scale
        rows.append(
            FastChannel(f"extra_{k}", kind.unit, kind.wire_scale, -reach, reach, kind=kind.name)
        )
    return rows


def readings(n: int) -> list[SlowChannel]:
    """The standard readings, and ``n`` others of every kind."""
    kinds = list(signals.SLOW)
    rows = [SlowChannel(row.name) for row in signals.READINGS]
    return rows + [SlowChannel(f"more_{k}", kinds[k % len(kinds)]) for k in range(n)]


def rig(n: int, more: int = 0, rate_hz: int = 5000, schema: int = 2) -> Config:
    """``bench`` with ``n`` channels and ``more`` readings beside the standard ones."""
    replace = msgspec.structs.replace
    return BENCH.replaced(
        bus=replace(BENCH.bus, schema=schema),
        sampling=replace(BENCH.sampling, rate_hz=rate_hz),
        channel=channels(n),
        reading=readings(more) if more else [],
    )


LAYOUTS = {
    "bench": WireLayout.of(rig(8)),
    "least": WireLayout.of(rig(2)),
    "nine": WireLayout.of(rig(9, 1)),
    "twelve": WireLayout.of(rig(12, 5, 10_000)),
    "most": WireLayout.of(rig(24, 40)),
    "slow": WireLayout.of(rig(5, 13, 1000)),
}
"""Layouts of wire schema 2."""
