"""The rotor alone as a stranger calls it: maps, targets as functions of time, oil, either sense of
rotation."""

import numpy as np
import pytest

from sim_hil import Duty, load_rig, power_map, simulate
from sim_hil.plant.response import COMMAND_S

BENCH = load_rig("bench")


def test_the_map_shows_where_whirl_begins():
    found = power_map(BENCH, 12000.0, 30.0, [60e-6, 66e-6, 80e-6], seconds=0.6)
    share = found.peak_to_peak_m[0, 0] / [60e-6, 66e-6, 80e-6]
    assert share[0] < 0.25 < 0.5 < share[1] < 1 < share[2]
    assert (np.diff(found.power_W) < 0).all()


def test_the_map_is_the_same_in_either_sense_of_rotation():
    found = power_map(BENCH, [-3000.0, 3000.0], 100.0, 60e-6, seconds=0.2)
    for figures in (found.power_W, found.min_film_m):
        assert figures[0] == pytest.approx(figures[1], rel=1e-3)


def test_targets_may_be_functions_of_time():
    run = simulate(
        BENCH,
        Duty.hold(3000, 100, 1.0),
        clearance=lambda t: 60e-6 + 20e-6 * t,
        pressure=lambda t: 1e5,
        thermal=False,
    )
    assert run.column("clearance_m")[-1] == pytest.approx(60e-6 + 20e-6 * (1 - 0.05), abs=1e-6)


def test_a_function_of_time_is_read_every_millisecond():
    asked = []
    simulate(
        BENCH,
        Duty.hold(3000, 100, 0.01),
        clearance=lambda t: asked.append(t) or 60e-6,
        rate_hz=10000,
    )
    np.testing.assert_allclose(asked, np.arange(10) * COMMAND_S)


def test_warm_oil_costs_less():
    cold, warm = (
        simulate(BENCH, Duty.hold(6000, 100, 0.1), clearance=60e-6, inlet_C=inlet).power_W.mean()
        for inlet in (35, 45)
    )
    assert warm / cold == pytest.approx(np.exp(-0.03 * 10), rel=0.1)
