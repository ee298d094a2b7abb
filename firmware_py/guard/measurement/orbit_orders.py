"""Does the orbit turn as the marks say?  Its first order, beside those that false edges would make
of it.

Unbalance and runout move a shaft once a turn.  With two edges a turn this motion is told at half
the speed, with every second edge missing at twice the speed.  So the motion at these orders is
compared with the motion at the told speed, where either stands well above noise and runout.  A
whirl moves the shaft about once in two turns: a window cannot tell it from two edges a turn, and
both end authority.

Counts times an integer cosine, summed as integers: the same on every machine.
"""

from __future__ import annotations

import enum
from math import cos, pi
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from firmware_py.config import Config
from firmware_py.guard.measurement.motion import DISPLACEMENTS
from firmware_py.records import Block, Quality

WINDOW_S: Final = 0.5
"""12 turns at 1500 rpm: motion at other orders leaks by less than 6 %."""

FLOOR_M: Final = 1e-6
"""Least amplitude that is evidence, beside twice the slow-roll runout: a probe's noise leaves 0.01
um here."""

BELOW_FIRST: Final = 2.0
"""The orbit agrees with the marks where the first order is this much larger than those below it,
and not smaller than those above it: a shaft that is only unbalanced and not round has none
below."""

ABOVE_FIRST: Final = 4.0
"""A higher order contradicts the marks where it is this much larger than the first: a bent or
cracked shaft, or one that is not round, may have a second order as large as the first.  A lower one
does where it is as large, and larger than the way of the mean since the window before."""

STANDING_SWINGS: Final = 8
"""Swings in a window that a standing shaft does not make: a clearance that moves makes one."""

FIRST: Final = 2
"""Place of the first order in :data:`ORDERS`."""

ORDERS: Final = (1 / 3, 1 / 2, 1.0, 2.0, 3.0)
"""Of the told speed: once a turn with three edges, with two, rightly, with every second and two of
three missing."""

_PERIOD_TURNS: Final = 6.0
"""After so many turns all orders begin anew."""

_STEPS: Final = 256
_UNIT: Final = 1024
_STEPS_A_TURN: Final = _STEPS * np.array(ORDERS)
_COSINE: Final = np.array(
    [round(_UNIT * cos(2 * pi * i / _STEPS)) for i in range(_STEPS)], np.int64
)
_OK_MASK: Final = sum(1 << i for i in DISPLACEMENTS)

Counts = NDArray[np.integer[Any]]


GAP_MAX_US: Final = 50_000
"""A gap so long at most leaves a window whole: the shaft turns on at the told speed meanwhile."""


class Evidence(enum.IntEnum):
    """What a window says of the marks."""

    NONE = 0
    AGREES = 1
    CONTRADICTS = 2


class OrbitState(msgspec.Struct):
    """The window under count.

    ``sums``: products of both channels and of 1 with each order's cosine, then with its sine.
    ``totals``: the counts themselves.  ``centre``, ``side`` and ``swings``: mean of the window
    before, side of it that each channel was on last, changes of side.
    """

    samples: int = 0
    next_us: int = -1
    whole: bool = True
    told_turns: float = 0.0
    sums: list[list[int]] = msgspec.field(
        default_factory=lambda: [[0] * 3 for _ in range(2 * len(ORDERS))]
    )
    totals: list[int] = msgspec.field(default_factory=lambda: [0, 0])
    centre: tuple[float, float] | None = None
    side: list[int] = msgspec.field(default_factory=lambda: [0, 0])
    swings: list[int] = msgspec.field(default_factory=lambda: [0, 0])


class OrbitOrders:
    """Orders of the shaft's motion in windows of :data:`WINDOW_S`.

    Parameters
    ----------
    config
        Scale and runout of the displacement channels, sampling.

    Attributes
    ----------
    seen_order
        Order of the told speed that was the largest in the last window with evidence.
    """

    def __init__(self, config: Config) -> None:
        channels = [config.machine.channel[i] for i in DISPLACEMENTS]
        self._scales = [channel.scale for channel in channels]
        floor_m = FLOOR_M + 2e-6 * max(channel.slow_roll_um for channel in channels)
        self._floor_m2 = floor_m * floor_m
        self._swing_counts = [FLOOR_M / abs(scale) for scale in self._scales]
        self._samples = round(WINDOW_S * config.sampling.rate_hz)
        self.seen_order = 0.0
        self.state = OrbitState()

    def restart(self) -> None:
        """Begin a new window."""
        self.state = OrbitState()

    def step(self, block: Block, speed_rad_s: float) -> Evidence:
        """Take in ``block`` beside the speed that the marks say; evidence when it completes a
        window."""
        s = self.state
        gap_us = block.tick_us - s.next_us if s.next_us >= 0 else 0
        if block.quality & Quality.GAP_BEFORE and not 0 < gap_us <= GAP_MAX_US:
            s.whole = False
        s.whole &= block.channel_ok & _OK_MASK == _OK_MASK
        counts = (
            np.frombuffer(block.samples, "<i2")
            .reshape(-1, block.channels)[:, : len(DISPLACEMENTS)]
            .astype(np.int64)
        )
        turn_step = speed_rad_s * (block.sample_period_us * 1e-6) / (2 * pi)
        if turn_step > 0.0:
            s.told_turns += turn_step * max(gap_us, 0) / block.sample_period_us
            self._project(counts, turn_step)
        elif s.centre is not None:
            self._swing(counts, s.centre)
        first, second = counts.sum(axis=0).tolist()
        s.totals = [s.totals[0] + first, s.totals[1] + second]
        s.samples += len(counts)
        s.next_us = block.tick_us + len(counts) * block.sample_period_us
        if s.samples < self._samples:
            return Evidence.NONE
        evidence = self._evidence() if s.whole else Evidence.NONE
        centre = (s.totals[0] / s.samples, s.totals[1] / s.samples)
        self.state = OrbitState(centre=centre, next_us=s.next_us)
        return evidence

    def _project(self, counts: Counts, turn_step: float) -> None:
        """Add the products with every order's cosine and sine."""
        s = self.state
        turns = s.told_turns + turn_step * np.arange(len(counts))
        index = (_STEPS_A_TURN[:, None] * turns).astype(np.int64)
        waves = _COSINE[np.concatenate((index, index - _STEPS // 4)) & (_STEPS - 1)]
        added = waves @ np.column_stack((counts, np.ones(len(counts), np.int64)))
        s.sums = [
            [a + b for a, b in zip(*rows, strict=True)]
            for rows in zip(s.sums, added.tolist(), strict=True)
        ]
        s.told_turns += turn_step * len(counts)
        if s.told_turns >= _PERIOD_TURNS:
            s.told_turns -= _PERIOD_TURNS

    def _swing(self, counts: Counts, centre: tuple[float, float]) -> None:
        """Count how often each channel goes from well below the centre to well above it, and
        back."""
        s = self.state
        for i, limit in enumerate(self._swing_counts):
            away = counts[:, i] - centre[i]
            sides = np.concatenate(
                ([s.side[i]], np.where(away > limit, 1, np.where(away < -limit, -1, 0)))
            )
            sides = sides[sides != 0]
            if len(sides):
                s.swings[i] += int((sides[1:] != sides[:-1]).sum())
                s.side[i] = int(sides[-1])

    def _evidence(self) -> Evidence:
        s = self.state
        if max(s.swings) >= STANDING_SWINGS:
            self.seen_order = 0.0
            return Evidence.CONTRADICTS
        squares = [
            self._square(*pair)
            for pair in zip(s.sums[: len(ORDERS)], s.sums[len(ORDERS) :], strict=True)
        ]
        below, first, above = max(squares[:FIRST]), squares[FIRST], max(squares[FIRST + 1 :])
        if first >= max(self._floor_m2, BELOW_FIRST * BELOW_FIRST * below, above):
            self.seen_order = 1.0
            return Evidence.AGREES
        slow = max(first, self._moved_m2())
        for square, least in ((below, slow), (above, ABOVE_FIRST * ABOVE_FIRST * first)):
            if square >= max(self._floor_m2, least):
                self.seen_order = ORDERS[squares.index(square)]
                return Evidence.CONTRADICTS
        return Evidence.NONE

    def _moved_m2(self) -> float:
        """Squared way of the mean since the window before (m2), of the larger channel.

        A clearance or a load that moves shifts the shaft, and the shift looks like the lowest
        orders, the more the slower it turns: at 700 rpm a window holds two periods of the third.
        """
        s = self.state
        if s.centre is None:
            return 0.0
        ways = (
            (total / s.samples - before) * scale
            for total, before, scale in zip(s.totals, s.centre, self._scales, strict=True)
        )
        return max(way * way for way in ways)

    def _square(self, cosine: list[int], sine: list[int]) -> float:
        """Squared amplitude (m2) of an order, of the larger channel."""
        n = self.state.samples
        squares = []
        for i, scale in enumerate(self._scales):
            mean = self.state.totals[i] / n
            real, imaginary = (
                (sums[i] - mean * sums[2]) * scale * 2.0 / (n * _UNIT) for sums in (cosine, sine)
            )
            squares.append(real * real + imaginary * imaginary)
        return max(squares)
