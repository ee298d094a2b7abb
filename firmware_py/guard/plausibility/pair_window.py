"""One window of both displacement probes: its sums in integers, and what they say.

All sums are those of raw counts, so that they are the same on every machine; only the statistics at
the end of a window are floats.
"""

from __future__ import annotations

from math import pi, sqrt
from typing import Final, NamedTuple

import msgspec
import numpy as np

from firmware_py.config import Config
from firmware_py.guard.measurement.motion import DISPLACEMENTS, probes_to_xy
from firmware_py.records import Block

OUTSIDE, POSITION, BACKWARD, COPIED_KIND = "outside", "position", "backward", "copied"
REST: Final = "rest"
KINDS: Final = (OUTSIDE, POSITION, BACKWARD, COPIED_KIND, REST)


class Facts(msgspec.Struct, frozen=True):
    """Slow readings at the time of a block; ``usable`` False: they say nothing of the film now."""

    clearance_m: float
    temperature_C: float
    usable: bool = True


UNKNOWN_C: Final = -300.0
"""Below the absolute zero: nobody measures the oil.  No NaN: a replay finds that it differs."""
NO_FACTS: Final = Facts(0.0, 0.0, False)


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


class PairSums:
    """Sums of a window, kept in a :class:`PairState`, and their statistics.

    Parameters
    ----------
    config
        Scales and angles of the two probes, and the sample period.
    """

    def __init__(self, config: Config) -> None:
        probes = [config.machine.channel[i] for i in DISPLACEMENTS]
        self._scales = [(p.scale, p.offset) for p in probes]
        self.to_xy = probes_to_xy(probes[0].angle_deg, probes[1].angle_deg)
        (xa, xb), (ya, yb) = self.to_xy
        self.turned_over = xa * yb - xb * ya
        self._period_s = config.sampling.period_us * 1e-6

    def leave_out(self, s: PairState) -> None:
        """A block is left out: what comes next does not continue what was before."""
        if s.n and s.last:
            (a0, b0), (a1, b1) = s.first, s.last[-1]
            s.moved = (s.moved[0] + a1 - a0, s.moved[1] + b1 - b0)
            s.last = []

    def add(self, s: PairState, block: Block, facts: Facts, peak_to_peak_m: float) -> None:
        """Take ``block`` into the sums of ``s``; the first one begins the window."""
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

    def statistics(self, s: PairState) -> PairStatistics:
        """What the sums of ``s`` say; the window ends here."""
        n = s.n
        a, b, aa, bb, ab, cross, daa, dbb, dab = s.sums
        (ka, oa), (kb, ob) = self._scales
        va, vb, vab = (
            (n * aa - a * a) / (n * n) * ka * ka,
            (n * bb - b * b) / (n * n) * kb * kb,
            (n * ab - a * b) / (n * n) * ka * kb,
        )
        self.leave_out(s)
        da, db = s.moved
        twice = (n * cross - a * db + b * da) / n * ka * kb * self.turned_over
        (xa, xb), (ya, yb) = self.to_xy
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


def _share(both: float, first: float, second: float) -> float:
    """Correlation coefficient; 0 where there is no signal."""
    return both / sqrt(first * second) if first > 0 and second > 0 else 0.0
