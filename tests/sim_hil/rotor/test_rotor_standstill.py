"""The rotor alone where its film is not smooth: standstill, a closing wall, stop and start,
reversal."""

import numpy as np
import pytest

from sim_hil.film.table_kernel import CONTACT_STIFFNESS_N_M, EPS_TABLE
from sim_hil.plant.duty import Duty
from sim_hil.plant.response import SimulationError, Trajectory, simulate
from sim_hil.rigs import load_rig

RIG = load_rig("bench")
NOMINAL_M = RIG.bearing.clearance_nominal_m


def beyond_film_m(run: Trajectory) -> float:
    e = np.hypot(*run.position_m.T)
    return float((e - EPS_TABLE * run.column("clearance_m")).max())


@pytest.mark.parametrize("dt_s", [50e-6, 25e-6])
@pytest.mark.parametrize("load_N", [100.0, 900.0])
def test_a_resting_journal_sinks_onto_the_asperities(load_N: float, dt_s: float) -> None:
    run = simulate(RIG, Duty.hold(0.0, load_N, 2.5), clearance=50e-6, dt_s=dt_s)
    assert beyond_film_m(run) == pytest.approx(load_N / CONTACT_STIFFNESS_N_M, rel=0.2)
    assert np.ptp(run.last(0.1).position_m, axis=0).max() < 50e-9
    assert abs(run.last(0.1).power_W).max() < 1e-3


@pytest.mark.parametrize("dt_s", [50e-6, 25e-6])
def test_a_closing_wall_carries_the_resting_journal_along(dt_s: float) -> None:
    run = simulate(
        RIG, Duty.hold(0.0, 100.0, 2.0), clearance=lambda t: 160e-6 if t < 0.3 else 40e-6, dt_s=dt_s
    )
    assert run.position_m[-1, 1] == pytest.approx(
        -EPS_TABLE * run.column("clearance_m")[-1], abs=1e-6
    )
    assert beyond_film_m(run) < 1.2 * 100.0 / CONTACT_STIFFNESS_N_M
    assert abs(run.position_m[:, 0]).max() < 1e-9


def test_it_stops_and_starts_again_and_ends_where_it_began() -> None:
    duty = Duty((0.0, 0.5, 1.0, 1.5, 1.8), (1500.0, 0.0, 0.0, 1500.0, 1500.0), (300.0,) * 5)
    run = simulate(RIG, duty, clearance=40e-6, thermal=False)
    assert [event.name for event in run.events] == ["contact", "release"]
    np.testing.assert_allclose(run.position_m[-1], run.position_m[0], atol=0.1e-6)


def test_backward_rotation_is_the_mirror_image() -> None:
    forward, backward = (
        simulate(RIG, Duty.hold(rpm, 200.0, 0.6), clearance=NOMINAL_M, thermal=False).last(0.2)
        for rpm in (3000.0, -3000.0)
    )
    np.testing.assert_allclose(
        backward.position_m.mean(axis=0) * [-1, 1], forward.position_m.mean(axis=0), atol=0.02e-6
    )
    assert backward.power_W.mean() == pytest.approx(forward.power_W.mean(), rel=1e-3)


def test_reversal_passes_through_zero() -> None:
    run = simulate(
        RIG, Duty((0.0, 0.6, 0.8), (3000.0, -3000.0, -3000.0), (200.0,) * 3), clearance=NOMINAL_M
    )
    assert run.position_m[-1, 0] < -20e-6
    assert run.min_film_m.min() > 0
    assert run.power_W.min() > -1.0


def test_a_start_from_rest_lies_on_the_wall_and_rubs() -> None:
    duty = Duty((0.0, 1.0), (0.0, 3000.0), (300.0, 300.0))
    run = simulate(RIG, duty, clearance=NOMINAL_M, thermal=False)
    depth_m = 300.0 / CONTACT_STIFFNESS_N_M
    # the friction of the first 200 us rolls it aside and lifts it by 0.08 um (step-converged)
    assert np.hypot(*run.position_m[0]) == pytest.approx(
        EPS_TABLE * NOMINAL_M + depth_m, abs=0.1e-6
    )
    assert [event.name for event in run.events] == ["contact", "release"]
    assert run.events[0].time_s == run.time_s[0]
    assert run.events[1].time_s > 0.05
    rubbing = run.time_s < 0.9 * run.events[1].time_s
    speed = run.time_s * 3000.0 * np.pi / 30.0
    friction_N = run.power_W[rubbing][1:] / (speed[rubbing][1:] * RIG.bearing.radius_m)
    assert 5.0 < friction_N.max() < 60.0  # Coulomb of a tenth, the film carries the more the faster


def test_a_stop_ends_on_the_wall() -> None:
    duty = Duty((0.0, 0.5, 2.5), (3000.0, 0.0, 0.0), (300.0,) * 3)
    run = simulate(RIG, duty, clearance=NOMINAL_M, thermal=False)
    assert [event.name for event in run.events] == ["contact"]
    assert beyond_film_m(run.last(0.1)) == pytest.approx(300.0 / CONTACT_STIFFNESS_N_M, rel=0.1)
    assert run.position_m[-1, 1] < 0
    assert abs(run.position_m[-1, 0]) < 0.2 * NOMINAL_M


@pytest.mark.parametrize("rpm", [0.0, 3000.0])
def test_a_load_upwards_is_the_mirror_image(rpm: float) -> None:
    down, up = (
        simulate(RIG, Duty.hold(rpm, load_N, 0.2), clearance=NOMINAL_M, thermal=False)
        for load_N in (100.0, -100.0)
    )
    np.testing.assert_allclose(up.position_m[0], -down.position_m[0], atol=0.05e-6)
    np.testing.assert_allclose(
        up.last(0.1).position_m.mean(axis=0), -down.last(0.1).position_m.mean(axis=0), atol=0.1e-6
    )


def test_without_load_it_stands_in_the_middle() -> None:
    for rpm in (0.0, 3000.0):
        run = simulate(RIG, Duty.hold(rpm, 0.0, 0.01), clearance=NOMINAL_M, thermal=False)
        assert np.hypot(*run.position_m[0]) < 0.01 * NOMINAL_M


def test_more_load_than_the_film_carries_begins_on_the_wall() -> None:
    run = simulate(RIG, Duty.hold(30.0, 3000.0, 0.1), clearance=NOMINAL_M, thermal=False)
    assert (run.min_film_m < (1.0 - EPS_TABLE) * NOMINAL_M).all()


@pytest.mark.parametrize(
    ("rpm", "dt_s", "named"),
    [(1e6, 50e-6, r"above 36000, 3 times"), (1e6, 1e-6, "above 36000"), (3e4, 2e-4, "10 steps a")],
)
def test_a_duty_beyond_the_rig_is_refused(rpm: float, dt_s: float, named: str) -> None:
    with pytest.raises(SimulationError, match=named):
        simulate(RIG, Duty.hold(rpm, 100.0, 0.1), clearance=NOMINAL_M, dt_s=dt_s)


def test_a_run_outside_the_domain_says_so() -> None:
    inside = simulate(RIG, Duty.hold(3000.0, 100.0, 0.05), clearance=NOMINAL_M)
    assert inside.warnings == ()
    fast = simulate(RIG, Duty.hold(30000.0, 100.0, 0.05), clearance=160e-6)
    assert [text.split(":")[0] for text in fast.warnings] == [
        "not laminar",
        "oil inertia counts",
        "few steps",
    ]
