"""Turbulent films: what turbulence takes from the conductance of the gap and adds to its shear.

With the local Reynolds number `Re = rho |omega| R h / mu`, pressure-driven flow meets
`12 + 0.0136 Re^0.9` instead of 12 around and `12 + 0.0043 Re^0.96` along, and the sliding wall a
shear `1 + 0.0012 Re^0.94` times the laminar one (linearised turbulent film of Ng and Pan, J. Basic
Eng. 87, 1965, in Constantinescu's powers; the digits are recalled, no print was at hand).

Below the onset of Taylor's vortices, `Re = 41.1 sqrt(R / h)`, the film is laminar.  Between there
and `Re = 2000`, where it is neither, the corrections come in linearly: an assumption, not a law.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from .records import Floats

if TYPE_CHECKING:
    from .bearing import Bearing

ONSET: Final = 41.1
"""Of Taylor's vortices: Re over sqrt(R / h)."""

TURBULENT_RE: Final = 2000.0
"""From here on the film is turbulent throughout."""

GREATEST_RE: Final = 1e5
"""The fits end here."""


def reynolds(bearing: Bearing, thickness: Floats) -> Floats:
    """Local Reynolds number at a film over clearance; 0 where the bearing does not say its
    density."""
    surface = bearing.density_kg_m3 * abs(bearing.speed_rad_s) * bearing.radius_m
    number: Floats = surface * bearing.clearance_m / bearing.viscosity_Pa_s * thickness
    return np.maximum(number, 0.0)


def turbulent_share(bearing: Bearing, thickness: Floats) -> Floats:
    """0 where the film is laminar, 1 where it is turbulent."""
    number = reynolds(bearing, thickness)
    ratio = bearing.radius_m / (bearing.clearance_m * np.maximum(thickness, 1e-9))
    onset = ONSET * np.sqrt(ratio)
    share = (number - onset) / np.maximum(TURBULENT_RE - onset, 0.1 * onset)
    return np.asarray(np.clip(share, 0.0, 1.0))


def resistance(bearing: Bearing, thickness: Floats) -> tuple[Floats, Floats]:
    """How many times the laminar resistance pressure-driven flow meets, around and along."""
    number, share = reynolds(bearing, thickness), turbulent_share(bearing, thickness)
    around = 1.0 + share * 0.0136 / 12 * number**0.9
    along = 1.0 + share * 0.0043 / 12 * number**0.96
    return around, along


def shear(bearing: Bearing, thickness: Floats) -> Floats:
    """How many times the laminar shear the sliding wall meets."""
    number = reynolds(bearing, thickness)
    return np.asarray(1.0 + turbulent_share(bearing, thickness) * 0.0012 * number**0.94)
