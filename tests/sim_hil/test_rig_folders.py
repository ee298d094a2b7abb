"""The shipped rig folders say what the simulator's own files say of the same machine."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import msgspec
import pytest
from msgspec import inspect

from firmware_py import config
from firmware_py.machine.folder import shipped_names
from sim_hil.duty import Duty
from sim_hil.rigs import RIGS, load_rig, read_json
from sim_hil.rigs.simulation import Simulation, load_simulation


def same(value: float | None, other: float) -> bool:
    return value is not None and math.isclose(value, other, rel_tol=1e-12, abs_tol=0.0)


@pytest.mark.parametrize("name", shipped_names())
def test_machine_and_simulation_hold_the_figures_of_the_simulator(name: str) -> None:
    machine = config.load(config.SHIPPED / name)[0].machine
    simulation, rig = load_simulation(config.SHIPPED / name), load_rig(name)
    b, o, f, r, a = (
        machine.bearing,
        machine.lubricant,
        machine.feed,
        machine.rotor,
        machine.actuator,
    )
    true = simulation.true_machine
    assert b.journal_radius_m == rig.bearing.radius_m
    assert b.length_m == rig.bearing.length_m
    assert same(b.radial_clearance_min_um, rig.bearing.clearance_min_m * 1e6)
    assert same(b.radial_clearance_max_um, rig.bearing.clearance_max_m * 1e6)
    assert same(b.radial_clearance_nominal_um, rig.bearing.clearance_nominal_m * 1e6)
    if (cone := rig.bearing.cone_half_angle_rad) is not None:
        assert same(b.cone_half_angle_deg, math.degrees(cone))
    else:
        assert b.cone_half_angle_deg is None
    assert (o.density_kg_m3, o.heat_capacity_J_kgK) == (
        rig.oil.density_kg_m3, rig.oil.heat_capacity_J_kgK,
    )  # fmt: skip
    assert o.viscosity_slope_per_K == rig.oil.slope_per_K
    assert same(true.viscosity_at_40C_Pa_s or o.viscosity_at_40C_Pa_s, rig.oil.viscosity_at(40.0))
    assert simulation.oil.inlet_C == rig.oil.inlet_C
    assert same(f.pressure_nominal_bar, rig.supply.nominal_Pa * 1e-5)
    assert same(f.pressure_min_bar, rig.supply.min_Pa * 1e-5)
    assert same(f.pressure_max_bar, rig.supply.max_Pa * 1e-5)
    assert f.pump_efficiency == rig.supply.pump_efficiency
    if (groove := rig.supply.groove) is not None:
        assert same(f.groove_angle_deg, math.degrees(groove.angle_rad))
        assert same(f.groove_width_deg, math.degrees(groove.width_rad))
        assert f.groove_length_share == groove.length_share
    else:
        assert f.groove_width_deg is None
    drawn = asdict(rig.rotor)
    assert r.unbalance_normal_kg_m == drawn.pop("unbalance_kg_m")
    assert {key: getattr(r, key) for key in drawn} == drawn
    assert r.mass_at_bearing_kg == rig.rotor.effective_mass_kg
    assert same(a.rate_um_s, rig.actuator.rate_m_per_s * 1e6)
    assert same(a.backlash_um, rig.actuator.backlash_m * 1e6)
    assert same(a.position_noise_um, rig.actuator.position_noise_rms_m * 1e6)
    assert a.time_constant_s == rig.actuator.time_constant_s
    assert a.time_to_live_ms == rig.actuator.command_ttl_s * 1e3
    w = machine.operating
    assert (w.speed_min_rpm, w.speed_max_rpm) == (rig.speed_min_rpm, rig.speed_max_rpm)
    assert (w.load_min_N, true.load_max_N or w.load_max_N) == (rig.load_min_N, rig.load_max_N)
    assert (true.windage_W_s3 or r.windage_W_s3) == rig.windage_W_s3


@pytest.mark.parametrize("name", RIGS)
def test_what_only_the_simulator_needs_is_what_it_has(name: str) -> None:
    simulation, rig = load_simulation(config.SHIPPED / name), load_rig(name)
    assert msgspec.structs.asdict(simulation.forces) == asdict(rig.excitation)
    assert msgspec.to_builtins(simulation.foundation) == asdict(rig.foundation)
    assert simulation.oil.capacity_J_K == rig.thermal.capacity_J_K
    assert simulation.oil.jacket_flow_m3_s == rig.thermal.jacket_flow_m3_s
    assert simulation.drive.coast_rad_s2 == rig.drive.coast_rad_s2
    assert simulation.drive.run_up_rad_s2 == rig.drive.run_up_rad_s2
    table, spread = read_json("classes.json")["build_spread"], simulation.spread
    shares = {
        key.removesuffix("_share"): value for key, value in msgspec.structs.asdict(spread).items()
    }
    for key in ("mass", "inertia", "coupling_stiffness", "contact_stiffness", "foundation_damping",
                "viscosity"):  # fmt: skip
        assert shares[key] == table[key]
    assert shares["housing_mode"] == table["housing_mode_frequency"]
    assert same(spread.radial_clearance_um, table["radial_clearance_m"] * 1e6)
    assert [spread.normal_unbalance_min_G, spread.normal_unbalance_max_G] == table[
        "normal_unbalance_G"
    ]
    assert same(spread.runout_max_um, table["runout_m"][1] * 1e6)


def test_the_duty_is_the_published_one() -> None:
    corners, published = load_simulation(config.SHIPPED / "bench").duty, Duty.published()
    time_s = 0.0
    for corner, *expected in zip(
        corners, published.time_s, published.speed_rpm, published.load_N, strict=True
    ):
        time_s += corner.seconds
        assert [time_s, corner.speed_rpm, corner.load_N] == expected


@pytest.mark.parametrize("name", shipped_names())
def test_the_channels_are_the_sensors(name: str) -> None:
    channels = config.load(config.SHIPPED / name)[0].machine.channel
    for channel, sensor in zip(channels, read_json("sensors.json")["channels"], strict=True):
        si = 1e-6 if sensor["unit"] == "um" else 1.0
        assert channel.name == sensor["name"]
        assert same(channel.range_high, sensor["range"][1] * si)
        assert channel.range_low == pytest.approx(sensor["range"][0] * si)
        assert channel.bandwidth_hz == sensor["bandwidth_Hz"]
        assert channel.gain_error_share == sensor.get("gain_error")
        for figure, value in (("noise_rms", "noise_rms"), ("zero_error", "zero_error")):
            found = getattr(channel, figure)
            assert found == pytest.approx(sensor[value] * si) if value in sensor else found is None


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
    assert [key for key, kind in found.items() if kind.ge is None or kind.le is None] == []  # type: ignore[attr-defined]
