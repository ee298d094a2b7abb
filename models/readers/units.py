"""Units as people write them, and their factors to SI (bar for pressure, degC for temperature, as
in :data:`firmware_py.signals.FAST`)."""

from __future__ import annotations

from math import pi
from typing import Final, NamedTuple

from firmware_py import signals

G: Final = 9.80665
INCH: Final = 0.0254


class Unit(NamedTuple):
    """``SI = value * factor + offset`` in the SI unit of ``quantity``."""

    quantity: str
    si: str
    factor: float
    offset: float = 0.0


_UNITS: Final[dict[str, Unit]] = {
    "m": Unit("displacement", "m", 1.0),
    "mm": Unit("displacement", "m", 1e-3),
    "um": Unit("displacement", "m", 1e-6),
    "nm": Unit("displacement", "m", 1e-9),
    "mil": Unit("displacement", "m", 1e-3 * INCH),
    "in": Unit("displacement", "m", INCH),
    "m/s2": Unit("acceleration", "m/s2", 1.0),
    "mm/s2": Unit("acceleration", "m/s2", 1e-3),
    "g": Unit("acceleration", "m/s2", G),
    "mg": Unit("acceleration", "m/s2", 1e-3 * G),
    "m/s": Unit("velocity", "m/s", 1.0),
    "mm/s": Unit("velocity", "m/s", 1e-3),
    "um/s": Unit("velocity", "m/s", 1e-6),
    "in/s": Unit("velocity", "m/s", INCH),
    "pa": Unit("sound_pressure", "Pa", 1.0),
    "kpa": Unit("pressure", "bar", 1e-2),
    "mpa": Unit("pressure", "bar", 10.0),
    "bar": Unit("pressure", "bar", 1.0),
    "psi": Unit("pressure", "bar", 0.0689475729),
    "v": Unit("voltage", "V", 1.0),
    "mv": Unit("voltage", "V", 1e-3),
    "a": Unit("current", "A", 1.0),
    "ma": Unit("current", "A", 1e-3),
    "n": Unit("force", "N", 1.0),
    "kn": Unit("force", "N", 1e3),
    "nm_torque": Unit("torque", "Nm", 1.0),
    "degc": Unit("temperature", "degC", 1.0),
    "k": Unit("temperature", "degC", 1.0, -273.15),
    "degf": Unit("temperature", "degC", 5.0 / 9.0, -160.0 / 9.0),
    "rpm": Unit("speed", "rad/s", pi / 30.0),
    "hz": Unit("speed", "rad/s", 2.0 * pi),
    "rad/s": Unit("speed", "rad/s", 1.0),
    "s": Unit("time", "s", 1.0),
    "ms": Unit("time", "s", 1e-3),
    "us": Unit("time", "s", 1e-6),
    "ns": Unit("time", "s", 1e-9),
    "fs": Unit("full scale", "full scale", 1.0),
}

_SPELLINGS: Final = {
    "g's": "g", "gs": "g", "gn": "g", "ms-2": "m/s2", "m/s^2": "m/s2", "m/s/s": "m/s2",
    "m/s**2": "m/s2", "mm/s^2": "mm/s2", "m*s-2": "m/s2", "ips": "in/s", "mils": "mil",
    "inch": "in", "micron": "um", "microns": "um", "mic": "um", "volt": "v", "volts": "v",
    "amp": "a", "amps": "a", "ampere": "a", "c": "degc", "°c": "degc", "celsius": "degc",
    "f": "degf", "°f": "degf", "1/min": "rpm", "min-1": "rpm", "u/min": "rpm", "r/min": "rpm",
    "rev/min": "rpm", "1/s": "hz", "rps": "hz", "sec": "s", "second": "s", "seconds": "s",
    "msec": "ms", "usec": "us", "n*m": "nm_torque", "n.m": "nm_torque", "n m": "nm_torque",
    "full scale": "fs",
}  # fmt: skip


def unit(text: str) -> Unit | None:
    """What ``text`` means; None when nothing is known of it.

    ``Nm`` is a torque, ``nm`` a length; only there the letter's case tells.
    """
    plain = text.strip().strip("[]()").strip()
    if plain in ("Nm", "N·m"):
        return _UNITS["nm_torque"]
    key = plain.lower().replace("µ", "u").replace("μ", "u").replace("²", "2").replace("⁻", "-")
    key = key.replace("·", "*")
    return _UNITS.get(_SPELLINGS.get(key, key))


def known() -> str:
    """The units that are understood, for messages."""
    return ", ".join(sorted({"Nm", *(name for name in _UNITS if name != "nm_torque")}))


FAR: Final = 10.0
"""A channel whose rms is so many times the greatest value of its kind on the wire has another
unit."""


def implausible(values_rms: float, known_unit: Unit) -> str:
    """Why an rms in SI cannot be meant, with the unit that would fit; empty: it can."""
    kind = signals.FAST.get(known_unit.quantity)
    if kind is None or values_rms <= FAR * kind.greatest:
        return ""
    fits = [
        name
        for name, other in _UNITS.items()
        if other.quantity == known_unit.quantity
        and values_rms / known_unit.factor * other.factor <= FAR * kind.greatest
    ]
    return (
        f"rms {values_rms:.4g} {known_unit.si}, more than a {kind.words} has (at most "
        f"{FAR * kind.greatest:.4g}): is its unit {' or '.join(fits) if fits else 'right'}?"
    )
