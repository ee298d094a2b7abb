"""The rig as a real process on a real bus, driven through its console."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from firmware_py.config import SHIPPED, load
from firmware_py.records import DeviceHeartbeat
from sim_hil import server
from sim_hil.console import ConsoleError, ask

START_WITHIN_S = 60.0


@pytest.mark.slow
def test_process_serves_bus_and_console_and_ends_when_asked(tmp_path: Path) -> None:
    environment = os.environ | {"ORBITD_BUS_DIR": str(tmp_path / "bus")}
    command = [
        sys.executable,
        "-m",
        "sim_hil.server",
        "--seed",
        "2",
        "--runtime-dir",
        str(tmp_path),
    ]
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert any("ready" in line for line in process.stdout)  # the film's domain comes first
            ask(tmp_path, {"verb": "inject", "fault": "unbalance", "severity": 16})
            deadline = time.monotonic() + START_WITHIN_S
            while (
                not ask(tmp_path, {"verb": "truth", "after_ns": 0})["truth"]
                and time.monotonic() < deadline
            ):
                time.sleep(0.05)
            assert ask(tmp_path, {"verb": "truth", "after_ns": 0})["truth"][0]["speed_rad_s"] > 600
            ask(tmp_path, {"verb": "quit"})
            assert process.wait(timeout=20) == 0
        finally:
            process.kill()
    with pytest.raises(ConsoleError):
        ask(tmp_path, {"verb": "status"})


@pytest.mark.parametrize("text", ["0", "0.49", "5.01", "nan", "inf", "-3", "soon", ""])
def test_a_heartbeat_limit_out_of_bounds_is_refused_by_name(
    text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        server.main([f"--heartbeat-limit={text}"])
    assert "not a number of seconds from 0.5 to 5" in capsys.readouterr().err


@pytest.mark.parametrize("limit_s", [0.5, 5.0])
def test_the_rig_hands_its_heartbeat_limit_to_the_drive(limit_s: float) -> None:
    rig = server.make_rig(
        load(SHIPPED / "bench")[0], "bench", 1, nominal=True, heartbeat_limit_s=limit_s
    )
    rig.drive.hear(DeviceHeartbeat(1, 7, 0, 0, True, False), 0)
    rig.drive.watch(round(limit_s * 1e6))
    assert not rig.drive.coasting
    rig.drive.watch(round(limit_s * 1e6) + 1)
    assert rig.drive.coasting
