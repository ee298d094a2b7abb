"""A channel at the end of its range: a vibration that saturates, an open circuit, or a bad contact?

A *touch* is a run of samples beyond the OK range; it ends where the signal is well inside again.
Touches that follow each other within one period of the slowest whirl are a *chain*.  A vibration
that saturates makes a long chain in step with the rotation, with one of its orders, or with whirl.
A bad contact makes short chains, or touches at random.  A cable that is open stays where it is,
without an alternating part.
"""

from __future__ import annotations

from math import pi
from typing import Final

import msgspec
import numpy as np
import numpy.typing as npt

SLOWEST_ORDER: Final = 0.4
"""Slowest whirl, in orders of the rotation: a vibration touches its rail at least once in 1 / 0.4
turns."""
CHAIN_MAX_S: Final = 0.5
"""Longest time between two touches of a chain, which holds at low speed."""
CHAIN_UNKNOWN_S: Final = 0.1
"""The same while the speed is unknown."""
CHAIN_LEAST: Final = 4
"""Touches before which nothing can be said of a chain: its blocks are not judged."""
COHERENT_LEAST: Final = 16
COHERENT_PERCENT: Final = 70
"""Touches, and mean resultant length of their phases in the best order: 16 at random reach it in 1
of 100 chains, 32 in 1 of 200 000 (29 orders are tried)."""
REMEMBERED: Final = 32
INSIDE_SHARE: Final = 0.1
"""A touch ends where the signal is this share of half the range inside: noise at the rail makes no
second one."""
ALTERNATING_SHARE: Final = 0.02
"""Peak to peak of a block, as a share of the range, above which a signal beyond the range still
alternates."""
OPEN_S: Final = 0.1
OPEN_MAX_S: Final = 0.3
"""Time at the rail after which a cable is open: the first, or one turn where that is longer, up to
the second."""

_TURN: Final = 65536
_HALF: Final = _TURN // 2
_UNIT: Final = _HALF * _HALF // 4 >> 14
_ORDERS: Final = np.array([*range(40, 51), *range(80, 100, 2), *range(100, 900, 100)])[:, None]
"""Whirl (twice: it may touch both ends), the rotation and its first harmonics, in 1/100 of the
rotation."""

Counts = npt.NDArray[np.int16]


class RailState(msgspec.Struct):
    """The present touch and chain of one channel.

    ``side`` is the rail that is touched now (-1, 0, 1); ``run`` and ``flat`` count the samples
    there, and the latest of them without an alternating part.  ``turns`` are the places of the
    chain's touches, in turns. ``count`` is all its touches, ``idle`` the samples since the last of
    them ended.
    """

    side: int = 0
    run: int = 0
    flat: int = 0
    idle: int = 0
    count: int = 0
    coherent: bool = False
    turns: list[float] = []


class Rail(msgspec.Struct, frozen=True):
    """What one block says of the ends of the range."""

    open: bool = False
    beyond: bool = False
    """Beyond the range for as long as an open circuit would be, but alternating."""
    saturated: bool = False
    out_of_step: bool = False
    unsure: bool = False
    """At the rail, or in a chain that is still too short."""


CLEAR: Final = Rail()


class RailWatch:
    """Judges one channel.

    Parameters
    ----------
    low, high
        OK range in counts.
    rate_hz
        Sampling rate.
    """

    def __init__(self, low: int, high: int, rate_hz: int) -> None:
        self._low, self._high, self._rate_hz = low, high, rate_hz
        inside = INSIDE_SHARE * 0.5 * (high - low)
        self._inside = (low + inside, high - inside)
        self._alternating = ALTERNATING_SHARE * (high - low)

    def step(
        self, s: RailState, counts: Counts, touched: bool, turn: float, speed_rad_s: float
    ) -> Rail:
        """Judge a block of one channel.

        Parameters
        ----------
        s
            The channel's state, which is changed.
        touched
            Whether any sample lies beyond the OK range.
        turn
            Place of the first sample in turns.
        speed_rad_s
            Present speed; 0 is unknown or standstill.
        """
        n = len(counts)
        longest = self._chain_samples(speed_rad_s)
        if not touched and not s.side:
            if not s.count:
                return CLEAR
            s.idle += n
            return self._end(s) if s.idle > longest else self._verdict(s, False)
        broken = self._touches(s, counts, longest, turn, speed_rad_s)
        if s.side:
            there = counts[-min(s.run, n) :]
            steady = int(there.max()) - int(there.min()) <= self._alternating
            s.flat = s.flat + len(there) if steady else 0
        turn_s = 2 * pi / speed_rad_s if speed_rad_s > 0.0 else 0.0
        long = max(OPEN_S, min(turn_s, OPEN_MAX_S)) * self._rate_hz
        if s.side and s.run >= long:
            s.count, s.coherent, s.turns = 0, False, []
            return Rail(open=s.flat >= long, beyond=s.flat < long, unsure=s.flat >= long)
        verdict = self._verdict(s, True)
        return msgspec.structs.replace(verdict, out_of_step=True) if broken else verdict

    def _chain_samples(self, speed_rad_s: float) -> float:
        if speed_rad_s > 0.0:
            return min(2 * pi / (SLOWEST_ORDER * speed_rad_s), CHAIN_MAX_S) * self._rate_hz
        return CHAIN_UNKNOWN_S * self._rate_hz

    def _touches(
        self, s: RailState, counts: Counts, longest: float, turn: float, speed_rad_s: float
    ) -> bool:
        """Take in the touches of a block; whether a chain ended in it that was no vibration."""
        per_sample = speed_rad_s / (2 * pi * self._rate_hz)
        low, high = self._inside
        broken = new = False
        for k, value in enumerate(counts.tolist()):
            side = 1 if value > self._high else -1 if value < self._low else 0
            if side and side != s.side:
                if s.count and s.idle > longest:
                    broken |= self._end(s).out_of_step
                s.side, s.run, s.flat, s.idle = side, 0, 0, 0
                s.count, new = s.count + 1, True
                s.turns.append(turn + k * per_sample)
                if len(s.turns) > REMEMBERED:
                    del s.turns[0]
            elif s.side and low < value < high:
                s.side, s.run, s.flat, s.idle = 0, 0, 0, 0
            if s.side:
                s.run += 1
            else:
                s.idle += 1
        if new and len(s.turns) >= COHERENT_LEAST:
            s.coherent = speed_rad_s > 0.0 and coherent(s.turns)
        return broken

    def _verdict(self, s: RailState, at_rail: bool) -> Rail:
        """Of a chain that goes on: dense touches that keep no step are a bad contact once there are
        enough."""
        short = s.count < CHAIN_LEAST
        lost = not s.coherent and len(s.turns) >= REMEMBERED
        return Rail(saturated=s.coherent, out_of_step=lost, unsure=short and at_rail)

    def _end(self, s: RailState) -> Rail:
        """The chain is over: a short one, or one without step, was no vibration."""
        out_of_step = not s.coherent
        s.count, s.idle, s.coherent, s.turns = 0, 0, False, []
        return Rail(out_of_step=out_of_step)


def coherent(turns: list[float]) -> bool:
    """Whether places in turns keep step with one order of a machine.

    Integers throughout, so that the sums are the same on every machine: phases in 1/65536 turn, and
    a parabola for the sine, which is within 6 % of it.
    """
    places = np.array([round((t - turns[0]) * _TURN) for t in turns], np.int64)
    phase = places * _ORDERS // 100
    sums = _parabola(np.concatenate((phase + _TURN // 4, phase)) & _TURN - 1).sum(axis=1)
    x, y = sums[: len(_ORDERS)], sums[len(_ORDERS) :]
    least = COHERENT_PERCENT * len(turns) * _UNIT // 100
    return bool((x * x + y * y >= least * least).any())


def _parabola(phase: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    half = phase & _HALF - 1
    arch = half * (_HALF - half) >> 14
    return np.where(phase < _HALF, arch, -arch)
