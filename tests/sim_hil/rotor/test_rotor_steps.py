"""The step: whirl that fills the clearance, and a journal at the wall, against an eighth of it."""

import numpy as np
import pytest

from sim_hil.bench.rotors import WHIRL_STEP_S, whirl
from sim_hil.plant.build import Build
from sim_hil.plant.duty import Duty
from sim_hil.plant.machine import MAX_STEP_S, SimulatedMachine
from sim_hil.plant.runs import run
from sim_hil.rigs import load_rig
from sim_hil.rotor.parameters import TRUTH_COLUMNS

RIG = load_rig("bench")


@pytest.mark.parametrize("clearance_um", [80, 120, 160])
def test_whirl_at_sixty_steps_a_turn(clearance_um: int) -> None:
    coarse, fine = (whirl(clearance_um * 1e-6, WHIRL_STEP_S / cut) for cut in (1, 8))
    assert fine.radius_m > 0.55 * clearance_um * 1e-6
    assert coarse.radius_m == pytest.approx(fine.radius_m, rel=0.005)
    assert coarse.power_W == pytest.approx(fine.power_W, rel=0.01)


def test_a_journal_thrown_to_the_wall_comes_back() -> None:
    """Errors of the step must not hold it there: at 40 um the equilibrium is stable."""
    coarse, fine = (whirl(40e-6, WHIRL_STEP_S / cut, start=0.987) for cut in (1, 8))
    assert fine.radius_m < 3e-6
    assert coarse.radius_m == pytest.approx(fine.radius_m, abs=0.1e-6)
    assert coarse.power_W == pytest.approx(fine.power_W, rel=1e-3)


@pytest.mark.parametrize("clearance_um", [80, 160])
def test_whirl_of_the_whole_rig(clearance_um: int) -> None:
    figures = []
    for step_s in (MAX_STEP_S, MAX_STEP_S / 8):
        machine = SimulatedMachine(
            RIG,
            Build.nominal(RIG),
            0,
            clearance_m=clearance_um * 1e-6,
            thermal=False,
            max_step_s=step_s,
        )
        truth = run(machine, Duty.hold(12000, 30, 0.8), 0.8, clearance=clearance_um * 1e-6).truth
        last = truth[len(truth) // 2 :]
        e = [last[:, TRUTH_COLUMNS.index(f"eccentricity_{axis}_m")] for axis in "xy"]
        power = last[:, TRUTH_COLUMNS.index("shaft_power_W")]
        figures.append((np.hypot(*e).mean(), power.mean()))
    (radius, power), (fine_radius, fine_power) = figures
    assert fine_radius > 0.55 * clearance_um * 1e-6
    assert radius == pytest.approx(fine_radius, rel=0.005)
    assert power == pytest.approx(fine_power, rel=0.01)
