"""`orbitd run` on a bus that knows nothing of orbitd: classic CAN frames of somebody's logger, sent
by python-can alone, described by a DBC in the rig folder."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import can
import pytest

from firmware_py import config
from firmware_py.config.foreign import EXTENDED_ID
from firmware_py.gate import keys
from tests.monitor.processes import device, state
from tests.monitor.test_foreign import PERIOD_S, Plant
from tests.monitor.test_foreign import plant as plant  # the folder of the foreign machine


class Logger(threading.Thread):
    """Somebody's logger, in real time; ``received`` counts what anybody else put on its bus."""

    def __init__(self, channel: str) -> None:
        super().__init__(daemon=True)
        self.plant, self.stopped, self.received = Plant(), threading.Event(), 0
        self._bus = can.Bus(interface="orbitd_hub", channel=channel)

    def run(self) -> None:
        begun_s = time.monotonic()
        while not self.stopped.wait(0.001):
            while self.plant.sample * PERIOD_S < time.monotonic() - begun_s:
                for frame in self.plant.frame():
                    self._bus.send(
                        can.Message(
                            arbitration_id=frame.frame_id & ~EXTENDED_ID,
                            is_extended_id=bool(frame.frame_id & EXTENDED_ID),
                            data=frame.data,
                        )
                    )
            while self._bus.recv(0) is not None:
                self.received += 1
        self._bus.shutdown()


@pytest.mark.slow
def test_a_foreign_bus_is_watched_and_never_spoken_on(
    plant: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ORBITD_BUS_DIR", str(tmp_path / "bus"))
    settings = plant / "device.toml"
    settings.write_text(
        f'{settings.read_text()}\n[recorder]\ndirectory = "{tmp_path / "recorded"}"\n'
    )
    logger = Logger(config.load(plant)[0].bus.channel)
    logger.start()
    try:
        with device(plant, keys.prefix("lab", "least"), tmp_path) as client:
            good = state(client, lambda s: s.guard and s.guard.run_permit and s.diagnosis)
            assert good.guard is not None
            assert "a bus that knows nothing of orbitd" in good.guard.monitor_only
            assert good.guard.peak_to_peak_um == pytest.approx((20.5, 20.5), abs=1.5)
            assert good.guard.speed_rad_s == pytest.approx(314.16, rel=1e-2)
            logger.plant.radius_um = 60.0
            tripped = state(client, lambda s: s.guard and s.guard.trip_request)
            assert {"disp_x_danger", "disp_y_danger"} & {alarm.name for alarm in tripped.alarms}
    finally:
        logger.stopped.set()
        logger.join()
    assert logger.received == 0, "nothing is sent on a bus that was made for others"
