"""Terms of the equation of motion, each by itself, and the bolted joints."""

import math

import numpy as np
import pytest

from sim_hil.film.table import FilmTable
from sim_hil.plant.build import Build
from sim_hil.rigs import load_rig
from sim_hil.rotor.assembly import assemble
from sim_hil.rotor.bearing import bearing_force, oil_now
from sim_hil.rotor.joints import foot_forces, normal_force
from sim_hil.rotor.kernel import GRAVITY, move_actuator, substep
from sim_hil.rotor.parameters import (
    ANGLE,
    CLEARANCE,
    OIL,
    PRESSURE,
    FilmOil,
    Plant,
    State,
    new_state,
)
from sim_hil.rotor.stator import rub_force

DT = 1e-6
TABLE = FilmTable.load(0.5).coefficients
RIG = load_rig("bench")


def free_plant() -> Plant:
    """No film, no coupling, no tooth force: only inertia, gravity, unbalance."""
    plant = assemble(RIG, Build.nominal(RIG), DT)
    return plant._replace(
        shaft=plant.shaft._replace(coupling_stiffness=0.0, coupling_damping=0.0),
        excite=plant.excite._replace(tooth_force=0.0),
    )


def one_step(
    plant: Plant,
    state: State,
    omega: float = 0.0,
    alpha: float = 0.0,
    load: float = 0.0,
    dt: float = DT,
) -> State:
    film = plant.film
    substep(
        plant,
        state,
        TABLE,
        True,
        omega,
        alpha,
        load,
        60e-6,
        0.0,
        FilmOil(1e-15 * film.viscosity, 1.0, 1.0, 0.0),
        np.zeros(4),
        dt,
    )
    return state


def rest() -> State:
    return new_state(3, 60e-6, 1e5, 40.0, 0.0)


def test_gravity_and_load_act_at_their_places() -> None:
    state = one_step(free_plant(), rest(), load=RIG.rotor.gravity_share_N)
    # with only its own weight, and the coupling carrying its share at the other end
    assert state.a[1] * RIG.rotor.mass_kg == pytest.approx(-RIG.rotor.gravity_share_N, rel=1e-6)
    more = one_step(free_plant(), rest(), load=RIG.rotor.gravity_share_N + 60.0)
    assert (more.a[1] - state.a[1]) * RIG.rotor.mass_kg == pytest.approx(-60.0)
    assert (more.a[3] - state.a[3]) * RIG.rotor.diametral_inertia_kg_m2 == pytest.approx(
        -60.0 * 0.25
    )
    assert pytest.approx(9.81) == GRAVITY


@pytest.mark.parametrize("omega", [1000.0, -1000.0])
def test_gyroscopic_moment_turns_one_tilt_rate_into_the_other(omega: float) -> None:
    plant = free_plant()
    plant = plant._replace(shaft=plant.shaft._replace(unbalance=0.0))
    state = rest()
    state.v[3] = 0.01
    one_step(plant, state, omega)
    ratio = RIG.rotor.polar_inertia_kg_m2 / RIG.rotor.diametral_inertia_kg_m2
    assert state.v[2] / DT == pytest.approx(-ratio * omega * 0.01, rel=1e-4)
    state = rest()
    state.v[2] = 0.01
    before = one_step(plant, rest(), omega).v[3]
    one_step(plant, state, omega)
    assert (state.v[3] - before) / DT == pytest.approx(ratio * omega * 0.01, rel=1e-4)


def test_gyroscopic_coupling_keeps_the_energy_at_any_step() -> None:
    plant = free_plant()
    plant = plant._replace(shaft=plant.shaft._replace(unbalance=0.0))
    state = rest()
    state.v[2] = 1e-4
    for _ in range(1000):  # an explicit step would grow by 2 %
        one_step(plant, state, 1000.0, dt=1e-4)
    assert math.hypot(state.v[2], state.v[3]) == pytest.approx(1e-4, rel=1e-3)


def test_run_up_turns_a_standing_tilt() -> None:
    """The other half of the gyroscopic moment, ``J_p alpha`` times the tilt."""
    plant = free_plant()
    plant = plant._replace(shaft=plant.shaft._replace(unbalance=0.0))
    ratio, alpha = RIG.rotor.polar_inertia_kg_m2 / RIG.rotor.diametral_inertia_kg_m2, 500.0
    state, base = rest(), rest()
    state.q[2], state.q[3] = 1e-5, 2e-5
    change = one_step(plant, state, 0.0, alpha).a - one_step(plant, base, 0.0, alpha).a
    assert change[2:4] == pytest.approx([-ratio * alpha * 2e-5, ratio * alpha * 1e-5])


def test_moments_are_those_of_forces_at_their_lever() -> None:
    """Coupling at -0.25 m, bearing at +0.25 m: the same force turns the rotor in opposite
    senses."""
    plant = free_plant()
    spring = plant._replace(shaft=plant.shaft._replace(coupling_stiffness=1e6, unbalance=0.0))
    state, base = rest(), rest()
    for each in (state, base):
        each.q[2:4] = 0.0
    state.q[0] = 1e-5
    change = one_step(spring, state).a - one_step(spring, base).a
    r = RIG.rotor
    assert change[0] * r.mass_kg == pytest.approx(-10.0, rel=1e-3)
    assert change[2] * r.diametral_inertia_kg_m2 == pytest.approx(0.25 * 10.0, rel=1e-3)


@pytest.mark.parametrize("angle", [0.0, 1.0, 4.0])
def test_unbalance_force_with_run_up(angle: float) -> None:
    omega, alpha = 300.0, 5e4
    still = free_plant()
    still = still._replace(shaft=still.shaft._replace(unbalance=0.0))
    states = []
    for plant in (still, free_plant()):
        state = rest()
        state.scalar[ANGLE] = angle
        states.append(one_step(plant, state, omega, alpha))
    force = (states[1].a[:2] - states[0].a[:2]) * RIG.rotor.mass_kg
    u = RIG.rotor.unbalance_kg_m
    expected = [
        u * (omega**2 * math.cos(angle) + alpha * math.sin(angle)),
        u * (omega**2 * math.sin(angle) - alpha * math.cos(angle)),
    ]
    np.testing.assert_allclose(force, expected, rtol=1e-6, atol=1e-9)


def test_joint_is_clamped_then_free_then_stopped_by_the_bolt() -> None:
    k, clamp, gap, k_bolt = 5e7, 100.0, 3e-5, 2e7
    lift_off = clamp / k
    assert normal_force(-1e-6, k, clamp, gap, k_bolt) == pytest.approx(50.0)
    assert normal_force(lift_off, k, clamp, gap, k_bolt) == pytest.approx(-clamp)
    assert normal_force(lift_off + 0.99 * gap, k, clamp, gap, k_bolt) == -clamp
    assert normal_force(lift_off + gap + 1e-6, k, clamp, gap, k_bolt) == pytest.approx(
        -clamp - 20.0
    )
    assert normal_force(1e-6, k, 0.0, gap, k_bolt) == 0.0


def test_foot_slips_at_the_friction_limit_and_returns_with_a_permanent_set() -> None:
    foot = assemble(RIG, Build.nominal(RIG), DT).pedestal._replace(
        clamp=(100.0,) * 4, damping=(0.0,) * 4
    )
    slip = np.zeros(8)
    limit = 4 * foot.friction * 100.0
    force, _, _ = foot_forces(foot, 1e-3, 0.0, 0.0, 0.0, 0.0, 0.0, slip, 0)
    assert force == pytest.approx(-limit)
    back, _, _ = foot_forces(foot, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, slip, 0)
    assert back == pytest.approx(limit)
    assert (slip[:4] > 0).all()
    assert (slip[4:] == 0).all()


def test_equal_feet_do_not_join_lift_and_roll_but_one_soft_foot_does() -> None:
    foot = assemble(RIG, Build.nominal(RIG), DT).pedestal
    assert foot_forces(foot, 0.0, 1e-6, 0.0, 0.0, 0.0, 0.0, np.zeros(8), 0)[2] == pytest.approx(
        0.0, abs=1e-9
    )
    soft = foot._replace(stiffness=(2e7, 5e7, 5e7, 5e7))
    assert foot_forces(soft, 0.0, 1e-6, 0.0, 0.0, 0.0, 0.0, np.zeros(8), 0)[2] < -1.0


def test_rub_is_one_sided_and_drags_against_the_sliding() -> None:
    """A ring of 100 um gap that leaves 10 um above the shaft."""
    excite = free_plant().excite._replace(
        rub_stiffness=1e6, rub_gap=1e-5, rub_clearance=1e-4, rub_friction=0.2
    )
    assert rub_force(excite, 0.0, 0.9e-5, 0.0, 0.0, 10.0) == (0.0, 0.0, 0.0)
    assert rub_force(excite, 0.0, -9e-5, 0.0, 0.0, 10.0) == (0.0, 0.0, 0.0)
    assert rub_force(excite, 0.0, 2e-5, 0.0, 0.0, 10.0) == pytest.approx((2.0, -10.0, 2.0))
    assert rub_force(excite, 0.0, 2e-5, 0.0, 0.0, -10.0) == pytest.approx((-2.0, -10.0, -2.0))
    # backward whirl faster than the surface: the shaft rolls over and friction turns round
    assert rub_force(excite, 0.0, 2e-5, 12.0, 0.0, 10.0) == pytest.approx((-2.0, -10.0, -2.0))
    assert rub_force(excite, 0.0, 2e-5, 10.0, 0.0, 10.0) == pytest.approx((0.0, -10.0, 0.0))
    # the ring is round: pressed to the side, it pushes back from there
    fx, fy, _ = rub_force(excite, 1.2e-4, -9e-5, 0.0, 0.0, 0.0)
    assert (fx, fy) == pytest.approx((-20.0, 0.0))


def test_misaligned_coupling_turns_twice_a_turn_and_pushes_aside() -> None:
    plant, omega = free_plant(), 300.0
    plant = plant._replace(shaft=plant.shaft._replace(unbalance=0.0))
    off = plant._replace(excite=plant.excite._replace(misaligned_kg_m=4e-5, misaligned_N_m=15.0))
    state, base = rest(), rest()
    state.scalar[ANGLE] = base.scalar[ANGLE] = math.pi / 4
    change = one_step(off, state, omega).a - one_step(plant, base, omega).a
    r = RIG.rotor
    # 2 theta = 90 degrees: the whirling force points up, at the coupling
    assert change[:2] * r.mass_kg == pytest.approx([0.0, 4 * omega**2 * 4e-5], abs=1e-9)
    assert change[2] * r.diametral_inertia_kg_m2 == pytest.approx(15.0)


def test_narrow_film_bears_less_shears_less_and_sheds_less() -> None:
    film = free_plant().film
    full, half = (
        np.array(
            bearing_force(
                TABLE, film, FilmOil(0.01, s, s**2.5, 0.0), 1e-5, -3e-5, 0.0, 0.0, 600.0, 6e-5, 0.0
            )
        )
        for s in (1.0, 0.5)
    )
    assert half[:2] == pytest.approx(full[:2] * 0.5**2.5)
    assert half[3] == pytest.approx(full[3] * 0.5)
    pressure_part = 0.5 * (1e-5 * full[1] + 3e-5 * full[0])
    assert half[2] - 0.5**2.5 * pressure_part == pytest.approx(0.5 * (full[2] - pressure_part))


def test_oil_thins_with_heat_and_fills_with_pressure() -> None:
    film = free_plant().film
    scalar = rest().scalar
    assert oil_now(film, scalar) == pytest.approx((0.01, 1.0, 1.0, 1e5))
    scalar[OIL] = 60.0
    scalar[PRESSURE] = 0.6 * film.pressure_needed
    assert oil_now(film, scalar) == pytest.approx(
        (0.01 * math.exp(-0.6), 0.6, 0.6**2.5, 0.6 * film.pressure_needed)
    )


def test_actuator_keeps_its_rate_and_its_backlash() -> None:
    act = free_plant().act
    scalar = rest().scalar
    for _ in range(1000):
        rate = move_actuator(act, scalar, 100e-6, 1e5, 1e-3)
        assert abs(rate) <= act.rate * 1.001
    assert scalar[CLEARANCE] == pytest.approx(100e-6, abs=1.01e-6)
    reached = scalar[CLEARANCE]
    move_actuator(act, scalar, 100e-6 - 0.4e-6, 1e5, 1e-3)
    assert scalar[CLEARANCE] == reached
