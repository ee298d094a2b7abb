"""The rig as a real process on a real bus, driven through its console."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from sim_hil.console import ConsoleError, ask

START_WITHIN_S = 60.0


@pytest.mark.slow
def test_process_serves_bus_and_console_and_ends_when_asked(tmp_path: Path) -> None:
    environment = os.environ | {"ORBITD_BUS_DIR": str(tmp_path / "bus")}
    command = [sys.executable, "-m", "sim_hil.server", "--seed", "2", "--runtime-dir", str(tmp_path)]
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert any("ready" in line for line in process.stdout)  # the film's domain comes first
            ask(tmp_path, {"verb": "inject", "fault": "unbalance", "severity": 16})
            deadline = time.monotonic() + START_WITHIN_S
            while not ask(tmp_path, {"verb": "truth", "after_ns": 0})["truth"] and time.monotonic() < deadline:
                time.sleep(0.05)
            assert ask(tmp_path, {"verb": "truth", "after_ns": 0})["truth"][0]["speed_rad_s"] > 600
            ask(tmp_path, {"verb": "quit"})
            assert process.wait(timeout=20) == 0
        finally:
            process.kill()
    with pytest.raises(ConsoleError):
        ask(tmp_path, {"verb": "status"})
