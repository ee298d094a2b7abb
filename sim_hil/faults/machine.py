"""Faults of the machine: each changes the parameters of a healthy plant.

Severities are those of ``classes.json`` where it fixes them: balance grade G for unbalance, percent of
preload left for bolts (100 is healthy); 0 (healthy) to 1 for the rest.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from sim_hil.build import Build, unbalance_of_grade
from sim_hil.rigs import RigData
from sim_hil.rotor.parameters import Foot, Four, Plant, four

LEAST_CONTACT_SHARE = 0.1
PRELOAD_EXPONENT = 1.0
RUB_STIFFNESS_N_M = 2e7
RUB_GAP_M = 20e-6
MISALIGNMENT_N = 60.0
WEAR_M = 30e-6
STARVED_SHARE = 0.7

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
    """Rotating force ``U omega^2`` with ``U`` of balance grade G = ``severity`` at 6000 rpm (ISO 21940-11).

    Range G 0.4 to 40; normal builds lie between 0.4 and 6.3.  Signature: order 1, forward, grows with speed squared.
    """
    return plant._replace(shaft=plant.shaft._replace(unbalance=unbalance_of_grade(rig, severity)))


def pedestal_bolt(plant: Plant, rig: RigData, build: Build, severity: float) -> Plant:
    """Pedestal bolt A with ``severity`` percent of its preload left (:func:`loosen`), 100 to 0.

    Signature: roll joins vertical and lateral motion, modes fall; near 0 %: harmonics and a truncated wave.
    """
    return plant._replace(pedestal=loosen(plant.pedestal, BOLT_A, severity, float(build.bolt_gap_m[BOLT_A])))


def pedestal_two_bolts(plant: Plant, rig: RigData, build: Build, severity: float) -> Plant:
    """Pedestal bolts A and B, each with ``severity`` percent of preload left, 100 to 0 (:func:`loosen`)."""
    one = pedestal_bolt(plant, rig, build, severity)
    return one._replace(pedestal=loosen(one.pedestal, BOLT_B, severity, float(build.bolt_gap_m[BOLT_B])))


def pedestal_bolt_c(plant: Plant, rig: RigData, build: Build, severity: float) -> Plant:
    """A pedestal bolt on the other side, no class of the classifier (:func:`loosen`), 100 to 0 percent."""
    return plant._replace(pedestal=loosen(plant.pedestal, BOLT_C, severity, float(build.bolt_gap_m[BOLT_C])))


def motor_bolt(plant: Plant, rig: RigData, build: Build, severity: float) -> Plant:
    """Motor bolt with ``severity`` percent of preload left (:func:`loosen`), 100 to 0: shows at the motor."""
    return plant._replace(motor=loosen(plant.motor, 0, severity, float(build.bolt_gap_m[4])))


def pedestal_and_motor_bolt(plant: Plant, rig: RigData, build: Build, severity: float) -> Plant:
    """Pedestal bolt A and the motor bolt, each with ``severity`` percent of preload left."""
    return motor_bolt(pedestal_bolt(plant, rig, build, severity), rig, build, severity)


def misalignment(plant: Plant, rig: RigData, build: Build, severity: float) -> Plant:
    """Coupling misalignment: rotating force at the coupling in order 2 (60 N at 1), a third of it in order 1.

    Phenomenological, after Gibbons (1976) and Sekhar and Prabhu (1995): the second order dominates.
    """
    return plant._replace(excite=plant.excite._replace(misalignment=MISALIGNMENT_N * severity))


def rub(plant: Plant, rig: RigData, build: Build, severity: float) -> Plant:
    """Partial rub: a seal ``20 um (1 - severity)`` above where the shaft ran before, 20 MN/m, friction 0.2.

    One-sided, piecewise linear contact with dry friction against the rotation (Muszynska 1989).  On a strongly
    damped film it mostly restrains and shifts the orbit; harmonics stay weak.
    """
    gap = RUB_GAP_M * (1 - severity)
    stiffness = RUB_STIFFNESS_N_M if severity > 0 else 0.0
    return plant._replace(excite=plant.excite._replace(rub_gap=gap, rub_stiffness=stiffness))


def starvation(plant: Plant, rig: RigData, build: Build, severity: float) -> Plant:
    """Oil starvation: the filled share of the film falls to ``1 - 0.7 severity``.

    Force and friction fall alike (one factor on the viscosity, the first-order effect of a shorter film).
    """
    return plant._replace(film=plant.film._replace(share=1 - STARVED_SHARE * severity))


def wear(plant: Plant, rig: RigData, build: Build, severity: float) -> Plant:
    """Bearing wear: up to 30 um of radial clearance more than the actuator reports (uniform wear)."""
    return plant._replace(film=plant.film._replace(wear=plant.film.wear + WEAR_M * severity))


def pressure_loss(plant: Plant, rig: RigData, build: Build, severity: float) -> Plant:
    """Supply pressure falls to ``1 - severity`` of its set point; below half the minimum the film starves."""
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


def apply_machine_faults(plant: Plant, rig: RigData, build: Build, faults: dict[str, float]) -> Plant:
    """``plant`` with every machine fault of ``faults``; sensor faults are left to the sensors."""
    for name, severity in faults.items():
        if name in MACHINE_FAULTS:
            plant = MACHINE_FAULTS[name].apply(plant, rig, build, severity)
    return plant
