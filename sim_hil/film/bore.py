"""Fixed pads: the gap of a bore that is not one circle, and what of it enters the film.

Each of `count` equal pads is an arc of a circle with the machined clearance `c_p`, pushed towards
the shaft until the inscribed circle has the clearance `c`, which is the bearing's. With the preload
`m = 1 - c / c_p` and the angle `t_p` of each pad where a shaft in the middle stands nearest,

    h / c = (1 - m cos(t - t_p)) / (1 - m) - X cos t - Y sin t

(Lund and Thomsen, A calculation method and data for the dynamic coefficients of oil-lubricated
journal bearings, ASME, 1978). `offset` is where on the pad `t_p` lies: 0.5 in its middle (lemon,
three-lobe), 1 at its end in the direction of rotation (offset halves).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from firmware_py.machine import FixedPads

from .pad_shape import pad_shear
from .records import FeedPatch, FilmError, Floats

_WHOLE_TURN = 2 * math.pi


@dataclass(frozen=True)
class PadBore:
    """Equal fixed pads, evenly around the shaft.

    Parameters
    ----------
    count
        Number of pads.
    angle_rad
        Middle of the first pad.
    arc_rad
        Of each pad; what is left between two of them is an axial groove at ambient pressure.
    preload
        `m`, from 0 (round) to below 1.
    offset
        Share of the pad's arc, in the positive direction, at which it stands nearest.
    """

    count: int
    angle_rad: float
    arc_rad: float
    preload: float
    offset: float = 0.5

    def __post_init__(self) -> None:
        pitch = _WHOLE_TURN / self.count if self.count > 0 else math.nan
        if not 1 <= self.count <= 12:
            raise FilmError(f"pads: {self.count}; 1 to 12 pads")
        if not 0.0 < self.arc_rad <= pitch * (1 + 1e-9):
            raise FilmError(
                f"pads: an arc of {math.degrees(self.arc_rad):g} deg; above 0 and at most "
                f"{math.degrees(pitch):g}, a turn over {self.count}"
            )
        if not 0.0 <= self.preload <= 0.95:
            raise FilmError(f"pads: a preload of {self.preload:g}; from 0 to 0.95")
        if not 0.0 <= self.offset <= 1.0:
            raise FilmError(f"pads: an offset of {self.offset:g}; from 0 to 1")
        if not math.isfinite(self.angle_rad):
            raise FilmError(f"pads: at {self.angle_rad} rad; must be finite")

    @classmethod
    def of(cls, pads: FixedPads | None) -> PadBore | None:
        """The bore of a machine; None where it is round."""
        if pads is None:
            return None
        angle, arc = math.radians(pads.angle_deg), math.radians(pads.arc_deg)
        return cls(pads.count, angle, arc, pads.preload, pads.offset_share)

    def shear(self, position: Floats) -> float:
        """Integral of the clearance over the film around the pads, the journal at `position` over
        the clearance; the grooves between them are deep and shear nothing."""
        return float(
            pad_shear(
                self.count,
                self.angle_rad,
                self.arc_rad / 2,
                self.shift,
                (self.offset - 0.5) * self.arc_rad,
                float(position[0]),
                float(position[1]),
            )
        )

    @property
    def middles_rad(self) -> Floats:
        """Middle of each pad."""
        pitch = _WHOLE_TURN / self.count
        return np.array([self.angle_rad + pitch * k for k in range(self.count)])

    @property
    def nearest_rad(self) -> Floats:
        """Where each pad stands nearest to a shaft in the middle."""
        return self.middles_rad + (self.offset - 0.5) * self.arc_rad

    @property
    def shift(self) -> float:
        """Distance of each pad's centre from that of the bearing, over its clearance."""
        return self.preload / (1.0 - self.preload)

    @property
    def seams_rad(self) -> Floats:
        """Between neighbouring pads, in the middle of the groove where there is one."""
        return self.middles_rad + math.pi / self.count

    @property
    def gap_rad(self) -> float:
        """Width of each groove; 0 where the pads meet."""
        gap = _WHOLE_TURN / self.count - self.arc_rad
        return gap if gap > 1e-6 else 0.0

    def grooves(self, length_m: float) -> tuple[FeedPatch, ...]:
        """The grooves between the pads, as long as the bearing, at ambient pressure."""
        if not self.gap_rad:
            return ()
        return tuple(
            FeedPatch("groove", float(angle), self.gap_rad, length_m, 0.0)
            for angle in self.seams_rad
        )

    def thickness(self, theta: Floats) -> Floats:
        """Film over clearance around a shaft in the middle."""
        return 1.0 + self.shift * (1.0 - np.cos(self._from_nearest(theta)))

    def _from_nearest(self, theta: Floats) -> Floats:
        """Angle from where the pad that is at `theta` stands nearest; a groove belongs to the pad
        that is closer."""
        pitch = _WHOLE_TURN / self.count
        within = np.remainder(theta - self.angle_rad + pitch / 2, pitch) - pitch / 2
        return np.asarray(within - (self.offset - 0.5) * self.arc_rad)

    def smallest(self, position: Floats) -> float:
        """Smallest film over clearance on any pad; the journal at `position` over clearance."""
        half = self.arc_rad / 2
        least = math.inf
        for middle, nearest in zip(self.middles_rad, self.nearest_rad, strict=True):
            x = self.shift * math.cos(nearest) + float(position[0])
            y = self.shift * math.sin(nearest) + float(position[1])
            away = math.remainder(math.atan2(y, x) - middle, _WHOLE_TURN)
            at = min(max(away, -half), half)
            reach = math.hypot(x, y)
            ends = (at, -half, half)
            least = min(least, *(1 + self.shift - reach * math.cos(end - away) for end in ends))
        return least

    def reach(self, direction_rad: float) -> float:
        """How far the journal goes in that direction until it touches, over the clearance."""
        low, high = 1.0 - 1e-12, 1.0 + 2 * self.shift + 1.0
        way = np.array([math.cos(direction_rad), math.sin(direction_rad)])
        while self.smallest(high * way) > 0.0 and high < 1e3:
            high *= 2.0
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.smallest(middle * way) > 0.0 else (low, middle)
        return low
