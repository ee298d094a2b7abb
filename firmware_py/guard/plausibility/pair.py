"""Do the two displacement probes tell of one shaft?  Plausibility of the pair by static position,
load and orbit.

Every second of samples is judged as a whole; a gap, a bad sample or a lost mark leaves out its
block.  Five things no shaft does, each with the smallest size that is found:

- *outside*: the mean position lies outside the clearance.  Found beyond the clearance, its error
  and the error of the zero.
- *position*: no place of the film at rest, at any declared load and oil, is credible for both
  probes (steady speed and clearance).  Found where each probe is off by 2 um + 3 % of its reading
  (0.5 um + 1 % once zeroed), and by what the clearance's error adds.
- *backward*: the orbit runs against the rotation by more than runout can feign.  Found with an
  orbit of about 8 um (1 um once zeroed and slow-rolled).
- *copied*: both channels carry one signal, its noise included.  Found at 0.3 um rms.
- *rest*: a shaft that stands lies off the wall of the bearing.  Found at 33 um + 8 % of the
  clearance (3 um + 6 % once zeroed), and at the clearance's error.

A kind stands after :data:`BAD_LEAST` windows, and later where good ones come between: 3 to 5 s
while speed and clearance are steady, and as much later as they are not.
``python -m models.control.pair_study --faults --builds 6 --seed 3000`` measures it under a random
duty (unzeroed probes, half a minute for each fault):

- Gain of x times 0.2: named in 5 of 6 builds, after 18 s (median) and 27 s at most; times 0.5: in 1
  of 6.
- Sign of y, or both signs: named in 6 of 6 builds, after 7 s (median) and 9 s at most; a step that
  is large enough ends authority at once, for the channel looks like a bad contact.
- With ``--builds 3``: gain of y times 2 and offsets of 10 um after 3 s; swapped, copied, 3 to 7 s;
  a drift of 1 um/s, 12 to 15 s.  Both gains times 0.5 after 3 to 15 s; times 0.2 in 2 of 3, after 3
  to 4 s.

What moves the mean along the curve is another load and cannot be seen: both gains, where the mean
is near the middle or the loss is small; one gain, where its probe reads little.  Until it is named,
and where it is not, the range does not widen by the smaller orbit
(:mod:`~firmware_py.guard.envelope.vibration_hold`), as long as the speed stays, for two minutes.

A position off the curve stands from the first steady seconds on as well, but for one case: probes
whose zero was never taken (``zeroed = false``), a mean below the middle that was off by at most
:data:`~.pair_verdicts.ANOTHER_ZERO_M` in the very first window, has not moved since, and an orbit
that is a forward circle, which order, single signs and unequal gains do not leave.  That may be a
zero (or a direction of the load) other than configured: the load estimate rests on the declared
range meanwhile, and nothing is said here.  An equal loss of gain of both probes from the first
second on can hide in it while the shaft runs, and not at rest: a shaft that stands lies on the
wall, as far from the middle as the clearance is wide, so that a gain of 0.2 is named in a clearance
of 50 um and more, of 0.5 from 80 um on, :data:`REST_S` after it stopped.  Such a mean may be ten
times the declared error of the zero off: nothing but this narrow case keeps it from being named,
and the zero procedure closes it.

A channel with a bad contact is judged in the seconds in which it is clean: a sign or order that
changes at once looks like one first, and must be named before the channel counts as OK again.  All
sums are integers, so that they are the same on every machine.
"""

from __future__ import annotations

from math import pi
from typing import Final

from firmware_py.config import Config
from firmware_py.guard.alarms.alarm import Notice
from firmware_py.guard.alarms.tally import BAD, counted
from firmware_py.guard.measurement.motion import DISPLACEMENTS
from firmware_py.guard.plausibility.pair_verdicts import PairVerdicts, Verdict, copied
from firmware_py.guard.plausibility.pair_window import (
    BACKWARD,
    COPIED_KIND,
    KINDS,
    OUTSIDE,
    POSITION,
    REST,
    Facts,
    Kind,
    PairState,
    PairStatistics,
    PairSums,
)
from firmware_py.records import Alarm, Block, ChannelCause, Quality, Severity, cause_of

WINDOW_S: Final = 1.0
BAD_LEAST: Final = 3
"""Windows before a kind stands; they add up where good ones come between."""
HELD_S: Final = 3.0
"""A window whose blocks are that far apart begins anew."""
REST_S: Final = 10.0
"""A shaft that has stood so long has sunk to the wall: the film under it is squeezed out in 2 s."""
GOOD_LEAST: Final = 10
"""Windows in a row without it, before a kind ends."""

JUDGED: Final = (ChannelCause.OK, ChannelCause.INTERMITTENT)
"""Causes of a channel with which a block may be judged, if the block itself is clean."""
FIRST: Final = "disp"
"""Before the names of the alarms of the first bearing."""


class PairCheck:
    """Judges the pair, second by second.

    Parameters
    ----------
    config
        Bearing, oil, probes and the declared range of static load (downward, along -y).
    name
        Of the bearing, in its alarms; that of the first is ``disp``.
    """

    def __init__(self, config: Config, name: str = FIRST) -> None:
        self._name, self._probes = name, tuple(c.name for c in config.machine.channel[:2])
        self._sums = PairSums(config)
        self._verdicts = PairVerdicts(config, self._sums.to_xy)
        self._samples = round(WINDOW_S / (config.sampling.period_us * 1e-6))
        self._slowest_rad_s = 0.98 * config.machine.operating.speed_min_rpm * pi / 30
        self.facts, self.drawn = self._verdicts.facts, self._verdicts.drawn
        self.state = PairState()

    def restore(self, state: PairState) -> None:
        """Go on from a snapshot; kinds that an earlier version did not judge begin anew."""
        state.kinds = self.state.kinds | state.kinds
        self.state = state

    @property
    def plausible(self) -> bool:
        """Whether nothing stands against the pair."""
        return not any(kind.standing for kind in self.state.kinds.values())

    def standing(self) -> list[Alarm]:
        """One alarm for each kind that stands."""
        return [
            Alarm(
                f"{self._name}_pair_{name}",
                int(Severity.FAULT),
                k.since_ns,
                k.value,
                k.limit,
                False,
                f"{self._both} contradict the machine ({name}); {self._next_step}",
            )
            for name, k in self.state.kinds.items()
            if k.standing
        ]

    @property
    def _both(self) -> str:
        return " and ".join(self._probes)

    @property
    def _next_step(self) -> str:
        return f"check wiring, order, sign, gain and zero of {self._both}"

    def step(self, block: Block, facts: Facts, peak_to_peak_m: float) -> list[Notice]:
        """Take in ``block``; judge when it ends a window."""
        s = self.state
        resting = block.speed_rad_s == 0.0 and not block.quality & Quality.NO_MARK
        if resting != (s.rest_ns >= 0):
            s.n, s.rest_ns = 0, block.t_acq_ns if resting else -1
        if not resting and 0.0 < block.speed_rad_s < self._slowest_rad_s:
            s.n = 0
        elif _says_nothing(block):
            self._sums.leave_out(s)
        elif not resting or block.t_acq_ns - s.rest_ns >= REST_S * 1e9:
            if block.t_acq_ns - s.begun_ns >= HELD_S * 1e9:
                s.n = 0
            self._sums.add(s, block, facts, peak_to_peak_m)
        if s.n < self._samples:
            return []
        notices = self._judge(self._sums.statistics(s), facts, block)
        s.n = 0
        return notices

    def _judge(self, w: PairStatistics, facts: Facts, block: Block) -> list[Notice]:
        """What the window says of each kind; nothing said leaves a kind as it is."""
        s, verdicts = self.state, self._verdicts
        found = {BACKWARD: verdicts.backward(w), COPIED_KIND: copied(w)}
        usable = facts.usable and s.start is not None and s.start.usable
        if s.rest_ns >= 0:
            found = {REST: verdicts.at_rest(s, w, facts)} if usable else {}
        elif usable:
            found[OUTSIDE] = verdicts.outside(s, w, facts)
            position = verdicts.position(s, w, facts, block.speed_rad_s)
            if position is not None:
                found[POSITION] = position
        t_ns = block.t_acq_ns + block.instants * block.period_ns
        notices = []
        for name in KINDS:
            if name in found:
                notices += self._count(name, s.kinds[name], found[name], t_ns)
        return notices

    def _count(self, name: str, kind: Kind, found: Verdict, t_ns: int) -> list[Notice]:
        """Count a verdict; what begins or ends with it."""
        kind.bad = counted(kind.bad, found.bad, 1, BAD_LEAST)
        kind.good = 0 if found.bad else kind.good + 1
        if found.bad:
            kind.value, kind.limit = found.value, found.limit
        if found.bad and kind.bad >= BAD * BAD_LEAST and not kind.standing:
            kind.standing, kind.since_ns = True, t_ns
            return [
                Notice(
                    Severity.FAULT,
                    f"{self._name}_pair_{name}",
                    (
                        f"{self._both} contradict the machine: {found.text} {found.value:.4g} "
                        f"above {found.limit:.4g} for "
                        f"{BAD_LEAST * WINDOW_S:g} s; {self._next_step}"
                    ),
                    found.value,
                    found.limit,
                )
            ]
        if kind.good >= GOOD_LEAST and kind.standing:
            kind.standing = False
            kind.bad = 0
            return [
                Notice(
                    Severity.INFO,
                    f"{self._name}_pair_{name}_ok",
                    (
                        f"{self._both} agree with the machine again ({name}) since "
                        f"{GOOD_LEAST * WINDOW_S:g} s"
                    ),
                )
            ]
        return []


def _says_nothing(block: Block) -> bool:
    """Whether the samples of ``block`` are not to be judged, or do not continue the ones before."""
    return bool(
        block.quality & (Quality.GAP_BEFORE | Quality.NO_MARK)
        or block.channel_ok & 3 != 3
        or block.unusable & 3
        or any(cause_of(block.causes, i) not in JUDGED for i in DISPLACEMENTS)
    )
