"""The rig's own console: JSON over a Unix socket beside the device's, never through the device.

One packet is one request ``{"verb": ..., ...}``, answered by one packet ``{"ok": true, ...}`` or
``{"ok": false, "error": "..."}``.  Verbs: ``inject`` (fault, severity), ``clear``, ``operating``
(speed_rpm, load_N, ramp_s), ``duty`` (name published or random, seed, seconds), ``start`` (the
operator's hand after a coast-down), ``truth`` (after_ns), ``status``, ``quit``.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import select
import socket
from collections.abc import Callable
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import msgspec

from firmware_py import launch
from firmware_py.errors import OrbitdError
from firmware_py.options import finite
from firmware_py.wire.listener import listen, own

if TYPE_CHECKING:
    from sim_hil.hil.rig import Rig

SOCKET_NAME: Final = "rig.sock"
MAX_PACKET: Final = 65_536
TRUTH_PER_REPLY: Final = 100
ANSWER_WITHIN_S: Final = 5.0

Reply = dict[str, Any]


class ConsoleError(OrbitdError):
    """The rig does not answer, or refused; the text says what and why."""


class NoRig(ConsoleError):
    """No rig in software serves this instance."""

    exit_code = 3


class Console:
    """The rig's end of the console.

    Parameters
    ----------
    path
        Socket path; PeerError when another rig serves it.
    rig
        The rig it commands.
    """

    def __init__(self, path: Path, rig: Rig) -> None:
        self._rig = rig
        self._path = path
        self._lock = own(path)
        self._listener = listen(path)
        self._poller = select.epoll()
        self._poller.register(self._listener, select.EPOLLIN)
        self._peers: dict[int, socket.socket] = {}
        self.quit = False
        self._verbs: dict[str, Callable[[dict[str, Any]], Reply]] = {
            "inject": self._inject,
            "clear": self._clear,
            "operating": self._operating,
            "duty": self._duty,
            "start": self._start,
            "truth": self._truth,
            "status": self._status,
            "quit": self._quit,
        }

    def poll(self) -> None:
        """Answer everything that waits; never blocks."""
        for fd, _ in self._poller.poll(0, 16):
            if fd == self._listener.fileno():
                peer, _ = self._listener.accept()
                peer.setblocking(False)
                self._peers[peer.fileno()] = peer
                self._poller.register(peer, select.EPOLLIN)
            else:
                self._serve(fd)

    def close(self) -> None:
        """Close every socket and remove the path."""
        for peer in self._peers.values():
            peer.close()
        self._poller.close()
        self._listener.close()
        self._path.unlink(missing_ok=True)
        os.close(self._lock)

    def answer(self, packet: bytes) -> Reply:
        """The reply to one request; every bad request is answered with its reason."""
        try:
            request = json.loads(packet)
            verb = self._verbs[request["verb"]]
            return {"ok": True, **verb(request)}
        except OrbitdError as error:
            return {"ok": False, "error": str(error)}
        except (ValueError, KeyError, TypeError) as error:
            known = ", ".join(self._verbs)
            return {
                "ok": False,
                "error": f"bad request ({type(error).__name__}: {error}); verbs: {known}",
            }

    def _serve(self, fd: int) -> None:
        peer = self._peers[fd]
        try:
            packet = peer.recv(MAX_PACKET)
            if packet:
                peer.send(json.dumps(self.answer(packet)).encode())
                return
        except OSError:
            pass  # gone, or not reading its answers: dismissed below
        self._poller.unregister(fd)
        del self._peers[fd]
        peer.close()

    def _inject(self, request: dict[str, Any]) -> Reply:
        self._rig.inject(str(request["fault"]), float(request["severity"]))
        return {"faults": self._rig.faults}

    def _clear(self, request: dict[str, Any]) -> Reply:
        self._rig.clear()
        return {"faults": {}}

    def _operating(self, request: dict[str, Any]) -> Reply:
        data = self._rig.machine.rig
        speed, load = float(request["speed_rpm"]), float(request["load_N"])
        if not 0.0 <= speed <= data.speed_max_rpm:
            raise ConsoleError(
                f"speed_rpm = {speed:g}: outside 0 .. {data.speed_max_rpm:g}; choose a value inside"
            )
        if not data.load_min_N <= load <= data.load_max_N:
            raise ConsoleError(
                f"load_N = {load:g}: outside {data.load_min_N:g} .. {data.load_max_N:g}; choose a "
                f"value inside"
            )
        self._rig.set_operating(speed, load, float(request.get("ramp_s", 0.0)))
        return {}

    def _duty(self, request: dict[str, Any]) -> Reply:
        import numpy as np

        from sim_hil.plant.duty import Duty

        if request["name"] == "published":
            duty = Duty.published(self._rig.machine.rig)
        elif request["name"] == "random":
            rng = np.random.default_rng(int(request["seed"]))
            duty = Duty.random(self._rig.machine.rig, rng, float(request["seconds"]))
        else:
            raise ConsoleError(f"duty = {request['name']}: unknown; choose published or random")
        self._rig.follow(duty)
        return {"seconds": duty.seconds}

    def _start(self, request: dict[str, Any]) -> Reply:
        if not self._rig.drive.start():
            raise ConsoleError(
                "start: the device does not permit the run; arm it or clear its trip first"
            )
        return {}

    def _truth(self, request: dict[str, Any]) -> Reply:
        after_ns = int(request.get("after_ns", 0))
        newer = (entry for entry in self._rig.truth if entry.t_ns > after_ns)
        return {"truth": [msgspec.to_builtins(entry) for entry in islice(newer, TRUTH_PER_REPLY)]}

    def _status(self, request: dict[str, Any]) -> Reply:
        rig = self._rig
        return {
            "time_s": rig.time_s,
            "speed_rpm": rig.drive.speed_rad_s * 30 / math.pi,
            "load_N": rig.drive.load_N,
            "coasting": rig.drive.coasting,
            "coast_reason": rig.drive.reason,
            "faults": rig.faults,
            "lag_ms_max": rig.lag_ms_max,
            "periods_left_out": rig.periods_left_out,
            "session": rig.node.session,
            "refused": rig.node.refused,
            "target_clearance_um": rig.node.clearance_um,
        }

    def _quit(self, request: dict[str, Any]) -> Reply:
        self.quit = True
        return {}


def ask(runtime: Path, request: dict[str, Any]) -> Reply:
    """One request to the rig of ``runtime``, and its reply.

    Raises
    ------
    NoRig
        Nothing answers there.
    ConsoleError
        The rig refused.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as sock:
        sock.settimeout(ANSWER_WITHIN_S)
        try:
            sock.connect(str(runtime / SOCKET_NAME))
            sock.send(json.dumps(request).encode())
            packet = sock.recv(4 * MAX_PACKET)
        except OSError as error:
            raise NoRig(
                f"{runtime / SOCKET_NAME}: no rig answers ({error}); start `orbitd hil` with the "
                f"same "
                "--instance"
            ) from error
    reply: Reply = json.loads(packet) if packet else {"ok": False, "error": "the rig ended"}
    if not reply.pop("ok"):
        raise ConsoleError(str(reply["error"]))
    return reply


VERBS: Final = ("clear", "start", "status", "truth", "duty", "operating")
"""What `orbitd inject` takes beside a fault."""


def main(argv: list[str]) -> int:
    """``orbitd inject FAULT SEVERITY``: the rig in software only."""
    from sim_hil.faults import ACTUATOR_FAULTS, MACHINE_FAULTS, NODE_FAULTS, SENSOR_FAULTS

    sensors = [f"sensor_{kind}:CHANNEL" for kind in SENSOR_FAULTS]
    faults = ", ".join([*MACHINE_FAULTS, *ACTUATOR_FAULTS, *NODE_FAULTS, *sensors])
    parser = argparse.ArgumentParser(
        prog="orbitd inject",
        description="give the rig in software a fault (or: clear, operating, duty, start, status, "
        "truth)",
        epilog=f"faults: {faults}. Severity: balance grade G for unbalance, percent of preload "
        f"left for bolts "
        "(100 is tight), 0 to 1 for the rest.",
    )
    parser.add_argument(
        "what", metavar="FAULT", help="a fault, clear, operating, duty, start, status or truth"
    )
    parser.add_argument(
        "value", type=finite, nargs="?", metavar="SEVERITY", help="how much; see below"
    )
    parser.add_argument("--severity", type=finite, metavar="SEVERITY", help="the same by name")
    parser.add_argument("--speed-rpm", type=finite, help="with operating")
    parser.add_argument(
        "--load-N", type=finite, dest="load_N", help="with operating: static bearing load"
    )
    parser.add_argument(
        "--ramp-s", type=finite, default=0.0, help="with operating: how long the change takes"
    )
    parser.add_argument("--json", action="store_true", help="the answer as JSON")
    launch.add_options(parser)
    options = parser.parse_args(argv)
    request = _request(parser, options)
    reply = ask(launch.place(options).runtime, request)
    print(json.dumps(reply) if options.json else _words(options.what, reply))
    return 0


def _request(parser: argparse.ArgumentParser, options: argparse.Namespace) -> dict[str, Any]:
    given = [value for value in (options.value, options.severity) if value is not None]
    if options.what in VERBS and given:
        parser.error(f"{options.what} takes no severity")
    if options.what in ("clear", "start", "status", "truth"):
        return {"verb": options.what}
    if options.what == "duty":
        return {"verb": "duty", "name": "published"}
    if options.what == "operating":
        if options.speed_rpm is None or options.load_N is None:
            parser.error("operating needs --speed-rpm and --load-N")
        return {
            "verb": "operating",
            "speed_rpm": options.speed_rpm,
            "load_N": options.load_N,
            "ramp_s": options.ramp_s,
        }
    if len(given) != 1:
        parser.error(f"{options.what} needs one severity: orbitd inject {options.what} SEVERITY")
    return {"verb": "inject", "fault": options.what, "severity": given[0]}


def _words(what: str, reply: Reply) -> str:
    lines = [f"{what}: done"]
    return "\n".join([*lines, *(f"  {key}: {value}" for key, value in reply.items())])
