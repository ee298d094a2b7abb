"""The table of signals: what follows from it, and what is held against it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

import msgspec
import pytest

import firmware_py
from firmware_py import config, recording, records, signals
from firmware_py.acquire import channel_map, plausible
from firmware_py.config.instances import slow_signals
from firmware_py.gate import keys
from firmware_py.gate.instances import Instances
from firmware_py.gate.metrics import _readings
from firmware_py.guard.core import GuardCore
from firmware_py.machine import FastChannel, SlowChannel
from firmware_py.records import (
    EventAck,
    Hello,
    NodeState,
    RigReading,
    RigStatus,
    SlowValue,
)
from firmware_py.wire import dbc
from firmware_py.wire.layout import WireLayout
from firmware_py.wire.link import codec_for
from sim_hil.sensors.chain import SCALES
from tests.wire.layouts import rig

PACKAGE = Path(firmware_py.__file__).parent
TRANSIENT = {EventAck, Hello}
"""Records between processes that leave the device nowhere."""


def test_every_record_that_leaves_the_device_has_a_row() -> None:
    rows = {row.record for row in signals.STREAMS}
    crossing = {kind.__name__ for kind in get_args(records.PeerRecord) if kind not in TRANSIENT}
    assert rows == crossing | {"WallClock"}
    assert {kind.__name__: topic.name for kind, topic in recording.TOPICS.items()} == {
        row.record: row.topic for row in signals.STREAMS
    }
    assert len({row.topic for row in signals.STREAMS}) == len(signals.STREAMS)


def test_the_page_of_keys_names_every_published_record() -> None:
    for kind, key in keys.PUBLISHED.items():
        assert re.search(rf"^{key} +``{kind.__name__}``", keys.__doc__ or "", re.MULTILINE), key
    published = {row.record for row in signals.STREAMS if row.published}
    assert {kind.__name__ for kind in keys.PUBLISHED} == published


def test_the_status_of_schema_1_has_the_standard_readings() -> None:
    fields = [name for name in RigStatus.__struct_fields__ if name not in ("counter", "tick_us")]
    assert fields == [f"{row.name}_{signals.SLOW[row.kind].suffix}" for row in signals.READINGS]


def test_what_stages_use_of_the_standard_channels_is_of_their_kinds() -> None:
    kinds = [signals.FAST[row.kind] for row in signals.CHANNELS]
    assert tuple(row.name for row in signals.CHANNELS) == records.CHANNELS
    scales = tuple(kind.wire_scale for kind in kinds)
    assert channel_map.WIRE_SCALES == scales == tuple(SCALES.tolist())
    assert tuple(kind.mains_si for kind in kinds) == plausible.MAINS_SI
    assert scales == (1e-8, 1e-8, 1e-2, 1e-2, 1e-2, 1e-3, 1e-3, 1e-4)  # of orbitd.dbc


def test_the_dialect_of_schema_1_tells_the_scales_of_the_kinds() -> None:
    text = " ".join((PACKAGE / "wire" / "orbitd.xml").read_text().split())
    (told,) = re.findall(r"Per count: (.*?)</description>", text)
    for row in signals.CHANNELS:
        kind = signals.FAST[row.kind]
        assert f"{kind.wire_scale * kind.wire_per_si:.4g} {kind.wire_unit}" in told


@pytest.mark.parametrize("kind", signals.FAST.values(), ids=lambda kind: kind.name)
def test_a_fast_kind_can_be_configured(kind: signals.FastKind) -> None:
    reach = 30_000 * kind.wire_scale
    assert 0.0 < kind.wire_scale <= 1.0
    assert kind.words
    assert kind.not_ok
    channel = FastChannel("new", kind.unit, kind.wire_scale, -reach, reach, kind=kind.name)
    assert checked(rig(8), channel=channel) == []


@pytest.mark.parametrize("kind", signals.SLOW.values(), ids=lambda kind: kind.name)
def test_a_slow_kind_fits_its_field_and_names_a_metric(kind: signals.SlowKind) -> None:
    for end in (kind.least, kind.greatest):
        assert abs(end / kind.resolution) < 2**31
    assert re.fullmatch(r"[A-Za-z_]+", kind.suffix)
    assert checked(rig(8), reading=SlowChannel("new", kind.name)) == []


def checked(base: config.Config, **rows: FastChannel | SlowChannel) -> list[str]:
    """What `check` says of ``base`` with one more channel or reading."""
    tables = msgspec.to_builtins(base)
    standard = [msgspec.to_builtins(SlowChannel(row.name)) for row in signals.READINGS]
    tables["machine"]["reading"] = tables["machine"]["reading"] or standard
    for name, row in rows.items():
        tables["machine"][name].append(msgspec.to_builtins(row))
    try:
        config.decode(msgspec.json.encode(tables), Path("rig.json"))
    except config.ConfigError as error:
        return [str(fault) for fault in error.faults]
    return []


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ({"channel": FastChannel("new", "m", 1e-8, -1e-4, 1e-4)}, "no kind of fast channel"),
        ({"channel": FastChannel("new", "V", 1e-8, -1e-4, 1e-4, kind="force")}, "write N"),
        ({"channel": FastChannel("disp_x", "m", 1e-8, -1e-4, 1e-4)}, "named twice"),
        ({"reading": SlowChannel("new", "colour")}, "no kind of slow reading"),
        ({"reading": SlowChannel("shaft_power")}, "named twice"),
        ({"reading": SlowChannel("new", "flow", 2.0, 1.0)}, "not below ok_high"),
    ],
)
def test_an_instance_that_cannot_be_is_refused_by_name(
    rows: dict[str, FastChannel | SlowChannel], words: str
) -> None:
    assert any(words in fault for fault in checked(rig(8), **rows))


def test_schema_1_takes_no_instance_of_its_own() -> None:
    said = checked(rig(8, schema=1), channel=FastChannel("n", "V", 1e-4, -1.0, 1.0, kind="voltage"))
    assert any("set bus.schema = 2" in fault for fault in said)


def test_a_new_kind_is_one_row(monkeypatch: pytest.MonkeyPatch) -> None:
    """Range, alarm, metric, page label, recording and DBC follow from it."""
    humidity = signals.SlowKind("humidity", "%RH", "percent", 0.1, 0.0, 100.0, "humidity")
    strain = signals.FastKind("strain", "um/m", "um/m", 1.0, 0.1, "strain", "alarm")
    monkeypatch.setitem(signals.SLOW, "humidity", humidity)
    monkeypatch.setitem(signals.FAST, "strain", strain)
    base = rig(8, 1)
    gauge = FastChannel("gauge", "um/m", 0.1, -3000.0, 3000.0, kind="strain")
    hall = SlowChannel("hall_humidity", "humidity", words="Humidity of the hall")
    assert checked(base, channel=gauge, reading=hall) == []
    made = base.replaced(
        channel=[*base.machine.channel, gauge], reading=[*base.machine.reading, hall]
    )
    text = dbc.text(WireLayout.of(made))
    assert '(0.1,0) [-3276.8|3276.7] "um/m"' in text
    assert "Humidity of the hall" in text
    guard = GuardCore(made, codec_for(made), 1)
    assert {"gauge"} <= set(guard.stages.protection.state.not_ok)
    node = NodeState(1, 2, 0, 0, 0, 50.0, 1.0, True, 0, 0, 0, 0)
    values = {
        row.name: SlowValue(140.0 if row.name == "hall_humidity" else 1.0, 0, 0)
        for row in slow_signals(made)
    }
    reading = RigReading(0, 0, 0, RigStatus(1, 2, 1.0, 40.0, 50.0, 1.0), node, values)
    notices = guard.stages.more.step([reading], 5)
    assert [notice.name for notice in notices] == ["hall_humidity_not_ok"]
    assert "outside 0 .. 100" in notices[0].text
    shown = Instances(made).readings(reading)
    assert (shown[-1].words, shown[-1].unit, shown[-1].ok) == ("Humidity of the hall", "%RH", False)
    names = {metric.name for metric in _readings(shown)}
    assert "orbitd_reading_humidity_percent" in names
    stored = recording.serialise(reading)
    assert msgspec.json.decode(stored, type=RigReading).values["hall_humidity"].value == 140.0
