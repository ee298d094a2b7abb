"""The rotor of equation (2): modes, integrator, films, and what it refuses."""

import dataclasses

import numpy as np
import pytest

import sim_hil
from sim_hil import Support, modes, simulate
from sim_hil.film.table import FilmTable
from sim_hil.plant.build import Build
from sim_hil.plant.duty import Duty
from sim_hil.plant.response import SimulationError, equilibrium_at
from sim_hil.rotor.assembly import assemble
from sim_hil.rotor.modes import ModesError

BENCH = sim_hil.load_rig("bench")


def hold(rpm, load, seconds=0.3, **options):
    return simulate(BENCH, Duty.hold(rpm, load, seconds), thermal=False, **options)


def test_simulate_is_the_function_whatever_was_imported_before():
    import sim_hil.plant.runs

    assert callable(sim_hil.simulate)
    assert callable(sim_hil.power_map)


def test_gyroscopic_moment_splits_the_tilting_mode():
    found = modes(6.0, 0.06, 0.004, [Support(-0.25, 1e6), Support(0.25, 1e6)], 1000.0)
    half = 0.004 * 1000 / 0.06 / 2
    root = np.sqrt(half**2 + 2e6 * 0.25**2 / 0.06)
    np.testing.assert_allclose(found.frequency_rad_s[2:], [root - half, root + half], rtol=1e-9)
    assert found.forward[2:].tolist() == [-1, 1]
    np.testing.assert_allclose(found.damping_ratio, 0, atol=1e-9)


def test_modes_take_plain_tuples_and_damping():
    found = modes(2.0, 0.06, 0.0, [(0.0, 2e4, 40.0)], 0.0)
    assert found.damping_ratio.max() == pytest.approx(40 / (2 * np.sqrt(2e4 * 2)), rel=1e-6)


@pytest.mark.parametrize(
    ("mass", "polar", "supports"),
    [(0.0, 1.0, [(0.0, 1.0)]), (1.0, -1.0, [(0.0, 1.0)]), (1.0, 1.0, [])],
)
def test_modes_refuse_no_rotor(mass, polar, supports):
    with pytest.raises(ModesError):
        modes(mass, 1.0, polar, supports, 0.0)


def test_orbit_of_the_stiff_corner_is_step_converged():
    coarse, fine = (hold(1500, 300, clearance=40e-6, dt_s=dt).last(0.1) for dt in (100e-6, 50e-6))
    apart = np.hypot(*(coarse.position_m - fine.position_m).T).max()
    assert apart < 5e-3 * fine.peak_to_peak_m()


def test_journal_without_unbalance_rests_at_its_equilibrium():
    still = dataclasses.replace(Build.nominal(BENCH), unbalance_kg_m=0.0)
    run = hold(3000, 100, clearance=60e-6, build=still)
    start = equilibrium_at(BENCH, assemble(BENCH, still, 5e-5), 3000 * np.pi / 30, 100.0, 60e-6)
    np.testing.assert_allclose(run.position_m[-1], start.position_m, atol=0.1e-6)
    assert run.peak_to_peak_m() < 0.2e-6


def test_linear_film_agrees_for_a_small_orbit():
    small = [
        hold(6000, 100, clearance=60e-6, force=f).last(0.1).peak_to_peak_m()
        for f in ("table", "linear")
    ]
    assert small[1] == pytest.approx(small[0], rel=0.05)


def test_direct_film_stays_near_the_table():
    table, direct = (
        hold(10000, 100, clearance=60e-6, force=f).last(0.1) for f in ("table", "direct")
    )
    assert direct.peak_to_peak_m() == pytest.approx(table.peak_to_peak_m(), rel=0.02)
    assert direct.power_W.mean() == pytest.approx(table.power_W.mean(), rel=0.01)
    assert hold(10000, 100, clearance=60e-6, force=FilmTable.load(0.5)).rows[
        -1, 0
    ] == pytest.approx(hold(10000, 100, clearance=60e-6).rows[-1, 0])


def test_reversed_rotation_mirrors_the_path():
    forward, backward = (
        hold(rpm, 100, clearance=60e-6).last(0.1).position_m for rpm in (6000, -6000)
    )
    assert backward[:, 0].mean() == pytest.approx(-forward[:, 0].mean(), rel=0.02)
    assert backward[:, 1].mean() == pytest.approx(forward[:, 1].mean(), rel=0.02)


def test_a_rotor_at_rest_sinks_into_contact_and_stays_finite():
    run = hold(0, 300, seconds=2.0, clearance=40e-6)
    assert np.isfinite(run.rows).all()
    assert [e.name for e in run.events] == ["contact"]
    assert run.power_W[-1] == pytest.approx(0, abs=1e-2)


def test_closing_clearance_follows_the_rate_of_the_actuator():
    run = hold(3000, 100, seconds=1.0, clearance=lambda t: 80e-6 if t < 0.2 else 60e-6)
    rate = np.diff(run.column("clearance_m")) * 5000
    assert rate.min() >= -BENCH.actuator.rate_m_per_s * 1.01
    assert run.column("clearance_m")[-1] == pytest.approx(60e-6, abs=1e-6)


@pytest.mark.parametrize(
    "wrong",
    [
        {"clearance": 30e-6},
        {"clearance": 60e-6, "dt_s": 1e-3},
        {"clearance": 60e-6, "force": "magic"},
        {"clearance": 60e-6, "force": FilmTable(1.0, np.zeros((4, 4, 5)))},
        {"clearance": 60e-6, "seconds": 0.0},
    ],
)
def test_what_cannot_be_run_is_refused(wrong):
    with pytest.raises(SimulationError):
        simulate(BENCH, Duty.hold(3000, 100, 0.1), **wrong)
