"""From raw counts to SI: scales of the channels, and the shaft's x and y from its two probes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.config import Config
from firmware_py.config.instances import places
from firmware_py.records import N_CHANNELS
from firmware_py.wire.layout import SCHEMA_1

WIRE_SCALES: Final = tuple(channel.wire_scale for channel in SCHEMA_1.channels)
"""SI value of one count of each channel in ``orbitd.dbc`` (m, m, m/s2 x 3, Pa, bar, V)."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ChannelMap:
    """From counts to SI: ``counts * scale + offset``, and from the two probes to the machine's x,
    y.

    Attributes
    ----------
    scale, offset
        Shape (8,), SI per count and SI.
    to_xy
        Shape (2, 2): ``(x, y) = to_xy @ (disp_x, disp_y)``.
    """

    scale: Floats
    offset: Floats
    to_xy: Floats
    order: tuple[int, ...] = tuple(range(N_CHANNELS))
    """Place of each column in a block; -1 where the rig has no such channel."""

    @classmethod
    def from_config(cls, config: Config) -> ChannelMap:
        """The standard channels, which the diagnosis knows."""
        return cls._of(config, places(config.machine.channel).standard)

    @classmethod
    def every(cls, config: Config) -> ChannelMap:
        """All configured channels in wire order."""
        return cls._of(config, tuple(range(len(config.machine.channel))))

    @classmethod
    def chosen(cls, config: Config, order: tuple[int, ...]) -> ChannelMap:
        """The channels at the places ``order`` of the block, two probes first; -1: none."""
        return cls._of(config, order)

    @classmethod
    def _of(cls, config: Config, order: tuple[int, ...]) -> ChannelMap:
        channels = config.machine.channel
        first, second = channels[order[0]], channels[order[1]]
        return cls(
            np.array([channels[i].scale if i >= 0 else 1.0 for i in order]),
            np.array([channels[i].offset if i >= 0 else 0.0 for i in order]),
            _probe_inverse(first.angle_deg, second.angle_deg),
            order,
        )

    @classmethod
    def wire(cls) -> ChannelMap:
        """The scales of ``orbitd.dbc`` with probes at 45 and 135 degrees."""
        return cls(np.array(WIRE_SCALES), np.zeros(N_CHANNELS), _probe_inverse(45.0, 135.0))

    def columns(self, counts: NDArray[np.int16]) -> NDArray[np.int16]:
        """The columns of :attr:`order` out of a block's, zeros for a channel that is not there."""
        if self.order == tuple(range(counts.shape[1])):
            return counts
        found = counts[:, self.order]
        found[:, [i < 0 for i in self.order]] = 0
        return found

    def ok(self, mask: int) -> int:
        """The OK bits of a block in the order of :attr:`order`; a channel that is not there is not
        OK."""
        return sum((mask >> i & 1) << column for column, i in enumerate(self.order) if i >= 0)

    def to_si(self, counts: NDArray[np.int16]) -> Floats:
        """Shape (n, columns) in SI; columns 0 and 1 are the shaft's x and y in metres."""
        values = counts * self.scale + self.offset
        values[:, :2] = values[:, :2] @ self.to_xy.T
        return values


def _probe_inverse(first_deg: float, second_deg: float) -> Floats:
    """Inverse of ``probe_i = x cos a_i + y sin a_i``."""
    angles = np.radians([first_deg, second_deg])
    return np.linalg.inv(np.column_stack([np.cos(angles), np.sin(angles)]))
