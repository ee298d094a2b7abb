"""Limits of what a machine lacks need not be written."""

from __future__ import annotations

from typing import Any, Final

from firmware_py import signals
from firmware_py.machine.parts import ACTUATOR, CLEARANCE

NO_FILM: Final = {"min_film_um": 0.5}
NO_CLEARANCE: Final = {"clearance_share": 1.0}
NO_ACCELERATION: Final = {"acceleration_alert_m_s2": 2999.0, "acceleration_danger_m_s2": 3000.0}
"""Stand-ins that limit nothing: ends of what the keys may be."""

LIMITS_OFF: Final = tuple(f"limits.{key}" for key in NO_FILM | NO_CLEARANCE | NO_ACCELERATION)
"""Limits that may be stand-ins."""


def with_limits(table: dict[str, Any]) -> dict[str, Any]:
    """``table`` of a rig folder with stand-ins for limits that nothing could reach there."""
    limits, machine = table.get("limits"), table["machine"]
    if not isinstance(limits, dict):
        return table
    absent, stand_ins = machine.get("absent", ()), dict[str, float]()
    if ACTUATOR in absent:
        stand_ins |= NO_FILM
    if CLEARANCE in absent:
        stand_ins |= NO_CLEARANCE
    if not any(map(_accelerates, _rows(machine.get("channel")))):
        stand_ins |= NO_ACCELERATION
    return {**table, "limits": {**stand_ins, **limits}}


def _rows(value: object) -> list[dict[str, Any]]:
    return [row for row in value if isinstance(row, dict)] if isinstance(value, list) else []


def _accelerates(channel: dict[str, Any]) -> bool:
    name, kind = channel.get("name"), channel.get("kind", "")
    if not isinstance(name, str) or not isinstance(kind, str):
        return True
    found = signals.fast_kind(name, kind)
    return found is None or found.name == "acceleration"
