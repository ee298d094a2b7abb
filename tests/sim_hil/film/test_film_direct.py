"""The fast direct film against the same rule on a fine grid, and its ring solver."""

import numpy as np
import pytest

from sim_hil.film import film_force
from sim_hil.film.direct import DirectFilm, direct_force, solve_rings

C, MU, R, L = 60e-6, 0.01, 0.02, 0.02


def test_ring_solver_solves():
    rng = np.random.default_rng(4)
    n, systems = 9, 3
    link, right = rng.uniform(0.5, 2, n), rng.normal(size=(n, systems))
    diagonal = rng.uniform(0.1, 1, (n, systems)) + (link + np.roll(link, 1))[:, None]
    expected = []
    for k in range(systems):
        matrix = np.diag(diagonal[:, k])
        for i in range(n):
            matrix[i, (i + 1) % n] -= link[i]
            matrix[i, i - 1] -= link[i - 1]
        expected.append(np.linalg.solve(matrix, right[:, k]))
    solve_rings(link, diagonal, right, np.empty((n, systems)))
    np.testing.assert_allclose(right, np.column_stack(expected), rtol=1e-12)


@pytest.mark.parametrize(("eps", "tolerance"), [(0.1, 3e-3), (0.5, 4e-3), (0.8, 8e-3), (0.9, 2e-2)])
@pytest.mark.parametrize("stations", [64, 256])
def test_follows_the_fine_film(eps, tolerance, stations):
    film = DirectFilm.make(stations)
    rng = np.random.default_rng(6)
    for angle, whirl, rate in rng.uniform(-3, 3, (5, 3)):
        e = eps * C * np.array([np.cos(angle), np.sin(angle)])
        v = 0.1 * C * 300 * np.array([np.cos(whirl), np.sin(whirl)])
        c_rate = rate * 1e-5
        fx, fy, torque = direct_force(
            film.ring, film.axial, film.work, *e, *v, 300.0, C, MU, R, L, c_rate
        )
        truth = film_force(
            e,
            v,
            radius_m=R,
            length_m=L,
            clearance_m=C,
            viscosity_Pa_s=MU,
            speed_rad_s=300.0,
            rupture="gumbel",
            clearance_rate_m_s=c_rate,
            grid=(320, 40),
        )
        allowed = tolerance if stations == 64 else 3e-3
        assert np.hypot(fx - truth.force_N[0], fy - truth.force_N[1]) < allowed * np.hypot(
            *truth.force_N
        )
        assert torque == pytest.approx(truth.friction_torque_N_m, rel=allowed)
