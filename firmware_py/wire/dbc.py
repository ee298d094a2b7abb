"""The DBC of a rig: every message of its layout with signals, words, attributes and one example.

The text for wire schema 1 is ``orbitd.dbc`` itself, byte for byte (a test compares); ``orbitd rig
dbc`` writes that of a configured rig.  Messages are described here for people and tools; bytes are
made by :mod:`firmware_py.wire.fields`, and a test holds both against each other with cantools.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from struct import pack
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
    ReadingsFrame,
    RigStatus,
    SampleFrame,
    WireMessage,
)
from firmware_py.wire.codec import CanCodec, frames
from firmware_py.wire.layout import WireLayout, wire_step

DEVICE, NODE = "Device", "Node"
_CRC: Final = (
    "CRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF, not reflected, no final xor; over the "
    "data id (2 bytes, little endian, not transmitted), then payload bytes 2 to the last (reserved "
    "bytes included)"
)
_COUNTER: Final = "Per message id; +1 with every frame sent, 65535 is followed by 0"
_TICK: Final = "Node clock, 1 us per count, wraps after 71.6 min; "
_COVERAGE: Final = (
    "data id (2 bytes, little endian, not transmitted), then payload bytes 2 to the last"
)
_ABOUT: Final = (
    "The wire of orbitd: CAN FD, 11-bit identifiers, bit rate switching, 1 Mbit/s arbitration, 5 "
    "Mbit/s data, little endian. Reserved bits and bytes (those of no signal) are sent as 0 and "
    "ignored by receivers, but the CRC covers them. The duties of a node stand in NODE.md. Every "
    "message carries an attribute ExampleBytes: one whole frame, CRC included, whose values its "
    "comment names."
)


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


def _names(kind: type[Mode | ArmState | NodeMode | DriveMode | ReadingQuality]) -> tuple[str, ...]:
    return tuple(member.name for member in kind)


def _enum(name: str, choices: tuple[str, ...], comment: str) -> Signal:
    return Signal(name, 8, comment, most=len(choices) - 1, choices=choices)


def _bit(name: str, comment: str, at: int | None = None) -> Signal:
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
_MADE: Final = Signal("tick", 32, _TICK + "when this frame was made", "us")
_MEASURED: Final = Signal("tick", 32, _TICK + "of the measurement", "us")

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
        _enum("mode", _names(Mode), "Who chooses the targets"),
        _enum(
            "arm_state", _names(ArmState), "Life cycle of the device's right to move the actuator"
        ),
        _bit("run_permit", "1: the drive may run"),
        _bit("trip_request", "1: coast down now"),
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
        _enum("mode", _names(NodeMode), "SAFE: the target is the boot value"),
        _enum("at_target", ("MOVING", "ARRIVED"), "1: clearance and pressure have arrived"),
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
        _MEASURED,
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
_HASH: Final = Signal(
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
        _bit("coasts_on_silence", "0: the drive runs on when the device falls silent"),
        _bit("drive_commandable", "1: the drive executes DRIVE_COMMAND"),
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
        _enum("mode", _names(DriveMode), "LOCAL: setpoints of the operator; COASTING: it is off"),
        replace(_speed("speed_setpoint", "Speed that the drive goes to"), at=128),
        _load("load_setpoint", "Load that the drive goes to"),
        _speed("speed", "Measured speed", signed=True),
        _load("load", "Measured load", signed=True),
        *_REFUSED,
    ),
)


def described(layout: WireLayout) -> dict[type, Described]:
    """Every message of ``layout``, by its record."""
    common: dict[type, Described] = {DeviceHeartbeat: HEARTBEAT, Command: COMMAND, NodeState: STATE}
    info = _info(layout)
    if layout.schema == 1:
        return common | {RigStatus: STATUS, SampleFrame: _samples(layout), NodeInfo: info}
    return common | {
        DriveCommand: DRIVE,
        DriveState: DRIVE_STATE,
        ReadingsFrame: _readings(layout),
        SampleFrame: _samples(layout),
        NodeInfo: info,
        NodeFigures: FIGURES,
    }


def _info(layout: WireLayout) -> Described:
    schema, period = layout.schema, layout.period_us
    told = tuple(
        replace(s, comment=s.comment.replace("{schema}", str(schema))) for s in INFO.signals
    )
    values = INFO.values.format(schema=schema, period=period)
    if schema > 1:
        told, values = (*told, _HASH), f"{values}, layout_hash {layout.hash:#010x}"
    example = NodeInfo(1, 5_000_000, schema, period, 50.0, 1.0, 100, 50.0, layout.hash)
    return replace(INFO, signals=told, values=values, example=example)


EXAMPLE_COUNTS: Final = (1250, -830, 15, -7, 3, 120, 1000, 13000)
"""First instant of the example of wire schema 1."""


def _samples(layout: WireLayout) -> Described:
    n, instants = len(layout.channels), layout.instants
    head: tuple[Signal, ...] = (
        Signal("tick", 32, _TICK + "of instant 0", "us"),
        Signal(
            "mark_tick",
            32,
            "Tick of the newest once-per-turn mark at or before the last instant; valid when "
            "mark_valid is 1",
            "us",
        ),
        Signal("turn_count", 16, "Marks seen since boot, wrapping"),
        _bit("rig_behind", "1: the rig in software is behind real time"),
        _bit("mark_valid", "1: at least one mark has been seen"),
        _bit("drive_coasting", "1: the drive is off"),
    )
    values = tuple(
        Signal(
            f"{c.name}_{i}",
            16,
            f"{c.words}; instant 0 of {instants}" if i == 0 else "",
            c.kind.wire_unit,
            wire_step(c),
            True,
            at=128 if i == 0 and k == 0 else None,
        )
        for i in range(instants)
        for k, c in enumerate(layout.channels)
    )
    known = "counter 4096, tick 5000000 us, mark_tick 4998765 us, turn_count 321, mark_valid 1"
    cycle_us = instants * layout.period_us
    if layout.schema == 1:
        counts = [v + i for i in range(instants) for v in EXAMPLE_COUNTS]
        comment = (
            "Three sampling instants, one sample period apart (NODE_INFO.sample_period), of eight "
            "channels. Cycle time is three sample periods: 600 us at 5 kHz, 300 us at 10 kHz."
        )
        told = (
            f"{known}; instant 0: 12.50 um, -8.30 um, 0.15, -0.07, 0.03 m/s2, 0.120 Pa, 1.000 bar, "
            "1.3000 V; each raw value one higher at instant 1 and two higher at instant 2"
        )
    else:
        counts = [100 + k for k in range(n * instants)]
        head = (*head, _layout_tag(120))
        comment = (
            f"Sampling instants: {instants}, one sample period apart (NODE_INFO.sample_period), of "
            f"{n} channels, all channels of one instant together."
        )
        told = f"{known}, layout {layout.tag}; raw values 100, 101 .. in the order of the signals"
    example = SampleFrame(4096, 5_000_000, 4_998_765, 321, 2, pack(f"<{len(counts)}h", *counts))
    name = "SAMPLES"
    return Described(name, NODE, cycle_us, comment, told, example, (*head, *values))


def _layout_tag(at: int) -> Signal:
    return Signal(
        "layout", 8, "Low byte of layout_hash; a frame of another layout is refused", at=at
    )


def _readings(layout: WireLayout) -> Described:
    head = (
        _MEASURED,
        Signal("page", 8, "Which readings this frame carries", most=layout.pages - 1, mux="M"),
        _layout_tag(72),
    )
    slots = layout.slots
    rows: list[Signal] = []
    for number in range(layout.pages):
        for slot, row in enumerate(layout.page(number)):
            mux = f"m{number}"
            rows += [
                Signal(row.name, 32, row.words, row.kind.unit, row.kind.resolution, True,
                       at=96 + 32 * slot, mux=mux),
                Signal(f"{row.name}_age", 8, "Age at tick; 2550 ms: that or older", "ms", 10.0,
                       at=96 + 32 * slots + 8 * slot, mux=mux),
                replace(
                    _enum(f"{row.name}_quality", _names(ReadingQuality),
                          "What the node says of the reading"),
                    at=96 + 40 * slots + 8 * slot, mux=mux,
                ),
            ]  # fmt: skip
    n = len(layout.page(0))
    example = ReadingsFrame(
        9,
        5_000_000,
        0,
        tuple(1000 * (k + 1) * row.kind.resolution for k, row in enumerate(layout.page(0))),
        (10,) * n,
        (int(ReadingQuality.OK),) * n,
    )
    return Described(
        "READINGS",
        NODE,
        50_000 // layout.pages,
        f"Slow readings, {layout.pages} page(s) in turn, all of them every 50 ms.",
        f"counter 9, tick 5000000 us, page 0, layout {layout.tag}; raw values 1000, 2000 .., ages "
        "10 ms, OK",
        example,
        (*head, *rows),
    )


# ---------------------------------------------------------------------- the text


@dataclass(frozen=True)
class _DbcMessage:
    """A described message with its place on the bus, and its signals with their first bits."""

    told: Described
    frame_id: int
    data_id: int
    size: int
    placed: tuple[tuple[Signal, int], ...]
    example: bytes


def text(
    layout: WireLayout, nominal_bitrate: int = 1_000_000, data_bitrate: int = 5_000_000
) -> str:
    """The whole DBC of ``layout``."""
    messages = _messages(layout)
    return "\n".join(
        [
            'VERSION "1"' if layout.schema == 1 else 'VERSION "2"',
            "",
            "NS_ :",
            "",
            "BS_:",
            "",
            f"BU_: {DEVICE} {NODE}",
            "",
            *_blocks(messages),
            *_comments(messages),
            "",
            *_attributes(messages, layout, nominal_bitrate, data_bitrate),
            "",
            *_choices(messages),
            "",
        ]
    )


def _messages(layout: WireLayout) -> list[_DbcMessage]:
    codec, told = CanCodec(layout), described(layout)
    found = [
        _DbcMessage(
            told[kind],
            int(frame.frame_id),
            frame.data_id,
            frame.size,
            tuple(_placed(told[kind].signals)),
            codec.encode(told[kind].example).data,
        )
        for kind, frame in frames(layout).items()
    ]
    return sorted(found, key=lambda message: message.frame_id)


def _placed(rows: Iterable[Signal]) -> Iterator[tuple[Signal, int]]:
    head = (Signal("crc", 16, _CRC), Signal("counter", 16, _COUNTER))
    bit = 0
    for signal in (*head, *rows):
        bit = bit if signal.at is None else signal.at
        yield signal, bit
        bit += signal.bits


def _blocks(messages: list[_DbcMessage]) -> Iterator[str]:
    for m in messages:
        yield f"BO_ {m.frame_id} {m.told.name}: {m.size} {m.told.sender}"
        receiver = NODE if m.told.sender == DEVICE else DEVICE
        for s, bit in m.placed:
            low, high = (-(2 ** (s.bits - 1)), 2 ** (s.bits - 1) - 1)
            if not s.signed:
                low, high = 0, 2**s.bits - 1
            least = low * s.factor if s.least is None else s.least
            most = high * s.factor if s.most is None else s.most
            mux = f" {s.mux}" if s.mux else ""
            yield (
                f" SG_ {s.name}{mux} : {bit}|{s.bits}@1{'-' if s.signed else '+'} "
                f'({s.factor:.9g},0) [{least:.12g}|{most:.12g}] "{s.unit}" {receiver}'
            )
        yield ""


def _comments(messages: list[_DbcMessage]) -> Iterator[str]:
    yield f'CM_ "{_ABOUT}";'
    yield f'CM_ BU_ {DEVICE} "orbitd: reads samples, sends heartbeat and commands.";'
    yield f'CM_ BU_ {NODE} "Sensor and actuator node of the rig.";'
    for m in messages:
        yield f'CM_ BO_ {m.frame_id} "{m.told.comment} ExampleBytes: {m.told.values}.";'
        for s, _ in m.placed:
            if s.comment:
                yield f'CM_ SG_ {m.frame_id} {s.name} "{s.comment}";'


def _attributes(
    messages: list[_DbcMessage], layout: WireLayout, nominal_bitrate: int, data_bitrate: int
) -> Iterator[str]:
    hashed = layout.schema > 1
    formats = ",".join(
        f'"{name}"'
        for name in (
            "StandardCAN",
            "ExtendedCAN",
            *(f"reserved{i}" for i in range(2, 14)),
            "StandardCAN_FD",
            "ExtendedCAN_FD",
        )
    )
    yield 'BA_DEF_  "BusType" STRING ;'
    yield 'BA_DEF_  "CrcPolynomial" HEX 0 65535;'
    yield 'BA_DEF_  "CrcStart" HEX 0 65535;'
    yield 'BA_DEF_  "CrcCoverage" STRING ;'
    yield 'BA_DEF_  "NominalBitrate" INT 0 1000000;'
    yield 'BA_DEF_  "DataBitrate" INT 0 8000000;'
    if hashed:
        yield 'BA_DEF_  "LayoutHash" STRING ;'
    yield f'BA_DEF_ BO_  "VFrameFormat" ENUM  {formats};'
    yield 'BA_DEF_ BO_  "CANFD_BRS" ENUM  "0","1";'
    yield 'BA_DEF_ BO_  "GenMsgSendType" ENUM  "Cyclic";'
    yield 'BA_DEF_ BO_  "GenMsgCycleTime" INT 0 65535;'
    yield 'BA_DEF_ BO_  "CycleTimeUs" INT 0 10000000;'
    yield 'BA_DEF_ BO_  "DataId" HEX 0 65535;'
    yield 'BA_DEF_ BO_  "ExampleBytes" STRING ;'
    yield 'BA_DEF_DEF_  "BusType" "CAN FD";'
    yield 'BA_DEF_DEF_  "CrcPolynomial" 4129;'
    yield 'BA_DEF_DEF_  "CrcStart" 65535;'
    yield f'BA_DEF_DEF_  "CrcCoverage" "{_COVERAGE}";'
    yield 'BA_DEF_DEF_  "NominalBitrate" 1000000;'
    yield 'BA_DEF_DEF_  "DataBitrate" 5000000;'
    if hashed:
        yield 'BA_DEF_DEF_  "LayoutHash" "";'
    yield 'BA_DEF_DEF_  "VFrameFormat" "StandardCAN_FD";'
    yield 'BA_DEF_DEF_  "CANFD_BRS" "1";'
    yield 'BA_DEF_DEF_  "GenMsgSendType" "Cyclic";'
    yield 'BA_DEF_DEF_  "GenMsgCycleTime" 0;'
    yield 'BA_DEF_DEF_  "CycleTimeUs" 0;'
    yield 'BA_DEF_DEF_  "DataId" 0;'
    yield 'BA_DEF_DEF_  "ExampleBytes" "";'
    yield 'BA_ "BusType" "CAN FD";'
    yield 'BA_ "CrcPolynomial" 4129;'
    yield 'BA_ "CrcStart" 65535;'
    yield f'BA_ "CrcCoverage" "{_COVERAGE}";'
    yield f'BA_ "NominalBitrate" {nominal_bitrate};'
    yield f'BA_ "DataBitrate" {data_bitrate};'
    if hashed:
        yield f'BA_ "LayoutHash" "{layout.hash:#010x}";'
    for m in messages:
        yield f'BA_ "VFrameFormat" BO_ {m.frame_id} 14;'
        yield f'BA_ "CANFD_BRS" BO_ {m.frame_id} 1;'
        yield f'BA_ "GenMsgCycleTime" BO_ {m.frame_id} {max(1, round(m.told.cycle_us / 1000))};'
        yield f'BA_ "CycleTimeUs" BO_ {m.frame_id} {m.told.cycle_us};'
        yield f'BA_ "DataId" BO_ {m.frame_id} {m.data_id};'
        yield f'BA_ "ExampleBytes" BO_ {m.frame_id} "{m.example.hex(" ").upper()}";'


def _choices(messages: list[_DbcMessage]) -> Iterator[str]:
    for m in messages:
        for s, _ in m.placed:
            if s.choices:
                named = " ".join(f'{i} "{name}"' for i, name in enumerate(s.choices))
                yield f"VAL_ {m.frame_id} {s.name} {named} ;"
