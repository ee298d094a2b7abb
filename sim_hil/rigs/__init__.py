"""The rigs, sensors, classes and duty as data, read into frozen dataclasses.

``bench.json``, ``seed.json``, ``sensors.json``, ``classes.json`` and ``duty_bench.json`` are the
reference files as given; ``assumed.json`` holds what they leave open.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from importlib import resources
from typing import Any, Final

from firmware_py.errors import OrbitdError

RIGS: Final = ("bench", "seed")
GRAVITY_M_S2: Final = 9.81


class UnknownRig(OrbitdError, ValueError):
    """There is no rig of that name."""

    exit_code = 2


class NoCone(OrbitdError, ValueError):
    """The bearing has no cone angle."""

    exit_code = 2


@dataclass(frozen=True)
class Bearing:
    """Journal bearing; clearances are radial."""

    radius_m: float
    length_m: float
    clearance_min_m: float
    clearance_max_m: float
    clearance_nominal_m: float
    cone_half_angle_rad: float | None

    def axial_shift_m(self, clearance_m: float) -> float:
        """How far the cone stands from its place at nominal clearance: ``dc = dz tan(half angle)``.

        Raises
        ------
        NoCone
            The bearing is no cone.
        """
        if self.cone_half_angle_rad is None:
            raise NoCone(
                "axial shift: this rig's bearing is no cone; its clearance is set otherwise"
            )
        return (clearance_m - self.clearance_nominal_m) / math.tan(self.cone_half_angle_rad)


@dataclass(frozen=True)
class Oil:
    """Lubricant: ``mu = viscosity_Pa_s * exp(-slope_per_K (T - reference_C))``."""

    viscosity_Pa_s: float
    slope_per_K: float
    reference_C: float
    density_kg_m3: float
    heat_capacity_J_kgK: float
    inlet_C: float

    def viscosity_at(self, temperature_C: float) -> float:
        """Dynamic viscosity, Pa s."""
        return self.viscosity_Pa_s * math.exp(
            -self.slope_per_K * (temperature_C - self.reference_C)
        )


@dataclass(frozen=True)
class Groove:
    """One axial feed groove: its middle, its width around the journal, and its share of the
    bearing's length."""

    angle_rad: float
    width_rad: float
    length_share: float


@dataclass(frozen=True)
class Supply:
    """Oil supply pressure above ambient, the pump, and the groove (None: fed otherwise)."""

    nominal_Pa: float
    min_Pa: float
    max_Pa: float
    pump_efficiency: float
    groove: Groove | None


@dataclass(frozen=True)
class Rotor:
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
class Body:
    """A pedestal or motor on its four bolts."""

    mass_kg: float
    inertia_kg_m2: float
    foot_below_cg_m: float
    axis_above_cg_m: float
    bolt_x_m: list[float]


@dataclass(frozen=True)
class Foundation:
    """Pedestal and motor with their joints; ``contact_stiffness_N_m`` is that of four bolts
    together."""

    pedestal: Body
    motor: Body
    contact_stiffness_N_m: float
    tangential_share: float
    friction: float
    preload_N: float
    damping_ratio: float


@dataclass(frozen=True)
class Excitation:
    """Forces that do not come from the rotor's unbalance."""

    motor_unbalance_kg_m: float
    line_force_N: float
    line_hz: float
    tooth_force_N: float
    teeth: int
    ambient_force_rms_N: float


@dataclass(frozen=True)
class Thermal:
    """One-node oil temperature with a forced jacket flow."""

    capacity_J_K: float
    jacket_flow_m3_s: float


@dataclass(frozen=True)
class Drive:
    """How fast the drive lets go and comes back."""

    coast_rad_s2: float
    run_up_rad_s2: float


@dataclass(frozen=True)
class ActuatorData:
    """Clearance actuator."""

    rate_m_per_s: float
    time_constant_s: float
    backlash_m: float
    position_noise_rms_m: float
    command_ttl_s: float


@dataclass(frozen=True)
class RigData:
    """Everything fixed about one rig, nominal build."""

    name: str
    bearing: Bearing
    oil: Oil
    supply: Supply
    rotor: Rotor
    foundation: Foundation
    excitation: Excitation
    thermal: Thermal
    drive: Drive
    actuator: ActuatorData
    load_min_N: float
    load_max_N: float
    speed_min_rpm: float
    speed_max_rpm: float
    windage_W_s3: float


def read_json(name: str) -> dict[str, Any]:
    """One of the data files of this package."""
    table: dict[str, Any] = json.loads(
        resources.files(__name__).joinpath(name).read_text(encoding="utf-8")
    )
    return table


def load_rig(name: str) -> RigData:
    """The rig ``bench`` or ``seed``.

    Raises
    ------
    UnknownRig
        Any other name.
    """
    if name not in RIGS:
        raise UnknownRig(f"rig = {name}: unknown; choose one of {', '.join(RIGS)}")
    assumed = read_json("assumed.json")[name]
    table = read_json(f"{name}.json")
    specific = _bench(table) if name == "bench" else _seed(table, assumed)
    foundation = dict(assumed["foundation"])
    return RigData(
        name=name,
        foundation=Foundation(
            pedestal=Body(**foundation.pop("pedestal")),
            motor=Body(**foundation.pop("motor")),
            **foundation,
        ),
        excitation=Excitation(**assumed["excitation"]),
        thermal=Thermal(**assumed["thermal"]),
        drive=Drive(**assumed["drive"]),
        windage_W_s3=assumed["windage_W_s3"],
        **specific,
    )


def _bench(t: dict[str, Any]) -> dict[str, Any]:
    clearance, oil, feed, rotor = (
        t["bearing"]["radial_clearance_m"],
        t["oil"],
        t["feed"],
        t["rotor"],
    )
    return {
        "bearing": Bearing(
            t["bearing"]["journal_radius_m"],
            t["bearing"]["length_m"],
            clearance["min"],
            clearance["max"],
            clearance["nominal"],
            math.radians(t["bearing"]["cone_half_angle_deg"]),
        ),
        "oil": Oil(
            oil["viscosity_Pa_s_at_40C"],
            0.03,
            40.0,
            oil["density_kg_m3"],
            oil["heat_capacity_J_kgK"],
            oil["inlet_C"],
        ),
        "supply": Supply(
            feed["pressure_Pa"]["nominal"],
            feed["pressure_Pa"]["min"],
            feed["pressure_Pa"]["max"],
            feed["pump_efficiency"],
            Groove(math.pi / 2, math.radians(feed["width_deg"]), feed["length_share"]),
        ),
        "rotor": Rotor(
            rotor["mass_kg"],
            rotor["J_d_kg_m2"],
            rotor["J_p_kg_m2"],
            rotor["coupling_to_cg_m"],
            rotor["bearing_to_cg_m"],
            rotor["coupling_stiffness_N_m"],
            rotor["coupling_damping_N_s_m"],
            t["unbalance"]["kg_m"],
        ),
        "actuator": ActuatorData(**t["actuator"]),
        "load_min_N": float(t["load_N"]["min"]),
        "load_max_N": float(t["load_N"]["max"]),
        "speed_min_rpm": float(t["speed_rpm"][0]),
        "speed_max_rpm": float(t["speed_rpm"][1]),
    }


def _seed(t: dict[str, Any], assumed: dict[str, Any]) -> dict[str, Any]:
    """The seed file gives ``[value, where it comes from]`` pairs."""
    rotor, low_high = t["rotor"], t["feed"]["pressure_Pa"][0]
    return {
        "bearing": Bearing(
            t["bearing"]["journal_radius_m"][0],
            t["bearing"]["length_m"][0],
            assumed["clearance_m"][0],
            assumed["clearance_m"][1],
            t["bearing"]["radial_clearance_m"][0],
            None,
        ),
        "oil": Oil(
            t["lubricant"]["viscosity_Pa_s"][0],
            assumed["viscosity_slope_per_K"],
            assumed["reference_C"],
            t["lubricant"]["density_kg_m3"][0],
            assumed["heat_capacity_J_kgK"],
            assumed["reference_C"],
        ),
        "supply": Supply(
            sum(low_high) / 2, low_high[0], low_high[1], assumed["pump_efficiency"], None
        ),
        "rotor": Rotor(
            rotor["mass_kg"][0],
            rotor["J_d_kg_m2"][0],
            rotor["J_p_kg_m2"][0],
            rotor["coupling_to_cg_m"][0],
            rotor["bearing_to_cg_m"][0],
            rotor["coupling_stiffness_N_m"][0],
            rotor["coupling_damping_N_s_m"][0],
            assumed["unbalance_kg_m"],
        ),
        "actuator": ActuatorData(**assumed["actuator"]),
        "load_min_N": assumed["load_N"][0],
        "load_max_N": assumed["load_N"][1],
        "speed_min_rpm": float(t["speed_rpm"][0][0]),
        "speed_max_rpm": float(t["speed_rpm"][0][1]),
    }
