"""Plays the device on a CAN FD bus: reads the samples, sends heartbeat and commands (see
../NODE.md).

    python play_device.py --seconds 10 --clearance 62.5 [--channel orbitd0] [--interface orbitd_hub]
        [--dbc FILE]

It knows the DBC alone.  At the end it prints what it saw as one JSON object.
"""

from __future__ import annotations

import argparse
import json
import secrets
import time
from itertools import count, takewhile
from pathlib import Path

import can
from dbc_wire import DBC, Wire

AUTO, ARMED = 2, 3


class PlayedDevice:
    """What the device has seen, and the session under which it speaks."""

    def __init__(self) -> None:
        self.session = secrets.randbits(32) | 1
        self.newest_tick: int | None = None
        self.displacement: list[float] = []
        self.marks: dict[int, int] = {}
        self.state: dict[str, float] = {}
        self.status: dict[str, float] = {}
        self.info: dict[str, float] = {}

    def take(self, name: str, values: dict[str, float]) -> None:
        if name == "SAMPLES":
            self.newest_tick = int(values["tick"])
            names = takewhile(lambda name: name in values, (f"disp_x_{i}" for i in count()))
            self.displacement += [values[name] for name in names]
            if values["mark_valid"]:
                self.marks[int(values["turn_count"])] = int(values["mark_tick"])
        elif name == "NODE_STATE":
            self.state = values
        elif name in ("RIG_STATUS", "READINGS"):  # the second comes in pages
            self.status |= values
        elif name == "NODE_INFO":
            self.info = values

    @property
    def speed_rpm(self) -> float:
        """Mean over all turns seen (fewer than 65536)."""
        turns, ticks = list(self.marks), list(self.marks.values())
        if len(turns) < 2:
            return 0.0
        return ((turns[-1] - turns[0]) & 0xFFFF) * 60e6 / ((ticks[-1] - ticks[0]) & 0xFFFFFFFF)

    @property
    def peak_to_peak_um(self) -> float:
        """Of the last 500 instants."""
        recent = self.displacement[-500:]
        return max(recent) - min(recent) if recent else 0.0


def play(wire: Wire, seconds: float, clearance_um: float, pressure_bar: float) -> dict[str, object]:
    device, start = PlayedDevice(), time.monotonic()
    heartbeat_due = command_due = start
    following = states = 0
    while (now := time.monotonic()) < start + seconds:
        for name, values in wire.receive(0.001):
            device.take(name, values)
            if name == "NODE_STATE":
                states += 1
                following += values["mode"] == 1 and values["session"] == device.session
        if now >= heartbeat_due:
            wire.send(
                "DEVICE_HEARTBEAT",
                session=device.session,
                mode=AUTO,
                arm_state=ARMED,
                run_permit=1,
                trip_request=0,
            )
            heartbeat_due = now + 0.050
        if now >= command_due and device.newest_tick is not None:
            wire.send(
                "COMMAND",
                session=device.session,
                echo_tick=device.newest_tick,
                clearance=clearance_um,
                pressure=pressure_bar,
            )
            command_due = now + 0.020
    return {
        "instants": len(device.displacement),
        "peak_to_peak_um": device.peak_to_peak_um,
        "speed_rpm": device.speed_rpm,
        "states": states,
        "states_following": following,
        "node": device.state,
        "status": device.status,
        "info": device.info,
        "bus": dict(wire.counts),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--channel", default="orbitd0")
    parser.add_argument("--dbc", type=Path, default=DBC, help="of the rig (default: schema 1)")
    parser.add_argument("--interface", default="orbitd_hub")
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--clearance", type=float, default=62.5, help="radial clearance in um")
    parser.add_argument("--pressure", type=float, default=1.5, help="supply pressure in bar")
    options = parser.parse_args()
    with can.Bus(channel=options.channel, interface=options.interface, fd=True) as bus:
        print(
            json.dumps(
                play(Wire(bus, options.dbc), options.seconds, options.clearance, options.pressure)
            )
        )


if __name__ == "__main__":
    main()
