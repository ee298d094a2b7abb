"""What only a simulator needs of a rig: ``simulation.toml`` of its folder, all of it defaulted."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import msgspec
from msgspec import Meta

from firmware_py.config.convert import convert
from firmware_py.config.source import ConfigError, read_file
from firmware_py.config.verify import toml_table
from firmware_py.machine.values import LoadN, Section, Share, SpeedRpm, TemperatureC

SIMULATION: Final = "simulation.toml"

MassKg = Annotated[float, Meta(ge=1e-3, le=1e6)]
LengthM = Annotated[float, Meta(ge=-10.0, le=10.0)]
ForceN = Annotated[float, Meta(ge=0.0, le=1e6)]
StiffnessNM = Annotated[float, Meta(ge=1e3, le=1e13)]
RampRadS2 = Annotated[float, Meta(ge=0.1, le=1e5)]
GradeG = Annotated[float, Meta(ge=0.01, le=4000.0)]


class BoltedBody(Section, frozen=True):
    """A pedestal or a motor on its four bolts; heights from its centre of gravity."""

    mass_kg: MassKg
    inertia_kg_m2: Annotated[float, Meta(ge=1e-6, le=1e6)]
    foot_below_cg_m: LengthM
    axis_above_cg_m: LengthM
    bolt_x_m: Annotated[list[LengthM], Meta(min_length=4, max_length=4)]


class BoltedFoundation(Section, frozen=True):
    """Pedestal and motor with their joints; the stiffness is that of four bolts together."""

    contact_stiffness_N_m: StiffnessNM = 2e8
    tangential_share: Share = 0.5
    friction: Annotated[float, Meta(ge=0.0, le=2.0)] = 0.2
    preload_N: ForceN = 10600.0
    damping_ratio: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.03
    pedestal: BoltedBody = BoltedBody(10.0, 0.04, 0.06, 0.08, [-0.09, -0.06, 0.06, 0.09])
    motor: BoltedBody = BoltedBody(12.0, 0.05, 0.08, 0.0, [-0.08, -0.06, 0.06, 0.08])


class ShakingForces(Section, frozen=True):
    """Forces that do not come from the rotor's unbalance."""

    motor_unbalance_kg_m: Annotated[float, Meta(ge=0.0, le=100.0)] = 1.2e-5
    line_force_N: ForceN = 2.0
    line_hz: Annotated[float, Meta(ge=1.0, le=1000.0)] = 100.0
    tooth_force_N: ForceN = 0.5
    teeth: Annotated[int, Meta(ge=1, le=1000)] = 24
    ambient_force_rms_N: ForceN = 0.5


class OilNode(Section, frozen=True):
    """The oil behind the outlet thermometer; None: as ``machine.toml`` says."""

    capacity_J_K: Annotated[float, Meta(ge=0.1, le=1e6)] | None = None
    inlet_C: TemperatureC | None = None
    """None: the middle of the declared inlet range."""
    jacket_flow_m3_s: Annotated[float, Meta(ge=0.0, le=1.0)] | None = None
    reading_error_C: Annotated[float, Meta(ge=0.0, le=20.0)] = 1.0
    """Most that the thermometer of one example is off by."""


class DriveRamps(Section, frozen=True):
    """How fast the drive lets go and comes back, and where it runs until it is told otherwise."""

    coast_rad_s2: RampRadS2 = 157.08
    run_up_rad_s2: RampRadS2 = 418.88
    start_speed_rpm: SpeedRpm | None = None
    """None: the middle of the declared range."""
    start_load_N: LoadN | None = None
    """None: the geometric middle of the declared range."""


class BuildSpread(Section, frozen=True):
    """How far one example of the machine may be from its drawing: uniform, grades log-uniform."""

    mass_share: Share = 0.05
    inertia_share: Share = 0.05
    coupling_stiffness_share: Share = 0.3
    contact_stiffness_share: Share = 0.4
    foundation_damping_share: Share = 0.4
    radial_clearance_um: Annotated[float, Meta(ge=0.0, le=100.0)] = 2.0
    viscosity_share: Share = 0.1
    normal_unbalance_min_G: GradeG = 0.4
    normal_unbalance_max_G: GradeG = 6.3
    runout_max_um: Annotated[float, Meta(ge=0.0, le=100.0)] = 10.0
    bolt_gap_min_um: Annotated[float, Meta(ge=0.1, le=10_000.0)] = 20.0
    bolt_gap_max_um: Annotated[float, Meta(ge=0.1, le=10_000.0)] = 200.0
    """How far a loose bolt backs off, log-uniform."""
    housing_mode_share: Share = 0.1
    inlet_min_C: TemperatureC | None = None
    inlet_max_C: TemperatureC | None = None
    """Oil inlet of an episode; None: the declared range of ``machine.toml``."""


class DutyCorner(Section, frozen=True):
    """Speed and load reached in ``seconds`` from the corner before, along a straight line."""

    speed_rpm: SpeedRpm
    load_N: LoadN
    seconds: Annotated[float, Meta(ge=0.0, le=1e6)]


class TrueMachine(Section, frozen=True):
    """Where the simulated machine is not what ``machine.toml`` tells the device."""

    viscosity_at_40C_Pa_s: Annotated[float, Meta(ge=2e-4, le=1.5)] | None = None
    windage_W_s3: Annotated[float, Meta(ge=0.0, le=1e-3)] | None = None
    load_max_N: LoadN | None = None


class Simulation(Section, frozen=True):
    """The whole of ``simulation.toml``."""

    foundation: BoltedFoundation = BoltedFoundation()
    forces: ShakingForces = ShakingForces()
    oil: OilNode = OilNode()
    drive: DriveRamps = DriveRamps()
    spread: BuildSpread = BuildSpread()
    true_machine: TrueMachine = TrueMachine()
    duty: list[DutyCorner] = msgspec.field(default_factory=list)


def load_simulation(rig: Path) -> Simulation:
    """What ``simulation.toml`` of the folder ``rig`` says; all defaults where there is none.

    Raises
    ------
    ConfigError
        With every fault: the file, TOML, keys, values.
    """
    path = rig / SIMULATION
    if not path.exists():
        return Simulation()
    file = read_file(path, f"{rig.resolve().name}/{SIMULATION}")
    values, found = convert(toml_table(file), Simulation)
    if found:
        raise ConfigError([file.fault(*each) for each in found])
    return msgspec.convert(values, Simulation)
