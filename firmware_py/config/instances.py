"""The signal instances of a rig: its fast channels and slow readings, each with its kind.

The one place that reads the tables ``[[channel]]`` and ``[[reading]]`` for names, kinds and
places; stages ask it which channel is which.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

from firmware_py import signals
from firmware_py.config.schema import Config
from firmware_py.machine import FastChannel, SlowChannel
from firmware_py.machine.parts import READINGS, has
from firmware_py.records import CHANNELS

PROBES: Final = CHANNELS[:2]
"""The displacement probes of the bearing: always the first two channels."""


class FastSignal(NamedTuple):
    """A fast channel: its kind, and SI per count as the node sends it."""

    name: str
    kind: signals.FastKind
    wire_scale: float
    words: str


class SlowSignal(NamedTuple):
    """A slow reading: its kind and the range in which it is OK."""

    name: str
    kind: signals.SlowKind
    ok_low: float
    ok_high: float
    words: str


class Places(NamedTuple):
    """Which channel is which, as indices into the frame; -1 where the rig has none.

    ``standard`` has a place for each standard channel; ``accelerations`` are all channels of that
    kind.
    """

    names: tuple[str, ...]
    kinds: tuple[str, ...]
    standard: tuple[int, ...]
    accelerations: tuple[int, ...]
    shaking: frozenset[int]

    def of(self, name: str) -> int:
        """Index of the channel ``name``; -1 where the rig has none."""
        return self.names.index(name) if name in self.names else -1

    @property
    def number(self) -> int:
        """Number of channels."""
        return len(self.names)

    @property
    def absent(self) -> tuple[str, ...]:
        """Standard channels that the rig has not."""
        return tuple(name for name, i in zip(CHANNELS, self.standard, strict=True) if i < 0)


def fast_signals(channels: Sequence[FastChannel]) -> tuple[FastSignal, ...]:
    """The channels of known kind, in wire order (the configuration's checks name the others)."""
    found = []
    for channel in channels:
        kind = signals.fast_kind(channel.name, channel.kind)
        if kind is not None:
            standard = signals.STANDARD_CHANNEL.get(channel.name)
            words = channel.words or (standard.words if standard else kind.words.capitalize())
            scale = channel.wire_scale or kind.wire_scale
            found.append(FastSignal(channel.name, kind, scale, words))
    return tuple(found)


def places(channels: Sequence[FastChannel]) -> Places:
    """Which of ``channels`` is which."""
    names = tuple(channel.name for channel in channels)
    kinds = [signals.fast_kind(channel.name, channel.kind) for channel in channels]
    return Places(
        names,
        tuple(kind.name if kind else "" for kind in kinds),
        tuple(names.index(name) if name in names else -1 for name in CHANNELS),
        tuple(i for i, kind in enumerate(kinds) if kind and kind.name == "acceleration"),
        frozenset(i for i, kind in enumerate(kinds) if kind and kind.shakes),
    )


def slow_signals(config: Config) -> tuple[SlowSignal, ...]:
    """The readings of known kind, the standard ones first, in wire order; none where the rig sends
    none."""
    if not has(config.machine, READINGS):
        return ()
    rows = config.machine.reading or [SlowChannel(row.name) for row in signals.READINGS]
    standard = [row.name for row in signals.READINGS]
    found = []
    for row in sorted(
        rows, key=lambda r: standard.index(r.name) if r.name in standard else len(standard)
    ):
        kind = signals.slow_kind(row.name, row.kind)
        if kind is not None:
            known = signals.STANDARD_READING.get(row.name)
            words = row.words or (known.words if known else kind.words.capitalize())
            found.append(
                SlowSignal(
                    row.name,
                    kind,
                    max(row.ok_low, kind.least),
                    min(row.ok_high, kind.greatest),
                    words,
                )
            )
    return tuple(found)


def frame_instants(config: Config) -> int:
    """Sampling instants in a sample frame of this rig."""
    return signals.instants_per_frame(
        config.bus.schema, len(config.machine.channel), config.sampling.period_us
    )
