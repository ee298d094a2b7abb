"""MAVLink 2 for a ground station on this machine: presence, status texts, settings to read, arm and
disarm.

Speaks UDP to one loopback port, where ground stations listen (14550 by custom); off unless asked
for. Standard messages only, so any ground station understands: HEARTBEAT, STATUSTEXT, PARAM_VALUE,
COMMAND_ACK. Commands take the same way as all others: the guard accepts or gives all its reasons,
which follow the refusing COMMAND_ACK as status texts.
"""

from __future__ import annotations

import contextlib
import socket
import struct
from collections import Counter, deque
from collections.abc import Callable
from functools import partial
from typing import Any, Final

from firmware_py.config import Config
from firmware_py.records import ArmState, CommandReply, Event, GuardState, Mode, Severity
from firmware_py.wire import mav_dialect as mav

SYSTEM, COMPONENT = 1, 1
"""The device as the one system that the station looks after."""

HEARTBEAT_NS: Final = 1_000_000_000
DATAGRAMS_PER_STEP: Final = 256
HEARD_PER_STEP: Final = 8
"""Of the datagrams that came, so many are read: those that begin with a command first, the others
as they came."""

DATAGRAM_BYTES: Final = 512
"""Read of one datagram; the longest packet has 280."""

PACKETS_PER_STEP: Final = 8
"""Answers that wait (a list of settings) go out at this pace, so that no receive buffer
overflows."""

MAX_WAITING: Final = 256
TEXT_BYTES: Final = 50
CHUNKS: Final = 5

_SYSTEM_STATUS: Final = {
    ArmState.BOOT: mav.MAV_STATE_BOOT,
    ArmState.CHECK: mav.MAV_STATE_CALIBRATING,
    ArmState.DISARMED: mav.MAV_STATE_STANDBY,
    ArmState.ARMED: mav.MAV_STATE_ACTIVE,
    ArmState.RECOVERY: mav.MAV_STATE_CRITICAL,
    ArmState.TRIPPED: mav.MAV_STATE_EMERGENCY,
}
_SEVERITY: Final = {
    Severity.INFO: mav.MAV_SEVERITY_INFO,
    Severity.ALERT: mav.MAV_SEVERITY_WARNING,
    Severity.DANGER: mav.MAV_SEVERITY_CRITICAL,
    Severity.FAULT: mav.MAV_SEVERITY_ERROR,
}

Ask = Callable[[str, object, str, Callable[[CommandReply], None], int], Any]


def settings(config: Config) -> dict[str, float]:
    """The settings that a station may read, by their MAVLink name (at most 16 characters)."""
    b, a, lim, o = (
        config.machine.bearing,
        config.machine.actuator,
        config.limits,
        config.machine.operating,
    )
    return {
        "RATE_HZ": config.sampling.rate_hz,
        "CLR_MIN_UM": b.radial_clearance_min_um,
        "CLR_MAX_UM": b.radial_clearance_max_um,
        "CLR_NOMINAL_UM": b.radial_clearance_nominal_um,
        "CLR_SAFE_UM": a.safe_radial_clearance_um,
        "CLR_RATE_UM_S": a.rate_um_s,
        "PRS_SAFE_BAR": a.safe_pressure_bar,
        "NODE_TTL_MS": a.time_to_live_ms,
        "FILM_MIN_UM": lim.min_film_um,
        "DISP_ALERT_UM": lim.displacement_alert_um,
        "DISP_DANGER_UM": lim.displacement_danger_um,
        "ACC_ALERT_MS2": lim.acceleration_alert_m_s2,
        "ACC_DANGER_MS2": lim.acceleration_danger_m_s2,
        "ALERT_DELAY_S": lim.alert_delay_s,
        "DANGER_DELAY_S": lim.danger_delay_s,
        "SPEED_MIN_RPM": o.speed_min_rpm,
        "SPEED_MAX_RPM": o.speed_max_rpm,
        "LOAD_MIN_N": o.load_min_N,
        "LOAD_MAX_N": o.load_max_N,
    }


class GroundStation:
    """The device's side of a MAVLink link to a ground station.

    Parameters
    ----------
    port
        UDP port on the loopback where the station listens.
    config
        For the settings that may be read.
    ask
        Takes a command as :meth:`firmware_py.gate.core.Gate.ask` does.

    Notes
    -----
    ``counters``: ``station_packets_out``, ``station_lost`` (answers that found no room),
    ``station_malformed``, ``station_refused`` (datagrams beyond what a step reads).
    """

    def __init__(self, port: int, config: Config, ask: Ask) -> None:
        self.counters: Counter[str] = Counter()
        self._ask = ask
        self._settings = list(settings(config).items())
        self._mav = mav.MAVLink(None, srcSystem=SYSTEM, srcComponent=COMPONENT)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.connect(("127.0.0.1", port))
        self._urgent: deque[bytes] = deque()  # acknowledgements
        self._waiting: deque[bytes] = deque()
        self._next_heartbeat_ns = 0
        self._text_id = 0

    def tell(self, event: Event) -> None:
        """Show ``event`` to the operator."""
        self._text(_SEVERITY[Severity(event.severity)], event.text)

    def step(self, guard: GuardState | None, now_ns: int) -> None:
        """Hear the station, and send what is due; ``guard`` is None while the guard is silent."""
        for data in self._received():
            self._hear(data, now_ns)
        if now_ns >= self._next_heartbeat_ns:
            self._next_heartbeat_ns = now_ns + HEARTBEAT_NS
            self._queue(self._heartbeat(guard))
        for _ in range(min(PACKETS_PER_STEP, len(self._urgent) + len(self._waiting))):
            packet = (self._urgent or self._waiting).popleft()
            with contextlib.suppress(OSError):  # nobody listens there at present
                self._socket.send(packet)
                self.counters["station_packets_out"] += 1

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _received(self) -> list[bytes]:
        """What this step reads of what came: commands before all else, however much there is."""
        data: list[bytes] = []
        with contextlib.suppress(OSError):  # nothing more waits, or nobody listens there
            while len(data) < DATAGRAMS_PER_STEP:
                data.append(self._socket.recv(DATAGRAM_BYTES))
        data.sort(key=lambda datagram: not _is_command(datagram))
        self.counters["station_refused"] += max(0, len(data) - HEARD_PER_STEP)
        return data[:HEARD_PER_STEP]

    def _hear(self, data: bytes, now_ns: int) -> None:
        for message in self._parsed(data):
            kind = message.get_type()
            if kind == "BAD_DATA":
                self.counters["station_malformed"] += 1
            elif getattr(message, "target_system", SYSTEM) not in (0, SYSTEM):
                continue
            elif (
                kind == "PARAM_REQUEST_LIST"
                and len(self._waiting) + len(self._settings) < MAX_WAITING
            ):
                for index in range(len(self._settings)):
                    self._queue(self._setting(index))
            elif kind in ("PARAM_REQUEST_READ", "PARAM_SET"):
                self._answer_setting(message)
            elif kind == "COMMAND_LONG":
                self._obey(message, now_ns)

    def _parsed(self, data: bytes) -> list[Any]:
        """The messages in ``data``; the parser was written for friendly bytes."""
        parser = mav.MAVLink(None)
        parser.robust_parsing = True
        try:
            return parser.parse_buffer(data) or []
        except (mav.MAVError, ValueError, LookupError, TypeError, struct.error):
            self.counters["station_malformed"] += 1
            return []

    def _answer_setting(self, message: Any) -> None:
        """The asked setting; a request to change one gets its unchanged value, as the protocol
        wants it."""
        names = [name for name, _ in self._settings]
        index = getattr(message, "param_index", -1)
        if index == -1 and message.param_id in names:
            index = names.index(message.param_id)
        if 0 <= index < len(names):
            self._queue(self._setting(index))
        if message.get_type() == "PARAM_SET":
            self._text(
                mav.MAV_SEVERITY_WARNING,
                "settings are read-only here; change the configuration file",
            )

    def _obey(self, message: Any, now_ns: int) -> None:
        verb, value = "", None
        if message.command == mav.MAV_CMD_COMPONENT_ARM_DISARM:
            verb = "arm" if message.param1 == 1.0 else "disarm"
        elif message.command == mav.MAV_CMD_DO_SET_MODE and message.param2 in tuple(Mode):
            verb, value = "mode", Mode(int(message.param2)).name.lower()
        if not verb:
            self._acknowledge(message.command, mav.MAV_RESULT_UNSUPPORTED)
            return
        self._ask(verb, value, "mavlink", partial(self._answer, message.command), now_ns)

    def _answer(self, command: int, reply: CommandReply) -> None:
        self._acknowledge(
            command, mav.MAV_RESULT_ACCEPTED if reply.accepted else mav.MAV_RESULT_DENIED
        )
        for reason in reply.reasons:
            self._text(mav.MAV_SEVERITY_WARNING, reason)

    def _acknowledge(self, command: int, result: int) -> None:
        if len(self._urgent) < MAX_WAITING:
            self._urgent.append(
                bytes(self._mav.command_ack_encode(command, result).pack(self._mav))
            )

    def _heartbeat(self, guard: GuardState | None) -> Any:
        flags = mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        if guard and guard.arm_state == ArmState.ARMED:
            flags |= mav.MAV_MODE_FLAG_SAFETY_ARMED
        status = _SYSTEM_STATUS[ArmState(guard.arm_state)] if guard else mav.MAV_STATE_UNINIT
        return self._mav.heartbeat_encode(
            mav.MAV_TYPE_ONBOARD_CONTROLLER,
            mav.MAV_AUTOPILOT_GENERIC,
            flags,
            guard.mode if guard else 0,
            status,
        )

    def _setting(self, index: int) -> Any:
        name, value = self._settings[index]
        return self._mav.param_value_encode(
            name.encode(), float(value), mav.MAV_PARAM_TYPE_REAL32, len(self._settings), index
        )

    def _text(self, severity: int, text: str) -> None:
        """A status text, in numbered chunks when it is long."""
        data = text.encode()[: TEXT_BYTES * CHUNKS]
        self._text_id = self._text_id % 65535 + 1 if len(data) > TEXT_BYTES else self._text_id
        for chunk, start in enumerate(range(0, len(data), TEXT_BYTES)):
            self._queue(
                self._mav.statustext_encode(
                    severity,
                    data[start : start + TEXT_BYTES],
                    self._text_id if len(data) > TEXT_BYTES else 0,
                    chunk,
                )
            )

    def _queue(self, message: Any) -> None:
        if len(self._waiting) >= MAX_WAITING:
            self.counters["station_lost"] += 1
        else:
            self._waiting.append(bytes(message.pack(self._mav)))


def _is_command(datagram: bytes) -> bool:
    """Whether a MAVLink 2 or 1 packet with a command begins it."""
    number = mav.MAVLINK_MSG_ID_COMMAND_LONG
    return (datagram[:1] == b"\xfd" and datagram[7:10] == number.to_bytes(3, "little")) or (
        datagram[:1] == b"\xfe" and datagram[5:6] == bytes([number])
    )
