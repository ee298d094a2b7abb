"""Faults of the actuators and of their node: what is reached is not what was commanded.

Severity 0 is healthy, 1 the strongest.  They stand between the node's targets and the machine; what
the node reports as its target, and what the position sensor measures, stays true.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

OFFSET_M: Final = 20e-6


@dataclass(frozen=True)
class Reach:
    """Targets of the node, where the clearance stands and may go, and how far its target leads it
    at full rate."""

    clearance_m: float
    pressure_Pa: float
    now_m: float
    boot_m: float
    range_m: tuple[float, float]
    lead_m: float


Apply = Callable[[Reach, float], tuple[float, float]]


def stuck(at: Reach, severity: float) -> tuple[float, float]:
    """The clearance stays where it is."""
    return at.now_m if severity > 0.0 else at.clearance_m, at.pressure_Pa


def runaway(at: Reach, severity: float) -> tuple[float, float]:
    """The clearance runs towards its wider end, by this share of the way there."""
    return at.clearance_m + severity * (at.range_m[1] - at.clearance_m), at.pressure_Pa


def slow(at: Reach, severity: float) -> tuple[float, float]:
    """The actuator loses this share of its rate."""
    lead_m = (1.0 - severity) * at.lead_m
    return at.now_m + min(max(at.clearance_m - at.now_m, -lead_m), lead_m), at.pressure_Pa


def offset(at: Reach, severity: float) -> tuple[float, float]:
    """The clearance stands ``20 um severity`` wider than its target."""
    return at.clearance_m + OFFSET_M * severity, at.pressure_Pa


def reversed_sign(at: Reach, severity: float) -> tuple[float, float]:
    """The clearance goes the other way from its boot value."""
    return at.clearance_m - 2.0 * severity * (at.clearance_m - at.boot_m), at.pressure_Pa


def pressure_lost(at: Reach, severity: float) -> tuple[float, float]:
    """This share of the supply pressure is missing."""
    return at.clearance_m, (1.0 - severity) * at.pressure_Pa


ACTUATOR_FAULTS: Final[dict[str, Apply]] = {
    "actuator_stuck": stuck,
    "actuator_runaway": runaway,
    "actuator_slow": slow,
    "actuator_offset": offset,
    "actuator_reversed": reversed_sign,
    "pressure_lost": pressure_lost,
}

NODE_FAULTS: Final = ("node_refuses",)
"""The node's clock is so far off that every command counts as stale."""


def reached(at: Reach, faults: dict[str, float]) -> tuple[float, float]:
    """Where the actuators are really sent: clearance, m, inside its range, and pressure, Pa."""
    clearance_m, pressure_Pa = at.clearance_m, at.pressure_Pa
    for name, severity in faults.items():
        if name in ACTUATOR_FAULTS:
            now = Reach(clearance_m, pressure_Pa, at.now_m, at.boot_m, at.range_m, at.lead_m)
            clearance_m, pressure_Pa = ACTUATOR_FAULTS[name](now, severity)
    low_m, high_m = at.range_m
    return min(max(clearance_m, low_m), high_m), max(pressure_Pa, 0.0)
