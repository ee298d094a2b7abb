"""Channel OK (vocabulary of API 670, 5th ed.): could a working sensor give that signal, and if not,
why not?

* **open**: at the rail for 0.1 s without an alternating part (a broken cable).  Not OK; it leaves
  the vote.
* **stuck**: not moved by one count for :data:`STUCK_S`.  Not OK; it leaves the vote.
* **saturated**: the rail is touched in step with the rotation or with whirl
  (:mod:`~firmware_py.acquire.rails`): that is vibration, and must not defeat its own trip.  It
  counts as its rail and votes.
* **intermittent**: the rail is touched out of step, or a displacement steps faster than a shaft
  can.  Not OK until clean for :data:`CLEAN_S`; what is clean in between still counts towards a
  trip, a bad block neither way.
* **beyond**: much of it lies outside the range, and it is none of these, or not yet: a gap that is
  wrong while the signal alternates.  Not OK; it votes as measured.

Open, stuck, saturated and beyond return after :data:`HOLD_OFF_S` without their cause.
"""

from __future__ import annotations

import math
from typing import Final

import msgspec
import numpy as np
import numpy.typing as npt

from firmware_py.acquire.rails import CLEAR, Rail, RailState, RailWatch
from firmware_py.config import Config
from firmware_py.config.instances import places
from firmware_py.machine import FastChannel, JournalBearing, Machine
from firmware_py.machine.parts import bearings_of, clearance_known
from firmware_py.records import ChannelCause, cause_bits, cause_of
from firmware_py.records.acquired import CAUSE_BITS

STUCK_S: Final = 0.25
FLAT_S: Final = 0.02
"""A signal that has not moved for so long says nothing of a vibration, neither that it is small."""
HOLD_OFF_S: Final = 1.0
CLEAN_S: Final = 30.0
"""Time without a bad block after which a channel with a bad contact is OK again."""

STEP_FACTOR: Final = 2.0
"""A shaft in the widest clearance ``c`` cannot move faster than ``w c`` at its highest speed ``w``;
twice that, for what runs faster than the shaft."""
LONE_SHARE: Final = 0.5
"""A step is one of a contact where the signal beside it moves by less than this share of it: a
vibration that is too large for its range crosses the range in several steps."""
DROP_M: Final = 2e-6
"""Fall of a displacement to exactly zero, within one sample, that is a contact and no movement."""
MEAN_S: Final = 0.25
"""Time constant of the mean of a displacement."""
GAP_SHARE: Final = 1.25
"""Mean of a displacement, over the widest clearance, beyond which the gap is wrong, whatever
touches the rail."""

_BEFORE: Final = 3
"""Samples of the block before that a step needs on both its sides."""
_WORD: Final = (1 << CAUSE_BITS) - 1
_INT16_MIN: Final = -32768
_INT16_MAX: Final = 32767


class ChannelOkState(msgspec.Struct):
    """Per channel: samples without change and the value they hold; good samples still owed.

    ``owed`` is that of the flag for the diagnosis.  ``cause`` stands for as long as ``cause_owed``,
    a bad contact as long as ``unclean``; ``torn`` counts from the last step that no shaft can make.
    Of the displacements: ``before`` are the last three samples, ``means`` the means, ``dropped``
    the bits of those that lie at zero after a drop. ``turn`` is where the shaft stands.  ``causes``
    and ``unusable`` are what the last block said: see :class:`~firmware_py.records.Block`.
    """

    same: list[int]
    value: list[int]
    owed: list[int]
    cause: list[int] = []
    cause_owed: list[int] = []
    unclean: list[int] = []
    rails: list[RailState] = []
    torn: list[int] = []
    before: list[list[int]] = []
    means: list[float] = []
    dropped: int = 0
    turn: float = 0.0
    causes: int = 0
    unusable: int = 0
    causes_high: int = 0


def counts_range(channel: FastChannel) -> tuple[int, int]:
    """OK range of ``channel`` in raw counts, always inside the rails of ``int16``."""
    ends = sorted(
        (limit - channel.offset) / channel.scale for limit in (channel.ok_low, channel.ok_high)
    )
    return max(math.ceil(ends[0]), _INT16_MIN + 1), min(math.floor(ends[1]), _INT16_MAX - 1)


class ChannelOk:
    """Judges the channels, block by block.

    Parameters
    ----------
    channels
        The configured channels in wire order; on those that shake with the shaft (by their kind)
        a touch of the rail out of step is a bad contact.
    rate_hz
        Sampling rate.
    reach_m, fastest_m_s
        The farthest that a shaft can be from the middle, and its fastest movement; infinite: not
        judged.
    """

    def __init__(
        self,
        channels: list[FastChannel],
        rate_hz: int,
        reach_m: float = math.inf,
        fastest_m_s: float = math.inf,
    ) -> None:
        ranges = [counts_range(c) for c in channels]
        self._low = np.array([low for low, _ in ranges], np.int16)
        self._high = np.array([high for _, high in ranges], np.int16)
        self._rails = [RailWatch(low, high, rate_hz) for low, high in ranges]
        self._rate_hz = rate_hz
        self._mean_samples = MEAN_S * rate_hz
        self._flat_samples = round(FLAT_S * rate_hz)
        self._stuck_samples = round(STUCK_S * rate_hz)
        self._hold_off_samples = round(HOLD_OFF_S * rate_hz)
        self._clean_samples = round(CLEAN_S * rate_hz)
        where = places(channels)
        self._count, self._shaking = where.number, where.shaking
        self._probes = [i for i, c in enumerate(where.kinds) if c == "displacement"]
        scales = [
            (abs(channels[i].scale), channels[i].offset / channels[i].scale) for i in self._probes
        ]
        self._steps = [fastest_m_s / rate_hz / scale for scale, _ in scales]
        self._zeros = [DROP_M / scale for scale, _ in scales]
        self._gaps = [(zero, GAP_SHARE * reach_m / scale) for scale, zero in scales]
        self.state = ChannelOkState([0] * self._count, [0] * self._count, [0] * self._count)

    @classmethod
    def of(cls, config: Config) -> ChannelOk:
        """With the widest clearance and the speed that ``config`` declares."""
        machine = config.machine
        reach_m = max(_reach_m(machine, bearing) for bearing in bearings_of(machine))
        fastest_m_s = STEP_FACTOR * reach_m * machine.operating.speed_max_rpm * math.pi / 30
        return cls(config.machine.channel, config.sampling.rate_hz, reach_m, fastest_m_s)

    def step(
        self, samples: npt.NDArray[np.int16], speed_rad_s: float = 0.0, gap: bool = False
    ) -> int:
        """Mask of OK channels for the diagnosis, after the next ``samples`` (``n x channels``
        counts).

        ``gap`` says that samples are missing before them; a speed of 0 is unknown.
        """
        s, n = self.state, len(samples)
        if not s.cause:
            s.cause, s.cause_owed, s.unclean, s.torn = ([0] * self._count for _ in range(4))
            s.rails = [RailState() for _ in range(self._count)]
        if gap:
            s.before = []
        outside = ((samples < self._low) | (samples > self._high)).sum(axis=0).tolist()
        still = (samples[0] == samples[-1]).tolist()
        torn, undecided = self._torn(samples)
        ok = causes = unusable = 0
        for i in range(self._count):
            if still[i]:
                stuck = self._stuck(i, samples)
            else:
                s.same[i], stuck = 0, False
            rail, touch = CLEAR, s.rails[i]
            if outside[i] or touch.side or touch.count:
                rail = self._rails[i].step(
                    touch, samples[:, i], outside[i] > 0, s.turn, speed_rad_s
                )
            bad = 4 * outside[i] > n or stuck or torn >> i & 1
            s.owed[i] = self._hold_off_samples if bad else _after(s.owed[i], n)
            ok |= (s.owed[i] == 0) << i
            cause, left_out = self._cause(i, n, rail, stuck, bool(torn >> i & 1))
            if cause == ChannelCause.OK and s.owed[i]:
                cause = ChannelCause.BEYOND
            causes |= cause_bits(i, cause)
            unusable |= (left_out or undecided >> i & 1) << i
        s.turn += n * speed_rad_s / (2 * math.pi * self._rate_hz)
        s.causes, s.causes_high = causes & _WORD, causes >> CAUSE_BITS
        s.unusable = unusable
        return ok

    def _cause(
        self, i: int, n: int, rail: Rail, stuck: bool, torn: bool
    ) -> tuple[ChannelCause, bool]:
        """Why channel ``i`` is not OK, and whether its block is left out of every judgement."""
        s = self.state
        if rail is CLEAR and not (
            stuck or torn or s.unclean[i] or s.torn[i] or s.cause_owed[i]
        ):  # nothing is wrong, and nothing was
            return ChannelCause.OK, s.same[i] >= self._flat_samples
        torn_rail = rail.out_of_step and i in self._shaking
        s.unclean[i] = self._clean_samples if torn or torn_rail else _after(s.unclean[i], n)
        s.torn[i] = self._hold_off_samples if torn else _after(s.torn[i], n)
        now = ChannelCause.OK
        if rail.open:
            now = ChannelCause.OPEN
        elif stuck:
            now = ChannelCause.STUCK
        elif rail.saturated and not s.torn[i]:  # no vibration steps so, in step or not
            now = ChannelCause.SATURATED if self._gap_valid(i) else ChannelCause.BEYOND
        elif rail.beyond:
            now = ChannelCause.BEYOND
        if now:
            s.cause[i], s.cause_owed[i] = now, self._hold_off_samples
        else:
            s.cause_owed[i] = _after(s.cause_owed[i], n)
        held = cause_of(s.cause[i], 0) if s.cause_owed[i] else ChannelCause.OK
        cause = ChannelCause.INTERMITTENT if held == ChannelCause.OK and s.unclean[i] else held
        left_out = torn or rail.unsure or s.same[i] >= self._flat_samples
        return cause, left_out or cause in (ChannelCause.OPEN, ChannelCause.STUCK)

    def _gap_valid(self, i: int) -> bool:
        """Whether a displacement's mean is one that a shaft in its bearing can have."""
        if i not in self._probes:
            return True
        zero, most = self._gaps[self._probes.index(i)]
        return abs(self.state.means[self._probes.index(i)] + zero) <= most

    def _torn(self, samples: npt.NDArray[np.int16]) -> tuple[int, int]:
        """Masks of displacements with a lone step that no shaft can make, or that drop to zero, and
        of undecided ones.

        A step at the end of the block is judged with the next one.
        """
        s, mask, undecided = self.state, 0, 0
        new = samples[:, self._probes].astype(np.int64)
        means = [total / len(samples) for total in new.sum(axis=0).tolist()]
        share = min(1.0, len(samples) / self._mean_samples)
        s.means = [a + share * (b - a) for a, b in zip(s.means or means, means, strict=True)]
        rows = np.concatenate([np.array(s.before, np.int64), new]) if s.before else new
        s.before = rows[-_BEFORE:].tolist()
        steps = rows[1:] - rows[:-1]
        largest = np.abs(steps).max(axis=0, initial=0).tolist()
        zeros = (rows == 0).any(axis=0).tolist()
        for j, i in enumerate(self._probes):
            dropped = zeros[j] and _drops_to_zero(
                rows[:, j], self._zeros[j], bool(s.dropped >> j & 1)
            )
            s.dropped = s.dropped & ~(1 << j) | (dropped and bool(rows[-1, j] == 0)) << j
            torn = largest[j] > self._steps[j] and _lone_step(steps[:, j], self._steps[j])
            mask |= (torn or dropped) << i
            undecided |= _lone_so_far(steps[-2:, j].tolist(), self._steps[j]) << i
        return mask, undecided

    def _stuck(self, i: int, samples: npt.NDArray[np.int16]) -> bool:
        """Whether channel ``i``, which ends as it begins, has held one value for the stuck time."""
        s = self.state
        if bool((samples[:, i] != samples[0, i]).any()):
            s.same[i] = 0
            return False
        value = int(samples[0, i])
        s.same[i] = s.same[i] + len(samples) if value == s.value[i] else len(samples)
        s.value[i] = value
        return s.same[i] >= self._stuck_samples


def _reach_m(machine: Machine, bearing: JournalBearing) -> float:
    """The farthest that the shaft can be from the middle of ``bearing``; infinite: not known."""
    if not clearance_known(machine, bearing):
        return math.inf
    return (bearing.radial_clearance_max_um + bearing.radial_clearance_offset_um) * 1e-6


def _after(owed: int, n: int) -> int:
    """What is left of ``owed`` samples after ``n`` good ones."""
    return owed - n if owed > n else 0


def _lone_step(steps: npt.NDArray[np.int64], limit: float) -> bool:
    """Whether a step beyond ``limit`` lies between two that go much less far the same way."""
    middle, size = np.sign(steps[1:-1]), np.abs(steps[1:-1])
    beside = np.maximum(steps[:-2] * middle, steps[2:] * middle)
    return bool(((size > limit) & (beside < LONE_SHARE * size)).any())


def _lone_so_far(steps: list[int], limit: float) -> bool:
    """Whether the last step may turn out to be a lone one."""
    return len(steps) > 1 and abs(steps[1]) > limit and steps[0] / steps[1] < LONE_SHARE


def _drops_to_zero(rows: npt.NDArray[np.int64], least: float, dropped: bool) -> bool:
    """Whether the signal falls to exactly zero from ``least`` or more, and stays there, or comes
    back from there.

    ``dropped``: it was there at the end of the block before.
    """
    before, at, after = rows[:-2], rows[1:-1], rows[2:]
    back = (np.abs(after) > least) & ((after > 0) == (before > 0))
    falls = (np.abs(before) > least) & (back | (after == 0))
    rises = (before == 0) & (np.abs(after) > least)
    return bool(((at == 0) & (falls | rises)).any()) or (dropped and not rows.any())
