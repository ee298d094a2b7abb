"""The simulator takes every figure from the rig folder."""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterator
from dataclasses import replace
from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest
from msgspec import inspect

from firmware_py import config
from firmware_py.config.simulation import load_simulation
from firmware_py.machine.simulation import Simulation
from sim_hil.plant.build import Build
from sim_hil.rigs import NotSimulated, load_rig
from sim_hil.rotor.assembly import assemble
from sim_hil.sensors.chain import SensorChain

MICROPHONE = 5
BENCH = config.SHIPPED / "bench"


def copied(folder: Path, machine: dict[str, str], simulation: dict[str, str]) -> Path:
    """The rig folder of the bench with texts of its files replaced."""
    shutil.copytree(BENCH, folder)
    for name, changes in (("machine.toml", machine), ("simulation.toml", simulation)):
        text = (folder / name).read_text()
        for old, new in changes.items():
            assert old in text
            text = text.replace(old, new, 1)
        (folder / name).write_text(text)
    return folder


def test_a_copy_of_a_shipped_folder_is_the_same_rig(tmp_path: Path) -> None:
    assert load_rig(copied(tmp_path / "bench", {}, {})) == load_rig("bench")


@pytest.mark.parametrize(
    ("old", "new", "figure", "expected"),
    [
        ("journal_radius_m = 0.02", "journal_radius_m = 0.021", "bearing.radius_m", 0.021),
        (
            "viscosity_at_40C_Pa_s = 0.01",
            "viscosity_at_40C_Pa_s = 0.02",
            "oil.viscosity_Pa_s",
            0.02,
        ),
        ("viscosity_slope_per_K = 0.03", "viscosity_slope_per_K = 0.025", "oil.slope_per_K", 0.025),
        (
            "thermal_capacity_J_K = 250.0",
            "thermal_capacity_J_K = 99.0",
            "thermal.capacity_J_K",
            99.0,
        ),
        (
            "jacket_flow_m3_s = 3.333e-5",
            "jacket_flow_m3_s = 1e-5",
            "thermal.jacket_flow_m3_s",
            1e-5,
        ),
        ("pressure_nominal_bar = 1.0", "pressure_nominal_bar = 1.1", "supply.nominal_Pa", 110000.0),
        (
            "groove_angle_deg = 90.0",
            "groove_angle_deg = 80.0",
            "supply.groove.angle_rad",
            math.radians(80.0),
        ),
        (
            "groove_width_deg = 20.0",
            "groove_width_deg = 30.0",
            "supply.groove.width_rad",
            math.radians(30.0),
        ),
        (
            "groove_length_share = 0.8",
            "groove_length_share = 0.7",
            "supply.groove.length_share",
            0.7,
        ),
        ("# pump_efficiency = 0.6", "pump_efficiency = 0.5", "supply.pump_efficiency", 0.5),
        ("# backlash_um = 1.0", "backlash_um = 0.3", "actuator.backlash_m", 3e-7),
        (
            "# position_noise_um = 0.2",
            "position_noise_um = 0.7",
            "actuator.position_noise_rms_m",
            7e-7,
        ),
        ("rate_um_s = 50.0", "rate_um_s = 49.0", "actuator.rate_m_per_s", 4.9e-5),
        ("shaft_power_error_W = 5.0", "shaft_power_error_W = 4.0", "errors.shaft_power_W", 4.0),
        ("circuit_ohm = 100e3", "circuit_ohm = 90e3", "contact.circuit_ohm", 90e3),
        ("windage_W_s3 = 5e-9", "windage_W_s3 = 6e-9", "windage_W_s3", 6e-9),
    ],
)
def test_the_simulated_rig_follows_machine_toml(
    tmp_path: Path, old: str, new: str, figure: str, expected: float
) -> None:
    rig = load_rig(copied(tmp_path / "bench", {old: new}, {}))
    assert attrgetter(figure)(rig) == expected != attrgetter(figure)(load_rig("bench"))


def test_what_the_simulator_plays_may_differ_from_what_the_device_is_told() -> None:
    rig, told = load_rig("seed"), config.read_machine("seed")
    assert rig.oil.viscosity_at(20.0) == pytest.approx(1e-3, rel=1e-12)
    assert rig.windage_W_s3 == 5e-9 != told.rotor.windage_W_s3
    assert rig.load_max_N == 50.0 != told.operating.load_max_N


def test_a_rig_folder_without_a_simulation_is_simulated_as_its_machine(tmp_path: Path) -> None:
    folder = copied(tmp_path / "bench", {}, {})
    (folder / "simulation.toml").unlink()
    rig = load_rig(folder)
    assert rig.oil.inlet_C == 38.5
    assert rig.thermal == load_rig("bench").thermal
    assert (rig.start_rpm, rig.start_load_N) == (6750.0, pytest.approx(math.sqrt(30.0 * 300.0)))


def test_a_rotor_that_was_only_weighed_is_not_simulated(tmp_path: Path) -> None:
    drawn = {"polar_inertia_kg_m2 = 0.004\n": "", "coupling_stiffness_N_m = 1e7\n": ""}
    with pytest.raises(NotSimulated, match="polar_inertia_kg_m2, coupling_stiffness_N_m"):
        load_rig(copied(tmp_path / "bench", drawn, {}))


@pytest.mark.parametrize("channel", range(8))
def test_every_figure_of_a_channel_reaches_the_counts(channel: int) -> None:
    """Range, noise and bandwidth: an ideal channel in place of the declared one."""
    rig = load_rig("bench")
    declared = rig.channels[channel]
    for change in (
        {"high": 0.5 * declared.high},
        {"noise_rms": declared.noise_rms + 100 * declared.wire_scale},
        {"wire_scale": 2 * declared.wire_scale},
    ):
        channels = list(rig.channels)
        channels[channel] = replace(declared, **change)
        other = replace(rig, channels=tuple(channels))
        signals = np.full((200, 8), [0.9 * each.high for each in rig.channels])
        told, changed = (
            SensorChain(each, Build.nominal(rig)).counts(
                signals, np.ones((200, 8)), np.zeros((200, 8)), np.zeros(200), np.zeros(200), {}
            )
            for each in (rig, other)
        )
        differs = (told != changed).any(axis=0)
        assert differs[channel] == ("noise_rms" not in change or channel != MICROPHONE)
        assert differs.sum() == differs[channel]
    slower = replace(declared, bandwidth_hz=0.5 * declared.bandwidth_hz)
    channels[channel] = slower
    lags, slow = (
        assemble(each, Build.nominal(rig), 4e-5).pickup.lag_share
        for each in (rig, replace(rig, channels=tuple(channels)))
    )
    assert [a != b for a, b in zip(lags, slow, strict=True)] == [i == channel for i in range(8)]


def test_a_rig_without_a_simulation_has_the_defaults_and_a_wrong_one_is_told(
    tmp_path: Path,
) -> None:
    assert load_simulation(tmp_path) == Simulation()
    (tmp_path / "simulation.toml").write_text(
        "[drive]\ncoast_rad_s2 = -1\n[forces]\nteth = 3\n[foundation.motor]\nmass_kg = 1\n"
        "inertia_kg_m2 = 1\nfoot_below_cg_m = 0\naxis_above_cg_m = 0\nbolt_x_m = [1.0, 2.0, 3.0]\n"
    )
    with pytest.raises(config.ConfigError) as caught:
        load_simulation(tmp_path)
    assert [(fault.key, fault.line) for fault in caught.value.faults] == [
        ("foundation.motor.bolt_x_m", 10), ("forces.teth", 4), ("drive.coast_rad_s2", 2),
    ]  # fmt: skip


def test_every_number_of_a_simulation_has_a_least_and_a_greatest_value() -> None:
    def numbers(kind: inspect.Type, key: str) -> Iterator[tuple[str, inspect.Type]]:
        if isinstance(kind, inspect.StructType):
            for each in kind.fields:
                yield from numbers(each.type, f"{key}.{each.name}")
        elif isinstance(kind, inspect.ListType):
            yield from numbers(kind.item_type, key)
        elif isinstance(kind, inspect.UnionType):
            for one in kind.types:
                yield from numbers(one, key)
        elif isinstance(kind, inspect.IntType | inspect.FloatType):
            yield key, kind

    found = dict(numbers(inspect.type_info(Simulation), ""))
    assert len(found) > 40
    limits = {key: (kind.ge, kind.le) for key, kind in found.items()}  # type: ignore[attr-defined]
    assert [key for key, both in limits.items() if None in both] == []
