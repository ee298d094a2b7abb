"""What drives the flow through an orifice or a capillary: one law of the pressure drop,

    dp = (q0 + q1 / h^2) Q^2 + mu (l0 + l1 / h^2) Q,

``h`` the film at the opening.

Orifice.  The bore ``A0 = pi d^2 / 4`` and, in series, the curtain ``A1 = P h`` between the edge of
the opening (perimeter ``P``) and the shaft; without losses of their own these two give Lund's
``A = A0 / sqrt(1 + (A0 / A1)^2)`` (J. Basic Eng. 86, 1964).  The discharge coefficient follows
``1 / Cd^2 = (1 + Re_t / Re) / Cd0^2``, which is ``Cd0`` at high and Merritt's ``delta sqrt(Re)`` at
low Reynolds number ``Re = rho (Q / A) D / mu`` (Hydraulic Control Systems, 1967; Wuest's delta is
0.2 for a round hole, 0.157 for a slit with ``D = 2 h``), ``Re_t = (Cd0 / delta)^2``: a quadratic in
``Q``.

Capillary.  Hagen-Poiseuille, ``dp = 128 mu l Q / (pi d^4)``, laminar up to Re = 2300 and without
the entrance, whose length is ``0.06 Re d``.

Only + - * / and sqrt in a fixed order.
"""

from __future__ import annotations

from math import pi, radians, sqrt
from typing import Final, NamedTuple

from firmware_py.machine.feeds import CAPILLARY, GROOVE, ORIFICE, FeedPort

ROUND_DELTA: Final = 0.2
SLIT_DELTA: Final = 0.157
LAMINAR_RE: Final = 2300.0
ENTRANCE_SHARE: Final = 0.06
"""Length over bore and Reynolds number in which the profile of a capillary develops."""
AMBIENT_PA: Final = 1.013e5
LIQUID_BULK_PA: Final = 1.6e9
"""Bulk modulus of mineral oil; water has 2.1e9. Air decides long before."""


class Restrictor(NamedTuple):
    """Coefficients of the pressure drop, SI, and what lies behind; all zero: no restrictor.

    Parameters
    ----------
    q0, q1
        Pa s2/m6 and Pa s2/m4: quadratic part of the bore and of the curtain.
    l0, l1
        1/m3 and 1/m: part that is proportional to viscosity and flow.
    volume_m3, air_share
        Compressible store between restrictor and film.
    """

    q0: float = 0.0
    q1: float = 0.0
    l0: float = 0.0
    l1: float = 0.0
    volume_m3: float = 0.0
    air_share: float = 0.0

    def resistance(self, viscosity_Pa_s: float, film_m: float) -> tuple[float, float]:
        """Coefficients of ``Q^2`` and ``Q`` at that film."""
        per_h2 = 1.0 / (film_m * film_m)
        return self.q0 + self.q1 * per_h2, viscosity_Pa_s * (self.l0 + self.l1 * per_h2)

    def flow_m3_s(self, drop_Pa: float, viscosity_Pa_s: float, film_m: float) -> float:
        """Flow that a pressure drop drives, of its sign.

        Raises
        ------
        ZeroDivisionError
            There is no restrictor.
        """
        quadratic, linear = self.resistance(viscosity_Pa_s, film_m)
        size = abs(drop_Pa)
        flow = 2.0 * size / (linear + sqrt(linear * linear + 4.0 * quadratic * size))
        return flow if drop_Pa >= 0.0 else -flow

    def lag_s(self, supply_Pa: float, viscosity_Pa_s: float, film_m: float) -> float:
        """How late the pressure behind the restrictor follows at half of the supply: store over
        slope of the flow, without the film, which only hastens it."""
        half_Pa = 0.5 * supply_Pa
        quadratic, linear = self.resistance(viscosity_Pa_s, film_m)
        flow = self.flow_m3_s(half_Pa, viscosity_Pa_s, film_m)
        return self.stored_m3_Pa(half_Pa) * (linear + 2.0 * quadratic * flow)

    def stored_m3_Pa(self, pressure_Pa: float) -> float:
        """Volume that the store takes up per pressure, at a pressure above ambient: the liquid, and
        its air at constant temperature."""
        absolute = max(pressure_Pa, 0.0) + AMBIENT_PA
        air = self.air_share * AMBIENT_PA / (absolute * absolute)
        return self.volume_m3 * ((1.0 - self.air_share) / LIQUID_BULK_PA + air)


NONE: Final = Restrictor()


def orifice(
    bore_m: float, discharge_coefficient: float, density_kg_m3: float, perimeter_m: float
) -> Restrictor:
    """An orifice behind an opening of that perimeter; of a bare bore ``pi d``."""
    area = 0.25 * pi * bore_m * bore_m
    squared = discharge_coefficient * discharge_coefficient
    per_Cd2 = 1.0 / (2.0 * squared)
    hole_Re = squared / (ROUND_DELTA * ROUND_DELTA)
    slit_Re = squared / (SLIT_DELTA * SLIT_DELTA)
    return Restrictor(
        q0=density_kg_m3 * per_Cd2 / (area * area),
        q1=density_kg_m3 * per_Cd2 / (perimeter_m * perimeter_m),
        l0=hole_Re * per_Cd2 / (bore_m * area),
        l1=slit_Re * per_Cd2 / (2.0 * perimeter_m),
    )


def capillary(bore_m: float, length_m: float) -> Restrictor:
    """A capillary."""
    return Restrictor(l0=128.0 * length_m / (pi * bore_m * bore_m * bore_m * bore_m))


class Opening(NamedTuple):
    """The opening of a feed in the bore of the bearing: its middle, its extents, SI."""

    angle_rad: float
    axial_m: float
    width_rad: float
    length_m: float
    elliptic: bool

    def perimeter_m(self, radius_m: float) -> float:
        """Of the ellipse, Ramanujan's first formula; of the rectangle, the sum of its sides."""
        a, b = self.width_rad * radius_m, self.length_m
        if not self.elliptic:
            return 2.0 * (a + b)
        return 0.5 * pi * (3.0 * (a + b) - sqrt((3.0 * a + b) * (a + 3.0 * b)))


def opening(port: FeedPort, radius_m: float) -> Opening:
    """Where and how large ``port`` opens into the film; what is not given is the bore."""
    bore_m = 1e-3 * (port.bore_mm or 0.0)
    width, length_mm = port.recess_width_deg, port.recess_length_mm
    return Opening(
        angle_rad=radians(port.angle_deg),
        axial_m=1e-3 * port.axial_mm,
        width_rad=bore_m / radius_m if width is None else radians(width),
        length_m=bore_m if length_mm is None else 1e-3 * length_mm,
        elliptic=port.kind != GROOVE and width is None,
    )


def restrictor(port: FeedPort, radius_m: float, density_kg_m3: float) -> Restrictor:
    """The law of ``port`` at a bearing of that radius; none of a groove or port.

    A capillary or an orifice without its figures, which a verified configuration never has, counts
    as none.
    """
    bore_m, length_mm = 1e-3 * (port.bore_mm or 0.0), port.capillary_length_mm
    law = NONE
    if port.kind == ORIFICE and bore_m > 0.0:
        around_m = opening(port, radius_m).perimeter_m(radius_m)
        law = orifice(bore_m, port.discharge_coefficient, density_kg_m3, around_m)
    elif port.kind == CAPILLARY and bore_m > 0.0 and length_mm is not None:
        law = capillary(bore_m, 1e-3 * length_mm)
    return law._replace(volume_m3=1e-9 * port.recess_volume_mm3, air_share=port.air_share)


def bore_Re(port: FeedPort, flow_m3_s: float, density_kg_m3: float, mu_Pa_s: float) -> float:
    """Reynolds number of the flow through a bore."""
    return 4.0 * density_kg_m3 * abs(flow_m3_s) / (pi * 1e-3 * (port.bore_mm or 0.0) * mu_Pa_s)
