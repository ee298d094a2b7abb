"""What each uncertainty of a machine costs: the guard's own stages, once as the rig folder says and
once with that uncertainty gone.

A shaft that rests where the film puts it is looked at for :data:`LOOKED_S` by the load estimator,
which learns the oil from the shaft power, and the shield says what is admissible then.  The power
is that of the film in the widest admissible clearance.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, pi, sin
from typing import Any, Final, NamedTuple

import msgspec

from firmware_py.config import Config
from firmware_py.guard.envelope.load_estimate import LoadEstimator, Look
from firmware_py.guard.envelope.oil_estimate import STEADY_S
from firmware_py.guard.envelope.shield import Shield
from firmware_py.machine.film import static_film
from firmware_py.machine.groove import Groove
from firmware_py.machine.lubricant import viscosity_Pa_s
from firmware_py.machine.probes import FIGURES, PROBES
from firmware_py.machine.static import resting

LOOKED_S: Final = 2.5 * STEADY_S
PERIOD_S: Final = STEADY_S / 4.0
"""Steady windows of the oil's estimate follow one another: the second one teaches."""

CERTAIN: Final[Mapping[str, Mapping[str, Mapping[str, Any]]]] = {
    "clearance": {"bearing": {"radial_clearance_error_um": 0.05}},
    "oil": {
        "lubricant": {"viscosity_error_share": 0.0},
        "readings": {"oil_outlet_error_C": 0.0},
    },
    "probes": {"channel": {key: 0.0 for key in FIGURES if key != "noise_rms"}},
    "film law": {
        "bearing": {
            "load_error_share": 0.0, "attitude_error_deg": 0.0, "friction_error_share": 0.0,
        }
    },
    "rotor": {"rotor": {"mass_error_share": 0.0, "whirl_error_share": 0.0}},
    "torque meter": {"rotor": {"shaft_power_error_W": 0.01}},
}  # fmt: skip
"""Keys of the machine by uncertainty, at the values that leave nothing open."""

LOAD: Final = "load"
"""The uncertainty of the load has no key: it is what the estimator leaves open."""


class Corner(NamedTuple):
    """Speed, rad/s, and static load, N."""

    speed_rad_s: float
    load_N: float


class Admitted(NamedTuple):
    """Admissible radial clearances at a corner, and the film's power in the widest; None: none is,
    or the film does not carry the load."""

    low_m: float
    high_m: float
    power_W: float


class Cost(NamedTuple):
    """What a machine without one uncertainty gains.

    ``range_m`` is the width of the clearances admissible over the whole declared range, ``corners``
    what is admissible at each corner.
    """

    name: str
    range_m: float
    corners: tuple[Admitted | None, ...]


def corners(config: Config) -> tuple[Corner, ...]:
    """The corners of the declared range, slow before fast, light before heavy."""
    o = config.machine.operating
    return tuple(
        Corner(rpm * pi / 30.0, load_N)
        for rpm in (o.speed_min_rpm, o.speed_max_rpm)
        for load_N in (o.load_min_N, o.load_max_N)
    )


def costs(config: Config, temperature_C: float) -> list[Cost]:
    """The machine as it is known, and without each uncertainty in turn, in the order of
    :data:`CERTAIN`, then :data:`LOAD`.

    Parameters
    ----------
    config
        The whole configuration.
    temperature_C
        Of the oil outlet.
    """
    known = [("", config), *((name, without(config, name)) for name in CERTAIN)]
    found = [_cost(name, each, temperature_C, measured=False) for name, each in known]
    return [*found, _cost(LOAD, config, temperature_C, measured=True)]


def without(config: Config, name: str) -> Config:
    """``config`` with one uncertainty of :data:`CERTAIN` gone."""
    machine = config.machine
    changed: dict[str, Any] = {}
    for table, keys in CERTAIN[name].items():
        if table == "channel":
            changed[table] = [
                msgspec.structs.replace(channel, **keys) if i < PROBES else channel
                for i, channel in enumerate(machine.channel)
            ]
        else:
            changed[table] = msgspec.structs.replace(getattr(machine, table), **keys)
    return config.replaced(**changed)


def _cost(name: str, config: Config, temperature_C: float, *, measured: bool) -> Cost:
    shield = Shield(config)
    low_m, high_m = shield.fixed_range() or (0.0, 0.0)
    admitted = tuple(
        _admitted(config, shield, corner, temperature_C, measured) for corner in corners(config)
    )
    return Cost(name, high_m - low_m, admitted)


def _admitted(
    config: Config, shield: Shield, corner: Corner, temperature_C: float, measured: bool
) -> Admitted | None:
    """What the shield admits once the machine has been looked at in its retreat value."""
    bearing, estimator = config.machine.bearing, LoadEstimator(config)
    film = static_film(bearing.journal_radius_m, bearing.length_m)
    speed, film_N = corner.speed_rad_s, corner.load_N + Groove(config.machine).added_N[0]
    viscosity = viscosity_Pa_s(config.machine.lubricant, temperature_C)
    offset_m = bearing.radial_clearance_offset_um * 1e-6
    told_m = config.machine.actuator.safe_radial_clearance_um * 1e-6
    place = resting(film, told_m + offset_m, viscosity, speed, film_N)
    if place is None:
        return None
    out_m = place.eccentricity * (told_m + offset_m)
    look = Look(
        0.0,
        out_m * sin(place.attitude_rad),
        -out_m * cos(place.attitude_rad),
        0.0,
        told_m,
        speed,
        temperature_C,
        place.friction_W + config.machine.rotor.windage_W_s3 * speed * speed * speed,
        config.machine.actuator.safe_pressure_bar,
    )
    load = estimator.declared()
    for number in range(round(LOOKED_S / PERIOD_S) + 1):
        load = estimator.estimate(msgspec.structs.replace(look, time_s=number * PERIOD_S))
    law_C, oil = estimator.oil_at(temperature_C)
    low_N, high_N = (film_N, film_N) if measured else (load.low_N, load.film_N)
    interval = shield.interval(speed, low_N, high_N, law_C, oil=oil)
    if interval is None:
        return None
    widest = resting(film, interval[1] + offset_m, viscosity, speed, film_N)
    return Admitted(*interval, widest.friction_W) if widest else None
