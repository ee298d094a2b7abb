"""Decimated features of the raw blocks: what a trend or a picture needs, ten times a second.

Time-domain figures per channel in SI units, and the shaft orbit turned from the probe axes to x
(right) and y (up).  The diagnosis does not rest on these: the brain computes its own.
"""

from __future__ import annotations

from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.channel_map import ChannelMap
from firmware_py.config import Config
from firmware_py.records import Block

PERIOD_NS: Final = 100_000_000
BLOCKS_MAX: Final = 1000
"""More than the fastest sampling puts into a tenth of a second: time that stands still gathers no
more."""

ORBIT_POINTS: Final = 240


class ChannelFeatures(msgspec.Struct, frozen=True):
    """One channel over the last 0.1 s, in the channel's SI unit."""

    mean: float
    rms: float
    peak_to_peak: float
    ok: bool


class SignalFeatures(msgspec.Struct, frozen=True, kw_only=True):
    """All channels over the last 0.1 s; ``rms`` is about the mean."""

    seq: int
    t_acq_ns: int
    quality: int
    speed_rad_s: float
    channel: dict[str, ChannelFeatures]


class OrbitPath(msgspec.Struct, frozen=True):
    """The path of the journal in micrometres, x right and y up."""

    t_acq_ns: int
    x_um: list[float]
    y_um: list[float]


class Decimator:
    """Collects blocks and gives :class:`SignalFeatures` ten times a second of sample time.

    Parameters
    ----------
    config
        For the channels' scales and the probes' angles.
    """

    def __init__(self, config: Config) -> None:
        self._channels = ChannelMap.every(config)
        self._names = [channel.name for channel in config.machine.channel]
        self._blocks: list[Block] = []
        self._seq = 0
        self._counts: NDArray[np.int16] = np.zeros((0, len(self._names)), np.int16)
        self._t_acq_ns = 0

    def step(self, block: Block) -> SignalFeatures | None:
        """Take ``block``; the features when a tenth of a second is full."""
        self._blocks.append(block)
        first = self._blocks[0]
        end_ns = block.t_acq_ns + block.period_ns * block.instants
        if 0 <= end_ns - first.t_acq_ns < PERIOD_NS and len(self._blocks) < BLOCKS_MAX:
            return None
        blocks, self._blocks = self._blocks, []
        raw = b"".join(b.samples for b in blocks)
        self._counts = np.frombuffer(raw, "<i2").reshape(-1, block.channels)
        self._t_acq_ns = block.t_acq_ns
        self._seq += 1
        return self._features(blocks)

    def _features(self, blocks: list[Block]) -> SignalFeatures:
        last, quality, ok = blocks[-1], 0, -1
        for block in blocks:
            quality |= block.quality
            ok &= block.channel_ok
        scale = self._channels.scale
        mean = self._counts.mean(axis=0) * scale + self._channels.offset
        rms = self._counts.std(axis=0) * np.abs(scale)
        spread = (self._counts.max(axis=0).astype(float) - self._counts.min(axis=0)) * np.abs(scale)
        return SignalFeatures(
            seq=self._seq,
            t_acq_ns=last.t_acq_ns,
            quality=quality,
            speed_rad_s=last.speed_rad_s,
            channel={
                name: ChannelFeatures(
                    float(mean[i]), float(rms[i]), float(spread[i]), bool(ok >> i & 1)
                )
                for i, name in enumerate(self._names)
            },
        )

    def orbit(self) -> OrbitPath:
        """The orbit in the last full tenth of a second, at most :data:`ORBIT_POINTS` points."""
        path_um = np.round(self._channels.to_si(self._counts[-ORBIT_POINTS:])[:, :2] * 1e6, 2)
        return OrbitPath(self._t_acq_ns, path_um[:, 0].tolist(), path_um[:, 1].tolist())
