"""A machine of several bearings, seen bearing by bearing.

The guard judges each bearing by the same stages, each with the configuration of a machine that has
that bearing alone: its probes are the first two channels, its clearance and limits hold.
"""

from __future__ import annotations

from dataclasses import dataclass

import msgspec
import numpy as np

from firmware_py import signals
from firmware_py.config.schema import Config
from firmware_py.machine import JournalBearing, Machine, OtherBearing
from firmware_py.machine.parts import BEARING, CLEARANCE, LOAD, part_of
from firmware_py.records import Block, cause_bits, cause_of
from firmware_py.records.acquired import CAUSE_BITS

_LOW_WORD = (1 << CAUSE_BITS) - 1


@dataclass(frozen=True)
class BearingView:
    """One bearing of a machine.

    Attributes
    ----------
    name
        Of the bearing; empty for a first one without a name.
    config
        The configuration of a machine that has it alone.
    columns
        Channels of that machine, as places in the blocks of the whole one.
    whole
        Whether these are all channels.
    """

    name: str
    config: Config
    columns: tuple[int, ...]
    whole: bool

    def block(self, block: Block) -> Block:
        """What ``block`` holds of this bearing's channels."""
        if self.whole:
            return block
        counts = np.frombuffer(block.samples, "<i2").reshape(-1, block.channels)
        causes, ok, unusable = 0, 0, 0
        for place, i in enumerate(self.columns):
            causes |= cause_bits(place, cause_of(block.causes, i))
            ok |= (block.channel_ok >> i & 1) << place
            unusable |= (block.unusable >> i & 1) << place
        return msgspec.structs.replace(
            block,
            samples=counts[:, self.columns].tobytes(),
            channels=len(self.columns),
            channel_ok=ok,
            unusable=unusable,
            channel_cause=causes & _LOW_WORD,
            channel_cause_high=causes >> CAUSE_BITS,
        )


def views(config: Config) -> tuple[BearingView, ...]:
    """Every bearing, the first (the controlled one, if any) with all channels of no other."""
    machine = config.machine
    if not machine.other_bearing:
        return (
            BearingView(machine.bearing.name, config, tuple(range(len(machine.channel))), True),
        )
    others = [probes_of(machine, other) for other in machine.other_bearing]
    taken = {i for columns in others for i in columns}
    left = tuple(i for i in range(len(machine.channel)) if i not in taken)
    first = config.replaced(channel=[machine.channel[i] for i in left], other_bearing=[])
    return (
        BearingView(machine.bearing.name, first, left, False),
        *(
            BearingView(other.name, _alone(config, other, columns), columns, False)
            for other, columns in zip(machine.other_bearing, others, strict=True)
        ),
    )


def probes_of(machine: Machine, bearing: JournalBearing) -> tuple[int, ...]:
    """Places of the displacement probes at ``bearing``, which is not the first."""
    return tuple(
        i
        for i, channel in enumerate(machine.channel)
        if channel.bearing == bearing.name
        and (kind := signals.fast_kind(channel.name, channel.kind)) is not None
        and kind.name == "displacement"
    )


def _alone(config: Config, other: OtherBearing, columns: tuple[int, ...]) -> Config:
    """The configuration of a machine that has ``other`` alone."""
    machine, operating, limits = config.machine, config.machine.operating, config.limits
    absent = {name for name in machine.absent if name not in (BEARING, CLEARANCE, LOAD)}
    absent |= {p for p in (BEARING, CLEARANCE) if part_of(p, other.name) in machine.absent}
    if other.load_min_N is None or other.load_max_N is None:
        absent.add(LOAD)
    else:
        operating = msgspec.structs.replace(
            operating, load_min_N=other.load_min_N, load_max_N=other.load_max_N
        )
    own = {each.bearing: each for each in config.limits_at}.get(other.name)
    if own is not None:
        limits = msgspec.structs.replace(
            limits,
            displacement_alert_um=own.displacement_alert_um,
            displacement_danger_um=own.displacement_danger_um,
        )
    keys = JournalBearing.__struct_fields__
    return config.replaced(
        bearing=JournalBearing(**{key: getattr(other, key) for key in keys}),
        channel=[machine.channel[i] for i in columns],
        other_bearing=[],
        contact=None,
        operating=operating,
        limits=limits,
        absent=tuple(sorted(absent)),
    )
