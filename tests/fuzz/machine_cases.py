"""Rig folders of machines that could stand somewhere: bearing, oil, rotor and duty drawn inside the
documented ranges, and tied to one another as a designer would."""

from __future__ import annotations

import math
import random
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import msgspec

from firmware_py.config import ConfigError, load
from firmware_py.config.simulation import load_simulation
from firmware_py.guard.envelope.shield import Shield
from firmware_py.machine.folder import DEVICE, MACHINE, SHIPPED, SIMULATION

from .config_cases import Files, _base, _table, to_toml, written

_RPM: Final = 30.0 / math.pi
_GRAVITY: Final = 9.81


def machine_case(seed: int, i: int) -> Files:
    """The rig folder of machine ``i``."""
    rng = random.Random(f"machine {seed}:{i}")
    table = _table(_base("bench"))
    machine: dict[str, Any] = table.pop("machine")
    simulation = _plain(msgspec.to_builtins(load_simulation(SHIPPED / "bench")))
    machine["name"] = table["device"]["rig"] = "drawn"
    film = _bearing(rng, machine)
    _rotor(rng, machine, simulation, film)
    _device(rng, machine, table)
    return _with_retreat(rng, machine, table, simulation)


def _log(rng: random.Random, low: float, high: float) -> float:
    return math.exp(rng.uniform(math.log(low), math.log(high)))


def _put(table: dict[str, Any], **values: Any) -> None:
    table.update({name: _short(value) for name, value in values.items()})


def _short(value: Any) -> Any:
    """Four digits, as people write."""
    return float(f"{value:.4g}") if isinstance(value, float) else value


def _plain(table: Any) -> Any:
    if isinstance(table, Mapping):
        return {name: _plain(each) for name, each in table.items() if each is not None}
    return [_plain(each) for each in table] if isinstance(table, list) else table


def _bearing(rng: random.Random, machine: dict[str, Any]) -> dict[str, float]:
    """Size, clearances, oil, speeds and the load that the film carries at an eccentricity of 0.3 to
    0.7 in its middle clearance, by the short bearing."""
    radius = _log(rng, 0.005, 0.05)
    length = 2 * radius * (rng.uniform(0.15, 1.0) if rng.random() < 0.9 else rng.uniform(1.0, 2.0))
    narrow = radius * _log(rng, 0.0008, 0.0022)
    wide = narrow * rng.uniform(1.15, 4.0)
    fast = min(_log(rng, 3.0, 40.0) / radius, 29_000 / _RPM)
    slow = fast * rng.uniform(0.15, 0.6)
    thick, slope = _log(rng, 1e-3, 0.08), rng.uniform(0.015, 0.045)
    cold = rng.uniform(15.0, 40.0)
    warm, hot = cold + rng.uniform(3.0, 10.0), cold + rng.uniform(12.0, 30.0)
    middle, eps = math.sqrt(narrow * wide), rng.uniform(0.3, 0.7)
    thin = thick * math.exp(-slope * (warm - 40.0))
    e2 = eps * eps
    short = eps * math.sqrt(16 * e2 + math.pi**2 * (1 - e2)) / (1 - e2) ** 2
    load = (
        thin
        * slow
        * radius
        * length**3
        / (4 * middle**2)
        * short
        / (1 + (length / 2 / radius) ** 2)
    )
    most, least = load, load * rng.uniform(0.15, 0.6)
    error_um = max(0.3, 1e6 * narrow * rng.uniform(0.01, 0.05))
    _put(
        machine["bearing"],
        journal_radius_m=radius,
        length_m=length,
        radial_clearance_min_um=narrow * 1e6,
        radial_clearance_max_um=wide * 1e6,
        radial_clearance_nominal_um=middle * 1e6,
        radial_clearance_error_um=error_um,
    )
    _put(
        machine["lubricant"],
        viscosity_at_40C_Pa_s=thick,
        viscosity_slope_per_K=slope,
        inlet_min_C=cold,
        inlet_max_C=warm,
        film_max_C=hot,
        viscosity_error_share=rng.uniform(0.01, 0.1),
        density_kg_m3=rng.uniform(800.0, 1000.0),
    )
    _put(
        machine["operating"],
        speed_min_rpm=slow * _RPM,
        speed_max_rpm=fast * _RPM,
        load_min_N=least,
        load_max_N=most,
        speed_ramp_max_rpm_s=max(10.0, fast * _RPM * rng.uniform(0.2, 0.4)),
        speed_ramp_unannounced_rpm_s=max(5.0, fast * _RPM * rng.uniform(0.03, 0.15)),
        load_ramp_unannounced_N_s=max(0.05, most * rng.uniform(0.02, 0.15)),
    )
    return {"radius": radius, "narrow": narrow, "middle": middle, "fast": fast, "least": least,
            "most": most, "length": length}  # fmt: skip


def _rotor(
    rng: random.Random,
    machine: dict[str, Any],
    simulation: dict[str, Any],
    film: dict[str, float],
) -> None:
    """A rotor that the film keeps from whirling, most times; coupling, foundation and forces."""
    critical = 6.0 * film["least"] / (film["middle"] * film["fast"] ** 2)
    felt = max(0.002, critical * _log(rng, 0.05, 1.2))
    span = film["radius"] * rng.uniform(6.0, 20.0)
    mass = 2.0 * felt
    stiffness = max(1e4, film["most"] / film["middle"] * rng.uniform(2.0, 10.0))
    unbalance = felt * 1e-3 * _log(rng, 1.0, 6.3) / film["fast"]
    machine["rotor"].pop("effective_mass_at_bearing_kg", None)
    _put(
        machine["rotor"],
        mass_kg=mass,
        diametral_inertia_kg_m2=mass * span**2 * rng.uniform(0.8, 1.0),
        polar_inertia_kg_m2=mass * film["radius"] ** 2 * rng.uniform(0.4, 1.5),
        coupling_to_cg_m=span,
        bearing_to_cg_m=span,
        coupling_stiffness_N_m=stiffness,
        coupling_damping_N_s_m=0.1 * math.sqrt(stiffness * mass),
        unbalance_normal_kg_m=unbalance,
        windage_W_s3=0.0,
        shaft_power_error_W=max(0.05, 0.01 * film["most"]),
    )
    weight = mass + film["most"] / _GRAVITY
    foundation = simulation["foundation"]
    contact = 30.0 * film["most"] / film["middle"] + 1e6
    _put(foundation, contact_stiffness_N_m=contact, preload_N=10.0 * film["most"] + 50.0 * weight)
    for body in ("pedestal", "motor"):
        _put(foundation[body], mass_kg=2.0 * weight, inertia_kg_m2=0.02 * weight)
    forces = simulation["forces"]
    _put(
        forces,
        motor_unbalance_kg_m=unbalance,
        line_force_N=0.01 * film["least"],
        tooth_force_N=0.003 * film["least"],
        ambient_force_rms_N=0.003 * film["least"],
    )
    _put(
        simulation["drive"],
        coast_rad_s2=film["fast"] * 0.3,
        run_up_rad_s2=film["fast"] * 0.3,
        start_speed_rpm=rng.uniform(
            machine["operating"]["speed_min_rpm"], machine["operating"]["speed_max_rpm"]
        ),
        start_load_N=rng.uniform(film["least"], film["most"]),
    )
    simulation["duty"] = []
    for name in ("inlet_C", "capacity_J_K", "jacket_flow_m3_s"):
        simulation["oil"].pop(name, None)
    for name in ("inlet_min_C", "inlet_max_C", "runout_max_um"):
        simulation["spread"].pop(name, None)


def _device(rng: random.Random, machine: dict[str, Any], device: dict[str, Any]) -> None:
    """Supply, actuator, probes and limits of a machine of that size."""
    b, o = machine["bearing"], machine["operating"]
    narrow_um, wide_um = b["radial_clearance_min_um"], b["radial_clearance_max_um"]
    feed, actuator = machine["feed"], machine["actuator"]
    for name in (*(n for n in feed if n.startswith(("pump_", "hold_up", "groove_"))), "assumed"):
        feed.pop(name, None)
    actuator.pop("assumed", None)
    for table in ("lubricant", "rotor"):
        machine[table].pop("assumed", None)
    oil, omega = machine["lubricant"], o["speed_max_rpm"] / _RPM
    petroff_m4 = 2 * math.pi * b["journal_radius_m"] ** 3 * b["length_m"]
    thickest = oil["viscosity_at_40C_Pa_s"] * math.exp(
        oil["viscosity_slope_per_K"] * (40.0 - oil["inlet_min_C"])
    )
    most_W = 1.5 * petroff_m4 * thickest * omega**2 / (narrow_um * 1e-6)
    cooling = most_W / (0.5 * (oil["film_max_C"] - oil["inlet_max_C"]))
    _put(feed, jacket_flow_m3_s=max(1e-6, cooling / (oil["density_kg_m3"] * 2000.0)))
    _put(machine["lubricant"], thermal_capacity_J_K=50.0 + cooling, cooling_W_K=cooling)
    _put(
        actuator,
        rate_um_s=max(1.0, narrow_um * rng.uniform(0.5, 2.0)),
        following_error_um=max(0.1, min(0.1 * narrow_um, 0.4 * (wide_um - narrow_um))),
        backlash_um=0.01 * narrow_um,
        position_noise_um=0.003 * narrow_um,
    )
    for probe in machine["channel"][:2]:
        reach = min(1.6e-6 * wide_um + 30e-6, 320e-6)
        _put(probe, ok_low=-reach * 0.98, ok_high=reach * 0.98)
        _put(probe, range_low=-reach, range_high=reach)
        _put(probe, noise_rms=1e-9 * narrow_um, zero_error=0.01e-6 * narrow_um)
        _put(probe, runout_m=0.02e-6 * narrow_um, gain_error_share=rng.uniform(0.005, 0.03))
        for name in [n for n in probe if n.startswith("zeroed")]:
            probe.pop(name)
    kept = ("clearance_share", "acceleration_alert_m_s2", "acceleration_danger_m_s2")
    device["limits"] = {name: device["limits"][name] for name in kept} | {
        "min_film_um": _short(narrow_um * rng.uniform(0.08, 0.2)),
        "displacement_alert_um": _short(0.8 * narrow_um),
        "displacement_danger_um": _short(1.2 * narrow_um),
        "danger_delay_s": 3.0,
        "min_speed_rpm": _short(min(300.0, 0.5 * o["speed_min_rpm"])),
    }
    rates = [rate for rate in (5000, 10_000) if rate * 60 / 20 >= o["speed_max_rpm"]]
    device["sampling"] = {"rate_hz": rates[0]}
    device["bus"].pop("channel", None)


def _with_retreat(
    rng: random.Random, machine: dict[str, Any], device: dict[str, Any], simulation: dict[str, Any]
) -> Files:
    """The folder with a retreat value that ``check`` would name, where there is one."""
    b = machine["bearing"]
    low, high = b["radial_clearance_min_um"], b["radial_clearance_max_um"]
    _put(machine["actuator"], safe_radial_clearance_um=low + 0.2 * (high - low))
    files = _files(machine, device, simulation)
    with tempfile.TemporaryDirectory() as folder:
        try:
            config = load(written(files, Path(folder)))[0]
        except ConfigError:
            return files
    if admitted := Shield(config).fixed_range():
        first, last = (1e6 * value for value in admitted)
        at = first + rng.uniform(0.2, 0.6) * (last - first)
        _put(machine["actuator"], safe_radial_clearance_um=at)
    return _files(machine, device, simulation)


def _files(machine: dict[str, Any], device: dict[str, Any], simulation: dict[str, Any]) -> Files:
    tables = {MACHINE: machine, DEVICE: device, SIMULATION: simulation}
    return {name: to_toml(table).encode() for name, table in tables.items()}
