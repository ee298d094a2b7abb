"""The tabulated film between pads against the film itself, and the rotor that runs in it."""

import dataclasses
import math

import numpy as np
import pytest

from firmware_py.machine import FixedPads
from sim_hil.film import FilmError, equilibrium, film_force
from sim_hil.film import pad_table as tables
from sim_hil.film.bore import PadBore
from sim_hil.film.pad_kernel import PadLaw, pad_force
from sim_hil.film.pad_shape import pad_gap, pad_reach, pad_shear
from sim_hil.film.pad_table import PadTable
from sim_hil.film.table_kernel import CONTACT_STIFFNESS_N_M
from sim_hil.plant.build import Build
from sim_hil.plant.duty import Duty
from sim_hil.plant.response import SimulationError, simulate
from sim_hil.rigs import load_rig
from sim_hil.rotor.assembly import rig_film

C, MU, R, L = 60e-6, 0.01, 0.02, 0.02
PADS = FixedPads(2, 160.0, 0.5)
BORES = [
    PadBore(2, math.pi / 2, math.radians(160.0), 0.5),
    PadBore(3, -math.pi / 2, math.radians(100.0), 0.4, 0.8),
]


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory):
    """Tables of fewer cells, in a cache of their own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tables, "CELLS", (10, 24, 16, 5))
        patch.setattr(tables, "GRID", (64, 8))
        folder = tmp_path_factory.mktemp("films")
        patch.setattr(tables, "_cache", lambda: folder)
        yield folder


def padded_rig():
    rig = load_rig("bench")
    return dataclasses.replace(rig, bearing=dataclasses.replace(rig.bearing, pads=PADS))


def errors(law: PadLaw, bore: PadBore, count: int, senses=(1,)) -> np.ndarray:
    """Of the force, over its size and 10 N, at random states."""
    rng, found = np.random.default_rng(3), []
    for k in range(count):
        angle, speed = rng.uniform(-math.pi, math.pi), 300.0 * senses[k % len(senses)]
        e = (
            rng.uniform(0, 0.9)
            * bore.reach(angle)
            * C
            * np.array([math.cos(angle), math.sin(angle)])
        )
        v = rng.normal(size=2) * 0.1 * C * 300.0
        fx, fy, torque, flow = pad_force(law, *e, *v, speed, C, MU, R, L, 0.0)
        film = film_force(
            e, v, speed_rad_s=speed, radius_m=R, length_m=L, clearance_m=C, viscosity_Pa_s=MU,
            pads=bore,
        )  # fmt: skip
        force = film.force_N
        found.append(
            (
                math.hypot(fx - force[0], fy - force[1]) / (np.hypot(*force) + 10.0),
                abs(torque / film.friction_torque_N_m - 1),
                abs(flow / film.side_flow_m3_s - 1),
            )
        )
    return np.array(found)


@pytest.mark.parametrize("bore", BORES)
def test_the_compiled_shape_is_that_of_the_bore(bore):
    numbers = tables.shape_of(bore)
    for angle in np.linspace(-3, 3, 9):
        at = 0.4 * np.array([math.cos(angle), math.sin(angle)])
        assert pad_gap(*numbers, *at)[0] == pytest.approx(bore.smallest(at), abs=1e-12)
        assert pad_reach(*numbers, math.cos(angle), math.sin(angle)) == pytest.approx(
            bore.reach(angle), abs=1e-9
        )
        theta = bore.middles_rad[:, None] + np.linspace(-0.5, 0.5, 4001) * bore.arc_rad
        gap = bore.thickness(theta) - at[0] * np.cos(theta) - at[1] * np.sin(theta)
        assert pad_shear(*numbers, *at) == pytest.approx(
            float(np.trapezoid(1 / gap, theta, axis=1).sum()), rel=1e-5
        )


def test_a_small_table_follows_the_film(small):
    bore = BORES[0]
    found = errors(PadTable.load(bore, 0.5).law, bore, 40, senses=(1, -1))
    assert np.median(found, axis=0).max() < 0.03
    assert np.quantile(found[:, 0], 0.9) < 0.08


def test_the_table_is_computed_once(small, capsys):
    first, again = (PadTable.load(BORES[0], 0.5) for _ in range(2))
    np.testing.assert_array_equal(first.share, again.share)
    assert len(list(small.glob("pads_*.npz"))) == 1


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("bore", BORES)
def test_a_whole_table_follows_the_film(bore):
    found = errors(PadTable.build(bore, 0.5).law, bore, 100)
    assert np.median(found, axis=0).max() < 0.015
    assert np.quantile(found[:, 0], 0.9) < 0.03
    assert found[:, 0].max() < 0.12


@pytest.mark.parametrize(("rpm", "load_N"), [(3000.0, 100.0), (12000.0, 30.0)])
def test_the_rotor_rests_where_the_film_between_the_pads_carries_it(small, rpm, load_N):
    rig = padded_rig()
    balanced = dataclasses.replace(Build.nominal(rig), unbalance_kg_m=0.0)
    duty = Duty.hold(rpm, load_N, 0.4)
    run = simulate(rig, duty, clearance=C, thermal=False, build=balanced).last(0.1)
    speed = rpm * math.pi / 30
    rest = equilibrium(
        load_N=load_N, radius_m=R, length_m=L, clearance_m=C, speed_rad_s=speed,
        viscosity_Pa_s=rig.oil.viscosity_at(rig.oil.inlet_C), pads=PadBore.of(PADS),
    )  # fmt: skip
    np.testing.assert_allclose(run.position_m.mean(axis=0), rest.position_m, atol=1.5e-6)
    power = float(rest.film.friction_torque_N_m) * speed + rig.windage_W_s3 * speed**3
    assert run.power_W.mean() == pytest.approx(power, rel=0.01)
    assert run.min_film_m.mean() == pytest.approx(float(rest.film.min_film_m), abs=1e-6)
    assert run.peak_to_peak_m() < 1e-7


def test_a_stop_between_pads_ends_on_the_lower_one(small):
    duty = Duty((0.0, 0.5, 2.0), (3000.0, 0.0, 0.0), (300.0,) * 3)
    run = simulate(padded_rig(), duty, clearance=C, thermal=False)
    depth_m = 300.0 / CONTACT_STIFFNESS_N_M
    np.testing.assert_allclose(run.position_m[-1], (0.0, -0.99 * C - depth_m), atol=0.05e-6)


def test_other_films_between_pads_are_refused_by_name(small):
    rig = padded_rig()
    with pytest.raises(SimulationError, match="only the table knows them"):
        simulate(rig, Duty.hold(3000.0, 100.0, 0.1), clearance=C, force="direct")
    offset = FixedPads(2, 160.0, 0.5, 90.0, 1.0)
    bearing = dataclasses.replace(rig.bearing, pads=offset)
    with pytest.raises(SimulationError, match=r"backwards, and pads\.offset_share = 1"):
        simulate(
            dataclasses.replace(rig, bearing=bearing), Duty.hold(-3000.0, 100.0, 0.1), clearance=C
        )
    with pytest.raises(FilmError, match="grooves between its pads are at ambient"):
        rig_film(rig, fed=True)
