"""Properties that the film has whatever its numbers are."""

import numpy as np
import pytest

from sim_hil.film import FeedPatch, FilmError, JournalOutsideClearance, film_force

C = 60e-6
OIL = {
    "radius_m": 0.02,
    "length_m": 0.02,
    "clearance_m": C,
    "viscosity_Pa_s": 0.01,
    "speed_rad_s": 300.0,
}
GROOVE = FeedPatch("groove", np.pi / 2, np.radians(20), 0.016, 1e5)
E, V = np.array([0.5, -0.4]) * C, np.array([1e-3, 2e-3])
RULES = ["full", "gumbel", "reynolds"]
MIRROR = np.array([-1.0, 1.0])


def turned(vector, angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ vector


@pytest.mark.parametrize("rupture", RULES)
@pytest.mark.parametrize("inlet", ["periodic", "groove_hmax"])
@pytest.mark.parametrize("fed", [False, True])
def test_rotation_symmetry(rupture, inlet, fed):
    rules = OIL | {"rupture": rupture, "inlet": inlet}
    groove = [GROOVE] if fed else []
    moved = [FeedPatch("groove", np.pi / 2 + 1.1, np.radians(20), 0.016, 1e5)] if fed else []
    one = film_force(E, V, feed=groove, **rules)
    two = film_force(turned(E, 1.1), turned(V, 1.1), feed=moved, **rules)
    np.testing.assert_allclose(two.force_N, turned(one.force_N, 1.1), rtol=1e-9)
    for name in (
        "friction_torque_N_m",
        "side_flow_m3_s",
        "inflow_m3_s",
        "max_pressure_Pa",
        "min_film_m",
    ):
        assert getattr(two, name) == pytest.approx(getattr(one, name), rel=1e-9)


@pytest.mark.parametrize("rupture", RULES)
@pytest.mark.parametrize("couette", ["full", "filled"])
@pytest.mark.parametrize("fed", [False, True])
def test_mirror_symmetry(rupture, couette, fed):
    rules = OIL | {"rupture": rupture, "couette": couette, "feed": [GROOVE] if fed else []}
    one = film_force(E, V, **rules)
    two = film_force(E * MIRROR, V * MIRROR, **(rules | {"speed_rad_s": -300.0}))
    np.testing.assert_allclose(two.force_N, one.force_N * MIRROR, rtol=1e-9)
    for name in ("friction_torque_N_m", "side_flow_m3_s", "inflow_m3_s", "max_pressure_Pa"):
        assert getattr(two, name) == pytest.approx(getattr(one, name), rel=1e-9)


@pytest.mark.parametrize("rupture", RULES)
def test_homogeneous_in_speed_and_viscosity(rupture):
    one = film_force(E, V, rupture=rupture, **OIL)
    faster = OIL | {"speed_rad_s": 900.0, "viscosity_Pa_s": 0.02}
    two = film_force(E, 3 * V, rupture=rupture, **faster)
    np.testing.assert_allclose(two.force_N, 6 * one.force_N, rtol=1e-9)
    assert two.friction_torque_N_m == pytest.approx(6 * one.friction_torque_N_m, rel=1e-9)
    assert two.side_flow_m3_s == pytest.approx(3 * one.side_flow_m3_s, rel=1e-9)


@pytest.mark.parametrize("rupture", RULES)
def test_similar_in_clearance_and_size(rupture):
    one = film_force(E, V, rupture=rupture, **OIL)
    wide = film_force(2 * E, 2 * V, rupture=rupture, **(OIL | {"clearance_m": 2 * C}))
    large = film_force(E, V, rupture=rupture, **(OIL | {"radius_m": 0.04, "length_m": 0.04}))
    np.testing.assert_allclose(wide.force_N, one.force_N / 4, rtol=1e-9)
    np.testing.assert_allclose(large.force_N, one.force_N * 16, rtol=1e-9)


@pytest.mark.parametrize("rupture", RULES)
def test_pure_whirl_at_half_speed_has_no_force(rupture):
    whirl = 150.0 * np.array([-E[1], E[0]])
    scale = np.hypot(*film_force(E, (0.0, 0.0), rupture=rupture, **OIL).force_N)
    assert np.hypot(*film_force(E, whirl, rupture=rupture, **OIL).force_N) < 1e-9 * scale


def test_unfed_film_opposes_the_effective_squeeze_velocity():
    rng = np.random.default_rng(2)
    for _ in range(50):
        angle, whirl = rng.uniform(-np.pi, np.pi, 2)
        e = rng.uniform(0, 0.97) * C * np.array([np.cos(angle), np.sin(angle)])
        v = rng.uniform(0, 0.3) * C * 300 * np.array([np.cos(whirl), np.sin(whirl)])
        film = film_force(e, v, grid=(64, 8), **OIL)
        assert film.force_N @ (v + 150.0 * np.array([e[1], -e[0]])) <= 0


def test_complementarity():
    """Pressure nowhere below cavitation; rupture and full film both exist; Guembel differs, full
    film more so."""
    rules = OIL | {"cavitation_pressure_Pa": -5e4}
    film = film_force(E, V, fields=True, **rules)
    assert film.pressure_Pa.min() == pytest.approx(-5e4)
    ruptured = film.pressure_Pa <= -5e4 * (1 - 1e-9)
    assert 0.05 < ruptured.mean() < 0.8
    assert np.all(film.fill[~ruptured] == 1)
    forces = [
        np.hypot(*film_force(E, V, rupture=r, **rules).force_N)
        for r in ("reynolds", "gumbel", "full")
    ]
    assert len({round(f, 3) for f in forces}) == 3


@pytest.mark.parametrize("inlet", ["periodic", "groove_hmax"])
@pytest.mark.parametrize("eps", [0.3, 0.8, 0.95])
def test_default_grid_is_converged(inlet, eps):
    e = (eps * C, 0.0)
    default = film_force(e, V, inlet=inlet, **OIL)
    fine = film_force(e, V, inlet=inlet, grid=(320, 40), **OIL)
    assert np.hypot(*(default.force_N - fine.force_N)) < 2e-3 * np.hypot(*fine.force_N)
    assert default.side_flow_m3_s == pytest.approx(fine.side_flow_m3_s, rel=2e-3)


@pytest.mark.parametrize("rupture", ["full", "reynolds", "jfo"])
@pytest.mark.parametrize("eps", [0.3, 0.95])
def test_default_grid_is_converged_with_a_feed(rupture, eps):
    """The flow is singular at the corners of a port."""
    rules = OIL | {"rupture": rupture, "feed": [GROOVE], "couette": "filled"}
    e = (0.36 * eps * C, -0.93 * eps * C)
    default = film_force(e, (0.0, 0.0), **rules)
    fine = film_force(e, (0.0, 0.0), grid=(320, 40), **rules)
    assert np.hypot(*(default.force_N - fine.force_N)) < 4e-3 * np.hypot(*fine.force_N)
    for name in ("friction_torque_N_m", "side_flow_m3_s", "inflow_m3_s"):
        assert getattr(default, name) == pytest.approx(getattr(fine, name), rel=1e-2)


def test_groove_over_the_whole_length_presses_over_the_whole_length():
    rules = OIL | {"speed_rad_s": 0.0, "rupture": "full"}
    groove = FeedPatch("groove", np.pi / 2, np.radians(60), 0.02, 1e5)
    film = film_force((0.0, 0.0), (0.0, 0.0), feed=[groove], fields=True, **rules)
    middle = np.abs(film.theta_rad - np.pi / 2) < np.radians(29)
    np.testing.assert_array_equal(film.pressure_Pa[middle], 1e5)
    assert film.inflow_m3_s == pytest.approx(film.side_flow_m3_s, rel=1e-9)


def test_guembel_draws_in_at_an_end_above_cavitation_pressure():
    """Where no pressure falls below cavitation the cut-off film is the full film, and its net
    outflow zero."""
    rules = OIL | {"end_pressure_Pa": (5e4, 5e4)}
    full, cut = (
        film_force(E, (0.0, 0.0), rupture=r, cavitation_pressure_Pa=p, **rules)
        for r, p in (("full", 0.0), ("gumbel", -1e7))
    )
    shallow = film_force(E, (0.0, 0.0), rupture="gumbel", cavitation_pressure_Pa=4.9e4, **rules)
    for film in (full, cut, shallow):
        assert abs(film.side_flow_m3_s) < 1e-9 * film_force(E, (0.0, 0.0), **OIL).side_flow_m3_s


def test_inlet_line_feeds_what_the_ends_lose():
    film = film_force(E, (0.0, 0.0), inlet="groove_hmax", **OIL)
    assert film.inflow_m3_s == pytest.approx(film.side_flow_m3_s, rel=2e-3)


def test_full_film_conserves_mass_with_a_groove():
    film = film_force(E, (0.0, 0.0), rupture="full", feed=[GROOVE], **OIL)
    assert film.inflow_m3_s == pytest.approx(film.side_flow_m3_s, rel=1e-6)


def test_feed_pressure_reaches_the_film_and_pushes():
    still = OIL | {"speed_rad_s": 0.0}
    film = film_force((0.0, 0.0), (0.0, 0.0), feed=[GROOVE], **still)
    assert film.max_pressure_Pa == pytest.approx(1e5)
    assert film.force_N[1] < 0
    assert abs(film.force_N[0]) < 1e-9 * abs(film.force_N[1])
    orifice = FeedPatch("orifice", np.pi / 2, np.radians(20), 0.016, 1e5)
    assert (
        0.6
        < film_force((0.0, 0.0), (0.0, 0.0), feed=[orifice], **still).force_N[1] / film.force_N[1]
        < 1
    )


def test_end_pressures():
    both = film_force(E, V, end_pressure_Pa=(2e5, 2e5), cavitation_pressure_Pa=2e5, **OIL)
    np.testing.assert_allclose(both.force_N, film_force(E, V, **OIL).force_N, rtol=1e-9)
    one = film_force(E, V, end_pressure_Pa=(2e5, 0.0), fields=True, **OIL)
    other = film_force(E, V, end_pressure_Pa=(0.0, 2e5), fields=True, **OIL)
    np.testing.assert_allclose(one.force_N, other.force_N, rtol=1e-9)
    np.testing.assert_allclose(one.pressure_Pa, other.pressure_Pa[:, ::-1], atol=1e-3)
    assert one.pressure_Pa[0, 0] == 2e5


def test_half_and_whole_film_agree():
    half = film_force(E, V, **OIL)
    whole = film_force(E, V, end_pressure_Pa=(0.0, 1e-6), **OIL)
    np.testing.assert_allclose(whole.force_N, half.force_N, rtol=1e-6)
    assert whole.side_flow_m3_s == pytest.approx(half.side_flow_m3_s, rel=1e-4)


def test_closing_clearance_is_a_squeeze():
    still = film_force((0.0, 0.0), (0.0, 0.0), **OIL)
    closing = film_force((0.0, 0.0), (0.0, 0.0), clearance_rate_m_s=-1e-3, **OIL)
    opening = film_force((0.0, 0.0), (0.0, 0.0), clearance_rate_m_s=1e-3, **OIL)
    assert closing.max_pressure_Pa > 1e4 > still.max_pressure_Pa == opening.max_pressure_Pa == 0
    # what the closing gap displaces leaves through the ends
    assert closing.side_flow_m3_s == pytest.approx(2 * np.pi * 0.02 * 0.02 * 1e-3, rel=1e-9)


def test_filled_couette_is_thinner_than_full():
    full = film_force(E, (0.0, 0.0), **OIL).friction_torque_N_m
    filled = film_force(E, (0.0, 0.0), couette="filled", **OIL).friction_torque_N_m
    assert 0.6 * full < filled < 0.97 * full


def test_batches_broadcast():
    e = np.array([[[0.1, 0.2]], [[0.3, -0.5]]]) * C
    v = np.array([[0.0, 0.0], [1e-3, 0.0], [0.0, 1e-3]])
    film = film_force(e, v, fields=True, grid=(48, 8), **OIL)
    assert film.force_N.shape == (2, 3, 2)
    assert film.side_flow_m3_s.shape == (2, 3)
    assert film.pressure_Pa.shape == (2, 3, 48, 9)
    one = film_force(e[1, 0], v[2], grid=(48, 8), **OIL)
    np.testing.assert_array_equal(film.force_N[1, 2], one.force_N)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"clearance_m": 0.0}, "clearance_m = 0.0"),
        ({"clearance_m": 0.01}, "not a thin film"),
        ({"viscosity_Pa_s": float("nan")}, "viscosity_Pa_s = nan"),
        ({"length_m": -1.0}, "length_m = -1.0"),
        ({"speed_rad_s": float("inf")}, "must be finite"),
        ({"rupture": "other"}, "rupture = 'other'"),
        ({"cavitation_pressure_Pa": 1e5}, "above a feed or end pressure"),
        ({"grid": (4, 4)}, "grid"),
        ({"feed": [FeedPatch("groove", 0.0, 0.0, 0.01, 1e5)]}, "width must be"),
        ({"feed": [FeedPatch("slot", 0.0, 0.1, 0.01, 1e5)]}, "feed kind 'slot'"),
        ({"feed": [FeedPatch("groove", 0.0, 0.1, float("nan"), 1e5)]}, "finite"),
    ],
)
def test_absurd_parameters_are_refused(change, message):
    with pytest.raises(FilmError, match=message):
        film_force(E, V, **(OIL | change))


@pytest.mark.parametrize(
    ("position", "velocity", "error"),
    [
        ((C, 0.0), (0.0, 0.0), JournalOutsideClearance),
        ((0.0, -2 * C), (0.0, 0.0), JournalOutsideClearance),
        ((float("nan"), 0.0), (0.0, 0.0), FilmError),
        ((0.0, 0.0), (0.0, float("inf")), FilmError),
        ((0.0, 0.0, 0.0), (0.0, 0.0), FilmError),
    ],
)
def test_impossible_states_are_refused(position, velocity, error):
    with pytest.raises(error):
        film_force(position, velocity, **OIL)
