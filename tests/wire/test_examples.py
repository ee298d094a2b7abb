"""The example programs against each other on a real bus, as real processes that know the DBC
alone."""

from __future__ import annotations

import ast
import json
import re
import signal
import struct
import subprocess
import sys
import time
import zlib
from pathlib import Path

import pytest

from firmware_py.records import RawFrame
from firmware_py.wire import dbc
from firmware_py.wire.codec import CanCodec, frames
from firmware_py.wire.hub_connect import DIRECTORY_VARIABLE
from firmware_py.wire.layout import SCHEMA_1, WireLayout

from .layouts import rig

DEPLOY = Path(__file__).resolve().parents[2] / "deploy"
EXAMPLES = DEPLOY / "examples"


@pytest.fixture(autouse=True)
def directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(DIRECTORY_VARIABLE, str(tmp_path))


def start(program: str, *options: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, str(EXAMPLES / program), *options], stdout=subprocess.PIPE, text=True
    )


def result(process: subprocess.Popen[str]) -> dict[str, object]:
    output, _ = process.communicate(timeout=60)
    assert process.returncode == 0
    return json.loads(output)


@pytest.mark.timing
def test_rig_and_device_that_know_only_the_dbc_work_together() -> None:
    rig = start("play_rig.py", "--seconds", "60")
    seen = result(
        start("play_device.py", "--seconds", "2", "--clearance", "62.5", "--pressure", "1.5")
    )
    time.sleep(4)  # longer than any expiry: command 0.1 s, heartbeat 3 s
    rig.send_signal(signal.SIGINT)
    played = result(rig)
    assert seen["instants"] > 2000
    assert seen["speed_rpm"] == pytest.approx(3000, rel=1e-3)
    assert seen["states_following"] > seen["states"] / 2
    assert 52 < seen["status"]["clearance_actual"] <= 62.5
    assert seen["peak_to_peak_um"] == pytest.approx(
        0.2 * seen["status"]["clearance_actual"], rel=0.1
    )
    assert seen["info"]["boot_clearance"] == 50.0
    assert {k for k, n in {**seen["bus"], **played["bus"]}.items() if n} <= {"frames"}
    # The device has left: its last command expired, and so did its heartbeat.
    assert played["obeyed"] > 50
    assert played["mode"] == 0
    assert played["coasting"] is True
    assert played["actual"]["clearance"] == pytest.approx(50.0)


def test_the_echo_client_answers_every_ping() -> None:
    pong = start("echo_client.py", "pong")
    try:
        seen = result(start("echo_client.py", "ping", "orbitd0", "5"))
        while seen["answered"] < 5:  # pong was still starting
            seen = result(start("echo_client.py", "ping", "orbitd0", "5"))
    finally:
        pong.kill()
        pong.communicate()
    assert 0 < seen["p50"] <= seen["p99"] <= seen["max"]


@pytest.mark.parametrize("program", sorted(p.name for p in EXAMPLES.glob("*.py")))
def test_the_examples_import_nothing_of_the_project(program: str) -> None:
    tree = ast.parse((EXAMPLES / program).read_text())
    modules = {
        alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.Import)
        for alias in node.names
    }
    modules |= {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert not {m.partition(".")[0] for m in modules if m} & {"firmware_py", "sim_hil", "models"}


def test_the_worked_example_of_the_node_specification_is_right() -> None:
    (line,) = re.findall(
        r"^ +frame 0x060 +([0-9A-F ]+)$", (DEPLOY / "NODE.md").read_text(), re.MULTILINE
    )
    command = CanCodec().decode(RawFrame(0, 0x060, bytes.fromhex(line)))
    assert (command.counter, command.session, command.echo_tick_us) == (258, 0x1234ABCD, 5_000_000)
    assert (command.clearance_um, command.pressure_bar) == (62.5, 1.5)


# ---------------------------------------------------------------------- wire schema 2


def worked(frame_id: str) -> bytes:
    (line,) = re.findall(
        rf"^ +frame {frame_id} +([0-9A-F ]+)$", (DEPLOY / "NODE.md").read_text(), re.MULTILINE
    )
    return bytes.fromhex(line)


def test_the_worked_examples_of_schema_2_are_right() -> None:
    layout = WireLayout.of(rig(2, rate_hz=1000))
    page = (DEPLOY / "NODE.md").read_text()
    assert "".join(f"    {line}\n" for line in layout.text.splitlines()) in page
    assert f"layout_hash             0x{zlib.crc32(layout.text.encode()):08X}" in page
    codec = CanCodec(layout)
    readings = codec.decode(RawFrame(0, 0x0B8, worked("0x0B8")))
    assert (readings.counter, readings.tick_us, readings.page) == (9, 5_000_000, 0)
    assert readings.values == pytest.approx((10.0, 20.0, 30.0, 4.0))
    assert (set(readings.ages_ms), set(readings.qualities)) == ({10}, {0})
    samples = codec.decode(RawFrame(0, 0x0C8, worked("0x0C8")))
    assert (samples.counter, samples.mark_tick_us, samples.turn_count) == (4096, 4_998_765, 321)
    assert struct.unpack("<10h", samples.samples) == tuple(range(100, 110))
    assert len(worked("0x0C8")) == layout.samples_payload == 48


def test_the_table_of_messages_is_that_of_the_codec() -> None:
    rows = re.findall(
        r"^\| (0x0\w\w) \| (\w+) .*\| ([^|]+) \| [^|]+ \| (0x4F\w\w) \| ([12, ]+) \|$",
        (DEPLOY / "NODE.md").read_text(),
        re.MULTILINE,
    )
    for schema, layout in ((1, SCHEMA_1), (2, WireLayout.of(rig(8)))):
        told = dbc.described(layout)
        known = {
            (f"0x{frame.frame_id:03X}", told[kind].name, f"0x{frame.data_id:04X}")
            for kind, frame in frames(layout).items()
        }
        page = {(i, name, data) for i, name, _, data, said in rows if str(schema) in said}
        assert page == known


@pytest.mark.timing
def test_rig_and_device_play_with_the_dbc_of_a_rig_of_nine_channels(tmp_path: Path) -> None:
    path = tmp_path / "nine.dbc"
    path.write_text(dbc.text(WireLayout.of(rig(9, 6))))
    player = start("play_rig.py", "--seconds", "60", "--dbc", str(path))
    seen = result(
        start("play_device.py", "--seconds", "2", "--clearance", "62.5", "--dbc", str(path))
    )
    player.send_signal(signal.SIGINT)
    played = result(player)
    assert seen["instants"] > 2000
    assert seen["states_following"] > seen["states"] / 2
    assert seen["info"]["schema"] == 2
    assert 50 < seen["status"]["clearance_actual"] <= 62.5
    assert seen["status"]["more_0_quality"] == 3
    assert {k for k, n in {**seen["bus"], **played["bus"]}.items() if n} <= {"frames"}
    assert played["obeyed"] > 50
