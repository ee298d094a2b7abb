"""Wire schema 2: the rig's codec and its DBC are the same interface, for rigs of 2 to 24
channels."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import cantools
import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import firmware_py
from firmware_py import signals
from firmware_py.config import SHIPPED, load
from firmware_py.records import (
    DriveState,
    NodeInfo,
    RawFrame,
    ReadingsFrame,
    Rejected,
    RigStatus,
    SampleFrame,
    WireMessage,
)
from firmware_py.wire import dbc, mav_dialect, mav_packet, protection
from firmware_py.wire.codec import FRAMES_1, CanCodec, FrameId
from firmware_py.wire.layout import PAYLOADS, SCHEMA_1, WireLayout
from firmware_py.wire.mav_codec import IDS_1, IDS_2, MavCodec

from .layouts import LAYOUTS, rig
from .test_can_codec import FIELD_OF, random_values

PUBLISHED = Path(firmware_py.__file__).parent / "wire" / "orbitd.dbc"
FIELDS = FIELD_OF | {
    "speed": "speed_rpm",
    "load": "load_N",
    "speed_ramp": "speed_ramp_rpm_s",
    "load_ramp": "load_ramp_N_s",
    "speed_setpoint": "speed_setpoint_rpm",
    "load_setpoint": "load_setpoint_N",
    "heartbeat_limit": "heartbeat_limit_ms",
    "drive_time_to_live": "drive_time_to_live_ms",
    **{f"{what}_lag": f"{what}_lag_ms" for what in ("clearance", "pressure")},
    **{f"clearance_{end}": f"clearance_{end}_um" for end in ("min", "max")},
    **{f"pressure_{end}": f"pressure_{end}_bar" for end in ("min", "max")},
    **{f"speed_{end}": f"speed_{end}_rpm" for end in ("min", "max")},
    **{f"load_{end}": f"load_{end}_N" for end in ("min", "max")},
}


def database(layout: WireLayout) -> Any:
    return cantools.database.load_string(dbc.text(layout), "dbc")


@pytest.fixture(params=LAYOUTS, scope="module")
def layout(request: pytest.FixtureRequest) -> WireLayout:
    return LAYOUTS[request.param]


def protected(message: Any, values: dict[str, float]) -> bytes:
    """The frame of ``values``, made by the DBC alone."""
    body = message.encode(values | {"crc": 0})[2:]
    return protection.protect(body, protection.seed(message.dbc.attributes["DataId"].value))


def told(record: WireMessage, layout: WireLayout) -> dict[str, float]:
    """What the DBC calls the fields of ``record``."""
    fields = msgspec.structs.asdict(record)
    match record:
        case SampleFrame():
            flags = fields.pop("flags")
            names = [f"{c.name}_{i}" for i in range(layout.instants) for c in layout.channels]
            counts = struct.unpack(f"<{len(names)}h", fields.pop("samples"))
            steps = [signal_step(name, layout) for name in names]
            fields |= {n: c * s for n, c, s in zip(names, counts, steps, strict=True)}
            fields |= {
                "rig_behind": flags & 1,
                "mark_valid": flags >> 1 & 1,
                "drive_coasting": flags >> 2,
            }
        case ReadingsFrame():
            rows = layout.page(record.page)
            columns = [fields.pop(name) for name in ("values", "ages_ms", "qualities")]
            for i, row in enumerate(rows):
                for suffix, column in zip(("", "_age", "_quality"), columns, strict=True):
                    fields[row.name + suffix] = column[i]
    if isinstance(record, SampleFrame | ReadingsFrame):
        fields["layout"] = layout.tag
    back = {field: name for name, field in FIELDS.items()}
    if hasattr(record, "tick_us"):
        back["tick_us"] = "tick"
    return {
        ("mark_tick" if name == "mark_tick_us" else back.get(name, name)): float(value)
        for name, value in fields.items()
    }


def signal_step(name: str, layout: WireLayout) -> float:
    channel = next(c for c in layout.channels if name.rpartition("_")[0] == c.name)
    return channel.wire_scale * channel.kind.wire_per_si


def test_every_message_agrees_with_cantools_both_ways(layout: WireLayout) -> None:
    codec, rng = CanCodec(layout), np.random.default_rng(2)
    for message in database(layout).messages:
        pages = range(layout.pages) if message.name == "READINGS" else [0]
        for page in pages:
            names = [s.name for row in layout.page(page) for s in message.signals
                     if s.name in (row.name, f"{row.name}_age", f"{row.name}_quality")]  # fmt: skip
            for _ in range(40):
                values = random_values(message, rng)
                if message.name == "READINGS":
                    values = {n: values[n] for n in ("counter", "tick", *names)} | {"page": page}
                if "layout" in values or message.name == "READINGS":
                    values["layout"] = layout.tag
                data = protected(message, values)
                record = codec.decode(RawFrame(5, message.frame_id, data))
                assert not isinstance(record, Rejected), (message.name, record)
                assert codec.encode(record, 5) == RawFrame(5, message.frame_id, data)
                read = message.decode(data, decode_choices=False)
                del read["crc"]
                assert told(record, layout) == pytest.approx(read, rel=1e-9, abs=1e-9)


def test_every_message_carries_an_example_and_words(layout: WireLayout) -> None:
    codec = CanCodec(layout)
    for message in database(layout).messages:
        example = bytes.fromhex(message.dbc.attributes["ExampleBytes"].value)
        assert message.is_fd
        assert message.length == len(example)
        assert len(example) in PAYLOADS
        assert message.dbc.attributes["CycleTimeUs"].value > 0
        assert all(s.comment for s in message.signals if s.name[-2:] not in {
            f"_{i}" for i in range(1, 10)} and s.name[-3:] not in {"_10", "_11"})  # fmt: skip
        record = codec.decode(RawFrame(0, message.frame_id, example))
        assert not isinstance(record, Rejected)
        assert codec.encode(record).data == example


def test_schema_1_is_the_published_file_byte_for_byte() -> None:
    assert dbc.text(SCHEMA_1) == PUBLISHED.read_text()
    assert dbc.text(WireLayout.of(rig(8, schema=1))) == PUBLISHED.read_text()


@pytest.mark.parametrize("n", range(2, 25))
@pytest.mark.parametrize("rate_hz", [200, 1000, 2000, 5000, 10_000])
def test_a_frame_fits_and_spans_at_most_5_ms(n: int, rate_hz: int) -> None:
    layout = WireLayout.of(rig(n, rate_hz=rate_hz))
    assert layout.samples_payload in PAYLOADS
    assert layout.instants >= 1
    assert layout.instants * layout.period_us <= signals.SPAN_MAX_US
    more = signals.VALUES_MAX - n * layout.instants
    assert more < n or (layout.instants + 1) * layout.period_us > signals.SPAN_MAX_US


def test_a_frame_of_another_layout_is_refused_by_name() -> None:
    ours, theirs = CanCodec(WireLayout.of(rig(9))), CanCodec(LAYOUTS["bench"])
    swapped = WireLayout.of(rig(8))
    swapped = WireLayout(2, swapped.channels[::-1], swapped.readings, swapped.period_us)
    sample = SampleFrame(1, 2, 3, 4, 2, bytes(48))
    frame = theirs.encode(sample)
    assert theirs.decode(frame) == sample
    assert ours.decode(frame) == Rejected("layout", FrameId.SAMPLES_2)
    assert CanCodec(swapped).decode(frame) == Rejected("layout", FrameId.SAMPLES_2)
    assert swapped.hash != LAYOUTS["bench"].hash


def test_what_does_not_fit_the_layout_is_not_sent() -> None:
    nine = CanCodec(LAYOUTS["nine"])
    page = nine.decode(nine.encode(ReadingsFrame(1, 2, 0, (0.0,) * 5, (0,) * 5, (0,) * 5)))
    assert isinstance(page, ReadingsFrame)
    for message, words in (
        (SampleFrame(1, 2, 3, 4, 2, bytes(35)), "samples hold 35 bytes"),
        (SampleFrame(1, 2, 3, 4, 0x80, bytes(36)), "flags 0x80"),
        (msgspec.structs.replace(page, page=9), "page 9: this layout has 1"),
        (msgspec.structs.replace(page, ages_ms=(0,)), "page 0 has 5 readings"),
        (RigStatus(1, 2, 0.0, 0.0, 0.0, 0.0), "wire schema 2 has no RigStatus"),
    ):
        with pytest.raises(ValueError, match=words):
            nine.encode(message)


def test_a_rig_without_readings_has_a_dbc_without_them() -> None:
    layout = WireLayout.of(load(SHIPPED / "kit")[0])
    assert layout.pages == 0
    names = [message.name for message in database(layout).messages]
    assert "SAMPLES" in " ".join(names)
    assert "READINGS" not in names


def test_calibration_does_not_change_the_layout_but_what_crosses_the_wire_does() -> None:
    config, replace = rig(9, 2), msgspec.structs.replace
    hash_ = WireLayout.of(config).hash

    def changed(i: int, **keys: object) -> int:
        rows = list(config.machine.channel)
        rows[i] = replace(rows[i], **keys)
        return WireLayout.of(config.replaced(channel=rows)).hash

    assert changed(0, scale=1.03e-8, offset=1e-6, ok_low=-2e-4) == hash_
    assert changed(0, wire_scale=2e-8) != hash_
    assert changed(8, name="other") != hash_
    assert WireLayout.of(config.replaced(reading=config.machine.reading[:-1])).hash != hash_


def test_either_schema_reads_the_node_info_of_the_other() -> None:
    one, two = CanCodec(), CanCodec(LAYOUTS["nine"])
    info = NodeInfo(1, 2, 2, 200, 50.0, 1.0, 100, 50.0, LAYOUTS["nine"].hash)
    assert one.decode(two.encode(info)) == msgspec.structs.replace(info, layout_hash=0)
    old = NodeInfo(1, 2, 1, 200, 50.0, 1.0, 100, 50.0)
    assert two.decode(one.encode(old)) == old
    mav_one, mav_two = MavCodec(), MavCodec(LAYOUTS["nine"])
    assert mav_one.decode(mav_two.encode(info)) == info
    assert mav_two.decode(mav_one.encode(old)) == old


def test_no_frame_of_one_schema_passes_for_one_of_the_other_where_they_differ() -> None:
    two = CanCodec(LAYOUTS["bench"])
    changed = {FrameId.RIG_STATUS, FrameId.SAMPLES}
    for kind, frame in FRAMES_1.items():
        data = dbc.described(SCHEMA_1)[kind].example
        found = two.decode(CanCodec().encode(data))
        assert isinstance(found, Rejected) == (frame.frame_id in changed), kind


@given(
    name=st.sampled_from(list(LAYOUTS)),
    frame_id=st.sampled_from([*map(int, FrameId), 0]),
    data=st.binary(max_size=70),
)
def test_any_bytes_give_a_record_or_a_rejection(name: str, frame_id: int, data: bytes) -> None:
    result = CanCodec(LAYOUTS[name]).decode(RawFrame(0, frame_id, data))
    assert isinstance(result, Rejected | msgspec.Struct)


CODECS = {name: CanCodec(layout) for name, layout in LAYOUTS.items()}
SHAPES = {
    name: [
        (m.frame_id, m.length, m.dbc.attributes["DataId"].value) for m in database(each).messages
    ]
    for name, each in LAYOUTS.items()
}


@given(name=st.sampled_from(list(LAYOUTS)), data=st.data())
def test_any_protected_payload_gives_a_record_or_a_named_refusal(
    name: str, data: st.DataObject
) -> None:
    frame_id, size, data_id = data.draw(st.sampled_from(SHAPES[name]))
    body = bytearray(data.draw(st.binary(min_size=size - 2, max_size=size - 2)))
    if data.draw(st.booleans()):  # of this layout, so that what follows is read
        body[{FrameId.SAMPLES_2: 13, FrameId.READINGS: 7}.get(frame_id, 13)] = LAYOUTS[name].tag
    codec = CODECS[name]
    payload = protection.protect(bytes(body), protection.seed(data_id))
    result = codec.decode(RawFrame(0, frame_id, payload))
    if isinstance(result, Rejected):
        assert result.reason in ("range", "layout")
    else:
        assert codec.decode(codec.encode(result)) == result


# ---------------------------------------------------------------------- MAVLink

MAV = {name: MavCodec(layout) for name, layout in LAYOUTS.items()}


def test_every_example_crosses_the_serial_line_as_well(layout: WireLayout) -> None:
    codec, framer = MavCodec(layout), mav_packet.Framer()
    for told in dbc.described(layout).values():
        packet = codec.encode(told.example)
        ((message_id, found),) = framer.feed(packet.data, 8)
        assert codec.decode(RawFrame(0, message_id, found)) == told.example
        by_dialect = mav_dialect.MAVLink(None).decode(bytearray(packet.data))
        assert by_dialect.get_msgId() == message_id
        assert by_dialect.counter == told.example.counter
    assert framer.skipped_bytes == 0


def test_the_generated_dialect_reads_samples_and_readings_as_they_are_written() -> None:
    layout = LAYOUTS["twelve"]
    codec, dialect = MavCodec(layout), mav_dialect.MAVLink(None)
    told = {type(each.example): each.example for each in dbc.described(layout).values()}
    samples = dialect.decode(bytearray(codec.encode(told[SampleFrame]).data))
    assert samples.samples[:24] == list(range(100, 124))
    assert (samples.layout, samples.flags) == (layout.tag, 2)
    readings = dialect.decode(bytearray(codec.encode(told[ReadingsFrame]).data))
    assert readings.values == [1000 * (k + 1) for k in range(8)]
    assert readings.ages == [1] * 8
    drive = dialect.decode(bytearray(codec.encode(told[DriveState]).data))
    assert (drive.speed, drive.load, drive.refused_range) == (599_050, 9950, 4)


@given(
    name=st.sampled_from(list(LAYOUTS)),
    message_id=st.sampled_from([*IDS_2.values(), *IDS_1.values()]),
    payload=st.binary(min_size=1, max_size=80),
)
def test_any_packet_gives_a_record_or_a_rejection(
    name: str, message_id: int, payload: bytes
) -> None:
    packet = mav_packet.build(message_id, payload, 1, 2, 158)
    result = MAV[name].decode(RawFrame(0, message_id, packet))
    if not isinstance(result, Rejected) and type(result) in IDS_2:
        assert MAV[name].decode(MAV[name].encode(result)) == result
