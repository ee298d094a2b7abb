"""``orbitd mode|arm|disarm|reset|set|announce``: a person's commands, each answered by the guard.

``disarm`` goes to the guard itself, past the gate; only where no guard answers there is the gate
asked, which knows more of why.
"""

from __future__ import annotations

import argparse
import uuid
from typing import TYPE_CHECKING, Final

import msgspec

from firmware_py import launch
from firmware_py.options import finite
from firmware_py.records import CommandReply, Mode, PlannedRamp
from firmware_py.wire import disarm_socket

if TYPE_CHECKING:
    from firmware_py.gate.client import Client

GUARD_WITHIN_S: Final = 1.0
"""As the gate's own patience with the guard."""


def mode(argv: list[str]) -> int:
    """``orbitd mode monitor|manual|auto``."""
    parser = parser_of(
        "mode", "who chooses the targets: nobody (monitor), a person (manual), the model (auto)"
    )
    parser.add_argument("mode", choices=[each.name.lower() for each in Mode])
    options = parser.parse_args(argv)
    return ask(options, "mode", options.mode)


def arm(argv: list[str]) -> int:
    """``orbitd arm``."""
    return ask(parser_of("arm", "allow the device to move the actuator").parse_args(argv), "arm")


def disarm(argv: list[str]) -> int:
    """``orbitd disarm``."""
    parser = parser_of("disarm", "stop moving the actuator; the node goes to its safe value")
    options = parser.parse_args(argv)
    reply = disarm_socket.ask(launch.place(options).runtime, uuid.uuid4().hex, GUARD_WITHIN_S)
    return ask(options, "disarm") if reply is None else tell(options, "disarm", reply)


def reset(argv: list[str]) -> int:
    """``orbitd reset``."""
    return ask(
        parser_of("reset", "clear latched alarms and trips whose cause is gone").parse_args(argv),
        "reset",
    )


def set_target(argv: list[str]) -> int:
    """``orbitd set clearance UM`` and ``orbitd set pressure BAR``."""
    parser = parser_of("set", "set a target by hand; needs mode manual")
    parser.add_argument("what", choices=["clearance", "pressure"])
    parser.add_argument(
        "value", type=finite, help="radial clearance in um, or supply pressure in bar"
    )
    options = parser.parse_args(argv)
    return ask(options, f"set_{options.what}", options.value)


def announce(argv: list[str]) -> int:
    """``orbitd announce --in S --for S --speed RPM --load N``."""
    parser = parser_of(
        "announce",
        "tell a ramp that is faster than the declared unannounced ones; refused, it must wait",
    )
    parser.add_argument(
        "--in",
        dest="start_s",
        type=finite,
        required=True,
        metavar="S",
        help="it starts in S seconds",
    )
    parser.add_argument(
        "--for", dest="lasts_s", type=finite, required=True, metavar="S", help="and takes S seconds"
    )
    parser.add_argument(
        "--speed", type=finite, required=True, metavar="RPM", help="speed at its end"
    )
    parser.add_argument(
        "--load", type=finite, required=True, metavar="N", help="static load at its end"
    )
    options = parser.parse_args(argv)
    end_s = options.start_s + options.lasts_s
    return ask(
        options, "announce", PlannedRamp(options.start_s, end_s, options.speed, options.load)
    )


def parser_of(name: str, text: str) -> argparse.ArgumentParser:
    """Options of a command to a running device."""
    parser = argparse.ArgumentParser(prog=f"orbitd {name}", description=text)
    launch.add_options(parser)
    parser.add_argument("--json", action="store_true", help="the answer as JSON")
    return parser


def connect(options: argparse.Namespace) -> Client:
    """A client of the gate that ``options`` point at.

    Raises
    ------
    SessionError
        No gate runs there.
    """
    from firmware_py.gate import keys
    from firmware_py.gate.client import Client  # Zenoh, which `disarm` does without

    found = launch.place(options)
    return Client(found.runtime, keys.prefix(found.device.site, found.device.rig))


def ask(
    options: argparse.Namespace,
    verb: str,
    value: float | str | PlannedRamp | dict[str, object] | None = None,
) -> int:
    """Put a request to the device, and print its answer."""
    with connect(options) as client:
        reply = client.ask(verb, value)
    return tell(options, verb, reply)


def tell(options: argparse.Namespace, verb: str, reply: CommandReply) -> int:
    """Print an answer; the exit code says whether it is yes."""
    print(msgspec.json.encode(reply).decode() if options.json else _words(verb, reply))
    return 0 if reply.accepted else 1


def _words(verb: str, reply: CommandReply) -> str:
    if reply.accepted:
        return f"{verb}: accepted"
    return "\n".join([f"{verb}: refused", *(f"  - {reason}" for reason in reply.reasons)])
