"""Plays the rig and its node on a CAN FD bus: made-up orbits, real duties (see ../NODE.md).

    python play_rig.py --seconds 10 [--channel orbitd0] [--interface orbitd_hub] [--rate 5000]
    [--dbc FILE]

It knows the DBC alone: that of wire schema 1, or the one that `orbitd rig dbc` wrote for a rig.
The shaft turns at a fixed speed on a circular orbit whose size follows the clearance.  At its end,
or on Ctrl-C, it prints what it did as one JSON object.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import re
import time
from pathlib import Path

import can
from dbc_wire import DBC, Wire

BOOT = {"clearance": 50.0, "pressure": 1.0}  # um, bar: what it has at boot and when commands expire
RANGE = {"clearance": (40.0, 160.0), "pressure": (0.5, 3.0)}
RATE = {"clearance": 50.0, "pressure": 1.0}  # um/s, bar/s
TIME_TO_LIVE_US = 100_000
SESSION_HOLD_US = 1_000_000
HEARTBEAT_LIMIT_US = 3_000_000
SPEED_RPM = 3000.0
ENDS = ("min", "max")


class PlayedNode:
    """Actuator and drive: what it follows, where it stands, what it refused."""

    def __init__(self) -> None:
        self.target, self.actual = dict(BOOT), dict(BOOT)
        self.session = self.permit_session = 0
        self.command_counter = 0
        self.obeyed_us = self.heard_us = self.heartbeat_us = -(1 << 40)
        self.mode = 0
        self.coasting = False
        self.refused = dict.fromkeys(("stale", "check", "session", "range"), 0)
        self.obeyed = 0

    def take(self, messages: list[tuple[str, dict[str, float]]], now_us: int) -> None:
        for name, values in messages:
            if name == "DEVICE_HEARTBEAT":
                self._heartbeat(values, now_us)
        commands = [values for name, values in messages if name == "COMMAND"]
        if commands:
            self._command(commands[-1], now_us)
        if now_us - self.obeyed_us > TIME_TO_LIVE_US:
            self.mode, self.target = 0, dict(BOOT)
        if self.permit_session and now_us - self.heartbeat_us > HEARTBEAT_LIMIT_US:
            self.coasting = True

    def _heartbeat(self, values: dict[str, float], now_us: int) -> None:
        session = int(values["session"])
        if values["trip_request"]:
            self.coasting = True
        if values["run_permit"]:
            self.permit_session = session
        elif session == self.permit_session:
            self.coasting = True
        if session == self.permit_session:
            self.heartbeat_us = now_us
        if session == self.session:
            self.heard_us = now_us

    def _command(self, values: dict[str, float], now_us: int) -> None:
        reason = self._refusal(values, now_us)
        if reason:
            self.refused[reason] += 1
            return
        self.session, self.command_counter = int(values["session"]), int(values["counter"])
        self.obeyed_us = self.heard_us = now_us
        self.obeyed += 1
        self.mode = 1
        self.target = {name: values[name] for name in BOOT}

    def _refusal(self, values: dict[str, float], now_us: int) -> str:
        if values["session"] != self.session and now_us - self.heard_us < SESSION_HOLD_US:
            return "session"
        newer = (int(values["counter"]) - self.command_counter) & 0xFFFF
        if values["session"] == self.session and not 0 < newer < 0x8000:
            return "check"
        if (now_us - int(values["echo_tick"])) & 0xFFFFFFFF > TIME_TO_LIVE_US:
            return "stale"
        if any(not low <= values[name] <= high for name, (low, high) in RANGE.items()):
            return "range"
        return ""

    def move(self, seconds: float) -> None:
        for name, rate in RATE.items():
            step = self.target[name] - self.actual[name]
            self.actual[name] += max(-rate * seconds, min(rate * seconds, step))

    @property
    def at_target(self) -> bool:
        return all(abs(self.target[name] - self.actual[name]) < 0.01 for name in BOOT)


class Layout:
    """What the DBC says of the sample frames and the readings."""

    def __init__(self, wire: Wire) -> None:
        database = wire.database
        self.schema = int(database.version)
        samples = database.get_message_by_name("SAMPLES")
        names = [re.fullmatch(r"(\w+)_(\d+)", signal.name) for signal in samples.signals]
        places = [found for found in names if found and found[1] != "mark"]
        self.channels = list(dict.fromkeys(found[1] for found in places))
        self.instants = 1 + max(int(found[2]) for found in places)
        self.hash = 0
        self.pages: list[list[str]] = []
        if self.schema > 1:
            self.hash = int(database.dbc.attributes["LayoutHash"].value, 16)
            readings = database.get_message_by_name("READINGS")
            rows = [s for s in readings.signals if s.multiplexer_ids]
            for number in sorted({s.multiplexer_ids[0] for s in rows}):
                self.pages.append([s.name for s in rows if s.multiplexer_ids[0] == number])

    @property
    def tag(self) -> dict[str, int]:
        """The low byte of the hash, in the frames that follow the layout."""
        return {"layout": self.hash & 0xFF} if self.schema > 1 else {}


def orbit(t_s: float, clearance_um: float, pressure_bar: float) -> dict[str, float]:
    """One instant of the channels that this rig has; the others stay at zero."""
    angle = 2 * math.pi * SPEED_RPM / 60 * t_s
    size = 0.1 * clearance_um
    return {
        "disp_x": -0.2 * clearance_um + size * math.cos(angle),
        "disp_y": -0.3 * clearance_um + size * math.sin(angle),
        "acc_bearing_vertical": math.sin(angle),
        "acc_bearing_horizontal": math.cos(angle),
        "acc_motor": 0.5 * math.sin(angle),
        "microphone": 0.1 * math.sin(2 * angle),
        "supply_pressure": pressure_bar,
        "contact_resistance": 1.3,
    }


def samples(
    layout: Layout, first: int, period_us: int, actual: dict[str, float], coasting: bool
) -> dict[str, float]:
    """The sample frame whose first instant is sample number ``first``."""
    tick_us = first * period_us
    turn_us = 60e6 / SPEED_RPM
    turns = int((tick_us + (layout.instants - 1) * period_us) // turn_us)
    values: dict[str, float] = {
        "tick": tick_us & 0xFFFFFFFF,
        "mark_tick": round(turns * turn_us) & 0xFFFFFFFF,
        "turn_count": turns & 0xFFFF,
        "rig_behind": 0,
        "mark_valid": 1,
        "drive_coasting": coasting,
        **layout.tag,
    }
    for i in range(layout.instants):
        now = orbit((first + i) * period_us * 1e-6, actual["clearance"], actual["pressure"])
        values |= {f"{name}_{i}": now.get(name, 0.0) for name in layout.channels}
    return values


def readings(wire: Wire, layout: Layout, node: PlayedNode, tick: int) -> None:
    """The slow readings: RIG_STATUS, or the pages of READINGS."""
    told = {
        "shaft_power": 87.0,
        "oil_outlet": 41.5,
        "clearance_actual": node.actual["clearance"],
        "pressure_actual": node.actual["pressure"],
    }
    if layout.schema == 1:
        wire.send("RIG_STATUS", tick=tick, **told)
    for number, names in enumerate(layout.pages):
        values: dict[str, float] = {}
        for name in names:
            reading = re.sub("_(age|quality)$", "", name)
            known = reading in told
            if name == reading:
                values[name] = told.get(reading, 0.0)
            else:  # quality 3: this rig does not measure it
                values[name] = 0 if known else 2550 if name.endswith("_age") else 3
        wire.send("READINGS", tick=tick, page=number, **layout.tag, **values)


def node_info(wire: Wire, layout: Layout, period_us: int, tick: int) -> None:
    """Every second: what the node was built with, and what it is."""
    if layout.schema > 1:
        wire.send(
            "NODE_FIGURES",
            tick=tick,
            heartbeat_limit=HEARTBEAT_LIMIT_US // 1000,
            coasts_on_silence=1,
            drive_commandable=0,
            **{f"{name}_{end}": RANGE[name][i] for name in RANGE for i, end in enumerate(ENDS)},
            clearance_lag=0,
            pressure_lag=0,
            drive_time_to_live=0,
            **{f"{name}_{end}": 0 for name in ("speed", "load") for end in ENDS},
        )
    wire.send(
        "NODE_INFO",
        tick=tick,
        schema=layout.schema,
        sample_period=period_us,
        boot_clearance=BOOT["clearance"],
        boot_pressure=BOOT["pressure"],
        time_to_live=TIME_TO_LIVE_US // 1000,
        rate=RATE["clearance"],
        **({"layout_hash": layout.hash} if layout.schema > 1 else {}),
    )


def slow_messages(wire: Wire, layout: Layout, node: PlayedNode, now_us: int) -> None:
    """Status and state, every 50 ms."""
    tick = now_us & 0xFFFFFFFF
    bad = sum(count for name, count in wire.counts.items() if name.startswith("bad "))
    refused = {**node.refused, "check": node.refused["check"] + bad}
    readings(wire, layout, node, tick)
    wire.send(
        "NODE_STATE",
        tick=tick,
        session=node.session,
        command_counter=node.command_counter,
        mode=node.mode,
        at_target=node.at_target,
        target_clearance=node.target["clearance"],
        target_pressure=node.target["pressure"],
        **{f"refused_{reason}": count & 0xFFFF for reason, count in refused.items()},
    )


def play(wire: Wire, node: PlayedNode, seconds: float, period_us: int) -> None:
    layout = Layout(wire)
    start, sample, slow_due, info_due, moved_us = time.monotonic(), 0, 0, 0, 0
    while (now_us := int((time.monotonic() - start) * 1e6)) < seconds * 1e6:
        node.take(wire.receive(0.001), now_us)
        node.move((now_us - moved_us) * 1e-6)
        moved_us = now_us
        while (sample + layout.instants) * period_us <= now_us:
            wire.send("SAMPLES", **samples(layout, sample, period_us, node.actual, node.coasting))
            sample += layout.instants
        if now_us >= slow_due:
            slow_messages(wire, layout, node, now_us)
            slow_due += 50_000
        if now_us >= info_due:
            node_info(wire, layout, period_us, now_us & 0xFFFFFFFF)
            info_due += 1_000_000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--channel", default="orbitd0")
    parser.add_argument("--interface", default="orbitd_hub")
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--rate", type=int, default=5000, help="sampling rate in Hz")
    parser.add_argument("--dbc", type=Path, default=DBC, help="that of the rig (default: schema 1)")
    options = parser.parse_args()
    node = PlayedNode()
    with can.Bus(channel=options.channel, interface=options.interface, fd=True) as bus:
        wire = Wire(bus, options.dbc)
        with contextlib.suppress(KeyboardInterrupt):
            play(wire, node, options.seconds, 1_000_000 // options.rate)
    print(
        json.dumps(
            {
                "obeyed": node.obeyed,
                "refused": node.refused,
                "actual": node.actual,
                "mode": node.mode,
                "coasting": node.coasting,
                "bus": dict(wire.counts),
            }
        )
    )


if __name__ == "__main__":
    main()
