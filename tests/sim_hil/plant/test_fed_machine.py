"""The machine on the film that is fed from its groove: the supply pressure carries load, and costs
pump power."""

import math
from dataclasses import replace

import numpy as np
import pytest

from sim_hil.film import FeedPatch, film_force
from sim_hil.film.records import FilmError
from sim_hil.plant.build import Build
from sim_hil.plant.duty import Duty
from sim_hil.plant.machine import SimulatedMachine
from sim_hil.plant.response import SimulationError, simulate
from sim_hil.plant.truth import pump_power_W
from sim_hil.rigs import load_rig
from sim_hil.rotor.parameters import TRUTH_COLUMNS, Floats

RIG = load_rig("bench")
SPEED_RAD_S = 100 * math.pi


def settled(fed: bool, supply_Pa: float, speed_rad_s: float = SPEED_RAD_S) -> Floats:
    """Mean truth, after the start, of a machine with no unbalance."""
    machine = SimulatedMachine(
        RIG, Build.nominal(RIG), 1, fed=fed, thermal=False, pressure_Pa=supply_Pa
    )
    rows = machine.advance(np.tile([speed_rad_s, 100.0], (3001, 1)), 60e-6, supply_Pa).truth
    return np.asarray(rows[-600:].mean(axis=0))


def column(row: Floats, name: str) -> float:
    return float(row[TRUTH_COLUMNS.index(name)])


@pytest.mark.parametrize("supply_Pa", [0.5e5, 3e5])
def test_the_journal_rests_where_the_fed_film_carries_the_load(supply_Pa: float) -> None:
    row = settled(True, supply_Pa)
    groove = FeedPatch("groove", math.pi / 2, math.radians(20), 0.016, supply_Pa)
    film = film_force(
        row[7:9],
        np.zeros(2),
        radius_m=0.02,
        length_m=0.02,
        clearance_m=60e-6,
        viscosity_Pa_s=0.01,
        speed_rad_s=SPEED_RAD_S,
        feed=[groove],
    )
    np.testing.assert_allclose(film.force_N, [0.0, 100.0], atol=1.0)
    assert column(row, "side_flow_m3_s") == pytest.approx(film.side_flow_m3_s, rel=0.02)


def test_supply_pressure_acts_in_the_fed_film_alone() -> None:
    low, high = settled(True, 0.5e5), settled(True, 3e5)
    # the groove is above: it presses the journal down, and oil runs through
    assert column(high, "eccentricity_y_m") < column(low, "eccentricity_y_m") - 5e-6
    assert column(high, "side_flow_m3_s") > 3 * column(low, "side_flow_m3_s")
    same = [settled(False, p)[7:9] for p in (0.5e5, 3e5)]
    np.testing.assert_array_equal(same[0], same[1])


def test_pump_power_is_pressure_times_flow_over_efficiency() -> None:
    row = settled(True, 3e5)
    expected = 3e5 * column(row, "side_flow_m3_s") / 0.6
    assert pump_power_W(RIG, row[None])[0] == pytest.approx(expected, rel=1e-6)
    assert 5.0 < expected < 20.0


def test_backward_rotation_is_the_mirror_image() -> None:
    forward, backward = settled(True, 1e5), settled(True, 1e5, -SPEED_RAD_S)
    np.testing.assert_allclose(backward[7:9] * [-1, 1], forward[7:9], atol=0.15e-6)


def test_a_rig_without_a_groove_has_no_fed_film() -> None:
    seed = load_rig("seed")
    seed = replace(seed, supply=replace(seed.supply, ports=()))
    with pytest.raises(FilmError, match="not one axial groove"):
        SimulatedMachine(seed, Build.nominal(seed), 1, fed=True)


def test_the_rotor_alone_rests_where_the_machine_does_and_pumps_as_much() -> None:
    run = simulate(
        RIG, Duty.hold(3000.0, 100.0, 0.4), clearance=60e-6, thermal=False, pressure=3e5, fed=True
    ).last(0.1)
    row = settled(True, 3e5)
    np.testing.assert_allclose(run.position_m.mean(axis=0), row[7:9], atol=0.2e-6)
    assert run.pump_power_W(0.6).mean() == pytest.approx(pump_power_W(RIG, row[None])[0], rel=0.02)
    with pytest.raises(SimulationError, match="only the table"):
        simulate(RIG, Duty.hold(3000.0, 100.0, 0.1), clearance=60e-6, fed=True, force="direct")
    for bad in (math.nan, -1e5, math.inf):
        with pytest.raises(SimulationError, match="supply pressure"):
            simulate(RIG, Duty.hold(3000.0, 100.0, 0.1), clearance=60e-6, pressure=bad)
