"""Features of any channels: orders follow the shaft, and say why where there are none."""

import numpy as np
import pytest

from firmware_py.acquire.channel_features import (
    ORDERS,
    VIEWS,
    angle_at,
    no_orders,
    orders,
    window_samples,
)

RATE, N = 5000.0, 5000
TIME = np.arange(N) / RATE


def shaft(start=20.0, end=40.0):
    """Turns of a shaft that gathers speed."""
    return start * TIME + 0.5 * (end - start) * TIME**2


def wave(turns, order, amplitude, phase=0.0):
    return amplitude * np.cos(2.0 * np.pi * order * turns + phase)


@pytest.mark.parametrize("order", [1, 2, 5, 8])
def test_amplitudes_of_orders_while_the_speed_changes(order):
    turns = shaft()
    window = np.array([wave(turns, order, 3.0), wave(turns, order, 0.2)])
    row = orders(window, RATE, turns)
    found = 10.0 ** row[: 2 * ORDERS].reshape(2, ORDERS)
    assert found[:, order - 1] == pytest.approx([3.0, 0.2], rel=0.03)
    others = np.delete(found, order - 1, axis=1)
    assert others.max() < 0.03 * found.max()
    assert 10.0 ** row[-1] == pytest.approx(30.0, rel=0.02), "revolutions a second"


def test_the_half_order_and_the_phase_between_channels():
    turns = shaft()
    first = [wave(turns, 1, 1.0), wave(turns, 1, 2.0, np.pi / 2)]
    window = np.array(first) + wave(turns, 0.45, 0.5)
    row = orders(window, RATE, turns)
    assert 10.0 ** row[16:18] == pytest.approx([0.5, 0.5], rel=0.05)
    assert row[18:20] == pytest.approx([0.0, -1.0], abs=0.02)


def test_where_the_mark_stands_moves_nothing():
    turns = shaft()
    window = np.array([wave(turns, 1, 1.0), wave(turns, 2, 1.0)])
    assert np.allclose(orders(window, RATE, turns), orders(window, RATE, turns + 7.3), atol=1e-9)


@pytest.mark.parametrize(
    ("turns", "reason"),
    [
        (None, "neither mark nor speed is known"),
        (7.5 * TIME, "7.5 turns in 1 s, at least 8 are needed"),
        (400.0 * TIME, "12.5 samples a turn, at least 20 are needed"),
        (np.minimum(30.0 * TIME, 20.0), "the shaft stands, or its angle goes back"),
    ],
)
def test_why_there_are_no_orders(turns, reason):
    assert no_orders(RATE, turns) == reason
    with pytest.raises(ValueError, match=reason[:12]):
        orders(np.ones((2, N)), RATE, turns)


def test_the_angle_goes_on_beyond_the_marks():
    marks = np.array([1.0, 2.0, 4.0])
    assert angle_at(marks, np.array([0.0, 1.5, 3.0, 6.0])) == pytest.approx([-1.0, 0.5, 1.5, 3.0])


def test_every_view_gives_finite_features_of_one_size():
    rng = np.random.default_rng(0)
    for name, view in VIEWS.items():
        sizes = {
            len(view(rng.normal(size=(3, N)), RATE, shaft(*speeds)))
            for speeds in ((20.0, 20.0), (20.0, 60.0))
        }
        assert len(sizes) == 1, name
        assert np.isfinite(view(np.zeros((3, N)), RATE, shaft())).all(), name


def test_a_window_has_samples_enough():
    assert window_samples(50.0) == 200
    assert window_samples(5000.0) == 5000
    assert window_samples(5000.0, 0.2) == 1000
