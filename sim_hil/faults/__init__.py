"""Faults of the machine, its sensors, its actuators and their node, by name and continuous
severity.

``FaultSet`` maps names to severities: :data:`MACHINE_FAULTS`, ``sensor_<kind>:<channel>``, and of a
whole rig also :data:`ACTUATOR_FAULTS` and :data:`NODE_FAULTS`.
"""

from __future__ import annotations

from firmware_py.errors import OrbitdError
from sim_hil.faults.actuator import ACTUATOR_FAULTS, NODE_FAULTS
from sim_hil.faults.machine import MACHINE_FAULTS, apply_machine_faults
from sim_hil.faults.sensor import SENSOR_FAULTS, SensorFault, sensor_fault

FaultSet = dict[str, float]


class UnknownFault(OrbitdError, ValueError):
    """No fault of that name, or a severity outside its range."""

    exit_code = 2


def check_fault(name: str, severity: float) -> None:
    """Refuse an unknown name or a severity outside its declared range.

    Raises
    ------
    UnknownFault
        Names the fault, the value, the range and what exists.
    """
    kind = name.partition(":")[0].removeprefix("sensor_")
    if name in MACHINE_FAULTS:
        low, high = MACHINE_FAULTS[name].severity_range
    elif name.startswith("sensor_") and kind in SENSOR_FAULTS and sensor_fault(name) is not None:
        low, high = SENSOR_FAULTS[kind].severity_range
    elif name in ACTUATOR_FAULTS or name in NODE_FAULTS:
        low, high = 0.0, 1.0
    else:
        sensors = [f"sensor_{k}:<channel>" for k in SENSOR_FAULTS]
        known = ", ".join([*MACHINE_FAULTS, *ACTUATOR_FAULTS, *NODE_FAULTS, *sensors])
        raise UnknownFault(f"fault = {name}: unknown; choose one of {known}")
    if not low <= severity <= high:
        raise UnknownFault(
            f"severity of {name} = {severity:g}: outside {low:g} .. {high:g}; choose a value inside"
        )


__all__ = [
    "ACTUATOR_FAULTS",
    "MACHINE_FAULTS",
    "NODE_FAULTS",
    "SENSOR_FAULTS",
    "FaultSet",
    "SensorFault",
    "UnknownFault",
    "apply_machine_faults",
    "check_fault",
    "sensor_fault",
]
