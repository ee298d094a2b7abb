"""The machine as its rig folder describes it: shaft, bearing, lubricant, feed, sensors, actuator,
operating range.

Guard, acquisition, brain, simulator and trainers are given one frozen
:class:`~firmware_py.machine.schema.Machine`; nothing about a machine stands in their code.
"""

from __future__ import annotations

from firmware_py.machine.feeds import FeedPort
from firmware_py.machine.schema import (
    ClearanceActuator,
    ContactCircuit,
    Feed,
    FixedPads,
    JournalBearing,
    Lubricant,
    Machine,
    OperatingRange,
    OtherBearing,
    RotorDrawing,
)
from firmware_py.machine.sensors import FastChannel, SlowChannel, SlowReadings

__all__ = [
    "ClearanceActuator",
    "ContactCircuit",
    "FastChannel",
    "Feed",
    "FeedPort",
    "FixedPads",
    "JournalBearing",
    "Lubricant",
    "Machine",
    "OperatingRange",
    "OtherBearing",
    "RotorDrawing",
    "SlowChannel",
    "SlowReadings",
]
