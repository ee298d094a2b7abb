"""`orbitd run` with real processes, beside a generator of frames on the project's own bus."""

from __future__ import annotations

import shutil
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from firmware_py import config
from firmware_py.gate import keys
from firmware_py.gate.client import Client
from firmware_py.wire.can_link import CanLink, bus_opener
from tests.monitor.generator import MeasuringNode
from tests.monitor.processes import device, state


class Playing(threading.Thread):
    """Sends what the node has made, in real time."""

    def __init__(self, node: MeasuringNode, channel: str) -> None:
        super().__init__(daemon=True)
        self.node, self.stopped = node, threading.Event()
        self._link = CanLink(bus_opener("orbitd_hub", channel))

    def run(self) -> None:
        begun_ns = time.monotonic_ns()
        while not self.stopped.wait(0.001):
            now_ns = time.monotonic_ns()
            for frame in self.node.frames(now_ns - begun_ns):
                self._link.send(frame)
            self._link.receive(now_ns)
        self._link.close()


@pytest.fixture
def running(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Playing, Client]]:
    monkeypatch.setenv("ORBITD_BUS_DIR", str(tmp_path / "bus"))
    rig = Path(shutil.copytree(config.SHIPPED / "kit", tmp_path / "kit"))
    settings = rig / "device.toml"
    text = settings.read_text().replace("rate_hz = 5000", "rate_hz = 2000")
    settings.write_text(f'{text}\n[recorder]\ndirectory = "{tmp_path / "recorded"}"\n')
    machine = rig / "machine.toml"
    machine.write_text(machine.read_text().replace("max_rpm = 9000.0", "max_rpm = 6000.0"))
    loaded, _ = config.load(rig)
    playing = Playing(MeasuringNode(loaded), loaded.bus.channel)
    playing.start()
    try:
        with device(rig, keys.prefix("lab", "kit"), tmp_path) as client:
            yield playing, client
    finally:
        playing.stopped.set()
        playing.join()


@pytest.mark.slow
def test_the_kit_runs_and_a_fault_at_its_second_bearing_trips(
    running: tuple[Playing, Client],
) -> None:
    playing, client = running
    good = state(client, lambda s: s.guard and s.guard.run_permit and s.diagnosis)
    assert good.guard is not None
    assert good.guard.monitor_only.startswith("no [actuator]")
    assert good.guard.other_peak_to_peak_um["nde"][0] == pytest.approx(18.0, abs=4.0)
    reply = client.ask("arm")
    assert not reply.accepted
    assert reply.reasons[0].startswith("monitor only: no [actuator]")
    seen = state(client, lambda s: s.diagnosis and s.diagnosis.verdict == "uncommissioned")
    assert seen.diagnosis is not None
    assert seen.diagnosis.evidence["nde_1x_um"] == pytest.approx(8.0, rel=0.1)
    playing.node.orbits["nde"].forward_um = 70.0
    tripped = state(client, lambda s: s.guard and s.guard.trip_request)
    assert tripped.guard is not None
    assert {"nde_x_danger", "nde_y_danger"} & {alarm.name for alarm in tripped.alarms}
    assert not any(alarm.name.startswith("disp_") for alarm in tripped.alarms)
