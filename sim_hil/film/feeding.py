"""The openings of a machine's feed as the film solver takes them."""

from __future__ import annotations

from collections.abc import Sequence

from firmware_py.machine import FeedPort
from firmware_py.machine.restrictor import opening, restrictor

from .records import FeedPatch


def feed_patches(
    ports: Sequence[FeedPort], radius_m: float, density_kg_m3: float, supply_Pa: float
) -> tuple[FeedPatch, ...]:
    """One patch each; `supply_Pa`, above ambient, feeds those without a pressure of their own."""
    patches = []
    for port in ports:
        at = opening(port, radius_m)
        own = port.pressure_bar
        patches.append(
            FeedPatch(
                "orifice" if at.elliptic else "groove",
                at.angle_rad,
                at.width_rad,
                at.length_m,
                supply_Pa if own is None else 1e5 * own,
                at.axial_m,
                restrictor(port, radius_m, density_kg_m3),
            )
        )
    return tuple(patches)
