"""Polynomials of the innermost loops against the library."""

import numpy as np
import pytest

from sim_hil.film.elementary import angle_of, direction_of, exp_of, log_of, turn_of
from sim_hil.jit import kernel

Floats = np.ndarray
RNG = np.random.default_rng(5)


@kernel
def each(x: Floats, log: Floats, exp: Floats, angle: Floats, turn: Floats, way: Floats) -> None:
    for i in range(x.shape[0]):
        log[i], exp[i] = log_of(x[i, 0]), exp_of(x[i, 1])
        angle[i] = angle_of(x[i, 2], x[i, 3])
        turn[i, 0], turn[i, 1] = turn_of(x[i, 4])
        way[i, 0], way[i, 1] = direction_of(x[i, 5])


def test_each_is_the_library_s_to_thirteen_digits() -> None:
    n = 20000
    round_, size = RNG.uniform(0, np.pi, n), np.exp(RNG.uniform(-40, 10, n))
    x = np.column_stack(
        [
            np.concatenate([np.exp(RNG.uniform(-9, 0, n // 2)), 1 - np.logspace(-12, -1, n // 2)]),
            RNG.uniform(-200, 200, n),
            size * np.sin(round_),
            size * np.cos(round_),
            RNG.uniform(-np.pi / 2, np.pi / 2, n),
            RNG.uniform(-1e5, 1e5, n),
        ]
    )
    log, exp, angle, turn, way = (np.empty(n), np.empty(n), np.empty(n), *np.empty((2, n, 2)))
    each(x, log, exp, angle, turn, way)
    np.testing.assert_allclose(log, np.log(x[:, 0]), rtol=1e-13)
    np.testing.assert_allclose(exp, np.exp(x[:, 1]), rtol=1e-13)
    np.testing.assert_allclose(angle, np.arctan2(x[:, 2], x[:, 3]), rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(
        turn, np.column_stack([np.cos(x[:, 4]), np.sin(x[:, 4])]), atol=1e-13
    )
    np.testing.assert_allclose(way, np.column_stack([np.cos(x[:, 5]), np.sin(x[:, 5])]), atol=1e-11)


@pytest.mark.parametrize(
    ("y", "x", "angle"),
    [(0.0, 0.0, 0.0), (0.0, 2.0, 0.0), (0.0, -2.0, np.pi), (3.0, 0.0, np.pi / 2)],
)
def test_the_axes(y: float, x: float, angle: float) -> None:
    found = np.empty(1)
    nothing, pair = np.empty(1), np.empty((1, 2))
    each(np.array([[0.5, 0.0, y, x, 0.0, 0.0]]), nothing, nothing.copy(), found, pair, pair.copy())
    assert found[0] == pytest.approx(angle, abs=1e-15)


def test_what_is_no_number_gives_none() -> None:
    found = np.empty(1), np.empty(1), np.empty(1), np.empty((1, 2)), np.empty((1, 2))
    each(np.full((1, 6), np.nan), *found)
    assert all(np.isnan(one).all() for one in found[1:])
