"""Our MAVLink codec against the generated one, byte for byte; any bytes give an answer."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_py.records import (
    Command,
    DeviceHeartbeat,
    NodeInfo,
    NodeState,
    RawFrame,
    Rejected,
    RigStatus,
    SampleFrame,
    WireMessage,
)
from firmware_py.wire import mav_dialect, mav_packet
from firmware_py.wire.codec import CanCodec
from firmware_py.wire.mav_codec import DEVICE, RIG, MavCodec

CODEC = MavCodec()
u8, u16, u32 = (st.integers(0, 2**bits - 1) for bits in (8, 16, 32))
clearance = u16.map(lambda n: n * 0.01)
pressure = u16.map(lambda n: n * 0.001)

MESSAGES: st.SearchStrategy[WireMessage] = st.one_of(
    st.builds(
        DeviceHeartbeat,
        u16,
        u32,
        st.integers(0, 2),
        st.integers(0, 5),
        st.booleans(),
        st.booleans(),
    ),
    st.builds(Command, u16, u32, u32, clearance, pressure),
    st.builds(
        NodeState,
        u16,
        u32,
        st.integers(0, 1),
        u32,
        u16,
        clearance,
        pressure,
        st.booleans(),
        u16,
        u16,
        u16,
        u16,
    ),
    st.builds(
        RigStatus,
        u16,
        u32,
        st.integers(-(2**31), 2**31 - 1).map(lambda n: n * 0.01),
        st.integers(-(2**15), 2**15 - 1).map(lambda n: n * 0.01),
        clearance,
        pressure,
    ),
    st.builds(
        SampleFrame, u16, u32, u32, u16, st.integers(0, 7), st.binary(min_size=48, max_size=48)
    ),
    st.builds(
        NodeInfo,
        u16,
        u32,
        u16,
        st.integers(1, 2**16 - 1),
        clearance,
        pressure,
        st.integers(1, 2**16 - 1),
        u16.map(lambda n: n * 0.1),
    ),
)

SAMPLES = SampleFrame(1, 2, 3, 4, 5, bytes(range(1, 49)))


def counts(value: float, resolution: float) -> int:
    return round(value / resolution)


def generated(m: WireMessage) -> tuple[Any, tuple[int, int]]:
    """The same message through the module that pymavlink generated from ``orbitd.xml``."""
    d = mav_dialect
    match m:
        case DeviceHeartbeat():
            flags = m.run_permit * d.ORBITD_PERMIT_RUN + m.trip_request * d.ORBITD_PERMIT_TRIP
            return d.MAVLink_orbitd_device_heartbeat_message(
                m.counter, m.session, m.mode, m.arm_state, flags
            ), DEVICE
        case Command():
            return d.MAVLink_orbitd_command_message(
                m.counter,
                m.session,
                m.echo_tick_us,
                counts(m.clearance_um, 0.01),
                counts(m.pressure_bar, 0.001),
            ), DEVICE
        case NodeState():
            return d.MAVLink_orbitd_node_state_message(
                m.counter,
                m.tick_us,
                m.session,
                m.command_counter,
                m.mode,
                int(m.at_target),
                counts(m.target_clearance_um, 0.01),
                counts(m.target_pressure_bar, 0.001),
                m.refused_stale,
                m.refused_check,
                m.refused_session,
                m.refused_range,
            ), RIG
        case RigStatus():
            return d.MAVLink_orbitd_rig_status_message(
                m.counter,
                m.tick_us,
                counts(m.shaft_power_W, 0.01),
                counts(m.oil_outlet_C, 0.01),
                counts(m.clearance_actual_um, 0.01),
                counts(m.pressure_actual_bar, 0.001),
            ), RIG
        case SampleFrame():
            samples = [
                int.from_bytes(m.samples[i : i + 2], "little", signed=True) for i in range(0, 48, 2)
            ]
            return d.MAVLink_orbitd_samples_message(
                m.counter, m.tick_us, m.mark_tick_us, m.turn_count, m.flags, samples
            ), RIG
        case NodeInfo():
            return d.MAVLink_orbitd_node_info_message(
                m.counter,
                m.tick_us,
                m.schema,
                m.sample_period_us,
                counts(m.boot_clearance_um, 0.01),
                counts(m.boot_pressure_bar, 0.001),
                m.time_to_live_ms,
                counts(m.rate_um_s, 0.1),
            ), RIG


@given(message=MESSAGES)
@settings(deadline=None, max_examples=300)
def test_packets_are_those_of_the_generated_module(message: WireMessage) -> None:
    oracle, (system, component) = generated(message)
    sender = mav_dialect.MAVLink(None, srcSystem=system, srcComponent=component)
    sender.seq = message.counter & 0xFF
    assert CODEC.encode(message).data == oracle.pack(sender)


@given(message=MESSAGES)
@settings(deadline=None, max_examples=300)
def test_decoding_gives_the_message_back(message: WireMessage) -> None:
    frame = CODEC.encode(message, now_ns=5)
    assert frame.arrival_ns == 5
    assert CODEC.decode(frame) == message


@given(message=MESSAGES)
@settings(deadline=None, max_examples=100)
def test_both_wires_carry_the_same_record(message: WireMessage) -> None:
    can = CanCodec()
    assert CODEC.decode(CODEC.encode(message)) == can.decode(can.encode(message))


@given(
    message_id=st.sampled_from([*range(52000, 52008), 0, 253, 2**24]), data=st.binary(max_size=300)
)
@settings(deadline=None)
def test_any_bytes_give_an_answer(message_id: int, data: bytes) -> None:
    assert isinstance(CODEC.decode(RawFrame(0, message_id, data)), Rejected)


@given(message=MESSAGES, at=st.integers(0, 10_000), bit=st.integers(0, 7))
@settings(deadline=None, max_examples=300)
def test_one_flipped_bit_is_refused(message: WireMessage, at: int, bit: int) -> None:
    frame = CODEC.encode(message)
    data = bytearray(frame.data)
    data[at % len(data)] ^= 1 << bit
    assert isinstance(CODEC.decode(RawFrame(0, frame.frame_id, bytes(data))), Rejected)


def test_trailing_zeros_are_cut_and_restored() -> None:
    quiet = SampleFrame(1, 0, 0, 0, 0, bytes(48))
    frame = CODEC.encode(quiet)
    assert len(frame.data) == mav_packet.OVERHEAD_BYTES + 9  # up to the counter's low byte
    assert CODEC.decode(frame) == quiet
    nothing = SampleFrame(0, 0, 0, 0, 0, bytes(48))
    assert len(CODEC.encode(nothing).data) == mav_packet.OVERHEAD_BYTES + 1
    assert CODEC.decode(CODEC.encode(nothing)) == nothing


def packet(message_id: int, payload: bytes) -> RawFrame:
    return RawFrame(0, message_id, mav_packet.build(message_id, payload, 0, 1, 1))


def resealed(data: bytes, extra_id: int = 52005) -> bytes:
    """``data`` with a right CRC, so that only the other checks can refuse it."""
    crc: int = mav_dialect.x25crc(data[1:-2] + bytes([mav_packet.CRC_EXTRA[extra_id]])).crc
    return data[:-2] + crc.to_bytes(2, "little")


GOOD = CODEC.encode(SAMPLES).data
HEARTBEAT = CODEC.encode(DeviceHeartbeat(1, 2, 2, 5, True, True)).data


@pytest.mark.parametrize(
    ("reason", "frame"),
    [
        ("unknown_id", RawFrame(0, 0, GOOD)),
        ("unknown_id", RawFrame(0, 0x0C0, GOOD)),
        ("malformed", RawFrame(0, 52005, b"")),
        ("malformed", RawFrame(0, 52005, GOOD[:12])),
        ("malformed", RawFrame(0, 52005, b"\xfe" + GOOD[1:])),
        ("malformed", RawFrame(0, 52004, GOOD)),
        ("malformed", RawFrame(0, 52005, resealed(GOOD[:2] + b"\x01" + GOOD[3:]))),
        ("length", RawFrame(0, 52005, GOOD[:-1])),
        ("length", RawFrame(0, 52005, GOOD + b"\0")),
        ("length", packet(52005, bytes(range(1, 64)))),
        ("crc", RawFrame(0, 52005, GOOD[:-1] + bytes([GOOD[-1] ^ 1]))),
        ("range", packet(52001, b"\1\0\0\0\1\0\3\0\1")),
        ("range", packet(52001, b"\1\0\0\0\1\0\0\6\1")),
        ("range", packet(52003, bytes(24) + b"\2")),
        ("range", packet(52003, bytes(25) + b"\2")),
        ("range", packet(52006, b"\1" * 8)),
    ],
)
def test_each_refusal_has_its_name(reason: str, frame: RawFrame) -> None:
    assert CODEC.decode(frame) == Rejected(reason, frame.frame_id)


def test_the_boundary_values_pass() -> None:
    assert isinstance(CODEC.decode(RawFrame(0, 52001, HEARTBEAT)), DeviceHeartbeat)
    assert isinstance(CODEC.decode(packet(52005, bytes(range(1, 63)))), SampleFrame)


@pytest.mark.parametrize(
    "message",
    [
        Command(1, 2, 3, float("nan"), 1.0),
        Command(1, 2, 3, 655.36, 1.0),
        Command(1, 2, 3, -0.01, 1.0),
        Command(65536, 2, 3, 50.0, 1.0),
        SampleFrame(1, 2, 3, 4, 5, bytes(47)),
        DeviceHeartbeat(1, 2, 3, 0, False, False),
    ],
)
def test_a_value_that_does_not_fit_is_an_error(message: WireMessage) -> None:
    with pytest.raises(ValueError):
        CODEC.encode(message)


def test_a_full_sample_packet_is_74_bytes() -> None:
    assert len(GOOD) == 74
