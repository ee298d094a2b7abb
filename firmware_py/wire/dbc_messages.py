"""Every message of the wire as people and tools see it: signals, words, an example."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

from firmware_py import signals
from firmware_py.records import (
    ArmState,
    Command,
    DeviceHeartbeat,
    DriveCommand,
    DriveMode,
    DriveState,
    Mode,
    NodeFigures,
    NodeInfo,
    NodeMode,
    NodeState,
    ReadingQuality,
    RigStatus,
    WireMessage,
)

DEVICE, NODE = "Device", "Node"
TICK: Final = "Node clock, 1 us per count, wraps after 71.6 min; "


@dataclass(frozen=True)
class Signal:
    """One signal; it follows the one before unless ``at`` names its first bit.

    ``mux`` is ``M`` for the multiplexer, ``m0`` .. for what it selects.
    """

    name: str
    bits: int
    comment: str = ""
    unit: str = ""
    factor: float = 1.0
    signed: bool = False
    least: float | None = None
    most: float | None = None
    choices: tuple[str, ...] = ()
    at: int | None = None
    mux: str = ""


@dataclass(frozen=True)
class Described:
    """One message: its words, its signals after CRC and counter, an example."""

    name: str
    sender: str
    cycle_us: int
    comment: str
    values: str
    example: WireMessage
    signals: tuple[Signal, ...]


def names_of(
    kind: type[Mode | ArmState | NodeMode | DriveMode | ReadingQuality],
) -> tuple[str, ...]:
    """Names of an enumeration's members, in order."""
    return tuple(member.name for member in kind)


def enumerated(name: str, choices: tuple[str, ...], comment: str) -> Signal:
    """A byte that takes one of ``choices``."""
    return Signal(name, 8, comment, most=len(choices) - 1, choices=choices)


def one_bit(name: str, comment: str, at: int | None = None) -> Signal:
    """A flag."""
    return Signal(name, 1, comment, most=1, at=at)


def _clearance(name: str, comment: str, at: int | None = None) -> Signal:
    return Signal(name, 16, comment, "um", 0.01, at=at)


def _pressure(name: str, comment: str) -> Signal:
    return Signal(name, 16, comment, "bar", 0.001)


def _speed(name: str, comment: str, at: int | None = None, *, signed: bool = False) -> Signal:
    return Signal(name, 32, comment, "rpm", 0.01, signed, at=at)


def _load(name: str, comment: str, *, signed: bool = False) -> Signal:
    return Signal(name, 32, comment, "N", 0.01, signed)


_REFUSED: Final = (
    Signal("refused_stale", 16, "Commands older than the time to live"),
    Signal("refused_check", 16, "Wrong CRC, length or counter"),
    Signal("refused_session", 16, "Commands of another session while the present one lives"),
    Signal("refused_range", 16, "Targets outside the actuator's range"),
)
_MADE: Final = Signal("tick", 32, TICK + "when this frame was made", "us")
MEASURED: Final = Signal("tick", 32, TICK + "of the measurement", "us")

HEARTBEAT: Final = Described(
    "DEVICE_HEARTBEAT",
    DEVICE,
    50_000,
    "The rig's drive obeys it: it coasts down on trip_request, and on silence once a session has "
    "granted run_permit.",
    "counter 7, session 0x1234ABCD, AUTO, ARMED, run_permit 1, trip_request 0",
    DeviceHeartbeat(7, 0x1234ABCD, Mode.AUTO, ArmState.ARMED, True, False),
    (
        Signal("session", 32, "Nonce of the device's present run; never 0 from a running device"),
        enumerated("mode", names_of(Mode), "Who chooses the targets"),
        enumerated(
            "arm_state", names_of(ArmState), "Life cycle of the device's right to move the actuator"
        ),
        one_bit("run_permit", "1: the drive may run"),
        one_bit("trip_request", "1: coast down now"),
    ),
)
COMMAND: Final = Described(
    "COMMAND",
    DEVICE,
    20_000,
    "Target for the actuator node. Obeyed only when newest, of the followed session, and younger "
    "than the time to live by the node's own clock.",
    "counter 258, session 0x1234ABCD, echo_tick 5000000 us, clearance 62.50 um, pressure 1.500 bar",
    Command(258, 0x1234ABCD, 5_000_000, 62.5, 1.5),
    (
        Signal("session", 32, "Nonce of the sender's present run"),
        Signal(
            "echo_tick",
            32,
            "Newest node tick that the device had processed when it chose this target",
            "us",
        ),
        _clearance("clearance", "Target of the RADIAL bearing clearance"),
        _pressure("pressure", "Target of the supply pressure, gauge"),
    ),
)
STATE: Final = Described(
    "NODE_STATE",
    NODE,
    50_000,
    "Whom the node follows, where it goes, and what it refused (counts since boot, wrapping).",
    "counter 65535, tick 5020000 us, session 0x1234ABCD, command_counter 258, FOLLOWING, at_target "
    "0, target 62.50 um and 1.500 bar, refused 1 stale, 2 check, 3 session, 4 range",
    NodeState(65535, 5_020_000, NodeMode.FOLLOWING, 0x1234ABCD, 258, 62.5, 1.5, False, 1, 2, 3, 4),
    (
        _MADE,
        Signal("session", 32, "Session that the node follows; 0: none"),
        Signal("command_counter", 16, "Counter of the last command obeyed"),
        enumerated("mode", names_of(NodeMode), "SAFE: the target is the boot value"),
        enumerated("at_target", ("MOVING", "ARRIVED"), "1: clearance and pressure have arrived"),
        _clearance("target_clearance", "Radial clearance the node steers to"),
        _pressure("target_pressure", "Supply pressure the node steers to"),
        *_REFUSED,
    ),
)
STATUS: Final = Described(
    "RIG_STATUS",
    NODE,
    50_000,
    "Slow measurements of the rig.",
    "counter 9, tick 5000000 us, 87.32 W, 41.50 degC, 60.03 um, 0.998 bar",
    RigStatus(9, 5_000_000, 87.32, 41.5, 60.03, 0.998),
    (
        MEASURED,
        Signal("shaft_power", 32, signals.READINGS[0].words, "W", 0.01, True),
        Signal("oil_outlet", 16, signals.READINGS[1].words, "degC", 0.01, True),
        _clearance("clearance_actual", signals.READINGS[2].words),
        _pressure("pressure_actual", signals.READINGS[3].words),
    ),
)
INFO: Final = Described(
    "NODE_INFO",
    NODE,
    1_000_000,
    "What the node is: compared with the device's configuration before arming.",
    "counter 1, tick 5000000 us, schema {schema}, sample_period {period} us, boot 50.00 um and "
    "1.000 bar, time_to_live 100 ms, rate 50.0 um/s",
    NodeInfo(1, 5_000_000, 1, 200, 50.0, 1.0, 100, 50.0),
    (
        _MADE,
        Signal("schema", 16, "Version of this interface: {schema}"),
        Signal("sample_period", 16, "Time between two sampling instants", "us", least=1),
        _clearance(
            "boot_clearance",
            "Radial clearance taken at boot and whenever commands expire: the safe value",
        ),
        _pressure("boot_pressure", "Supply pressure taken at boot and whenever commands expire"),
        Signal(
            "time_to_live",
            16,
            "Age of echo_tick from which a command is refused; silence after which the target is "
            "the boot value",
            "ms",
            least=1,
        ),
        Signal("rate", 16, "Largest speed of the radial clearance", "um/s", 0.1),
    ),
)
HASH: Final = Signal(
    "layout_hash",
    32,
    "Hash of the layout that the node sends: the attribute LayoutHash of the DBC it was built with",
)
FIGURES: Final = Described(
    "NODE_FIGURES",
    NODE,
    1_000_000,
    "What the node was built with; sent before NODE_INFO.",
    "counter 1, tick 5000000 us, heartbeat_limit 3000 ms, coasts_on_silence 1, drive_commandable "
    "1, clearance 40 .. 160 um, pressure 0.5 .. 3 bar, lags 50 and 100 ms, drive_time_to_live 100 "
    "ms, speed 0 .. 15000 rpm, load 0 .. 500 N",
    NodeFigures(
        1, 5_000_000, 3000, True, True, 40.0, 160.0, 0.5, 3.0, 50, 100, 100, 0.0, 15e3, 0.0, 500.0
    ),
    (
        _MADE,
        Signal(
            "heartbeat_limit",
            16,
            "Silence of the granting session after which the drive coasts down",
            "ms",
        ),
        one_bit("coasts_on_silence", "0: the drive runs on when the device falls silent"),
        one_bit("drive_commandable", "1: the drive executes DRIVE_COMMAND"),
        _clearance("clearance_min", "Least radial clearance of the actuator", at=96),
        _clearance("clearance_max", "Greatest radial clearance of the actuator"),
        _pressure("pressure_min", "Least supply pressure that can be set"),
        _pressure("pressure_max", "Greatest supply pressure that can be set"),
        Signal("clearance_lag", 16, "Time constant of the clearance behind its target", "ms"),
        Signal("pressure_lag", 16, "Time constant of the pressure behind its target", "ms"),
        Signal("drive_time_to_live", 16, "Age from which a DRIVE_COMMAND is refused", "ms"),
        _speed("speed_min", "Least speed that can be commanded", at=224),
        _speed("speed_max", "Greatest speed that can be commanded"),
        _load("load_min", "Least load that can be commanded"),
        _load("load_max", "Greatest load that can be commanded"),
    ),
)
DRIVE: Final = Described(
    "DRIVE_COMMAND",
    DEVICE,
    50_000,
    "Setpoints for the drive, refused and expired like COMMAND; expired, the drive goes back to "
    "its local setpoints.",
    "counter 5, session 0x1234ABCD, echo_tick 5000000 us, 6000.0 rpm, 100.0 N, 500 rpm/s, 20 N/s",
    DriveCommand(5, 0x1234ABCD, 5_000_000, 6000.0, 100.0, 500, 20),
    (
        Signal("session", 32, "Nonce of the sender's present run"),
        Signal("echo_tick", 32, "Newest node tick that the device had processed", "us"),
        _speed("speed", "Setpoint of the shaft's speed"),
        _load("load", "Setpoint of the static load at the bearing"),
        Signal("speed_ramp", 16, "Largest change of the speed", "rpm/s"),
        Signal("load_ramp", 16, "Largest change of the load", "N/s"),
    ),
)
DRIVE_STATE: Final = Described(
    "DRIVE_STATE",
    NODE,
    50_000,
    "Whose setpoints the drive follows, where it stands, and what it refused.",
    "counter 3, tick 5020000 us, session 0x1234ABCD, command_counter 5, FOLLOWING, setpoints "
    "6000.0 rpm and 100.0 N, at 5990.5 rpm and 99.5 N, refused 1 stale, 2 check, 3 session, 4 "
    "range",
    DriveState(
        3, 5_020_000, 0x1234ABCD, 5, DriveMode.FOLLOWING, 6000.0, 100.0, 5990.5, 99.5, 1, 2, 3, 4
    ),
    (
        _MADE,
        Signal("session", 32, "Session that the drive follows; 0: none"),
        Signal("command_counter", 16, "Counter of the last command executed"),
        enumerated(
            "mode", names_of(DriveMode), "LOCAL: setpoints of the operator; COASTING: it is off"
        ),
        replace(_speed("speed_setpoint", "Speed that the drive goes to"), at=128),
        _load("load_setpoint", "Load that the drive goes to"),
        _speed("speed", "Measured speed", signed=True),
        _load("load", "Measured load", signed=True),
        *_REFUSED,
    ),
)
