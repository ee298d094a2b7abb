"""The time simulation against the linear answer where that holds, its own step, and whirl where it
must grow."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_py.brain.film import Points
from firmware_py.brain.time_simulation import simulate
from firmware_py.machine.lubricant import viscosity_Pa_s

from .machine import CONFIG, film

FILM = film()


def points(rpm: float, load_N: float, clearance_m: float, oil_C: float = 45.0) -> Points:
    return Points(
        *(
            np.array([v])
            for v in (
                rpm * np.pi / 30,
                clearance_m,
                viscosity_Pa_s(CONFIG.machine.lubricant, oil_C),
                load_N,
            )
        )
    )


@pytest.mark.parametrize("case", [(6000.0, 100.0, 60e-6), (9000.0, 200.0, 80e-6)])
def test_a_small_orbit_is_the_linear_response(case: tuple[float, float, float]) -> None:
    p, unbalance = points(*case), 3e-6
    response = FILM.steady(p).response_m_per_kg_m[0] * unbalance
    swing = simulate(FILM, p, np.array([unbalance]), 10).peak_to_peak_m(2)[0]
    assert swing == pytest.approx(2 * np.abs(response).max(), rel=0.03)


def test_half_the_step_gives_the_same_in_the_stiff_corner() -> None:
    """Smallest clearance, heaviest load, slow: where explicit steps are silently wrong."""
    p, unbalance = points(1500.0, 300.0, 40e-6), np.array([1e-4])
    coarse, fine = (simulate(FILM, p, unbalance, 4, steps_a_turn=n) for n in (200, 400))
    assert coarse.min_film_m(1)[0] == pytest.approx(fine.min_film_m(1, 400)[0], abs=0.02e-6)
    assert coarse.peak_to_peak_m(1)[0] == pytest.approx(
        fine.peak_to_peak_m(1, 400)[0], rel=0.01, abs=2e-9
    )


def test_whirl_grows_where_the_damping_is_negative_and_stops_inside_the_clearance() -> None:
    p = points(12000.0, 30.0, 90e-6)
    assert FILM.steady(p).damping_ratio[0] < 0
    motion = simulate(FILM, p, np.array([1e-6]), 40, steps_a_turn=100)
    early = np.ptp(motion.position_m[200:600], axis=0).max()
    assert motion.peak_to_peak_m(4, 100)[0] > 5 * early
    still_m = 90e-6 - np.hypot(*FILM.steady(p).position_m[0])
    assert 0 < motion.min_film_m(4, 100)[0] < still_m - 0.4 * motion.peak_to_peak_m(4, 100)[0]
