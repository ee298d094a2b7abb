"""Plant parameters of one build without faults."""

from __future__ import annotations

import math

import numpy as np

from firmware_py.errors import OrbitdError
from firmware_py.machine import ContactCircuit
from firmware_py.machine.simulation import BoltedBody
from sim_hil.film.bore import PadBore
from sim_hil.film.fed import FedLaw, FedTable
from sim_hil.film.pad_kernel import PadLaw
from sim_hil.film.pad_table import PadTable, shape_of
from sim_hil.film.port_table import PortLaw, port_law
from sim_hil.film.records import FilmError
from sim_hil.film.table import FilmTable
from sim_hil.plant.build import Build
from sim_hil.rigs import RigData
from sim_hil.rotor.parameters import (
    ActuatorParameters,
    ContactParameters,
    Excite,
    FilmParameters,
    Floats,
    Foot,
    Pickup,
    Plant,
    Shaft,
    four,
    three,
)

BOLT_STIFFNESS_SHARE = 0.5
"""A bolt that stops a lift, relative to the joint's contact stiffness."""
RUB_CLEARANCE_M = 150e-6
"""Radial gap between the shaft and a seal that stands right."""
_MODE_DAMPING = 0.02
_MODE_GAIN = 0.2
_SOUND_PA_S_M = 200.0
_TOOTH_SOUND_PA = 0.05

_POSITIVE = frozenset(
    {
        "mass",
        "inertia",
        "diametral",
        "radius",
        "length",
        "viscosity",
        "heat_capacity_per_m3",
        "thermal_capacity",
        "stiffness",
        "bolt_stiffness",
        "time_constant",
        "pressure_time_constant",
        "pressure_slew",
        "shut_off",
        "flow_max",
        "rate",
    }
)
_NOT_NEGATIVE = frozenset(
    {
        "polar",
        "to_coupling",
        "to_bearing",
        "coupling_stiffness",
        "coupling_damping",
        "unbalance",
        "damping",
        "clamp",
        "friction",
        "windage",
        "jacket_flow",
        "pressure_dead_time",
        "hold_up",
        "backlash",
        "roughness",
        "ambient",
    }
)


class AssemblyError(OrbitdError, ValueError):
    """A rig or a build that no machine can have."""

    exit_code = 2


def assemble(
    rig: RigData, build: Build, step_s: float, *, inlet_C: float | None = None, thermal: bool = True
) -> Plant:
    """Parameters of a healthy machine.

    Parameters
    ----------
    step_s
        Integration step, which the sensor lags are reckoned for.
    inlet_C
        Oil inlet temperature; the rig's own when None.
    thermal
        False holds the oil at the inlet temperature (isothermal results).

    Raises
    ------
    AssemblyError
        A number that is not finite, or a mass, stiffness, length ... that is not above zero.
    """
    plant = Plant(
        shaft=_shaft(rig, build),
        pedestal=_foot(rig, build, rig.foundation.pedestal, build.bolt[:4]),
        motor=_foot(rig, build, rig.foundation.motor, build.bolt[4:]),
        film=_film(rig, build, rig.oil.inlet_C if inlet_C is None else inlet_C, thermal),
        excite=_excite(rig, build),
        pickup=_pickup(rig, build, step_s),
        act=_actuator(rig, build),
    )
    _refuse_absurd(plant, rig)
    return plant


def _refuse_absurd(plant: Plant, rig: RigData) -> None:
    """Every number finite, and above zero or not below it where the equations need that."""
    for part, group in plant._asdict().items():
        for name, value in group._asdict().items():
            numbers = np.asarray(value, dtype=np.float64)
            where = f"{part}.{name} of rig {rig.name} = {value}"
            if not np.isfinite(numbers).all():
                raise AssemblyError(f"{where}: not finite; mend the rig's data or the build")
            if name in _POSITIVE and not (numbers > 0).all():
                raise AssemblyError(
                    f"{where}: must be above zero; mend the rig's data or the build"
                )
            if name in _NOT_NEGATIVE and not (numbers >= 0).all():
                raise AssemblyError(
                    f"{where}: must not be below zero; mend the rig's data or the build"
                )
    narrowest = rig.bearing.clearance_min_m + plant.film.wear
    if not narrowest > 0:
        raise AssemblyError(
            f"clearance error of the build = {plant.film.wear:g} m: leaves {narrowest:g} m of the "
            f"smallest clearance "
            f"of rig {rig.name}; must leave a gap"
        )


def rig_film(rig: RigData, fed: bool) -> Floats | FedLaw | PadLaw | PortLaw:
    """The tabulated film of ``rig``: between its pads, or with its openings where it has any; else
    unfed and periodic, or fed from its groove.

    Raises
    ------
    FilmError
        No table of that bearing is shipped, or the rig is not fed from one axial groove.
    """
    shape, bore = rig.bearing.length_m / (2 * rig.bearing.radius_m), PadBore.of(rig.bearing.pads)
    if bore is not None:
        if fed:
            raise FilmError(
                f"fed film of rig {rig.name}: the grooves between its pads are at ambient "
                "pressure, and no other is tabulated; take the periodic film"
            )
        if rig.supply.ports:
            raise FilmError(
                f"film of rig {rig.name}: feed ports between pads are not tabulated; the solver "
                "knows them (`orbitd rig show`), the rotor does not"
            )
        return PadTable.load(bore, shape).law
    if rig.supply.ports:
        return port_law(
            rig.supply.ports, rig.bearing.radius_m, rig.bearing.length_m, rig.oil.density_kg_m3
        )
    if not fed:
        return FilmTable.load(shape).coefficients
    groove = rig.supply.groove
    if groove is None:
        raise FilmError(
            f"fed film of rig {rig.name}: its feed is not one axial groove, and no other is "
            f"tabulated; take the "
            "periodic film, which knows no supply pressure"
        )
    return FedTable.load(shape, groove.width_rad, groove.length_share).law(groove.angle_rad)


def _actuator(rig: RigData, build: Build) -> ActuatorParameters:
    clearance, supply = rig.actuator, rig.supply
    return ActuatorParameters(
        rate=clearance.rate_m_per_s,
        time_constant=clearance.time_constant_s,
        backlash=clearance.backlash_m,
        pressure_dead_time=supply.dead_time_s * build.supply_delay,
        pressure_time_constant=supply.time_constant_s * build.supply_delay,
        pressure_slew=supply.slew_Pa_s / build.supply_delay,
        pressure_gain=1.0,
        shut_off=supply.shut_off_Pa * build.pump,
        flow_max=supply.flow_max_m3_s * build.pump,
        hold_up=supply.hold_up_s * build.pump,
    )


def _shaft(rig: RigData, build: Build) -> Shaft:
    r = rig.rotor
    return Shaft(
        mass=r.mass_kg * build.mass,
        diametral=r.diametral_inertia_kg_m2 * build.inertia,
        polar=r.polar_inertia_kg_m2 * build.inertia,
        to_coupling=r.coupling_to_cg_m,
        to_bearing=r.bearing_to_cg_m,
        coupling_stiffness=r.coupling_stiffness_N_m * build.coupling,
        coupling_damping=float(r.coupling_damping_N_s_m),
        unbalance=build.unbalance_kg_m,
        unbalance_angle=build.unbalance_angle_rad,
    )


def _foot(rig: RigData, build: Build, body: BoltedBody, bolt: Floats) -> Foot:
    f = rig.foundation
    stiffness = f.contact_stiffness_N_m / 4 * build.contact * bolt
    ratio = f.damping_ratio * build.damping
    return Foot(
        mass=body.mass_kg,
        inertia=body.inertia_kg_m2,
        depth=body.foot_below_cg_m,
        axis_height=body.axis_above_cg_m,
        x=four(body.bolt_x_m),
        stiffness=four(stiffness),
        damping=four(2 * ratio * np.sqrt(stiffness * body.mass_kg / 4)),
        clamp=(f.preload_N,) * 4,
        gap=(0.0,) * 4,
        tangential_share=f.tangential_share,
        friction=f.friction,
        bolt_stiffness=BOLT_STIFFNESS_SHARE * f.contact_stiffness_N_m / 4,
    )


def _film(rig: RigData, build: Build, inlet_C: float, thermal: bool) -> FilmParameters:
    oil = rig.oil
    pads = shape_of(PadBore.of(rig.bearing.pads))
    return FilmParameters(
        radius=rig.bearing.radius_m,
        length=rig.bearing.length_m,
        viscosity=oil.viscosity_Pa_s * build.viscosity,
        viscosity_slope=oil.slope_per_K,
        reference_C=oil.reference_C,
        inlet_C=float(inlet_C),
        heat_capacity_per_m3=float(oil.density_kg_m3 * oil.heat_capacity_J_kgK),
        thermal_capacity=rig.thermal.capacity_J_K,
        jacket_flow=rig.thermal.jacket_flow_m3_s,
        share=1.0,
        wear=build.clearance_error_m,
        drop=0.0,
        pressure_needed=rig.supply.full_film_Pa,
        windage=rig.windage_W_s3,
        thermal=1.0 if thermal else 0.0,
        pads=float(pads.pads),
        pad_angle=pads.angle,
        pad_half_arc=pads.half_arc,
        pad_shift=pads.shift,
        pad_nearest=pads.nearest,
    )


def _excite(rig: RigData, build: Build) -> Excite:
    e = rig.excitation
    return Excite(
        motor_unbalance=e.motor_unbalance_kg_m * build.excitation,
        motor_angle=build.motor_angle_rad,
        line_force=e.line_force_N * build.excitation,
        line_rad_s=2 * math.pi * e.line_hz,
        tooth_force=e.tooth_force_N * build.excitation,
        teeth=float(e.teeth),
        ambient=e.ambient_force_rms_N * build.excitation,
        misaligned_kg_m=0.0,
        misaligned_N_m=0.0,
        rub_gap=0.0,
        rub_clearance=RUB_CLEARANCE_M,
        rub_stiffness=0.0,
        rub_friction=0.2,
    )


def _pickup(rig: RigData, build: Build, step_s: float) -> Pickup:
    lags = [-math.expm1(-2 * math.pi * c.bandwidth_hz * step_s) for c in rig.channels]
    cosine = build.runout_m * np.cos(build.runout_phase_rad)
    sine = -build.runout_m * np.sin(build.runout_phase_rad)
    first, second = rig.probes.tolist()
    return Pickup(
        probe=((first[0], first[1]), (second[0], second[1])),
        mode_rad_s=three(build.housing_rad_s),
        mode_damping=_MODE_DAMPING,
        mode_gain=_MODE_GAIN,
        roughness=build.roughness_m,
        sound=_SOUND_PA_S_M,
        tooth_sound=_TOOTH_SOUND_PA * build.excitation,
        lag_share=(*four(lags[:4]), *four(lags[4:])),
        runout_cos=(three(cosine[0]), three(cosine[1])),
        runout_sin=(three(sine[0]), three(sine[1])),
        contact=contact_parameters(rig.contact),
    )


def contact_parameters(circuit: ContactCircuit | None) -> ContactParameters:
    """The contact circuit for the kernel; without one the channel stands at 0 V."""
    if circuit is None:
        return ContactParameters(0.0, 1.0, 1.0)
    return ContactParameters(circuit.circuit_V, circuit.circuit_ohm, circuit.film_ohm_per_m)
