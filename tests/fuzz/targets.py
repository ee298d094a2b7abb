"""What is fuzzed: one :class:`Input` for each input of the device.  Add yours to :data:`INPUTS`.

An input builds a feeder once; the feeder takes any bytes and must neither raise nor take long.  Its
corpus holds valid examples, which :mod:`.mutate` damages.
"""

from __future__ import annotations

import socket
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from http import HTTPStatus
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

import msgspec

from firmware_py import __version__
from firmware_py.commands.status import _lines
from firmware_py.config import SHIPPED, load
from firmware_py.decoding import UNDECODABLE
from firmware_py.gate import http, keys
from firmware_py.gate.answers import since
from firmware_py.gate.commands import CommandDesk
from firmware_py.gate.loop import read_models
from firmware_py.gate.metrics import render
from firmware_py.gate.normal_file import NormalFile
from firmware_py.gate.station import GroundStation
from firmware_py.gate.view import DeviceState, View
from firmware_py.guard.core import GuardCore
from firmware_py.guard.process.memory import Memory
from firmware_py.records import (
    BRAIN_VERBS,
    VERBS,
    Advice,
    Alarm,
    Block,
    CommandReply,
    CommandRequest,
    CommissionState,
    Cycle,
    Diagnosis,
    Event,
    EventAck,
    GuardState,
    Hello,
    NodeState,
    RawFrame,
    RigReading,
    RigStatus,
    decode,
    encode,
)
from firmware_py.wire import dbc, hub, protection
from firmware_py.wire import mav_dialect as mav
from firmware_py.wire.can_link import CanLink
from firmware_py.wire.codec import CanCodec, frames
from firmware_py.wire.hub_bus import OrbitdHubBus
from firmware_py.wire.layout import WireLayout
from firmware_py.wire.mav_codec import MavCodec
from firmware_py.wire.mav_packet import Framer

NODE = NodeState(1, 2, 1, 7, 3, 60.0, 1.0, True, 0, 0, 0, 0)

Feeder = Callable[[bytes], object]


@dataclass(frozen=True)
class Input:
    """One input: what builds its reader and valid examples, how many payloads the long form gives
    it, and words."""

    name: str
    build: Callable[[], tuple[Feeder, Sequence[bytes]]]
    cases: int
    words: str


def can_frames() -> tuple[Feeder, Sequence[bytes]]:
    """CAN frames into the guard's core: four bytes of identifier, then the data; a millisecond
    passes with each."""
    from ..guard.scripted_node import ScriptedNode, bench

    config = bench()
    core, node = GuardCore(config, CanCodec(), 0x77), ScriptedNode(config)
    valid = [frame for ms in range(1100) for frame in node.step(ms * 1_000_000)]
    clock = SimpleNamespace(seq=0)

    def feed(data: bytes) -> None:
        clock.seq += 1
        now_ns = clock.seq * 1_000_000
        frame = RawFrame(now_ns, int.from_bytes(data[:4], "big"), data[4:])
        core.step(Cycle(clock.seq, now_ns, [frame], None, [], True, True, True))

    of_each = {frame.frame_id: frame for frame in valid}.values()
    return feed, [
        frame.frame_id.to_bytes(4, "big") + frame.data for frame in (*of_each, *valid[:20])
    ]


def mavlink_packets() -> tuple[Feeder, Sequence[bytes]]:
    """Bytes of the serial line through framer and codec."""
    framer, codec = Framer(), MavCodec()

    def feed(data: bytes) -> None:
        for message_id, packet in framer.feed(data, 256):
            codec.decode(RawFrame(0, message_id, packet))

    status = RigStatus(1, 2, 60.0, 40.0, 60.0, 1.0)
    return feed, [bytes(codec.encode(status).data), bytes(codec.encode(status).data) * 3]


def schema_2_frames() -> tuple[Feeder, Sequence[bytes]]:
    """CAN frames of wire schema 2, twelve channels and many readings, into the guard's core, with a
    good CRC more often than not."""
    from ..wire.layouts import rig

    config = rig(12, 20)
    layout = WireLayout.of(config)
    codec = CanCodec(layout)
    core = GuardCore(config, codec, 0x77)
    seeds = {f.frame_id: protection.seed(f.data_id) for f in frames(layout).values()}
    clock = SimpleNamespace(seq=0)

    def feed(data: bytes) -> None:
        clock.seq += 1
        now_ns, frame_id = clock.seq * 1_000_000, int.from_bytes(data[:4], "big")
        body = data[4:]
        if clock.seq % 4 and frame_id in seeds and len(body) > 2:
            body = protection.protect(body[2:], seeds[frame_id])
        frame = RawFrame(now_ns, frame_id, body)
        core.step(Cycle(clock.seq, now_ns, [frame], None, [], True, True, True))

    examples = [codec.encode(told.example) for told in dbc.described(layout).values()]
    return feed, [frame.frame_id.to_bytes(4, "big") + frame.data for frame in examples]


def schema_2_packets() -> tuple[Feeder, Sequence[bytes]]:
    """Bytes of the serial line through framer and codec of wire schema 2."""
    from ..wire.layouts import rig

    layout = WireLayout.of(rig(9, 6))
    framer, codec = Framer(), MavCodec(layout)

    def feed(data: bytes) -> None:
        for message_id, packet in framer.feed(data, 256):
            codec.decode(RawFrame(0, message_id, packet))

    return feed, [codec.encode(told.example).data for told in dbc.described(layout).values()]


def room_packets() -> tuple[Feeder, Sequence[bytes]]:
    """Packets of a room's socket through all that the gate does with a record."""
    config = load(SHIPPED / "bench")[0]
    view, station = View(config), GroundStation(9, config, lambda *_: None)
    station.close()  # its sends fail silently, as with nobody there
    state = GuardState(
        1,
        1,
        2,
        3,
        True,
        ["x"],
        1.0,
        1.0,
        1.0,
        1.0,
        1.0,
        1.0,
        1.0,
        (1.0, 1.0),
        True,
        False,
        True,
        [Alarm("a", 1, 0, 1.0, 1.0, False)],
        {"n": 1},
    )
    records = [
        state,
        Event(1, 1, 2, "n", "t"),
        CommandReply(1, True, ["r"]),
        CommandRequest(1, "mode", mode=1),
        EventAck(1),
        Hello("brain", 1),
        Block(1, 0, 200_000, 0, 200, 0, 255, 1.0, 1, [3], bytes(480)),
        Advice(1, 1, 1, 1, 60.0, None, True, ["x"], None),
        CommissionState(1, 1, "gathering", "t"),
        Diagnosis(1, 1, 0, "v", 0.5, {"a": 0.1}, {"a": 0.1}, False, False, {"a": 0.1}, "m"),
        RigReading(1, 1, 0, RigStatus(1, 2, 60.0, 40.0, 60.0, 1.0), NODE),
    ]
    clock = SimpleNamespace(now_ns=0)

    def feed(data: bytes) -> None:
        try:
            record = decode(data)
        except UNDECODABLE:
            return
        clock.now_ns += 10_000_000
        view.step(record, clock.now_ns)
        if isinstance(record, Event):
            keys.event(record.severity)
            station.tell(record)
        shown = DeviceState(
            site="s",
            rig="r",
            instance="i",
            version=__version__,
            now_ns=clock.now_ns,
            unix_ns=0,
            rooms=view.processes(clock.now_ns),
            guard=view.guard,
            reading=view.reading,
            diagnosis=view.diagnosis,
            forecast=view.forecast,
            advice=view.advice,
            brain=view.brain,
            commission=view.commission,
            normal="",
            alarms=view.alarms(clock.now_ns),
            recording="",
            counters={},
        )
        msgspec.json.encode(shown)
        render(shown, view.features)
        _lines(shown)
        station.step(view.guard, clock.now_ns)

    return feed, [encode(record) for record in records]


def zenoh_payloads() -> tuple[Feeder, Sequence[bytes]]:
    """Payloads of command queries into the desk, for every verb, and the parameter ``since``."""
    replies: list[CommandReply] = []
    desk = CommandDesk(lambda request: True)
    clock = SimpleNamespace(now_ns=0)

    def feed(data: bytes) -> None:
        clock.now_ns += 100_000_000
        replies.clear()
        for verb in (*VERBS, *BRAIN_VERBS, "explode"):
            desk.hear(verb, data, "fuzz", replies.append, clock.now_ns)
        desk.step(clock.now_ns + 2_000_000_000)
        assert len(replies) >= len(VERBS), "every wish is answered"
        assert all(len(reason) < 1000 for reply in replies for reason in reply.reasons)
        since(data.decode("utf-8", "replace"))

    return feed, [
        b'{"id": "a"}',
        b'{"id": "b", "value": 60.0}',
        b'{"id": "c", "value": "auto"}',
        b'{"id": "d", "value": {"start_s": 3, "end_s": 5, "speed_rpm": 9000, "load_N": 60}}',
        b'{"id": "e", "value": {"target": "x", "seconds": 3, "owner": "o", "reason": "r"}}',
        b"-17",
        b"3",
    ]


def http_requests() -> tuple[Feeder, Sequence[bytes]]:
    """Heads of HTTP requests."""
    content = {"/": ("text/html", b"page"), "/metrics": ("text/plain", b"m 1")}

    def feed(data: bytes) -> None:
        status, answer = http.respond(data, content)
        assert isinstance(status, HTTPStatus)
        assert bytes(answer[:9]) == b"HTTP/1.1 "

    return feed, [
        b"GET / HTTP/1.1\r\nHost: x\r\n\r\n",
        b"HEAD /metrics?a=b HTTP/1.0\r\n\r\n",
        b"POST / HTTP/1.1\r\n\r\n",
    ]


def hub_packets() -> tuple[Feeder, Sequence[bytes]]:
    """Packets of a node on the hub, through the hub to another node's link."""
    folder = tempfile.TemporaryDirectory()
    path = Path(folder.name) / "t.sock"
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    listener.bind(str(path))
    listener.listen(8)
    listener.setblocking(False)
    bus = hub.Hub(listener)
    ends: list[socket.socket] = []

    def joined() -> socket.socket:
        end = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        end.connect(str(path))
        bus.step(0)
        end.recv(hub.MAX_PACKET)
        end.setblocking(False)
        return end

    node = OrbitdHubBus.__new__(OrbitdHubBus)
    node._socket, node._buffer, node._filters, node.lost, node._own = (
        joined(),
        bytearray(hub.MAX_PACKET),
        None,
        0,
        0,
    )
    node._is_shutdown = True
    link = CanLink(lambda wait_s: node)

    def feed(data: bytes, _kept: object = folder) -> None:
        if not ends:
            ends.append(joined())
        try:
            ends[0].send(data)
        except OSError:
            ends.pop().close()
        bus.step(0)
        link.receive(0)
        assert link._bus is node, "what one node sends must not take another off the bus"

    packet = hub.HEADER.pack(0, 0xC0, 0, hub.FD, 64) + bytes(64)
    return feed, [packet, hub.HEADER.pack(0, 0x40, 0, hub.ERROR_FRAME, 8) + bytes(8)]


def ground_station() -> tuple[Feeder, Sequence[bytes]]:
    """Datagrams of a ground station."""
    config = load(SHIPPED / "bench")[0]
    desk = CommandDesk(lambda request: True)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        station = GroundStation(listener.getsockname()[1], config, desk.ask)
        station.close()
    maker = mav.MAVLink(None, srcSystem=255, srcComponent=190)

    def feed(data: bytes) -> None:
        station._hear(data, 0)
        station._urgent.clear()
        station._waiting.clear()

    messages: list[Any] = [
        maker.param_request_list_encode(1, 1),
        maker.param_request_read_encode(1, 1, b"RATE_HZ", -1),
        maker.param_set_encode(1, 1, b"FILM_MIN_UM", 1.0, 9),
        maker.command_long_encode(1, 1, mav.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0),
        maker.command_long_encode(1, 1, mav.MAV_CMD_DO_SET_MODE, 0, 1, 2, 0, 0, 0, 0, 0),
    ]
    return feed, [bytes(message.pack(maker)) for message in messages]


def _file(
    name: str, read: Callable[[Path], object], corpus: Sequence[bytes]
) -> tuple[Feeder, Sequence[bytes]]:
    """A file that a process reads at its start."""
    folder = tempfile.TemporaryDirectory()
    path = Path(folder.name) / name

    def feed(data: bytes, _kept: object = folder) -> None:
        path.write_bytes(data)
        read(path)

    return feed, corpus


def normal_file() -> tuple[Feeder, Sequence[bytes]]:
    """The stored normal state."""
    return _file(
        "normal.json",
        lambda path: NormalFile(path.parent, lambda: 0).words(),
        [b'{"type": "Normal"}', b"{}"],
    )


def manifest() -> tuple[Feeder, Sequence[bytes]]:
    """The model folder's manifest."""
    config = load(SHIPPED / "bench")[0]

    def read(path: Path) -> object:
        return read_models(
            config.replaced(
                models=msgspec.structs.replace(config.models, directory=str(path.parent))
            )
        )

    return _file("manifest.json", read, [b'{"files": {"a.onnx": {"sha256": "00"}}}'])


def guard_memory() -> tuple[Feeder, Sequence[bytes]]:
    """The latched trips that the guard reads at its start."""
    return _file(
        "trips.json", lambda path: Memory(path.parent).close(), [b'["disp_x_danger"]', b"[]"]
    )


INPUTS: Final = (
    Input("can_frames", can_frames, 1_000_000, "CAN frames into the guard's core"),
    Input("mavlink_packets", mavlink_packets, 1_000_000, "bytes of the serial line"),
    Input("schema_2_frames", schema_2_frames, 1_000_000, "CAN frames of wire schema 2"),
    Input("schema_2_packets", schema_2_packets, 1_000_000, "the serial line of wire schema 2"),
    Input("room_packets", room_packets, 1_000_000, "packets of the local sockets"),
    Input("zenoh_payloads", zenoh_payloads, 1_000_000, "payloads of commands on Zenoh"),
    Input("http_requests", http_requests, 1_000_000, "requests to page and metrics"),
    Input("hub_packets", hub_packets, 200_000, "packets on the hub of the bus"),
    Input("ground_station", ground_station, 200_000, "datagrams of a ground station"),
    Input("normal_file", normal_file, 20_000, "the stored normal state"),
    Input("manifest", manifest, 20_000, "the manifest of the models"),
    Input("guard_memory", guard_memory, 5_000, "the latched trips"),
)
