"""The codec and `orbitd.dbc` are the same interface; decoding is total; the CRC catches what it
must."""

from __future__ import annotations

import math
import struct
from pathlib import Path
from typing import Any

import cantools
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import firmware_py
from firmware_py.config import SHIPPED, load
from firmware_py.records import (
    CHANNELS,
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
from firmware_py.wire import protection
from firmware_py.wire.codec import CanCodec, FrameId, SampleFlag

PACKAGE = Path(firmware_py.__file__).parent
DBC = cantools.database.load_file(PACKAGE / "wire" / "orbitd.dbc")
CODEC = CanCodec()
MESSAGES = {FrameId(m.frame_id): m for m in DBC.messages}
EXAMPLES = {i: bytes.fromhex(m.dbc.attributes["ExampleBytes"].value) for i, m in MESSAGES.items()}
RECORD_OF = {
    "DEVICE_HEARTBEAT": DeviceHeartbeat,
    "COMMAND": Command,
    "NODE_STATE": NodeState,
    "RIG_STATUS": RigStatus,
    "SAMPLES": SampleFrame,
    "NODE_INFO": NodeInfo,
}
# Signal of the DBC -> field of the record, where the names differ.
FIELD_OF = {
    "tick": "tick_us",
    "echo_tick": "echo_tick_us",
    "mark_tick": "mark_tick_us",
    "clearance": "clearance_um",
    "pressure": "pressure_bar",
    "target_clearance": "target_clearance_um",
    "target_pressure": "target_pressure_bar",
    "shaft_power": "shaft_power_W",
    "oil_outlet": "oil_outlet_C",
    "clearance_actual": "clearance_actual_um",
    "pressure_actual": "pressure_actual_bar",
    "sample_period": "sample_period_us",
    "boot_clearance": "boot_clearance_um",
    "boot_pressure": "boot_pressure_bar",
    "time_to_live": "time_to_live_ms",
    "rate": "rate_um_s",
}


def random_values(message: Any, rng: np.random.Generator) -> dict[str, float]:
    """Physical values of every signal, ends of the range included now and then."""
    values = {}
    for signal in message.signals:
        low = round((signal.minimum or 0) / signal.scale)
        high = round((signal.maximum or 0) / signal.scale)
        raw = int(
            rng.choice([low, high, rng.integers(low, high, endpoint=True)], p=[0.1, 0.1, 0.8])
        )
        values[signal.name] = raw * signal.scale
    return values


def record_of(name: str, values: dict[str, float]) -> WireMessage:
    """The record that carries the DBC's ``values``."""
    if name == "SAMPLES":
        raw = [
            round(
                values[f"{c}_{i}"] / MESSAGES[FrameId.SAMPLES].get_signal_by_name(f"{c}_{i}").scale
            )
            for i in range(3)
            for c in CHANNELS
        ]
        flags = (
            SampleFlag.BEHIND * values["rig_behind"]
            + SampleFlag.MARK_VALID * values["mark_valid"]
            + SampleFlag.COASTING * values["drive_coasting"]
        )
        return SampleFrame(
            values["counter"],
            values["tick"],
            values["mark_tick"],
            values["turn_count"],
            int(flags),
            struct.pack("<24h", *raw),
        )
    fields = {FIELD_OF.get(k, k): v for k, v in values.items() if k != "crc"}
    for flag in ("at_target", "run_permit", "trip_request"):
        if flag in fields:
            fields[flag] = bool(fields[flag])
    return RECORD_OF[name](**fields)


@pytest.mark.parametrize("frame_id", MESSAGES)
def test_codec_and_dbc_agree_on_random_messages(frame_id: FrameId) -> None:
    message = MESSAGES[frame_id]
    rng = np.random.default_rng(int(frame_id))
    for _ in range(300):
        values = random_values(message, rng)
        record = record_of(message.name, values)
        frame = CODEC.encode(record, now_ns=5)
        values["crc"] = struct.unpack_from("<H", frame.data)[0]
        assert frame == RawFrame(5, int(frame_id), message.encode(values))
        assert CODEC.decode(frame) == record
        assert message.decode(frame.data, decode_choices=False) == values


@pytest.mark.parametrize("frame_id", MESSAGES)
def test_the_dbc_says_all_that_a_stranger_needs(frame_id: FrameId) -> None:
    message, example = MESSAGES[frame_id], EXAMPLES[frame_id]
    attributes = message.dbc.attributes
    assert message.is_fd
    assert message.length == len(example)
    assert message.comment
    assert all(s.comment for s in message.signals if not s.name.endswith(("_1", "_2")))
    assert attributes["CycleTimeUs"].value > 0
    data_id = attributes["DataId"].value
    assert protection.protect(example[2:], protection.seed(data_id)) == example
    record = CODEC.decode(RawFrame(0, int(frame_id), example))
    assert not isinstance(record, Rejected)
    assert CODEC.encode(record).data == example


def test_the_crc_is_the_published_one() -> None:
    """The catalogue's check value of CRC-16/CCITT-FALSE ("123456789" -> 0x29B1), computed bit by
    bit."""

    def bitwise(data: bytes) -> int:
        register = 0xFFFF
        for byte in data:
            register ^= byte << 8
            for _ in range(8):
                register = (register << 1 ^ (0x1021 if register & 0x8000 else 0)) & 0xFFFF
        return register

    assert bitwise(b"123456789") == 0x29B1
    body = EXAMPLES[FrameId.COMMAND][2:]
    assert bitwise(b"\x02\x4f" + body) == int.from_bytes(EXAMPLES[FrameId.COMMAND][:2], "little")


def test_sample_scales_are_those_of_the_shipped_configuration() -> None:
    config, _ = load(SHIPPED / "bench")
    si_per_unit = {"um": 1e-6, "m/s2": 1.0, "Pa": 1.0, "bar": 1.0, "V": 1.0}
    for channel in config.machine.channel:
        signal = MESSAGES[FrameId.SAMPLES].get_signal_by_name(f"{channel.name}_0")
        assert signal.scale * si_per_unit[signal.unit] == pytest.approx(channel.scale, rel=1e-12)


@given(
    frame_id=st.sampled_from([*map(int, MESSAGES), 0, 0x7FF, 0x800000C0]),
    data=st.binary(max_size=70),
)
def test_any_bytes_give_a_record_or_a_rejection(frame_id: int, data: bytes) -> None:
    result = CODEC.decode(RawFrame(0, frame_id, data))
    assert isinstance(
        result,
        Rejected | SampleFrame | RigStatus | NodeState | NodeInfo | Command | DeviceHeartbeat,
    )


@given(st.sampled_from(list(MESSAGES)), st.data())
def test_any_protected_payload_gives_a_record_or_range(
    frame_id: FrameId, data: st.DataObject
) -> None:
    size = MESSAGES[frame_id].length
    body = data.draw(st.binary(min_size=size - 2, max_size=size - 2))
    seed = protection.seed(MESSAGES[frame_id].dbc.attributes["DataId"].value)
    result = CODEC.decode(RawFrame(0, int(frame_id), protection.protect(body, seed)))
    if isinstance(result, Rejected):
        assert result == Rejected("range", int(frame_id))
    else:
        assert CODEC.decode(CODEC.encode(result)) == result


@pytest.mark.parametrize("frame_id", MESSAGES)
def test_every_flipped_bit_is_caught(frame_id: FrameId) -> None:
    for bit in range(8 * len(EXAMPLES[frame_id])):
        data = bytearray(EXAMPLES[frame_id])
        data[bit // 8] ^= 1 << bit % 8
        assert CODEC.decode(RawFrame(0, int(frame_id), bytes(data))) == Rejected(
            "crc", int(frame_id)
        )


def test_a_payload_under_another_identifier_is_caught() -> None:
    pairs = [
        (i, j)
        for i in MESSAGES
        for j in MESSAGES
        if i != j and len(EXAMPLES[i]) == len(EXAMPLES[j])
    ]
    assert len(pairs) == 6  # three messages of 24 bytes
    for claimed, real in pairs:
        assert CODEC.decode(RawFrame(0, int(claimed), EXAMPLES[real])) == Rejected(
            "crc", int(claimed)
        )


def test_lengths_and_identifiers_are_checked() -> None:
    example = EXAMPLES[FrameId.COMMAND]
    assert CODEC.decode(RawFrame(0, 0x060, example[:-1])) == Rejected("length", 0x060)
    assert CODEC.decode(RawFrame(0, 0x060, example + b"\0")) == Rejected("length", 0x060)
    assert CODEC.decode(RawFrame(0, 0x061, example)) == Rejected("unknown_id", 0x061)


@pytest.mark.parametrize(
    ("frame_id", "offset", "value"),
    [
        (FrameId.DEVICE_HEARTBEAT, 8, 3),
        (FrameId.DEVICE_HEARTBEAT, 9, 6),
        (FrameId.NODE_STATE, 14, 2),
        (FrameId.NODE_STATE, 15, 2),
    ],
)
def test_enumerations_beyond_their_last_value_are_refused(
    frame_id: FrameId, offset: int, value: int
) -> None:
    seed = protection.seed(MESSAGES[frame_id].dbc.attributes["DataId"].value)
    for good, expected in ((value - 1, False), (value, True), (255, True)):
        data = bytearray(EXAMPLES[frame_id])
        data[offset] = good
        result = CODEC.decode(RawFrame(0, int(frame_id), protection.protect(bytes(data[2:]), seed)))
        assert isinstance(result, Rejected) is expected


@pytest.mark.parametrize("clearance", [-0.006, 655.356, math.nan, math.inf, -math.inf])
def test_a_clearance_that_does_not_fit_is_refused(clearance: float) -> None:
    with pytest.raises(ValueError, match="does not fit"):
        CODEC.encode(Command(0, 1, 2, clearance, 1.0))


@pytest.mark.parametrize("clearance", [0.0, 655.35])
def test_the_ends_of_the_clearance_fit(clearance: float) -> None:
    assert CODEC.decode(CODEC.encode(Command(0, 1, 2, clearance, 1.0))) == Command(
        0, 1, 2, clearance, 1.0
    )


@pytest.mark.parametrize(
    "message",
    [
        Command(65536, 1, 2, 50.0, 1.0),
        Command(-1, 1, 2, 50.0, 1.0),
        Command(0, 2**32, 2, 50.0, 1.0),
        DeviceHeartbeat(0, 1, 3, 0, True, False),
        DeviceHeartbeat(0, 1, 0, 6, True, False),
        SampleFrame(0, 0, 0, 0, 8, bytes(48)),
        SampleFrame(0, 0, 0, 0, 0, bytes(47)),
        NodeInfo(0, 0, 1, 0, 50.0, 1.0, 100, 50.0),
        RigStatus(0, 0, 3e7, 40.0, 50.0, 1.0),
        RigStatus(0, 0, 100.0, 400.0, 50.0, 1.0),
    ],
)
def test_other_values_that_do_not_fit_are_refused(message: WireMessage) -> None:
    with pytest.raises(ValueError):
        CODEC.encode(message)
