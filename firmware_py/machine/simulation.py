"""What only a simulator needs of a rig: ``simulation.toml`` of its folder, all of it defaulted.

The tables stand here so that ``orbitd check`` names their faults without a simulator.  The text at
each key is also the remark that ``orbitd rig new`` writes above it.
"""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from firmware_py.machine.values import LoadN, Section, Share, SpeedRpm, TemperatureC

MassKg = Annotated[float, Meta(ge=1e-3, le=1e6)]
LengthM = Annotated[float, Meta(ge=-10.0, le=10.0)]
ForceN = Annotated[float, Meta(ge=0.0, le=1e6)]
StiffnessNM = Annotated[float, Meta(ge=1e3, le=1e13)]
RampRadS2 = Annotated[float, Meta(ge=0.1, le=1e5)]
GradeG = Annotated[float, Meta(ge=0.01, le=4000.0)]


class BoltedBody(Section, frozen=True):
    """A pedestal or a motor on its four bolts; heights from its centre of gravity."""

    mass_kg: MassKg
    """Mass of the body. From: the drawing."""
    inertia_kg_m2: Annotated[float, Meta(ge=1e-6, le=1e6)]
    """Moment of inertia about an axis parallel to the shaft, through its centre of gravity. From:
    the drawing."""
    foot_below_cg_m: LengthM
    """Height of the centre of gravity above the feet. From: the drawing."""
    axis_above_cg_m: LengthM
    """Height of the shaft's axis above the centre of gravity. From: the drawing."""
    bolt_x_m: Annotated[list[LengthM], Meta(min_length=4, max_length=4)]
    """Where its four bolts stand, from the centre of gravity to the right. From: the drawing."""


class BoltedFoundation(Section, frozen=True):
    """Pedestal and motor with their joints; the stiffness is that of four bolts together."""

    contact_stiffness_N_m: StiffnessNM = 2e8
    """Stiffness of the joint of four bolts together. From: the first resonance of the foundation,
    or 2e8."""
    tangential_share: Share = 0.5
    """Tangential over normal stiffness of a joint. From: assumed, 0.5."""
    friction: Annotated[float, Meta(ge=0.0, le=2.0)] = 0.2
    """Friction coefficient of a joint. From: assumed, 0.2 of steel on steel."""
    preload_N: ForceN = 10600.0
    """Clamping force of one bolt. From: its tightening torque."""
    damping_ratio: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.03
    """Damping of the foundation, share of critical. From: a knock on it, or 0.03."""
    pedestal: BoltedBody = BoltedBody(10.0, 0.04, 0.06, 0.08, [-0.09, -0.06, 0.06, 0.09])
    """The pedestal with the bearing."""
    motor: BoltedBody = BoltedBody(12.0, 0.05, 0.08, 0.0, [-0.08, -0.06, 0.06, 0.08])
    """The motor."""


class ShakingForces(Section, frozen=True):
    """Forces that do not come from the rotor's unbalance."""

    motor_unbalance_kg_m: Annotated[float, Meta(ge=0.0, le=100.0)] = 1.2e-5
    """Unbalance of the motor. From: its grade."""
    line_force_N: ForceN = 2.0
    """Magnetic force of the motor at twice the mains. From: assumed."""
    line_hz: Annotated[float, Meta(ge=1.0, le=1000.0)] = 100.0
    """Twice the mains frequency. From: the mains."""
    tooth_force_N: ForceN = 0.5
    """Force at the slot passing frequency. From: assumed."""
    teeth: Annotated[int, Meta(ge=1, le=1000)] = 24
    """Slots or blades a turn. From: the motor's data sheet."""
    ambient_force_rms_N: ForceN = 0.5
    """Broad-band force of the surroundings, rms. From: assumed."""


class OilNode(Section, frozen=True):
    """The oil behind the outlet thermometer; None: as ``machine.toml`` says."""

    capacity_J_K: Annotated[float, Meta(ge=0.1, le=1e6)] | None = None
    """Heat capacity of the oil behind the outlet thermometer; not given: as `machine.toml` says."""
    inlet_C: TemperatureC | None = None
    """Temperature of the oil at the inlet; not given: the middle of the declared inlet range."""
    jacket_flow_m3_s: Annotated[float, Meta(ge=0.0, le=1.0)] | None = None
    """Forced flow around the film; not given: as `machine.toml` says."""
    reading_error_C: Annotated[float, Meta(ge=0.0, le=20.0)] | None = None
    """Most that the thermometer of one example is off by; not given: as `machine.toml` says. From:
    its class."""


class DriveRamps(Section, frozen=True):
    """How fast the drive lets go and comes back, and where it runs until it is told otherwise."""

    coast_rad_s2: RampRadS2 = 157.08
    """How fast the shaft slows down without drive. From: a coast-down."""
    run_up_rad_s2: RampRadS2 = 418.88
    """How fast the drive speeds up. From: the drive."""
    start_speed_rpm: SpeedRpm | None = None
    """Speed at which the drive begins; not given: the middle of the declared range."""
    start_load_N: LoadN | None = None
    """Load at which the drive begins; not given: the geometric middle of the declared range."""


class BuildSpread(Section, frozen=True):
    """How far one example of the machine may be from its drawing: uniform, grades log-uniform;
    None: as far as ``machine.toml`` declares."""

    mass_share: Share | None = None
    """Mass of the rotor, share of the drawing's; not given: as `machine.toml` says."""
    inertia_share: Share = 0.05
    """Moments of inertia of the rotor."""
    coupling_stiffness_share: Share = 0.3
    """Stiffness of the coupling."""
    contact_stiffness_share: Share = 0.4
    """Stiffness of the joints."""
    foundation_damping_share: Share = 0.4
    """Damping of the foundation."""
    radial_clearance_um: Annotated[float, Meta(ge=0.0, le=100.0)] | None = None
    """Radial clearance beside the one told; not given: as `machine.toml` says. From: the
    tolerance."""
    viscosity_share: Share | None = None
    """Viscosity of a batch of oil; not given: as `machine.toml` says. From: ISO 3448 allows
    10 %."""
    normal_unbalance_min_G: GradeG = 0.4
    """Least balance grade of a healthy rotor (e omega, mm/s). From: ISO 21940-11."""
    normal_unbalance_max_G: GradeG = 6.3
    """Greatest balance grade of a healthy rotor. From: ISO 21940-11."""
    runout_max_um: Annotated[float, Meta(ge=0.0, le=100.0)] | None = None
    """Greatest runout of a probe's target, of three orders together, which take 0.6, 0.3 and 0.1 of
    it; not given: as `machine.toml` says of the first. From: a slow roll."""
    bolt_gap_min_um: Annotated[float, Meta(ge=0.1, le=10_000.0)] = 20.0
    """Least gap of a loose bolt, log-uniform."""
    bolt_gap_max_um: Annotated[float, Meta(ge=0.1, le=10_000.0)] = 200.0
    """Greatest gap of a loose bolt, log-uniform."""
    housing_mode_share: Share = 0.1
    """Natural frequencies of the housing."""
    inlet_min_C: TemperatureC | None = None
    """Coldest inlet of an episode; not given: that of ``machine.toml``."""
    inlet_max_C: TemperatureC | None = None
    """Warmest inlet of an episode; not given: that of ``machine.toml``."""


class DutyCorner(Section, frozen=True):
    """Speed and load reached in ``seconds`` from the corner before, along a straight line."""

    speed_rpm: SpeedRpm
    """Speed at the end of this piece of the duty."""
    load_N: LoadN
    """Load at the end of this piece."""
    seconds: Annotated[float, Meta(ge=0.0, le=1e6)]
    """Time that it takes, along a straight line from the piece before."""


class TrueMachine(Section, frozen=True):
    """Where the simulated machine is not what ``machine.toml`` tells the device."""

    viscosity_at_40C_Pa_s: Annotated[float, Meta(ge=2e-4, le=1.5)] | None = None
    """True viscosity; not given: what the device is told."""
    windage_W_s3: Annotated[float, Meta(ge=0.0, le=1e-3)] | None = None
    """True windage; not given: what the device is told."""
    load_max_N: LoadN | None = None
    """True greatest load; not given: what the device is told."""


class Simulation(Section, frozen=True):
    """The whole of ``simulation.toml``."""

    foundation: BoltedFoundation = BoltedFoundation()
    forces: ShakingForces = ShakingForces()
    oil: OilNode = OilNode()
    drive: DriveRamps = DriveRamps()
    spread: BuildSpread = BuildSpread()
    true_machine: TrueMachine = TrueMachine()
    duty: list[DutyCorner] = msgspec.field(default_factory=list)
