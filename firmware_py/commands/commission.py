"""``orbitd commission``: teach the device what is normal for this machine.

start  gather healthy decisions (mode monitor or manual) while you run the machine over its range of
speed, load and
       clearance; stop  learn from them; cancel  keep what was; forget  judge by the fleet again;
       status  how it stands.
"""

from __future__ import annotations

import argparse

import msgspec

from firmware_py import launch
from firmware_py.commands.authority import connect
from firmware_py.gate.view import DeviceState
from firmware_py.records import COMMISSION_ACTIONS, CommandReply, CommissionState

_RAD_S_TO_RPM = 9.549296585513721


def main(argv: list[str]) -> int:
    """Ask the brain, or show how commissioning stands."""
    parser = argparse.ArgumentParser(
        prog="orbitd commission",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "action", nargs="?", default="status", choices=("status", *COMMISSION_ACTIONS)
    )
    launch.add_options(parser)
    parser.add_argument("--json", action="store_true", help="the answer as JSON")
    options = parser.parse_args(argv)
    with connect(options) as client:
        if options.action == "status":
            return _status(client.status(), as_json=options.json)
        reply = client.ask("commission", options.action)
    print(
        msgspec.json.encode(reply).decode()
        if options.json
        else "\n".join(_words(options.action, reply))
    )
    return 0 if reply.accepted else 1


def _status(state: DeviceState, *, as_json: bool) -> int:
    stands = state.commission if state.rooms.get("brain") else None
    if as_json:
        print(msgspec.json.encode({"commission": stands, "normal": state.normal}).decode())
    else:
        print("\n".join(lines(stands, state.normal)))
    return 0 if stands and stands.phase != "refused" else 1


def lines(stands: CommissionState | None, stored: str) -> list[str]:
    """How commissioning stands, for a person."""
    if stands is None:
        return [
            "normal      the brain is silent",
            *([f"            stored: {stored}"] if stored else []),
        ]
    found = [f"normal      {_phase(stands, stored)}"]
    if stands.ranges:
        low, high = stands.ranges["speed_rad_s"]
        over = f"            {low * _RAD_S_TO_RPM:.0f} .. {high * _RAD_S_TO_RPM:.0f} rpm"
        if "clearance_m" in stands.ranges:
            least_m, most_m = stands.ranges["clearance_m"]
            over += f", {least_m * 1e6:.0f} .. {most_m * 1e6:.0f} um radial clearance"
        found.append(over)
    if stands.phase == "gathering":
        found += [
            f"            left out: {count} windows, {reason}"
            for reason, count in stands.left_out.items()
        ]
        found += [
            f"            named {name}: {count} decisions; is the machine healthy?"
            for name, count in stands.named_faults.items()
        ]
    return found


def _phase(stands: CommissionState, stored: str) -> str:
    if stands.phase == "refused":
        return f"REFUSED, judged by the fleet: {stands.text}"
    if stands.phase == "commissioned":
        return f"this machine's own, {stored}" if stored else "this machine's own, NOT STORED"
    if stands.phase == "gathering":
        return (
            f"gathering: {stands.decisions} decisions in {stands.minutes:.1f} min, {stands.points} "
            f"operating "
            f"points, {stands.speed_steps} of {stands.speed_steps_declared} steps of speed"
        )
    if stands.text:
        return f"{stands.text}{f' ({stored})' if stored else ''}"
    return f"the fleet's: not commissioned{f' ({stored})' if stored else ''}"


def _words(action: str, reply: CommandReply) -> list[str]:
    return [
        f"commission {action}: {'accepted' if reply.accepted else 'refused'}",
        *(f"  - {reason}" for reason in reply.reasons),
    ]
