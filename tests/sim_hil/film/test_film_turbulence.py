"""The turbulent film: where it begins, how it grows, and what it refuses."""

import numpy as np
import pytest

from sim_hil.film import FilmError, equilibrium, film_force
from sim_hil.film.bearing import Bearing
from sim_hil.film.turbulence import ONSET, TURBULENT_RE, reynolds, turbulent_share

R, C, MU, WATER = 0.05, 100e-6, 1e-3, 1000.0


def bearing(number: float) -> Bearing:
    """A water bearing at that Reynolds number in its clearance."""
    return Bearing(R, R, C, MU, number * MU / (WATER * R * C), density_kg_m3=WATER)


def test_the_share_begins_with_the_vortices_and_is_whole_where_all_is_turbulent():
    onset = ONSET * np.sqrt(R / C)
    one = np.ones(1)
    assert reynolds(bearing(700.0), one)[0] == pytest.approx(700.0)
    shares = [turbulent_share(bearing(n), one)[0] for n in (0.99 * onset, onset, TURBULENT_RE)]
    assert shares == pytest.approx([0.0, 0.0, 1.0])
    assert 0.0 < turbulent_share(bearing(1400.0), one)[0] < 1.0


def test_a_thin_film_stays_laminar_beside_a_turbulent_wide_one():
    share = turbulent_share(bearing(3000.0), np.array([0.2, 1.0, 1.8]))
    assert share[0] == 0.0
    assert share[1] == share[2] == 1.0


def test_turbulence_bears_more_and_costs_more():
    speed = 5000.0 * MU / (WATER * R * C)
    rules = {
        "radius_m": R,
        "length_m": R,
        "clearance_m": C,
        "viscosity_Pa_s": MU,
        "speed_rad_s": speed,
    }
    laminar, stirred = (
        equilibrium(load_N=500.0, density_kg_m3=density, **rules) for density in (0.0, WATER)
    )
    assert stirred.eccentricity_ratio < laminar.eccentricity_ratio
    ratio = stirred.film.friction_torque_N_m / laminar.film.friction_torque_N_m
    assert 3.0 < ratio < 6.0
    assert stirred.damping_N_s_m[0, 0] > laminar.damping_N_s_m[0, 0]
    assert stirred.side_flow_m3_s < laminar.side_flow_m3_s


def test_below_the_onset_the_film_is_the_laminar_one():
    state = ((2e-5, -4e-5), (0.0, 0.0))
    rules = {"radius_m": R, "length_m": R, "clearance_m": C, "viscosity_Pa_s": MU}
    plain, judged = (
        film_force(*state, speed_rad_s=50.0, density_kg_m3=density, **rules)
        for density in (0.0, WATER)
    )
    np.testing.assert_allclose(judged.force_N, plain.force_N, rtol=1e-12)
    assert judged.friction_torque_N_m == pytest.approx(plain.friction_torque_N_m, rel=1e-3)


def test_beyond_the_fits_it_is_refused():
    with pytest.raises(FilmError, match=r"Re = 2e\+05 in the clearance"):
        bearing(2e5)
    with pytest.raises(FilmError, match="density_kg_m3 = -1"):
        Bearing(R, R, C, MU, 10.0, density_kg_m3=-1.0)
