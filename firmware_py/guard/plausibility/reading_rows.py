"""What each slow reading can be: its range, its greatest rate, and how far it scatters at rest.

=========== ================================= ============================ ======================
reading     range                             greatest rate                held against
=========== ================================= ============================ ======================
oil_outlet  ``oil_outlet_min_C .. max_C``     ``oil_outlet_rate_C_s``      heat (frozen)
clearance   the bearing's, with a margin      the actuator's, three times  the node's target
shaft_power most of the film, either sign     none: a torque steps         speed (frozen)
pressure    zero to the most, with a margin   none: a valve steps          ``supply_pressure``
=========== ================================= ============================ ======================

The keys are those of ``[readings]``; *frozen*: it stays the same while what drives it moves;
``supply_pressure`` is the fast channel of that name.
"""

from __future__ import annotations

from math import inf, pi
from typing import Final, NamedTuple

import msgspec

from firmware_py import signals
from firmware_py.config import Config
from firmware_py.machine.lubricant import CredibleOil
from firmware_py.machine.parts import FEED, ROTOR, has, has_film_law

OIL, CLEARANCE, POWER, PRESSURE = "oil_outlet", "clearance_actual", "shaft_power", "pressure_actual"

RATE_MARGIN: Final = 3.0
"""The actuator may be so much faster than declared: what it declares is the least that it does."""

POWER_MARGIN: Final = 10.0
"""The torque meter also shows what accelerates the rotor and what a rub takes: so many times the
film's friction."""

PRESSURE_MARGIN: Final = 2.0
"""A relief valve that sticks lets the pressure rise to about twice what the feed may set."""


class ReadingRow(msgspec.Struct, frozen=True):
    """What a reading can be: its range, its greatest rate per second, and how far two readings at
    rest may differ."""

    field: str
    unit: str
    place: str
    low: float
    high: float
    rate: float = inf
    noise: float = inf


class Doubt(NamedTuple):
    """Why a reading cannot be (empty: it can), and the limit that it passed."""

    cause: str
    limit: float


def reading_rows(config: Config) -> dict[str, ReadingRow]:
    """A row for each standard reading, by its name, from ``[readings]`` and the declared ranges."""
    b, f, r = config.machine.bearing, config.machine.feed, config.machine.readings
    most_W = r.shaft_power_max_W or _power_limit_W(config)
    most_bar = r.pressure_max_bar or (
        PRESSURE_MARGIN * f.pressure_max_bar
        if has(config.machine, FEED)
        else signals.SLOW["pressure"].greatest
    )
    return {
        OIL: ReadingRow(
            "oil_outlet_C",
            "degC",
            "readings.oil_outlet_min_C .. oil_outlet_max_C",
            r.oil_outlet_min_C,
            r.oil_outlet_max_C,
            r.oil_outlet_rate_C_s,
            r.oil_outlet_scatter_C,
        ),
        CLEARANCE: ReadingRow(
            "clearance_actual_um",
            "um",
            "bearing.radial_clearance_min_um .. radial_clearance_max_um",
            b.radial_clearance_min_um - r.clearance_scatter_um,
            b.radial_clearance_max_um + r.clearance_scatter_um,
            RATE_MARGIN * config.machine.actuator.rate_um_s,
            r.clearance_scatter_um,
        ),
        POWER: ReadingRow("shaft_power_W", "W", "readings.shaft_power_max_W", -most_W, most_W),
        PRESSURE: ReadingRow(
            "pressure_actual_bar", "bar", "readings.pressure_max_bar", 0.0, most_bar
        ),
    }


def implausible(
    row: ReadingRow, before: float, value: float, passed_s: float | None, target: float | None
) -> Doubt:
    """Why ``value`` cannot be, after ``before`` so long ago, and the limit; an empty reason when it
    can.

    What lands between where it was and its ``target`` has arrived there, however fast.
    """
    if not row.low <= value <= row.high:
        limit = row.low if value < row.low else row.high
        return Doubt(f"is outside {row.low:g} .. {row.high:g} ({row.place})", limit)
    if passed_s is None:
        return Doubt("", row.high)
    most, moved = row.noise + row.rate * passed_s, abs(value - before)
    arrived = target is not None and (
        min(before, target) - row.noise <= value <= max(before, target) + row.noise
    )
    if moved > most and not arrived:
        return Doubt(f"moved by {moved:.4g} in {passed_s:.3g} s, more than {most:.4g}", most)
    return Doubt("", row.high)


def _power_limit_W(config: Config) -> float:
    """:func:`power_max_W` where film and wind are known; else what the wire can carry."""
    known = has_film_law(config.machine) and has(config.machine, ROTOR)
    return power_max_W(config) if known else signals.SLOW["power"].greatest


def power_max_W(config: Config) -> float:
    """The most that a torque meter can credibly show: Petroff's friction at its worst,
    :data:`POWER_MARGIN` times."""
    b, w = config.machine.bearing, config.machine.operating.speed_max_rpm * pi / 30
    petroff_m4 = (
        2.0 * pi * b.journal_radius_m * b.journal_radius_m * b.journal_radius_m * b.length_m
    )
    oil = CredibleOil(config.machine)
    thickest = oil.law(config.machine.lubricant.inlet_min_C) * oil.thickest
    film_W = petroff_m4 * thickest * w * w / (b.radial_clearance_min_um * 1e-6)
    wind_W = config.machine.rotor.windage_W_s3 * w * w * w
    return POWER_MARGIN * (film_W + wind_W) + config.machine.rotor.shaft_power_error_W
