"""Oil viscosity against temperature with the same bits on every machine (libm's ``exp`` is not that)."""

from __future__ import annotations

from math import ceil, floor
from typing import Final

from firmware_py.config import Oil

COLDEST_C: Final = -40
HOTTEST_C: Final = 200


def decay(exponent: float) -> float:
    """``exp(-exponent)`` for ``0 <= exponent <= 1`` by its Taylor series, in a fixed order of + * /."""
    term = total = 1.0
    for n in range(1, 25):
        term = term * exponent / n
        total += term
    return 1.0 / total


class ViscosityTable:
    """``mu = mu_40 exp(-k (T - 40))`` at whole degrees, rounded to the side that is asked for."""

    def __init__(self, oil: Oil) -> None:
        per_degree = decay(oil.viscosity_slope_per_K)
        values = [1.0]
        for _ in range(HOTTEST_C - COLDEST_C):
            values.append(values[-1] * per_degree)
        scale = oil.viscosity_at_40C_Pa_s / values[40 - COLDEST_C]
        self._values = [value * scale for value in values]

    def thinnest(self, temperature_C: float) -> float:
        """Viscosity (Pa s) at ``temperature_C`` or up to one degree hotter."""
        return self._values[min(max(ceil(temperature_C), COLDEST_C), HOTTEST_C) - COLDEST_C]

    def thickest(self, temperature_C: float) -> float:
        """Viscosity (Pa s) at ``temperature_C`` or up to one degree colder."""
        return self._values[min(max(floor(temperature_C), COLDEST_C), HOTTEST_C) - COLDEST_C]
