"""Why no clearance is a retreat value: the film does not carry the load, or the shaft whirls in the
narrowest bearing; with the arithmetic.

Both are judged with the figures as drawn; the uncertainties come on top
(:func:`firmware_py.guard.envelope.shield_check.check_safe`).
"""

from __future__ import annotations

from collections.abc import Iterator
from math import pi

from firmware_py.config import Config
from firmware_py.guard.envelope.shield import GRID_M
from firmware_py.machine.film import static_film
from firmware_py.machine.lubricant import ViscosityTable
from firmware_py.machine.parts import monitor_only
from firmware_py.machine.static import greatest_load_N, stable_clearance_m


def check_carried(config: Config) -> Iterator[tuple[str, object, str]]:
    """Key, value, and cause with the next step, of a load that no film carries and of a machine
    that whirls in any clearance."""
    if not monitor_only(config.machine):
        yield from _load(config)
        yield from _whirl(config)


def _load(config: Config) -> Iterator[tuple[str, object, str]]:
    """The heaviest load at the slowest speed in the warmest oil of the inlet."""
    machine, thin_m = config.machine, config.limits.min_film_um * 1e-6
    b, o, oil = machine.bearing, machine.operating, machine.lubricant
    film = static_film(b.journal_radius_m, b.length_m)
    mu, speed = ViscosityTable(oil).law(oil.inlet_max_C), o.speed_min_rpm * pi / 30.0
    low_m, high_m = b.radial_clearance_min_um * 1e-6, b.radial_clearance_max_um * 1e-6
    most_N, best_m = 0.0, low_m
    for i in range(round((high_m - low_m) / GRID_M) + 1):
        built_m = low_m + i * GRID_M + b.radial_clearance_offset_um * 1e-6
        carried_N = greatest_load_N(film, built_m, thin_m, mu * speed)
        if carried_N > most_N:
            most_N, best_m = carried_N, built_m
    if most_N < o.load_max_N:
        yield (
            "machine.operating.load_max_N",
            o.load_max_N,
            f"no film carries it: at machine.operating.speed_min_rpm = {o.speed_min_rpm:g} in oil "
            f"of {oil.inlet_max_C:g} degC ({mu:.3g} Pa s) at most {most_N:.4g} N with "
            f"limits.min_film_um = {config.limits.min_film_um:g} um left, in "
            f"{best_m * 1e6:.0f} um; lower the load, raise the speed, or cool or thicken the oil",
        )


def _whirl(config: Config) -> Iterator[tuple[str, object, str]]:
    """The lightest load at the fastest speed, in the narrowest bearing."""
    machine = config.machine
    b, o = machine.bearing, machine.operating
    stable_um = stable_clearance_m(machine, o.speed_max_rpm * pi / 30.0, o.load_min_N) * 1e6
    if stable_um < b.radial_clearance_min_um:
        yield (
            "machine.operating.load_min_N",
            o.load_min_N,
            f"whirls in any clearance: at machine.operating.speed_max_rpm = {o.speed_max_rpm:g} a "
            f"rotor of {machine.rotor.mass_at_bearing_kg:.3g} kg at the bearing is stable up to "
            f"{stable_um:.3g} um, machine.bearing.radial_clearance_min_um = "
            f"{b.radial_clearance_min_um:g}; narrow the bearing, lower the speed or load it more",
        )
