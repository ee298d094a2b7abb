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
``python -m models.control.pair_study
--faults --builds 6 --seed 3000`` measures it under a random duty (unzeroed probes, half a minute
for each fault):

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
:data:`ANOTHER_ZERO_M` in the very first window, has not moved since, and an orbit that is a forward
circle, which order, single signs and unequal gains do not leave.  That may be a zero (or a
direction of the load) other than configured: the load estimate rests on the declared range
meanwhile, and nothing is said here.  An equal loss of gain of both probes from the first second on
can hide in it while the shaft runs, and not at rest: a shaft that stands lies on the wall, as far
from the middle as the clearance is wide, so that a gain of 0.2 is named in a clearance of 50 um and
more, of 0.5 from 80 um on, :data:`REST_S` after it stopped.  Such a mean may be ten times the
declared error of the zero off: nothing but this narrow case keeps it from being named, and the zero
procedure closes it.

A channel with a bad contact is judged in the seconds in which it is clean: a sign or order that
changes at once looks like one first, and must be named before the channel counts as OK again.  All
sums are integers, so that they are the same on every machine.
"""

from __future__ import annotations

from math import isnan, nan, pi, sqrt
from typing import Final, NamedTuple

import msgspec
import numpy as np

from firmware_py.config import Config
from firmware_py.guard.alarms.alarm import Notice
from firmware_py.guard.alarms.tally import BAD, counted
from firmware_py.guard.envelope.load_estimate import ORBIT_SHARE_MAX
from firmware_py.guard.measurement.motion import DISPLACEMENTS, probes_to_xy
from firmware_py.machine.film import KNOTS, static_film
from firmware_py.machine.groove import Groove
from firmware_py.machine.lubricant import CredibleOil
from firmware_py.machine.parts import CLEARANCE, has, has_film_law
from firmware_py.machine.probes import are_zeroed, probe_errors
from firmware_py.records import Alarm, Block, ChannelCause, Quality, Severity, cause_of

WINDOW_S: Final = 1.0
BAD_LEAST: Final = 3
"""Windows before a kind stands; they add up where good ones come between."""
HELD_S: Final = 3.0
"""A window whose blocks are that far apart begins anew."""
REST_S: Final = 10.0
"""A shaft that has stood so long has sunk to the wall: the film under it is squeezed out in 2 s."""
GOOD_LEAST: Final = 10
"""And without it before it goes."""

STEADY_SPEED: Final = 0.03
STEADY_M: Final = 5e-6
"""Change of speed (share) and clearance in a window up to which the film is at rest; the latter is
allowed for."""

BEYOND_C: Final = 15.0
"""Outside the declared temperatures by more than this, the outlet says nothing of the film."""
LOAD_SHARE: Final = 0.05
"""Allowed for beyond the declared loads."""
JUDGED: Final = (ChannelCause.OK, ChannelCause.INTERMITTENT)
"""Causes of a channel with which a block may be judged, if the block itself is clean."""
FLAT_SHARE: Final = 0.5
"""Of the orbit's amplitude times runout: what runout makes of a flat orbit."""
COPIED: Final = 0.98
COPIED_LEAST_M: Final = 0.3e-6
"""Correlation of the signals, and of their noise (second differences), and the least rms of a
signal that is judged."""
ROUND: Final = 0.9
FORWARD: Final = 0.95
ROUND_LEAST_M: Final = 0.3e-6
"""Axis ratio, area over that of a forward ellipse, and least rms of an orbit that shows that both
probes are right."""
ANOTHER_ZERO_M: Final = 25e-6
"""The farthest that a zero that was never taken may put the mean beside the curve."""
REST_LEFT: Final = 0.05
"""Share of the clearance that the film may still hold under a shaft that stands."""
MOVED_M: Final = 6e-6
"""A mean that was off the curve from the start may move so far beside it."""

OUTSIDE, POSITION, BACKWARD, COPIED_KIND = "outside", "position", "backward", "copied"
REST: Final = "rest"
KINDS: Final = (OUTSIDE, POSITION, BACKWARD, COPIED_KIND, REST)
FIRST: Final = "disp"
"""Before the names of the alarms of the first bearing."""


class Facts(msgspec.Struct, frozen=True):
    """Slow readings at the time of a block; ``usable`` False: they say nothing of the film now."""

    clearance_m: float
    temperature_C: float
    usable: bool = True


UNKNOWN_C: Final = -300.0
"""Below the absolute zero: nobody measures the oil.  No NaN: a replay finds that it differs."""
NO_FACTS: Final = Facts(0.0, 0.0, False)


class Verdict(NamedTuple):
    """Size of one kind beside its limit."""

    value: float
    limit: float
    text: str

    @property
    def bad(self) -> bool:
        """Whether the limit is passed."""
        return self.value > self.limit


class Kind(msgspec.Struct):
    """How much speaks for a kind, and how often in a row it was not found."""

    bad: int = 0
    good: int = 0
    standing: bool = False
    since_ns: int = 0
    value: float = 0.0
    limit: float = 0.0


class PairState(msgspec.Struct):
    """The window under way, and what earlier ones said.

    ``sums`` are those of a, b, aa, bb, ab, the cross product of neighbours, and aa, bb, ab of
    second differences, of counts ``a`` and ``b`` of the two probes; ``first`` and ``last`` are the
    ends of its part without a gap, ``moved`` the way between the ends of those before, ``begun_ns``
    the time of its first block.  The shaft stands since ``rest_ns`` (-1: it does not).  ``off_m``
    is how far beside the curve the mean was in the first window that was judged.
    """

    kinds: dict[str, Kind] = msgspec.field(default_factory=lambda: {kind: Kind() for kind in KINDS})
    n: int = 0
    sums: list[int] = []
    first: list[int] = []
    last: list[list[int]] = []
    moved: tuple[int, int] = (0, 0)
    begun_ns: int = 0
    rest_ns: int = -1
    start: Facts | None = None
    start_rad_s: float = 0.0
    turns: float = 0.0
    p2p_m: float = 0.0
    off_m: tuple[float, float] | None = None


class PairStatistics(NamedTuple):
    """What a window says, SI: means of the probes and of the shaft, rms of the axes, area over pi,
    correlations."""

    a_m: float
    b_m: float
    x_m: float
    y_m: float
    major_m: float
    minor_m: float
    area_m2: float
    least_rms_m: float
    correlation: float
    noise_correlation: float


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
        b, o = config.machine.bearing, config.machine.operating
        self._name, self._probes = name, tuple(c.name for c in config.machine.channel[:2])
        self._has_law = has_film_law(config.machine)
        self._drawn_m = (
            b.radial_clearance_nominal_um * 1e-6 if has(config.machine, CLEARANCE) else nan
        )
        probes = [config.machine.channel[i] for i in DISPLACEMENTS]
        self._scales = [(p.scale, p.offset) for p in probes]
        self._to_xy = probes_to_xy(probes[0].angle_deg, probes[1].angle_deg)
        (xa, xb), (ya, yb) = self._to_xy
        self._turned_over = xa * yb - xb * ya
        zeroed = self._zeroed = are_zeroed(config.machine)
        errors = probe_errors(config.machine)
        self._zero_m, self._gain = errors.zero_m, errors.gain_share
        rolled_m = max(p.slow_roll_um for p in probes) * 1e-6
        self._runout_m = rolled_m + errors.runout_m if zeroed else errors.runout_m
        self._offset_m, self._error_m = (
            b.radial_clearance_offset_um * 1e-6,
            b.radial_clearance_error_um * 1e-6,
        )
        self._range_m = (
            b.radial_clearance_min_um * 1e-6 - STEADY_M,
            b.radial_clearance_max_um * 1e-6 + STEADY_M,
        )
        self._range_C = (
            config.machine.lubricant.inlet_min_C - BEYOND_C,
            config.machine.lubricant.film_max_C + BEYOND_C,
        )
        self._attitude = b.attitude_error_deg * pi / 180.0
        self._shares = (1.0 - b.load_error_share, 1.0 + b.load_error_share)
        low_N, high_N = Groove(config.machine).film_loads_N
        self._loads_N = (low_N * (1.0 - LOAD_SHARE), high_N * (1.0 + LOAD_SHARE))
        self._film, self._oil = (
            static_film(b.journal_radius_m, b.length_m),
            CredibleOil(config.machine),
        )
        self._coldest_C = (
            200.0
            if config.machine.lubricant.film_at_outlet
            else config.machine.lubricant.inlet_min_C
        )
        # the inverse of the matrix from probes to xy: what each probe sees of the curve
        det = self._turned_over
        self._curve = [
            (e * s, -e * c)
            for e, s, c in zip(
                self._film.eccentricity, self._film.sine, self._film.cosine, strict=True
            )
        ]
        self._seen = [((yb * x - xb * y) / det, (xa * y - ya * x) / det) for x, y in self._curve]
        self._period_s = config.sampling.period_us * 1e-6
        self._samples = round(WINDOW_S / self._period_s)
        self._slowest_rad_s = 0.98 * o.speed_min_rpm * pi / 30
        self.state = PairState()

    def restore(self, state: PairState) -> None:
        """Go on from a snapshot; kinds that an earlier version did not judge begin anew."""
        state.kinds = self.state.kinds | state.kinds
        self.state = state

    def facts(self, clearance_m: float, temperature_C: float, ok: bool = True) -> Facts:
        """Slow readings as far as they are ``ok`` and within the bearing's range."""
        (low_m, high_m), (cold_C, hot_C) = self._range_m, self._range_C
        within = low_m <= clearance_m <= high_m and cold_C <= temperature_C <= hot_C
        return Facts(clearance_m, temperature_C, ok and within)

    def drawn(self, temperature_C: float | None) -> Facts:
        """Of a bearing whose clearance is fixed and not measured: that of its drawing."""
        if isnan(self._drawn_m):
            return NO_FACTS
        return Facts(self._drawn_m, UNKNOWN_C if temperature_C is None else temperature_C)

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
            self._break()
        elif not resting or block.t_acq_ns - s.rest_ns >= REST_S * 1e9:
            if block.t_acq_ns - s.begun_ns >= HELD_S * 1e9:
                s.n = 0
            self._add(block, facts, peak_to_peak_m)
        if s.n < self._samples:
            return []
        notices = self._judge(self._window(), facts, block)
        s.n = 0
        return notices

    def _break(self) -> None:
        """A block is left out: what comes next does not continue what was before."""
        s = self.state
        if s.n and s.last:
            (a0, b0), (a1, b1) = s.first, s.last[-1]
            s.moved = (s.moved[0] + a1 - a0, s.moved[1] + b1 - b0)
            s.last = []

    # ------------------------------------------------------------------ sums

    def _add(self, block: Block, facts: Facts, peak_to_peak_m: float) -> None:
        s = self.state
        rows = (
            np.frombuffer(block.samples, "<i2")
            .reshape(-1, block.channels)[:, : len(DISPLACEMENTS)]
            .astype(np.int64)
        )
        if not s.n:
            s.last, s.sums, s.moved, s.begun_ns = [], [0] * 9, (0, 0), block.t_acq_ns
            s.start, s.start_rad_s, s.turns, s.p2p_m = facts, block.speed_rad_s, 0.0, 0.0
        if not s.last:
            s.first = rows[0].tolist()
        joined = np.concatenate([np.array(s.last, np.int64), rows]) if s.last else rows
        (a, b), (c, d) = rows.T, joined.T
        cross = (
            c[:-1] * d[1:] - c[1:] * d[:-1]
            if len(s.last) < 2
            else c[1:-1] * d[2:] - c[2:] * d[1:-1]
        )
        bends = joined[2:] - 2 * joined[1:-1] + joined[:-2]
        new = (
            a.sum(),
            b.sum(),
            (a * a).sum(),
            (b * b).sum(),
            (a * b).sum(),
            cross.sum(),
            (bends[:, 0] * bends[:, 0]).sum(),
            (bends[:, 1] * bends[:, 1]).sum(),
            (bends[:, 0] * bends[:, 1]).sum(),
        )
        s.sums = [total + int(more) for total, more in zip(s.sums, new, strict=True)]
        s.last = joined[-2:].tolist()
        s.n += len(rows)
        s.turns += len(rows) * self._period_s * block.speed_rad_s / (2.0 * pi)
        s.p2p_m = max(s.p2p_m, peak_to_peak_m)

    def _window(self) -> PairStatistics:
        s, n = self.state, self.state.n
        a, b, aa, bb, ab, cross, daa, dbb, dab = s.sums
        (ka, oa), (kb, ob) = self._scales
        va, vb, vab = (
            (n * aa - a * a) / (n * n) * ka * ka,
            (n * bb - b * b) / (n * n) * kb * kb,
            (n * ab - a * b) / (n * n) * ka * kb,
        )
        self._break()
        da, db = s.moved
        twice = (n * cross - a * db + b * da) / n * ka * kb * self._turned_over
        (xa, xb), (ya, yb) = self._to_xy
        xx = xa * xa * va + 2.0 * xa * xb * vab + xb * xb * vb
        yy = ya * ya * va + 2.0 * ya * yb * vab + yb * yb * vb
        xy = xa * ya * va + (xa * yb + xb * ya) * vab + xb * yb * vb
        half, apart = 0.5 * (xx + yy), sqrt(0.25 * (xx - yy) * (xx - yy) + xy * xy)
        a_m, b_m = a / n * ka + oa, b / n * kb + ob
        return PairStatistics(
            a_m,
            b_m,
            xa * a_m + xb * b_m,
            ya * a_m + yb * b_m,
            sqrt(half + apart),
            sqrt(max(half - apart, 0.0)),
            0.5 * twice / (pi * s.turns) if s.turns else 0.0,
            sqrt(min(va, vb)),
            _share(vab, va, vb),
            _share(dab, daa, dbb),
        )

    # ------------------------------------------------------------------ verdicts

    def _judge(self, w: PairStatistics, facts: Facts, block: Block) -> list[Notice]:
        """What the window says of each kind; nothing said leaves a kind as it is."""
        found = {BACKWARD: self._backward(w), COPIED_KIND: _copied(w)}
        usable = facts.usable and self.state.start is not None and self.state.start.usable
        if self.state.rest_ns >= 0:
            found = {REST: self._at_rest(w, facts)} if usable else {}
        elif usable:
            found[OUTSIDE] = self._outside(w, facts)
            position = self._position(w, facts, block.speed_rad_s)
            if position is not None:
                found[POSITION] = position
        t_ns = block.t_acq_ns + block.instants * block.period_ns
        notices = []
        for name in KINDS:
            if name in found:
                notices += self._count(name, self.state.kinds[name], found[name], t_ns)
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

    def _backward(self, w: PairStatistics) -> Verdict:
        limit = (
            self._runout_m
            * (self._runout_m + FLAT_SHARE * sqrt(2.0) * w.major_m)
            * abs(self._turned_over)
        )
        return Verdict(
            -w.area_m2 * 1e12, limit * 1e12, "the orbit runs against the rotation, um2 over pi"
        )

    def _at_rest(self, w: PairStatistics, facts: Facts) -> Verdict:
        """How far a shaft that stands is off the wall on which it lies.

        Which part of the wall does not matter: friction and the direction of the load do not.
        """
        clearance_m = facts.clearance_m + self._offset_m
        begun_m = self.state.start.clearance_m if self.state.start else facts.clearance_m
        zero_m = sqrt(2.0) * self._zero_m if self._zeroed else ANOTHER_ZERO_M
        limit = zero_m + self._runout_m + self._error_m + self._gain * clearance_m
        limit += abs(facts.clearance_m - begun_m) + REST_LEFT * clearance_m
        off = abs(sqrt(w.x_m * w.x_m + w.y_m * w.y_m) - clearance_m)
        return Verdict(off * 1e6, limit * 1e6, "the shaft stands, but off the bearing's wall, um")

    def _outside(self, w: PairStatistics, facts: Facts) -> Verdict:
        clearance_m = max(
            facts.clearance_m, self.state.start.clearance_m if self.state.start else 0.0
        )
        limit = (clearance_m + self._offset_m + self._error_m) * (1.0 + self._gain) + sqrt(
            2.0
        ) * self._zero_m
        return Verdict(
            sqrt(w.x_m * w.x_m + w.y_m * w.y_m) * 1e6,
            limit * 1e6,
            "the mean position lies outside the clearance, um",
        )

    def _position(self, w: PairStatistics, facts: Facts, speed_rad_s: float) -> Verdict | None:
        """How far a probe is off the nearest place that is admissible, over what is allowed for;
        None: not at rest."""
        s = self.state
        begun = s.start or facts
        moved_m = abs(facts.clearance_m - begun.clearance_m)
        clearance_m = 0.5 * (facts.clearance_m + begun.clearance_m) + self._offset_m
        unsteady = (
            abs(speed_rad_s - s.start_rad_s) > STEADY_SPEED * s.start_rad_s or moved_m > STEADY_M
        )
        lawless = not self._has_law or facts.temperature_C == UNKNOWN_C
        if lawless or unsteady or clearance_m <= 0.0 or s.p2p_m > ORBIT_SHARE_MAX * clearance_m:
            return None
        first, last = self._admissible(clearance_m, speed_rad_s, facts.temperature_C)
        fixed_m = self._zero_m + moved_m + s.p2p_m / (2.0 * pi * max(1.0, s.turns))
        shifted_m = self._attitude * clearance_m + self._error_m
        least = float("inf")
        for k in range(first, last + 1):
            pa, pb = self._seen[k]
            slack_m = fixed_m + shifted_m * self._film.eccentricity[k]
            off = max(
                abs(w.a_m - clearance_m * pa) / (slack_m + self._gain * clearance_m * abs(pa)),
                abs(w.b_m - clearance_m * pb) / (slack_m + self._gain * clearance_m * abs(pb)),
            )
            least = min(least, off)
        if self._another_zero(w, clearance_m, least > 1.0):
            least = 1.0
        return Verdict(
            least,
            1.0,
            (
                "the mean position is none of the film at any declared load; its error over that "
                "allowed"
            ),
        )

    def _admissible(
        self, clearance_m: float, speed_rad_s: float, temperature_C: float
    ) -> tuple[int, int]:
        """Knots of the film that carry a declared load in any credible oil and clearance."""
        warm = self._oil.law(temperature_C) * speed_rad_s
        cold = self._oil.law(min(temperature_C, self._coldest_C)) * speed_rad_s
        narrow_m = max(clearance_m - self._error_m, 1e-9)
        wide_m = clearance_m + self._error_m
        most = self._shares[1] * cold * self._oil.thickest / (narrow_m * narrow_m)
        least = self._shares[0] * warm * self._oil.thinnest / (wide_m * wide_m)
        load = self._film.load
        first = next((k for k in range(KNOTS + 1) if load[k] * most >= self._loads_N[0]), KNOTS)
        last = next((k for k in range(KNOTS, -1, -1) if load[k] * least <= self._loads_N[1]), 0)
        return max(first - 1, 0), min(max(last, first) + 1, KNOTS)

    def _another_zero(self, w: PairStatistics, clearance_m: float, off: bool) -> bool:
        """Whether a mean off the curve is that of the first window, and the orbit shows that both
        probes are right.

        With both signs reversed an orbit is as forward, but the mean lies above the middle.
        """
        s = self.state
        beside = min(
            ((w.x_m - clearance_m * x, w.y_m - clearance_m * y) for x, y in self._curve),
            key=lambda d: d[0] * d[0] + d[1] * d[1],
        )
        round_ = w.minor_m >= ROUND * w.major_m and w.minor_m >= ROUND_LEAST_M
        forward = w.area_m2 >= FORWARD * 2.0 * w.major_m * w.minor_m and w.y_m <= 0.0
        if s.off_m is None:
            near = beside[0] * beside[0] + beside[1] * beside[1] <= ANOTHER_ZERO_M * ANOTHER_ZERO_M
            s.off_m = (
                beside if off and round_ and forward and near and not self._zeroed else (0.0, 0.0)
            )
        dx, dy = beside[0] - s.off_m[0], beside[1] - s.off_m[1]
        known = s.off_m != (0.0, 0.0) and dx * dx + dy * dy <= MOVED_M * MOVED_M
        return off and known and round_ and forward


def _says_nothing(block: Block) -> bool:
    """Whether the samples of ``block`` are not to be judged, or do not continue the ones before."""
    return bool(
        block.quality & (Quality.GAP_BEFORE | Quality.NO_MARK)
        or block.channel_ok & 3 != 3
        or block.unusable & 3
        or any(cause_of(block.causes, i) not in JUDGED for i in DISPLACEMENTS)
    )


def _copied(w: PairStatistics) -> Verdict:
    """Both correlations, as far as there is a signal."""
    value = (
        min(abs(w.correlation), abs(w.noise_correlation))
        if w.least_rms_m >= COPIED_LEAST_M
        else 0.0
    )
    return Verdict(value, COPIED, "both channels carry one signal: correlation with its noise")


def _share(both: float, first: float, second: float) -> float:
    """Correlation coefficient; 0 where there is no signal."""
    return both / sqrt(first * second) if first > 0 and second > 0 else 0.0
