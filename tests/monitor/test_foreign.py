"""Foreign buses: signals of any DBC become channels and readings; what does not fit is named."""

from __future__ import annotations

from math import cos, pi, radians, sin
from pathlib import Path

import cantools.database
import msgspec
import numpy as np
import pytest

from firmware_py import launch
from firmware_py.commands import check
from firmware_py.config import Config, ConfigError
from firmware_py.config.foreign import faults, mapped
from firmware_py.guard import report
from firmware_py.guard.core import GuardCore
from firmware_py.records import Cycle, NodeInfo, RawFrame, ReadingsFrame, SampleFrame
from firmware_py.wire.codec import CanCodec
from firmware_py.wire.foreign_link import ForeignTranslator
from firmware_py.wire.layout import WireLayout
from tests.machine.test_parts import DEVICE, LEAST

DBC = """VERSION ""
NS_ :
BS_:
BU_: LOGGER
BO_ 2566857213 VIB: 8 LOGGER
 SG_ SEQ : 0|8@1+ (1,0) [0|255] "" Vector__XXX
 SG_ X : 8|16@1- (0.02,0) [-600|600] "um" Vector__XXX
 SG_ Y : 24|16@1- (0.02,0) [-600|600] "um" Vector__XXX
 SG_ REV : 40|8@1+ (1,0) [0|255] "" Vector__XXX
 SG_ SINCE : 48|16@1+ (10,0) [0|655350] "us" Vector__XXX
BO_ 801 SLOW: 8 LOGGER
 SG_ PAGE M : 0|8@1+ (1,0) [0|1] "" Vector__XXX
 SG_ OIL m0 : 8|16@1- (0.1,0) [-40|200] "degC" Vector__XXX
 SG_ DRIVE m1 : 8|16@1+ (0.1,0) [0|6000] "kW" Vector__XXX
 SG_ FLOW m1 : 24|16@1+ (0.1,0) [0|6000] "gal" Vector__XXX
"""
ROWS = """
[foreign]
dbc = "plant.dbc"
""" + "".join(
    f'\n[[map]]\nsignal = "{signal}"\nto = "{to}"\n{more}'
    for signal, to, more in (
        ("VIB.X", "disp_x", ""), ("VIB.Y", "disp_y", "polarity = -1\n"), ("VIB.REV", "turns", ""),
        ("VIB.SINCE", "mark_age", ""), ("VIB.SEQ", "counter", ""),
        ("SLOW.OIL", "oil_outlet", ""), ("SLOW.DRIVE", "shaft_power", ""),
    )
)  # fmt: skip
READINGS = '\n[[reading]]\nname = "shaft_power"\n\n[[reading]]\nname = "oil_outlet"\n'
RPM, PERIOD_S = 3000.0, 500e-6


@pytest.fixture
def plant(tmp_path: Path) -> Path:
    folder = tmp_path / "plant"
    folder.mkdir()
    (folder / "machine.toml").write_text(LEAST + READINGS + ROWS)
    (folder / "device.toml").write_text(DEVICE)
    (folder / "plant.dbc").write_text(DBC)
    return folder


class Plant:
    """Sends the foreign bus: an orbit of 10 um about (-20, -40) um, y with the other sign."""

    def __init__(self) -> None:
        self.database = cantools.database.load_string(DBC, "dbc")
        self.sample, self.radius_um = 0, 10.0
        self.random = np.random.default_rng(2)

    def frame(self) -> list[RawFrame]:
        turned = self.sample * PERIOD_S * RPM / 60.0
        a = 2 * pi * turned
        x, y = -20 + self.radius_um * cos(a), -40 + self.radius_um * sin(a)
        probes = [x * cos(radians(d)) + y * sin(radians(d)) for d in (45, 135)]
        noise = 0.1 * self.random.standard_normal(2)
        since_us = (turned % 1.0) * 60e6 / RPM
        vib = self.database.encode_message("VIB", {
            "SEQ": self.sample % 256, "X": probes[0] + noise[0], "Y": -probes[1] + noise[1],
            "REV": int(turned) % 256, "SINCE": round(since_us / 10) * 10,
        })  # fmt: skip
        at_ns = round(self.sample * PERIOD_S * 1e9)
        out = [RawFrame(at_ns, 2566857213 | 1 << 31, vib)]
        if self.sample % 100 == 0:
            pages = {"PAGE": 0, "OIL": 47.5}, {"PAGE": 1, "DRIVE": 1.5, "FLOW": 0}
            slow = [self.database.encode_message("SLOW", page) for page in pages]
            out += [RawFrame(at_ns, 801, data) for data in slow]
        self.sample += 1
        return out


def translated(
    config: Config, folder: Path, samples: int, lost: range = range(0)
) -> list[RawFrame]:
    plant, translator = Plant(), ForeignTranslator(config, mapped(config, folder))
    return [
        made
        for i in range(samples)
        for frame in plant.frame()
        if i not in lost
        for made in translator.step(frame)
    ]


def test_signals_become_samples_marks_and_readings(plant: Path) -> None:
    config, _ = launch.verified(plant)
    codec = CanCodec(WireLayout.of(config))
    told = [codec.decode(frame) for frame in translated(config, plant, 400)]
    samples = [m for m in told if isinstance(m, SampleFrame)]
    assert [m.counter for m in samples] == list(range(40))
    assert [m.tick_us for m in samples[:3]] == [0, 5000, 10_000]
    counts = np.frombuffer(b"".join(m.samples for m in samples), "<i2").reshape(-1, 2)
    mean_um = counts.mean(axis=0) * 0.01
    assert mean_um == pytest.approx([(-20 - 40) / 2**0.5, (20 - 40) / 2**0.5], abs=0.5)
    assert np.diff([m.turn_count for m in samples]).sum() == 9
    assert samples[-1].mark_tick_us == pytest.approx(180_000, abs=600)
    readings = [m for m in told if isinstance(m, ReadingsFrame)][-1]
    assert readings.values == pytest.approx((1500.0, 47.5))
    assert readings.qualities == (0, 0)
    assert any(isinstance(m, NodeInfo) for m in told)


def test_the_guard_protects_on_a_foreign_bus(plant: Path) -> None:
    config, _ = launch.verified(plant)
    guard = GuardCore(config, CanCodec(WireLayout.of(config)), 1)
    for i, frame in enumerate(translated(config, plant, 8000)):
        now_ns = frame.arrival_ns + 200_000
        decision = guard.step(Cycle(i, now_ns, [frame], None, [], False, False, True))
    assert decision is not None
    state = report.guard_state(guard.stages, now_ns)
    assert state.speed_rad_s == pytest.approx(RPM * pi / 30, rel=1e-2)
    assert state.peak_to_peak_um == pytest.approx((20.5, 20.5), abs=1.0)
    assert [alarm.name for alarm in state.alarms] == []
    assert state.run_permit
    assert "a bus that knows nothing of orbitd" in state.monitor_only


def test_what_the_counter_leaves_out_is_a_gap(plant: Path) -> None:
    config, _ = launch.verified(plant)
    codec = CanCodec(WireLayout.of(config))
    frames = translated(config, plant, 400, lost=range(200, 215))
    ticks = [m.tick_us for m in map(codec.decode, frames) if isinstance(m, SampleFrame)]
    assert set(np.diff(ticks).tolist()) == {5000, 5000 + 15 * 500}


def test_frames_of_others_and_broken_ones_are_counted(plant: Path) -> None:
    config, _ = launch.verified(plant)
    translator = ForeignTranslator(config, mapped(config, plant))
    assert translator.step(RawFrame(0, 5, b"")) == []
    assert translator.step(RawFrame(0, 801, b"\x07")) == []
    assert translator.counters["foreign_unknown"] == 1
    assert translator.counters["foreign_refused"] == 1


@pytest.mark.parametrize(("file", "old", "new", "words"), [
    ("plant.dbc", "BO_ 801 SLOW", "BO_ 801 OTHER", "no message SLOW in the DBC, it has OTHER, VIB"),
    ("machine.toml", "VIB.X", "VIB.Z", "no signal Z in VIB, it has REV, SEQ, SINCE, X, Y"),
    ("machine.toml", "SLOW.OIL", "SLOW.FLOW", "unit 'gal', oil_outlet takes one of degC"),
    ("machine.toml", 'to = "oil_outlet"', 'to = "oil"', "none of counter, disp_x"),
    ("machine.toml", 'to = "disp_y"', 'to = "disp_x"', "mapped twice"),
    ("machine.toml", 'to = "turns"', 'to = "counter"', "nothing gives the once-per-turn mark"),
    ("machine.toml", 'dbc = "plant.dbc"', 'dbc = "other.dbc"', "copy the DBC into it"),
    ("plant.dbc", "BU_: LOGGER", "BU_ LOGGER {", "no DBC ("),
    ("device.toml", "schema = 2", "schema = 1", "must be exactly disp_x, disp_y"),
    ("device.toml", "schema = 2", 'schema = 2\nlink = "serial"\nserial_port = "/dev/x"',
     'a foreign bus is a CAN bus with a DBC; set bus.link = "can"'),
])  # fmt: skip
def test_what_does_not_fit_is_named(plant: Path, file: str, old: str, new: str, words: str) -> None:
    path = plant / file
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(ConfigError) as refusal:
        launch.verified(plant)
    assert words in str(refusal.value)


def test_all_that_does_not_fit_is_named_at_once(plant: Path) -> None:
    path = plant / "machine.toml"
    path.write_text(path.read_text().replace("VIB.X", "VIB.Z").replace("SLOW.OIL", "SLOW.FLOW"))
    with pytest.raises(ConfigError) as refusal:
        launch.verified(plant)
    assert len(refusal.value.faults) == 2


def test_a_dbc_in_the_text_of_windows_is_read(plant: Path) -> None:
    text = DBC.replace('"degC"', '"°C"').replace('"um"', '"µm"')
    (plant / "plant.dbc").write_bytes(text.encode("cp1252"))
    launch.verified(plant)
    (plant / "plant.dbc").write_text(text, encoding="utf-8")
    launch.verified(plant)


def test_check_says_that_the_device_only_listens(
    plant: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert check.main([str(plant)]) == 0
    assert "monitor only: [foreign]: on a bus that knows nothing" in capsys.readouterr().out


def test_rows_without_a_bus_and_a_bus_under_schema_1_are_named(plant: Path) -> None:
    config, _ = launch.verified(plant)
    first = msgspec.structs.replace(config.bus, schema=1)
    found = [key for key, _, _ in faults(config.replaced(bus=first), plant)]
    assert "bus.schema" in found
    (fault,) = faults(config.replaced(foreign=None), plant)
    assert "there is no [foreign] bus to map" in fault[2]
    assert list(faults(config.replaced(foreign=None, map=[]), plant)) == []
