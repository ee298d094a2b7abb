"""What the simulator knows of one rig, nominal build: frozen figures in SI."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, field
from decimal import Decimal
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from firmware_py.config import Config
from firmware_py.machine import ContactCircuit, FeedPort, FixedPads
from firmware_py.machine.probes import PROBES
from firmware_py.machine.simulation import (
    BoltedFoundation,
    BuildSpread,
    DriveRamps,
    DutyCorner,
    ShakingForces,
)

GRAVITY_M_S2: Final = 9.81


def shifted(value: float, decades: int) -> float:
    """``value`` times ten to ``decades`` as a person would write it: 0.2 um is 2e-07 m to the last
    bit, which neither ``0.2 * 1e-6`` nor ``0.2 / 1e6`` is."""
    return float(Decimal(repr(float(value))).scaleb(decades))


@dataclass(frozen=True)
class BearingData:
    """Journal bearing; clearances are radial."""

    radius_m: float
    length_m: float
    clearance_min_m: float
    clearance_max_m: float
    clearance_nominal_m: float
    pads: FixedPads | None = None


@dataclass(frozen=True)
class OilData:
    """Lubricant: ``mu = viscosity_Pa_s * exp(-slope_per_K (T - reference_C))``."""

    viscosity_Pa_s: float
    slope_per_K: float
    reference_C: float
    density_kg_m3: float
    heat_capacity_J_kgK: float
    inlet_C: float
    episodes_C: tuple[float, float]
    """Inlet temperatures between which an episode may drift."""
    hottest_C: float
    """Of the film, that the machine declares."""

    def viscosity_at(self, temperature_C: float) -> float:
        """Dynamic viscosity, Pa s."""
        return self.viscosity_Pa_s * math.exp(
            -self.slope_per_K * (temperature_C - self.reference_C)
        )


@dataclass(frozen=True)
class AxialGroove:
    """One axial feed groove: its middle, its width around the journal, and its share of the
    bearing's length."""

    angle_rad: float
    width_rad: float
    length_share: float


UNLIMITED: Final = 1e12
"""Slew (Pa/s), shut-off pressure (Pa) and flow (m3/s) of a supply that does not say them."""


@dataclass(frozen=True)
class SupplyData:
    """Oil supply pressure above ambient, how it follows its target, the pump, the groove (None:
    fed otherwise), and the openings of a film that is not fed by one groove."""

    nominal_Pa: float
    min_Pa: float
    max_Pa: float
    full_film_Pa: float
    dead_time_s: float
    time_constant_s: float
    slew_Pa_s: float
    error_share: float
    shut_off_Pa: float
    flow_max_m3_s: float
    hold_up_s: float
    pump_error_share: float
    pump_efficiency: float
    groove: AxialGroove | None
    ports: tuple[FeedPort, ...] = ()


@dataclass(frozen=True)
class RotorData:
    """Rigid rotor; distances from the centre of gravity along the axis."""

    mass_kg: float
    diametral_inertia_kg_m2: float
    polar_inertia_kg_m2: float
    coupling_to_cg_m: float
    bearing_to_cg_m: float
    coupling_stiffness_N_m: float
    coupling_damping_N_s_m: float
    unbalance_kg_m: float

    @property
    def effective_mass_kg(self) -> float:
        """Mass felt at the bearing when the rotor swings about its coupling end."""
        about_coupling = self.diametral_inertia_kg_m2 + self.mass_kg * self.coupling_to_cg_m**2
        return about_coupling / (self.coupling_to_cg_m + self.bearing_to_cg_m) ** 2

    @property
    def gravity_share_N(self) -> float:
        """Weight carried by the bearing."""
        return (
            self.mass_kg
            * GRAVITY_M_S2
            * self.coupling_to_cg_m
            / (self.coupling_to_cg_m + self.bearing_to_cg_m)
        )


@dataclass(frozen=True)
class ThermalData:
    """One-node oil temperature with a forced jacket flow."""

    capacity_J_K: float
    jacket_flow_m3_s: float


@dataclass(frozen=True)
class ActuatorData:
    """Clearance actuator."""

    rate_m_per_s: float
    time_constant_s: float
    backlash_m: float
    position_noise_rms_m: float
    command_ttl_s: float


@dataclass(frozen=True)
class BuildErrors:
    """How far the figures of one example are off those that the machine declares, at most: shares,
    and SI."""

    mass_share: float
    viscosity_share: float
    clearance_m: float
    runout_m: float


@dataclass(frozen=True)
class ReadingErrors:
    """Most that the slow readings of one example are off by."""

    shaft_power_W: float
    oil_C: float


@dataclass(frozen=True)
class ChannelData:
    """One sensor of the node: where it looks, what it can show, how it errs, SI, and SI per count
    on the wire."""

    name: str
    angle_rad: float
    low: float
    high: float
    noise_rms: float
    bandwidth_hz: float
    gain_error_share: float
    zero_error: float
    wire_scale: float


@dataclass(frozen=True)
class RigData:
    """Everything fixed about one rig, nominal build."""

    name: str
    bearing: BearingData
    oil: OilData
    supply: SupplyData
    rotor: RotorData
    foundation: BoltedFoundation
    excitation: ShakingForces
    thermal: ThermalData
    drive: DriveRamps
    actuator: ActuatorData
    errors: ReadingErrors
    build_errors: BuildErrors
    channels: tuple[ChannelData, ...]
    contact: ContactCircuit | None
    spread: BuildSpread
    duty: tuple[DutyCorner, ...]
    load_min_N: float
    load_max_N: float
    speed_min_rpm: float
    speed_max_rpm: float
    load_ramp_N_s: float
    speed_ramp_rpm_s: float
    """How fast load and speed may change unannounced."""
    min_film_m: float
    """Smallest film that the device is to keep."""
    windage_W_s3: float
    config: Config = field(repr=False, compare=False)
    """What its device is told."""

    @property
    def digest(self) -> str:
        """Changes with any figure of the rig, of its machine or of its limits: what was computed
        for one of another digest is of another machine."""
        told = msgspec.json.encode((self.config.machine, self.config.limits))
        return hashlib.sha256(repr(self).encode() + told).hexdigest()[:12]

    @property
    def probes(self) -> NDArray[np.float64]:
        """Directions in which the two displacement probes look, shape (2, 2): a row each, x and
        y."""
        angles = np.array([channel.angle_rad for channel in self.channels[:PROBES]])
        return np.column_stack([np.cos(angles), np.sin(angles)])

    @property
    def start_rpm(self) -> float:
        """Speed at which the drive holds the rotor until it is told otherwise."""
        told = self.drive.start_speed_rpm
        return 0.5 * (self.speed_min_rpm + self.speed_max_rpm) if told is None else told

    @property
    def start_load_N(self) -> float:
        """And its load."""
        told = self.drive.start_load_N
        return math.sqrt(self.load_min_N * self.load_max_N) if told is None else told
