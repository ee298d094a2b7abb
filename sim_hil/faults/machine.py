"""Faults of the machine: each changes the parameters of a healthy plant.

Severities as the rig's task fixes some of them: balance grade G for unbalance, percent
of preload left for bolts (100 is healthy); 0 (healthy) to 1 for the rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from sim_hil.plant.build import Build, unbalance_of_grade
from sim_hil.rigs import RigData
from sim_hil.rotor.parameters import Foot, Four, Plant, four

LEAST_CONTACT_SHARE = 0.1
PRELOAD_EXPONENT = 1.0
RUB_STIFFNESS_N_M = 1e8
RUB_GAP_M = (10e-6, -2e-6)
COUPLING_SLEEVE_KG = 0.4
OFFSET_M = 0.2e-3
SIDE_LOAD_N = 30.0
WEAR_M = 6e-6
STARVED_SHARE = 0.5

BOLT_A: Final = 0
BOLT_B: Final = 1
BOLT_C: Final = 2

Apply = Callable[[Plant, RigData, Build, float], Plant]


@dataclass(frozen=True)
class MachineFault:
    """How a fault changes the plant, the severities it takes, and the one that means healthy."""

    apply: Apply
    severity_range: tuple[float, float]
    healthy: float


def loosen(foot: Foot, bolt: int, percent_left: float, gap_m: float) -> Foot:
    """One bolt of ``foot`` with ``percent_left`` of its preload.

    The joint's stiffness falls with its pressure, ``k = k_0 (0.1 + 0.9 r)`` with ``r`` the share of
    preload left (rough contact: stiffness proportional to pressure, Greenwood and Williamson
    1966), its clamp is ``r P_0`` and the bolt has backed off by ``(1 - r) g``; see
    :mod:`sim_hil.rotor.joints` for the contact law that turns this into truncation and impacts.
    """
    r = percent_left / 100.0
    share = LEAST_CONTACT_SHARE + (1 - LEAST_CONTACT_SHARE) * r**PRELOAD_EXPONENT
    gap = list(foot.gap)
    gap[bolt] = (1 - r) * gap_m
    return foot._replace(
        stiffness=_scaled(foot.stiffness, bolt, share),
        damping=_scaled(foot.damping, bolt, share**0.5),
        clamp=_scaled(foot.clamp, bolt, r),
        gap=four(gap),
    )


def _scaled(values: Four, index: int, factor: float) -> Four:
    return four(x * factor if i == index else x for i, x in enumerate(values))


def unbalance(plant: Plant, rig: RigData, build: Build, severity: float) -> Plant:
    """Rotating force ``U omega^2`` with ``U`` of balance grade G = ``severity`` at 6000 rpm (ISO
    21940-11).

    Range G 0.4 to 40; normal builds lie between 0.4 and 6.3.  Signature: order 1, forward, grows
    with speed squared.
    """
    return plant._replace(shaft=plant.shaft._replace(unbalance=unbalance_of_grade(rig, severity)))


def pedestal_bolt(plant: Plant, rig: RigData, build: Build, severity: float) -> Plant:
    """Pedestal bolt A with ``severity`` percent of its preload left (:func:`loosen`), 100 to 0.

    Signature: roll joins vertical and lateral motion, modes fall; near 0 %: harmonics and a
    truncated wave.
    """
    return plant._replace(
        pedestal=loosen(plant.pedestal, BOLT_A, severity, float(build.bolt_gap_m[BOLT_A]))
    )


def pedestal_two_bolts(plant: Plant, rig: RigData, build: Build, severity: float) -> Plant:
    """Pedestal bolts A and B, each with ``severity`` percent of preload left, 100 to 0
    (:func:`loosen`)."""
    one = pedestal_bolt(plant, rig, build, severity)
    return one._replace(
        pedestal=loosen(one.pedestal, BOLT_B, severity, float(build.bolt_gap_m[BOLT_B]))
    )


def pedestal_bolt_c(plant: Plant, rig: RigData, build: Build, severity: float) -> Plant:
    """A pedestal bolt on the other side, no class of the classifier (:func:`loosen`), 100 to 0
    percent."""
    return plant._replace(
        pedestal=loosen(plant.pedestal, BOLT_C, severity, float(build.bolt_gap_m[BOLT_C]))
    )


def motor_bolt(plant: Plant, rig: RigData, build: Build, severity: float) -> Plant:
    """Motor bolt with ``severity`` percent of preload left (:func:`loosen`), 100 to 0: shows at the
    motor."""
    return plant._replace(motor=loosen(plant.motor, 0, severity, float(build.bolt_gap_m[4])))


def pedestal_and_motor_bolt(plant: Plant, rig: RigData, build: Build, severity: float) -> Plant:
    """Pedestal bolt A and the motor bolt, each with ``severity`` percent of preload left."""
    return motor_bolt(pedestal_bolt(plant, rig, build, severity), rig, build, severity)


def misalignment(plant: Plant, rig: RigData, build: Build, severity: float) -> Plant:
    """Coupling misalignment: order 2 at the coupling and a steady side load, both in proportion to
    ``severity``.

    Parallel offset (0.2 mm at 1): the loose member of a double-slider coupling runs round on a
    circle whose diameter is the offset, twice a turn, ``F = m_s (offset / 2) (2 omega)^2`` with
    ``m_s`` = 0.4 kg; gear and disc couplings show the same order (Gibbons, Coupling misalignment
    forces, 1976; Dewell and Mitchell 1984).  Angular offset: a steady bending moment tilts the
    rotor and loads the bearing from the side, 30 N at 1.  Masses and sizes assumed.
    """
    side_N_m = SIDE_LOAD_N * (rig.rotor.coupling_to_cg_m + rig.rotor.bearing_to_cg_m) * severity
    spinning_kg_m = 0.5 * COUPLING_SLEEVE_KG * OFFSET_M * severity
    return plant._replace(
        excite=plant.excite._replace(misaligned_kg_m=spinning_kg_m, misaligned_N_m=side_N_m)
    )


def rub(plant: Plant, rig: RigData, build: Build, severity: float) -> Plant:
    """Partial rub (:mod:`sim_hil.rotor.stator`): a seal comes down on the shaft as ``severity``
    goes from 0 to 1.

    Its gap above where the shaft ran before goes from 10 um to -2 um (pressed on), 100 MN/m,
    friction 0.2. Signature: orders 2 and up where the orbit touches (most of all in the housing's
    acceleration), backward components, friction power; pressed on, the orbit is held.  Fractions of
    the speed need less damping than here.
    """
    light, hard = RUB_GAP_M
    gap = light + (hard - light) * severity
    stiffness = RUB_STIFFNESS_N_M if severity > 0 else 0.0
    return plant._replace(excite=plant.excite._replace(rub_gap=gap, rub_stiffness=stiffness))


def starvation(plant: Plant, rig: RigData, build: Build, severity: float) -> Plant:
    """Oil starvation: the filled share of the film falls to ``1 - 0.5 severity``
    (:mod:`sim_hil.rotor.bearing`).

    Signature: the film thins (contact voltage), the journal sinks towards the load, less oil takes
    the heat away.
    """
    return plant._replace(film=plant.film._replace(share=1 - STARVED_SHARE * severity))


def wear(plant: Plant, rig: RigData, build: Build, severity: float) -> Plant:
    """Bearing wear: a flat worn by the journal into the loaded side; ``6 um severity`` of mean
    radial wear (volume).

    The profile is Dufrane's (Dufrane, Kannel and McCloskey 1983): ``delta = d - c (1 - cos psi)``
    from its deepest point, where the journal's own circle cuts the bore; ``d = 0.5 c`` at 1.  The
    film takes the profile's mean and first order: a cylinder that is wider and whose middle has
    moved towards the load (:func:`worn_bore`).  Beside a short bearing with the true profile (d =
    0.1 to 0.5 c, eccentricity ratios 0.3 to 0.7) friction is within 5 %, but the journal sinks only
    0.5 to 0.8 as far, and the smallest film is 1 to 20 % too thick: the flat is lost.
    """
    wider = WEAR_M * severity
    _, drop = worn_bore(wider, rig.bearing.clearance_nominal_m)
    return plant._replace(film=plant.film._replace(wear=plant.film.wear + wider, drop=drop))


def worn_bore(mean_m: float, clearance_m: float) -> tuple[float, float]:
    """Deepest point and first order of a Dufrane profile with that mean over the turn, m.

    With ``E`` the half angle of the flat: depth ``c (1 - cos E)``, mean ``c (sin E - E cos E) /
    pi``, first order ``c (E - sin E cos E) / pi``.

    Parameters
    ----------
    mean_m, clearance_m
        Mean radial wear, and the radial clearance in which the journal wore it.
    """
    wanted = math.pi * mean_m / clearance_m
    edge = (3 * wanted) ** (1 / 3)
    for _ in range(4 if wanted > 0 else 0):
        edge -= (math.sin(edge) - edge * math.cos(edge) - wanted) / (edge * math.sin(edge))
    first = (edge - math.sin(edge) * math.cos(edge)) / math.pi
    return clearance_m * (1 - math.cos(edge)), clearance_m * first


def pressure_loss(plant: Plant, rig: RigData, build: Build, severity: float) -> Plant:
    """Supply pressure falls to ``1 - severity`` of its set point; below half the minimum the film
    starves."""
    return plant._replace(act=plant.act._replace(pressure_gain=1 - severity))


_PERCENT = (0.0, 100.0)
_SHARE = (0.0, 1.0)

MACHINE_FAULTS: Final[dict[str, MachineFault]] = {
    "unbalance": MachineFault(unbalance, (0.4, 100.0), 0.4),
    "pedestal_bolt": MachineFault(pedestal_bolt, _PERCENT, 100.0),
    "pedestal_two_bolts": MachineFault(pedestal_two_bolts, _PERCENT, 100.0),
    "motor_bolt": MachineFault(motor_bolt, _PERCENT, 100.0),
    "pedestal_and_motor_bolt": MachineFault(pedestal_and_motor_bolt, _PERCENT, 100.0),
    "pedestal_bolt_c": MachineFault(pedestal_bolt_c, _PERCENT, 100.0),
    "misalignment": MachineFault(misalignment, _SHARE, 0.0),
    "rub": MachineFault(rub, _SHARE, 0.0),
    "starvation": MachineFault(starvation, _SHARE, 0.0),
    "wear": MachineFault(wear, _SHARE, 0.0),
    "pressure_loss": MachineFault(pressure_loss, _SHARE, 0.0),
}


def apply_machine_faults(
    plant: Plant, rig: RigData, build: Build, faults: dict[str, float]
) -> Plant:
    """``plant`` with every machine fault of ``faults``; sensor faults are left to the sensors."""
    for name, severity in faults.items():
        if name in MACHINE_FAULTS:
            plant = MACHINE_FAULTS[name].apply(plant, rig, build, severity)
    return plant
