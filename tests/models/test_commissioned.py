"""What commissioning knows of a machine, against the machine."""

from dataclasses import replace
from math import pi, sqrt

import numpy as np
import pytest

from models.control.commissioned import (
    CLEARANCE_ERROR_M,
    MASS_ERROR,
    POWER_ERROR_W,
    WHIRL_ORDER_MAX,
    Commissioned,
    apparent_mass_kg,
)
from models.control.episodes import Board, FixedSetting, play
from models.control.shielded import column
from sim_hil.film.equilibrium import equilibrium
from sim_hil.gym.control_task import OBSERVATIONS, Disturbances, Episode
from sim_hil.plant.build import Build
from sim_hil.rigs import load_rig

RIG = load_rig("bench")
CONFIG = RIG.config


def episode(seed: int) -> Episode:
    return Episode.draw(RIG, np.random.default_rng(seed), 5.0, Disturbances())


@pytest.mark.parametrize("seed", range(8))
def test_the_configuration_holds_the_machine_within_the_errors_that_it_declares(seed: int) -> None:
    drawn = episode(seed)
    build, known = drawn.build, Commissioned.of(CONFIG, RIG, drawn)
    bearing, rotor = known.config.machine.bearing, known.config.machine.rotor
    assert (
        abs(bearing.radial_clearance_offset_um * 1e-6 - build.clearance_error_m)
        <= CLEARANCE_ERROR_M
    )
    assert bearing.radial_clearance_error_um == pytest.approx(1e6 * CLEARANCE_ERROR_M)
    mass_kg = apparent_mass_kg(RIG.rotor, build, CONFIG.machine.operating.speed_max_rpm * pi / 60)
    assert rotor.mass_at_bearing_kg * (1 - MASS_ERROR) <= mass_kg * (1 + 1e-4)
    assert mass_kg <= rotor.mass_at_bearing_kg * (1 + rotor.mass_error_share) * (1 + 1e-4)
    assert build.unbalance_kg_m <= rotor.unbalance_normal_kg_m <= 1.23 * build.unbalance_kg_m
    assert all(channel.zeroed for channel in known.config.machine.channel[:2])
    assert Commissioned.of(CONFIG, RIG, drawn).config == known.config


def test_calibrated_probes_and_torque_meter_show_the_machine() -> None:
    drawn = replace(episode(3), power_error_W=4.0)
    drawn = replace(
        drawn, build=replace(drawn.build, gain=np.array([1.2, 0.8, *drawn.build.gain[2:]]))
    )
    known, (x_m, y_m) = Commissioned.of(CONFIG, RIG, drawn), (12e-6, -30e-6)
    probes = (
        np.array([x_m + y_m, y_m - x_m]) * sqrt(0.5) * drawn.build.gain[:2] + drawn.build.zero[:2]
    )
    seen = np.zeros(len(OBSERVATIONS), np.float32)
    seen[column("eccentricity_x_m")] = (probes[0] - probes[1]) * sqrt(0.5)
    seen[column("eccentricity_y_m")] = (probes[0] + probes[1]) * sqrt(0.5)
    seen[column("shaft_power_W")] = 104.0
    shown = known.corrected(seen)
    assert shown[column("eccentricity_x_m")] == pytest.approx(x_m, abs=1.2e-6)
    assert shown[column("eccentricity_y_m")] == pytest.approx(y_m, abs=1.2e-6)
    assert shown[column("shaft_power_W")] == pytest.approx(100.0, abs=POWER_ERROR_W)
    assert seen[column("shaft_power_W")] == np.float32(104.0)


@pytest.mark.parametrize("frequency_rad_s", [50.0, 400.0, 628.0])
def test_apparent_mass_is_that_of_the_rotor_on_its_coupling(frequency_rad_s: float) -> None:
    """A unit force at the bearing of the free rotor with its coupling as a spring, solved with
    translation and tilt.

    Both turn in the sense of the shaft: ``J_d t'' - i J_p speed t'`` is the moment that the tilt
    ``t`` takes.
    """
    build, r = Build.of_seed(RIG, 4), RIG.rotor
    a, b, w2 = r.coupling_to_cg_m, r.bearing_to_cg_m, frequency_rad_s**2
    speed_rad_s = frequency_rad_s / WHIRL_ORDER_MAX
    gyroscopic = r.polar_inertia_kg_m2 * speed_rad_s * frequency_rad_s / w2
    mass = np.diag(
        [r.mass_kg * build.mass, (r.diametral_inertia_kg_m2 - gyroscopic) * build.inertia]
    )
    hinge, bearing = np.array([1.0, -a]), np.array([1.0, b])
    stiffness = r.coupling_stiffness_N_m * build.coupling * np.outer(hinge, hinge)
    moved_m = bearing @ np.linalg.solve(stiffness - w2 * mass, bearing)
    assert apparent_mass_kg(r, build, frequency_rad_s) == pytest.approx(
        -1.0 / (w2 * moved_m), rel=1e-9
    )


def test_a_stiff_coupling_and_no_gyroscopic_moment_leave_the_effective_mass_of_the_drawing() -> (
    None
):
    stiff, slender = (
        replace(Build.nominal(RIG), coupling=1e6),
        replace(RIG.rotor, polar_inertia_kg_m2=0.0),
    )
    assert apparent_mass_kg(slender, stiff, 628.0) == pytest.approx(
        RIG.rotor.effective_mass_kg, rel=1e-6
    )
    assert apparent_mass_kg(RIG.rotor, stiff, 628.0) < 0.985 * RIG.rotor.effective_mass_kg


def test_no_film_at_rest_whirls_at_a_higher_order_than_the_apparent_mass_counts_on() -> None:
    orders = [
        equilibrium(
            eccentricity_ratio=e,
            radius_m=RIG.bearing.radius_m,
            length_m=RIG.bearing.length_m,
            clearance_m=60e-6,
            viscosity_Pa_s=0.01,
            speed_rad_s=600.0,
        ).whirl_ratio
        for e in np.linspace(0.02, 0.7, 18)
    ]
    assert 0.51 < max(orders) < WHIRL_ORDER_MAX


def test_commissioning_saves_power_behind_the_shield_and_breaks_no_limit() -> None:
    seeds = range(7100000, 7100006)
    drawn, known = (
        play(Board("bench", 10.0, commissioned=c), seeds, FixedSetting(160e-6), shielded=True)
        for c in (False, True)
    )
    assert known.power_W.mean() < drawn.power_W.mean() - 0.2
    assert known.violation_s.sum() == drawn.violation_s.sum() == 0.0
