"""The simulated oil supply: dead time, lag, slew, the pump's curve, and what is left after its
loss."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from sim_hil.faults import apply_machine_faults
from sim_hil.plant.build import Build
from sim_hil.rigs import RigData, load_rig
from sim_hil.rotor.assembly import assemble
from sim_hil.rotor.kernel import move_supply
from sim_hil.rotor.parameters import FLOW, PRESSURE, ActuatorParameters, Floats, new_state

RIG = load_rig("bench")
STEP_S = 1e-3


def supply(rig: RigData = RIG, lost: float = 0.0, **changes: float) -> ActuatorParameters:
    """Of the drawing, with ``changes``, and that share of the pump lost."""
    build = Build.nominal(rig)
    plant = assemble(rig, build, 4e-5)
    plant = apply_machine_faults(plant, rig, build, {"pressure_loss": lost})
    return plant.act._replace(**changes)


def played(
    act: ActuatorParameters,
    target_Pa: float,
    seconds: float,
    start_Pa: float = 1e5,
    flow: float = 0,
) -> Floats:
    """Pressure, Pa, at every millisecond after a step of the target."""
    scalar = new_state(1, 60e-6, start_Pa, 40.0, 0.0).scalar
    scalar[FLOW] = flow
    rows = np.empty(round(seconds / STEP_S))
    for i in range(rows.size):
        move_supply(act, scalar, target_Pa, STEP_S)
        rows[i] = scalar[PRESSURE]
    return rows


def test_the_kernel_is_given_what_the_folder_says() -> None:
    act = supply()
    assert act[3:] == pytest.approx((0.05, 0.2, 5e5, 1.0, 6e5, 2.5e-4, 8.0))


def test_a_small_step_comes_after_the_dead_time_and_with_the_lag() -> None:
    p = played(supply(), 1.1e5, 2.0)
    moved = np.flatnonzero(p != 1e5)[0] * STEP_S
    assert moved == pytest.approx(0.05, abs=0.05 / 16 + STEP_S)
    at = round((moved + 0.2) / STEP_S)
    assert p[at] == pytest.approx(1e5 + 1e4 * (1.0 - math.exp(-1.0)), rel=1e-3)
    assert p[-1] == pytest.approx(1.1e5, rel=1e-3)
    down = played(supply(), 0.9e5, 2.0)
    np.testing.assert_allclose(p - 1e5, 1e5 - down, atol=1e-6)


def test_a_large_step_keeps_the_slew() -> None:
    p = played(supply(), 3e5, 2.0)
    assert np.diff(p).max() == pytest.approx(5e5 * STEP_S)
    assert p[-1] == pytest.approx(3e5, rel=1e-2)


def test_without_a_dead_time_the_target_counts_at_once() -> None:
    p = played(supply(pressure_dead_time=0.0, pressure_time_constant=0.1), 1.1e5, 0.2)
    np.testing.assert_allclose(
        p, 1e5 + 1e4 * (1.0 - np.exp(-STEP_S / 0.1 * np.arange(1, 201))), rtol=1e-9
    )


@pytest.mark.parametrize(("flow", "reached"), [(5e-5, 3e5), (2e-4, 1.2e5), (4e-4, 0.0)])
def test_the_pump_gives_less_at_more_flow(flow: float, reached: float) -> None:
    p = played(supply(hold_up=0.0), 3e5, 4.0, flow=flow)
    assert p[-1] == pytest.approx(reached, abs=1e-3 * 3e5)


def test_after_the_loss_of_the_pump_the_accumulator_feeds() -> None:
    p = played(supply(lost=1.0), 1e5, 8.0)
    assert p[-1] == pytest.approx(1e5 * math.exp(-1.0), rel=1e-3)
    at_once = played(supply(lost=1.0, hold_up=0.0), 1e5, 1.0)
    assert at_once[-1] == pytest.approx(1e5 * math.exp(-1.0 / 0.2), rel=1e-2)
    # a lower target still opens the valve
    lowered = played(supply(lost=1.0), 0.5e5, 1.0)
    assert lowered[-1] < 0.51e5


def test_builds_differ_within_the_declared_shares_and_by_nothing_else() -> None:
    builds = [Build.of_seed(RIG, seed) for seed in range(200)]
    delays, pumps = (
        np.array([getattr(b, key) for b in builds]) for key in ("supply_delay", "pump")
    )
    assert 0.8 <= delays.min() < 0.82 < 1.18 < delays.max() <= 1.2
    assert 0.85 <= pumps.min() < 0.87 < 1.13 < pumps.max() <= 1.15
    exact = replace(RIG, supply=replace(RIG.supply, error_share=0.0, pump_error_share=0.0))
    one, other = Build.of_seed(RIG, 3), Build.of_seed(exact, 3)
    assert (one.mass, one.motor_angle_rad) == (other.mass, other.motor_angle_rad)
    assert (other.supply_delay, other.pump) == (1.0, 1.0)
