"""From a rig folder to the figures of the simulator: ``machine.toml``, and ``simulation.toml`` for
what only a simulator needs and for where the simulated machine is not what the device is told."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

from firmware_py import config as configuration
from firmware_py.config import Config
from firmware_py.config.instances import fast_signals
from firmware_py.config.simulation import load_simulation
from firmware_py.errors import OrbitdError
from firmware_py.machine import FastChannel, Feed, Machine, RotorDrawing
from firmware_py.machine.folder import find, simulated_names
from firmware_py.machine.probes import as_built
from firmware_py.machine.simulation import BuildSpread, OilNode, Simulation
from firmware_py.machine.supply import full_film_bar, nominal_bar
from firmware_py.records import CHANNELS
from firmware_py.signals import INT16_MAX
from sim_hil.rigs.data import (
    UNLIMITED,
    ActuatorData,
    AxialGroove,
    BearingData,
    BuildErrors,
    ChannelData,
    OilData,
    ReadingErrors,
    RigData,
    RotorData,
    SupplyData,
    ThermalData,
    shifted,
)

RIGS: Final = tuple(simulated_names())
REFERENCE_C: Final = 40.0
"""Where the viscosity law of ``machine.toml`` stands."""

FIRST_ORDER: Final = 0.6
"""Of a probe's runout: what its first order takes."""

CAPACITY_J_K: Final = 250.0
"""Of the oil behind the outlet thermometer, where nobody says: a cup of oil, 0.15 L."""


class UnknownRig(OrbitdError, ValueError):
    """There is no rig of that name."""

    exit_code = 2


class NotSimulated(OrbitdError, ValueError):
    """The rig folder does not say enough for a simulation, or says what it cannot play."""

    exit_code = 2


def load_rig(named: str | Path) -> RigData:
    """The rig of a shipped name, or of a rig folder.

    Raises
    ------
    UnknownRig
        Neither a shipped name nor a folder.
    NotSimulated
        The folder leaves out what a simulation needs.
    ConfigError
        Any fault in its files.
    """
    folder = find(str(named))
    if not folder.is_dir():
        raise UnknownRig(
            f"rig = {named}: unknown; choose one of {', '.join(RIGS)}, or name a rig folder"
        )
    return rig_of(configuration.load(folder)[0], load_simulation(folder))


def rig_of(config: Config, simulation: Simulation) -> RigData:
    """The figures of a rig folder's machine as the simulator plays them.

    Raises
    ------
    NotSimulated
        A figure that a simulation needs is not given.
    """
    machine = config.machine
    if machine.absent:
        raise NotSimulated(
            f"{machine.name}: its description lacks {', '.join(machine.absent)}; a simulation "
            "needs them, monitoring does not (`orbitd run`)"
        )
    o, true, given = machine.operating, simulation.true_machine, machine.lubricant
    thin = true.viscosity_at_40C_Pa_s
    windage, most_N = true.windage_W_s3, true.load_max_N
    return RigData(
        name=machine.name,
        bearing=_bearing(machine),
        oil=OilData(
            given.viscosity_at_40C_Pa_s if thin is None else thin,
            given.viscosity_slope_per_K,
            REFERENCE_C,
            given.density_kg_m3,
            given.heat_capacity_J_kgK,
            _inlet_C(machine, simulation.oil),
            _episodes_C(machine, simulation.spread),
            given.film_max_C,
        ),
        supply=_supply(machine),
        rotor=_rotor(machine.rotor),
        foundation=simulation.foundation,
        excitation=simulation.forces,
        thermal=_thermal(machine, simulation.oil),
        drive=simulation.drive,
        actuator=_actuator(machine),
        errors=_reading_errors(machine, simulation.oil),
        build_errors=_build_errors(machine, simulation.spread),
        channels=_channels(machine.channel),
        contact=machine.contact,
        spread=simulation.spread,
        duty=tuple(simulation.duty),
        load_min_N=o.load_min_N,
        load_max_N=o.load_max_N if most_N is None else most_N,
        speed_min_rpm=o.speed_min_rpm,
        speed_max_rpm=o.speed_max_rpm,
        load_ramp_N_s=o.load_ramp_unannounced_N_s,
        speed_ramp_rpm_s=o.speed_ramp_unannounced_rpm_s,
        min_film_m=shifted(config.limits.min_film_um, -6),
        windage_W_s3=machine.rotor.windage_W_s3 if windage is None else windage,
        config=config,
    )


def _reading_errors(machine: Machine, node: OilNode) -> ReadingErrors:
    declared_C, played_C = machine.readings.oil_outlet_error_C, node.reading_error_C
    return ReadingErrors(
        machine.rotor.shaft_power_error_W, declared_C if played_C is None else played_C
    )


def _build_errors(machine: Machine, spread: BuildSpread) -> BuildErrors:
    mass, oil = spread.mass_share, spread.viscosity_share
    gap_um, runout_um = spread.radial_clearance_um, spread.runout_max_um
    b = machine.bearing
    return BuildErrors(
        machine.rotor.mass_error_share if mass is None else mass,
        machine.lubricant.viscosity_error_share if oil is None else oil,
        shifted(b.radial_clearance_error_um if gap_um is None else gap_um, -6),
        as_built(machine).runout_m / FIRST_ORDER if runout_um is None else shifted(runout_um, -6),
    )


def _bearing(machine: Machine) -> BearingData:
    b = machine.bearing
    return BearingData(
        b.journal_radius_m,
        b.length_m,
        shifted(b.radial_clearance_min_um, -6),
        shifted(b.radial_clearance_max_um, -6),
        shifted(b.radial_clearance_nominal_um, -6),
        machine.pads,
    )


def _supply(machine: Machine) -> SupplyData:
    feed, a = machine.feed, machine.actuator
    slew, shut_off = a.pressure_slew_bar_s, feed.pump_shut_off_bar
    return SupplyData(
        nominal_Pa=shifted(nominal_bar(feed), 5),
        min_Pa=shifted(feed.pressure_min_bar, 5),
        max_Pa=shifted(feed.pressure_max_bar, 5),
        full_film_Pa=shifted(full_film_bar(feed), 5),
        dead_time_s=a.pressure_dead_time_s,
        time_constant_s=a.pressure_time_constant_s,
        slew_Pa_s=UNLIMITED if slew is None else shifted(slew, 5),
        error_share=a.pressure_error_share,
        shut_off_Pa=UNLIMITED if shut_off is None else shifted(shut_off, 5),
        flow_max_m3_s=feed.pump_flow_max_m3_s or UNLIMITED,
        hold_up_s=feed.hold_up_s,
        pump_error_share=feed.pump_error_share,
        pump_efficiency=feed.pump_efficiency,
        groove=_groove(feed),
        ports=tuple(machine.feed_port),
    )


def _groove(feed: Feed) -> AxialGroove | None:
    angle, width, share = feed.groove_angle_deg, feed.groove_width_deg, feed.groove_length_share
    if angle is None or width is None or share is None:
        return None
    return AxialGroove(math.radians(angle), math.radians(width), share)


def _rotor(r: RotorDrawing) -> RotorData:
    drawn = {
        "mass_kg": r.mass_kg,
        "diametral_inertia_kg_m2": r.diametral_inertia_kg_m2,
        "polar_inertia_kg_m2": r.polar_inertia_kg_m2,
        "coupling_to_cg_m": r.coupling_to_cg_m,
        "bearing_to_cg_m": r.bearing_to_cg_m,
        "coupling_stiffness_N_m": r.coupling_stiffness_N_m,
        "coupling_damping_N_s_m": r.coupling_damping_N_s_m,
    }
    missing = [name for name, value in drawn.items() if value is None]
    if missing:
        raise NotSimulated(
            f"machine.rotor.{', '.join(missing)}: not given; a simulation needs the rotor's drawing"
        )
    figures = {name: value for name, value in drawn.items() if value is not None}
    return RotorData(**figures, unbalance_kg_m=r.unbalance_normal_kg_m)


def _actuator(machine: Machine) -> ActuatorData:
    a = machine.actuator
    return ActuatorData(
        shifted(a.rate_um_s, -6),
        a.time_constant_s,
        shifted(a.backlash_um, -6),
        shifted(a.position_noise_um, -6),
        shifted(a.time_to_live_ms, -3),
    )


def _thermal(machine: Machine, node: OilNode) -> ThermalData:
    """``simulation.toml`` counts before what the device is told."""
    capacity, jacket = node.capacity_J_K, node.jacket_flow_m3_s
    told = machine.lubricant.thermal_capacity_J_K or CAPACITY_J_K
    return ThermalData(
        told if capacity is None else capacity,
        machine.feed.jacket_flow_m3_s if jacket is None else jacket,
    )


def _inlet_C(machine: Machine, node: OilNode) -> float:
    declared = machine.lubricant.inlet_min_C, machine.lubricant.inlet_max_C
    return 0.5 * sum(declared) if node.inlet_C is None else node.inlet_C


def _episodes_C(machine: Machine, spread: BuildSpread) -> tuple[float, float]:
    low, high = spread.inlet_min_C, spread.inlet_max_C
    return (
        machine.lubricant.inlet_min_C if low is None else low,
        machine.lubricant.inlet_max_C if high is None else high,
    )


def _channels(channels: list[FastChannel]) -> tuple[ChannelData, ...]:
    """The standard channels; a figure that is not given is ideal."""
    names = tuple(channel.name for channel in channels)
    if names != CHANNELS:
        raise NotSimulated(
            f"machine.channel = {', '.join(names)}: the simulator plays {', '.join(CHANNELS)}, "
            "in this order"
        )
    scales = (signal.wire_scale for signal in fast_signals(channels))
    return tuple(_channel(*pair) for pair in zip(channels, scales, strict=True))


def _channel(channel: FastChannel, wire_scale: float) -> ChannelData:
    low, high, bandwidth = channel.range_low, channel.range_high, channel.bandwidth_hz
    return ChannelData(
        channel.name,
        math.radians(channel.angle_deg),
        -INT16_MAX * wire_scale if low is None else low,
        INT16_MAX * wire_scale if high is None else high,
        channel.noise_rms or 0.0,
        math.inf if bandwidth is None else bandwidth,
        channel.gain_error_share or 0.0,
        channel.zero_error or 0.0,
        wire_scale,
    )
