"""The film against published values and closed forms; each tolerance says what it is for."""

import numpy as np
import pytest

from sim_hil.film import equilibrium, film_force
from sim_hil.film.equilibrium import whirl_threshold

OIL = {"radius_m": 0.02, "clearance_m": 60e-6, "viscosity_Pa_s": 0.01, "speed_rad_s": 300.0}
UNIT = 0.01 * 300.0 * 0.02 * (0.02 / 60e-6) ** 2  # mu omega R (R/c)^2, N per metre of length

# (eps, S, (R/c) f): Raimondi and Boyd 1958, L/D = 1; the digits carry about 1.5 %
RAIMONDI_BOYD = [
    (0.9, 0.0188, 1.05),
    (0.8, 0.0446, 1.7),
    (0.6, 0.121, 3.2),
    (0.4, 0.264, 5.79),
    (0.2, 0.631, 12.8),
    (0.1, 1.33, 26.4),
]
# side flow variable Q_s / (R c N L) = (Q / R c N L) (Q_s / Q): eps, Q, share
RAIMONDI_BOYD_FLOW = [
    (0.1, 3.37, 0.150),
    (0.2, 3.59, 0.280),
    (0.6, 4.33, 0.680),
    (0.8, 4.62, 0.842),
]


def raimondi_boyd_film(eps):
    return film_force((0.0, -eps * 60e-6), (0.0, 0.0), length_m=0.04, inlet="groove_hmax", **OIL)


@pytest.mark.parametrize(("eps", "sommerfeld", "friction"), RAIMONDI_BOYD)
def test_raimondi_boyd_load_and_friction(eps, sommerfeld, friction):
    film = raimondi_boyd_film(eps)
    load = np.hypot(*film.force_N)
    assert UNIT * 0.04 / (np.pi * load) == pytest.approx(sommerfeld, rel=2e-2)
    assert film.friction_torque_N_m / (load * 60e-6) == pytest.approx(friction, rel=2e-2)


@pytest.mark.parametrize(("eps", "flow", "share"), RAIMONDI_BOYD_FLOW)
def test_raimondi_boyd_side_flow(eps, flow, share):
    film = raimondi_boyd_film(eps)
    variable = film.side_flow_m3_s / (0.02 * 60e-6 * 300 / (2 * np.pi) * 0.04)
    assert variable == pytest.approx(flow * share, rel=2e-2)


def short_bearing(eps):
    """Dimensionless (-F_r, F_t) of the Ocvirk pi film over mu omega R L^3 / c^2."""
    return eps**2 / (1 - eps**2) ** 2, np.pi * eps / (4 * (1 - eps**2) ** 1.5)


@pytest.mark.parametrize("eps", [0.2, 0.5, 0.6])
def test_short_bearing_force_at_small_length(eps):
    # 5 %: the closed form neglects circumferential flow, of the order of (L/D)^2
    length = 0.04 / 32
    film = film_force((eps * 60e-6, 0.0), (0.0, 0.0), length_m=length, rupture="gumbel", **OIL)
    scale = 0.01 * 300 * 0.02 * length**3 / 60e-6**2
    radial, tangential = short_bearing(eps)
    assert -film.force_N[0] / scale == pytest.approx(radial, rel=5e-2)
    assert film.force_N[1] / scale == pytest.approx(tangential, rel=5e-2)


# eps, S (L/D)^2, attitude deg, K (xx, xy, yx, yy), C, whirl ratio, threshold
OCVIRK = [
    (
        0.2,
        0.461194,
        75.431,
        (1.4978, 5.7631, -4.5203, 2.4849),
        (10.9798, 2.4916, 2.4916, 9.5869),
        0.5106,
        2.6814,
    ),
    (
        0.5,
        0.106049,
        53.68,
        (2.9233, 3.9766, -0.8577, 2.2099),
        (6.6148, 2.245, 2.245, 3.0539),
        0.5146,
        2.5417,
    ),
]


@pytest.mark.parametrize(("eps", "sommerfeld", "attitude", "k", "c", "whirl", "threshold"), OCVIRK)
def test_short_bearing_coefficients(eps, sommerfeld, attitude, k, c, whirl, threshold):
    # 3 % of the largest coefficient: L/D = 1/16 is not zero, and the cut-off film has a grain at
    # its edge
    state = equilibrium(eccentricity_ratio=eps, length_m=0.0025, rupture="gumbel", **OIL)
    assert state.sommerfeld / 16**2 == pytest.approx(sommerfeld, rel=1e-2)
    assert np.degrees(state.attitude_rad) == pytest.approx(attitude, abs=0.5)
    np.testing.assert_allclose(state.stiffness.ravel(), k, atol=0.03 * max(k))
    np.testing.assert_allclose(state.damping.ravel(), c, atol=0.03 * max(c))
    assert state.whirl_ratio == pytest.approx(whirl, rel=1e-2)
    assert state.threshold == pytest.approx(threshold, rel=1e-2)


@pytest.mark.parametrize(("eps", "sommerfeld", "attitude", "k", "c", "whirl", "threshold"), OCVIRK)
def test_whirl_threshold_formula(eps, sommerfeld, attitude, k, c, whirl, threshold):
    found = whirl_threshold(np.reshape(k, (2, 2)), np.reshape(c, (2, 2)))
    assert found == pytest.approx((whirl, threshold), abs=2e-4)


def test_short_bearing_is_stable_at_high_eccentricity():
    state = equilibrium(eccentricity_ratio=0.8, length_m=0.0025, rupture="gumbel", **OIL)
    assert np.isnan(state.whirl_ratio)
    assert np.isnan(state.threshold)


@pytest.mark.parametrize("eps", [0.2, 0.6, 0.9])
@pytest.mark.parametrize("rupture", ["full", "gumbel"])
def test_long_bearing_pressure_in_the_middle_plane(eps, rupture):
    """Sommerfeld 1904. Only the middle plane of a long bearing is infinitely long: its ends lose
    about D/L."""
    film = film_force(
        (-eps * 60e-6, 0.0),
        (0.0, 0.0),
        length_m=0.32,
        rupture=rupture,
        fields=True,
        grid=(360, 20),
        **OIL,
    )
    theta = film.theta_rad  # the thickest film is at angle zero
    exact = (
        6
        * eps
        * np.sin(theta)
        * (2 + eps * np.cos(theta))
        / (2 + eps**2)
        / (1 + eps * np.cos(theta)) ** 2
    )
    exact = exact if rupture == "full" else np.maximum(exact, 0)
    middle = film.pressure_Pa[:, film.z_m.size // 2] / (0.01 * 300 * (0.02 / 60e-6) ** 2)
    np.testing.assert_allclose(middle, exact, atol=2e-3 * exact.max())


@pytest.mark.parametrize("ratio", [1.0, 8.0])
def test_lightly_loaded_full_film_of_any_length(ratio):
    """To first order in eps the load is 6 pi eps [1 - tanh(L/D)/(L/D)] mu omega R L (R/c)^2, at 90
    degrees."""
    state = equilibrium(
        eccentricity_ratio=1e-3, length_m=0.04 * ratio, rupture="full", grid=(160, 60), **OIL
    )
    exact = 6 * np.pi * 1e-3 * (1 - np.tanh(ratio) / ratio) * UNIT * 0.04 * ratio
    assert state.load_N == pytest.approx(exact, rel=2e-3)
    assert np.degrees(state.attitude_rad) == pytest.approx(90, abs=1e-3)


@pytest.mark.parametrize("eps", [0.2, 0.6])
def test_long_bearing_friction(eps):
    """Full film: (R/c) f = (1 + 2 eps^2) / (3 eps), with the load that the finite length really
    carries."""
    state = equilibrium(
        eccentricity_ratio=eps, length_m=1.28, rupture="full", grid=(240, 60), **OIL
    )
    # D/L = 1/32 of the load is lost at the ends; friction over load rises by no more than that
    assert 1 <= state.friction_variable / ((1 + 2 * eps**2) / (3 * eps)) <= 1 + 1.3 / 32
