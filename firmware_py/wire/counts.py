"""Resolutions of the scaled fields of the wire, and physical values as counts of them."""

from __future__ import annotations

import math
from typing import Final

# Resolution of each scaled field (unit per count).
CLEARANCE_UM: Final = 0.01
PRESSURE_BAR: Final = 0.001
POWER_W: Final = 0.01
TEMPERATURE_C: Final = 0.01
RATE_UM_S: Final = 0.1
SPEED_RPM: Final = 0.01
LOAD_N: Final = 0.01
AGE_MS: Final = 10

RANGE: Final = "range"
"""Reject reason of fields that name no state."""
LAYOUT: Final = "layout"
"""Reject reason of a frame of another layout."""

INT32_MIN: Final = -(2**31)


def counts(value: float, resolution: float, low: int = 0, high: int = 0xFFFF) -> int:
    """``value`` in counts of ``resolution``; ValueError when it is not finite or does not fit."""
    if not (math.isfinite(value) and low <= (found := round(value / resolution)) <= high):
        raise ValueError(
            f"{value} does not fit a field of {low * resolution:g} .. {high * resolution:g}"
        )
    return found


# Fields as the struct module gives and takes them: without the CRC, counter first.
Fields = tuple[int | bytes, ...]
