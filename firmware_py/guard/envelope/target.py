"""Where the actuator is sent."""

from __future__ import annotations

import msgspec


class Target(msgspec.Struct, frozen=True):
    """Radial clearance and supply pressure that the guard wants."""

    clearance_um: float
    pressure_bar: float
