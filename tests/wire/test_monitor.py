"""The bus monitor: tallies on frames by hand, and the whole of it on a live bus."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from firmware_py.config import SHIPPED, load, parse
from firmware_py.records import Command, DeviceHeartbeat, RawFrame, SampleFrame
from firmware_py.wire.codec import CanCodec
from firmware_py.wire.hub_connect import DIRECTORY_VARIABLE
from firmware_py.wire.monitor import Monitor, NoBusError, dump, monitor, wire_seconds
from tests.first_schema import BENCH

ROOT = Path(__file__).resolve().parents[2]
CONFIG, _ = load(SHIPPED / "bench")
CODEC = CanCodec()


@pytest.fixture(autouse=True)
def directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(DIRECTORY_VARIABLE, str(tmp_path))


def commands(*counters: int) -> list[RawFrame]:
    return [CODEC.encode(Command(counter, 1, 2, 50.0, 1.0)) for counter in counters]


def test_losses_repeats_and_rejects_are_counted_apart() -> None:
    seen = Monitor(CONFIG, CODEC)
    seen.take(commands(65534, 65535, 2, 2, 1, 3))
    seen.take([RawFrame(0, 0x060, bytes(24)), RawFrame(0, 0x700, b"")])
    report = seen.report(2.0)
    (message,) = report["messages"]
    assert message["name"] == "Command"
    assert (message["frames"], message["lost"], message["not_newer"]) == (6, 2, 2)
    assert message["per_s"] == 3.0
    assert message["last"]["counter"] == 3
    assert report["rejected"] == {"crc": 1, "unknown_id": 1}


def test_messages_stand_in_the_order_of_their_identifiers() -> None:
    seen = Monitor(CONFIG, CODEC)
    seen.take(
        [
            CODEC.encode(SampleFrame(0, 0, 0, 0, 0, b"\xe2\x04" + bytes(46))),
            CODEC.encode(DeviceHeartbeat(0, 1, 0, 0, False, False)),
        ]
    )
    report = seen.report(1.0)
    assert [m["id"] for m in report["messages"]] == [0x050, 0x0C0]
    assert report["messages"][1]["last"]["disp_x"] == pytest.approx(12.5e-6)


def test_the_load_of_a_full_sample_frame_is_that_of_the_standard() -> None:
    """64 data bytes at 1/5 Mbit/s: 30 us of arbitration, (5 + 512 + 32) / 5 us of data."""
    assert wire_seconds(CONFIG.bus, 64) == pytest.approx(30e-6 + 549 / 5e6)


@pytest.mark.parametrize("watch", [monitor, dump])
def test_a_live_bus_is_shown(watch: object, capsys: pytest.CaptureFixture[str]) -> None:
    rig = subprocess.Popen(
        [sys.executable, str(ROOT / "deploy" / "examples" / "play_rig.py"), "--seconds", "60"],
        stdout=subprocess.DEVNULL,
    )
    try:
        while watch(CONFIG, 1.0, True) == 3:  # type: ignore[operator]
            capsys.readouterr()  # the rig was still starting
    finally:
        rig.kill()
        rig.wait()
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    if watch is monitor:
        (report,) = lines
        names = {m["name"]: m for m in report["messages"]}
        assert names["SampleFrame"]["lost"] == 0
        assert names["SampleFrame"]["frames"] > 0
        assert 0 < report["bus_load"] < 1
    else:
        assert {"SampleFrame", "RigStatus"} <= {line["name"] for line in lines}


def test_the_table_is_printed_for_people(capsys: pytest.CaptureFixture[str]) -> None:
    assert monitor(CONFIG, 0.05, as_json=False) == 3
    assert "bus load" in capsys.readouterr().out


def test_an_absent_bus_is_a_named_error() -> None:
    text = BENCH.replace('interface = "orbitd_hub"', 'interface = "socketcan"')
    config, _ = parse(text.replace('channel = "orbitd0"', 'channel = "orbitd-none"'))
    with pytest.raises(NoBusError, match=r"\[bus\]"):
        monitor(config, 0.1, as_json=True)
