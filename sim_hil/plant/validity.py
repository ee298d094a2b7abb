"""What a run may be asked for, and where its figures are not proven."""

from __future__ import annotations

import math
from typing import Final

from sim_hil.film.domain import domain
from sim_hil.rigs import RigData

FEWEST_STEPS: Final = 20
"""Steps a turn below which a run is refused."""

ENOUGH_STEPS: Final = 60
"""Steps a turn that orbits need: 0.5 % of half the step."""

OVERSPEED: Final = 3.0
"""Of the greatest declared speed: beyond it no figure of the rig's drawing holds, a rigid rotor
least of all."""

_RPM: Final = 30 / math.pi


def refusal(rig: RigData, slowest_rad_s: float, fastest_rad_s: float, step_s: float) -> str:
    """Why a run between those speeds, of any sign, is refused, with value and limit; empty when it
    is not."""
    speed_rad_s = max(abs(slowest_rad_s), abs(fastest_rad_s))
    rpm, most_rpm = speed_rad_s * _RPM, OVERSPEED * rig.speed_max_rpm
    pads = rig.bearing.pads
    if slowest_rad_s < 0.0 and pads is not None and pads.offset_share != 0.5:
        return (
            f"speed = {slowest_rad_s * _RPM:g} rpm: backwards, and pads.offset_share = "
            f"{pads.offset_share:g} says which way the shaft turns; the film is tabulated for that "
            "way alone"
        )
    if rpm > most_rpm:
        return (
            f"speed = {rpm:g} rpm: above {most_rpm:g}, {OVERSPEED:g} times the greatest declared "
            f"speed of rig {rig.name} ({rig.speed_max_rpm:g} rpm), beyond which its drawing, a "
            "rigid rotor, says nothing; take a slower duty, or describe the machine for it"
        )
    steps = steps_a_turn(speed_rad_s, step_s)
    if steps < FEWEST_STEPS:
        return (
            f"step = {step_s:g} s: {steps:.3g} steps a turn at {rpm:g} rpm, at least "
            f"{FEWEST_STEPS}; take at most {2 * math.pi / (FEWEST_STEPS * speed_rad_s):.3g} s"
        )
    return ""


def doubts(
    rig: RigData, speed_rad_s: float, clearance_m: float, viscosity_Pa_s: float, step_s: float
) -> tuple[str, ...]:
    """What is not proven of a run that got as fast and as wide as that; empty where all is."""
    found = domain(rig, speed_rad_s * _RPM, clearance_m, viscosity_Pa_s).warnings
    steps = steps_a_turn(speed_rad_s, step_s)
    if steps < ENOUGH_STEPS:
        found += (f"few steps: {steps:.3g} a turn, below {ENOUGH_STEPS}",)
    return found


def steps_a_turn(speed_rad_s: float, step_s: float) -> float:
    """Steps of a turn; infinite at standstill."""
    return 2 * math.pi / (abs(speed_rad_s) * step_s) if speed_rad_s else math.inf


def step_for(rig: RigData, most_s: float) -> float:
    """The longest step, at most ``most_s``, that is enough at the rig's greatest speed."""
    return min(most_s, 60.0 / (rig.speed_max_rpm * ENOUGH_STEPS))
