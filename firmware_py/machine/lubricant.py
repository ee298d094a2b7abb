"""Viscosity of the lubricant against its temperature, ``mu = mu_40 exp(-k (T - 40))``.

The one law of guard and brain: a table made with + * / in a fixed order, the same bits on every
machine (libm's ``exp`` is not that).
"""

from __future__ import annotations

from functools import cache
from math import floor, isnan, nan
from typing import Final

from firmware_py.machine.schema import Lubricant, Machine

COLDEST_C: Final = -40
HOTTEST_C: Final = 200
COLD_C: Final = 1.0
"""An outlet colder than the coldest declared inlet by this beside the thermometer's error is
outside the declared range."""


def decay(exponent: float) -> float:
    """``exp(-exponent)`` for ``0 <= exponent <= 1`` by its Taylor series, in a fixed order of + *
    /."""
    term = total = 1.0
    for n in range(1, 25):
        term = term * exponent / n
        total += term
    return 1.0 / total


class ViscosityTable:
    """``mu = mu_40 exp(-k (T - 40))``, linear between whole degrees."""

    def __init__(self, lubricant: Lubricant) -> None:
        per_degree = decay(lubricant.viscosity_slope_per_K)
        values = [1.0]
        for _ in range(HOTTEST_C - COLDEST_C):
            values.append(values[-1] * per_degree)
        scale = lubricant.viscosity_at_40C_Pa_s / values[40 - COLDEST_C]
        self._values = [value * scale for value in values]

    def law(self, temperature_C: float) -> float:
        """Viscosity (Pa s) of the law; at most ``k^2 / 8`` of it above, for the curve is hollow."""
        place = min(max(temperature_C, float(COLDEST_C)), float(HOTTEST_C)) - COLDEST_C
        i = min(floor(place), HOTTEST_C - COLDEST_C - 1)
        part = place - i
        return self._values[i] + part * (self._values[i + 1] - self._values[i])


class CredibleOil(ViscosityTable):
    """The law, and by how much an oil may differ from it.

    Attributes
    ----------
    thinnest, thickest
        Viscosity of any credible batch at any credible temperature over the law's at the reading:
        the batch, and the thermometer; film that is colder than its outlet is not in them.
    """

    def __init__(self, machine: Machine) -> None:
        oil = machine.lubricant
        super().__init__(oil)
        reading = decay(oil.viscosity_slope_per_K * machine.readings.oil_outlet_error_C)
        self.thinnest = (1.0 - oil.viscosity_error_share) * reading
        self.thickest = (1.0 + oil.viscosity_error_share) / reading


def coldest_outlet_C(machine: Machine) -> float:
    """An outlet below this is outside the declared range."""
    return machine.lubricant.inlet_min_C - (machine.readings.oil_outlet_error_C + COLD_C)


@cache
def viscosity_table(lubricant: Lubricant) -> ViscosityTable:
    """:class:`ViscosityTable`, made once for all that share a lubricant."""
    return ViscosityTable(lubricant)


def viscosity_Pa_s(lubricant: Lubricant, temperature_C: float) -> float:
    """Dynamic viscosity (Pa s) of the law at ``temperature_C``; of a reading that never came,
    nan."""
    if isnan(temperature_C):
        return nan
    return viscosity_table(lubricant).law(temperature_C)
