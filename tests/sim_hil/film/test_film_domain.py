"""Where Reynolds' equation holds, by hand and for the two rigs."""

import math

import pytest

from sim_hil.film.domain import describe, domain
from sim_hil.rigs import load_rig

BENCH, SEED = load_rig("bench"), load_rig("seed")


def test_numbers_by_hand() -> None:
    at = domain(BENCH, 12000, 60e-6, 0.01)
    omega = 400 * math.pi
    assert at.reynolds == pytest.approx(850 * omega * 0.02 * 60e-6 / 0.01)
    assert at.taylor == pytest.approx(at.reynolds * math.sqrt(60e-6 / 0.02))
    assert at.inertia == pytest.approx(850 * omega * 60e-6**2 / 0.01)
    assert domain(BENCH, -12000, 60e-6, 0.01) == at
    assert at.warnings == ()


def test_water_in_the_seed_rig_is_outside() -> None:
    nominal = domain(SEED, 3000, 62.5e-6, 0.001)
    assert [text.split(":")[0] for text in nominal.warnings] == ["oil inertia counts"]
    widest = domain(SEED, 3000, 95e-6, 0.001)
    assert [text.split(":")[0] for text in widest.warnings] == ["not laminar", "oil inertia counts"]
    assert any(line.startswith("warning: film at 3000 rpm") for line in describe(SEED))


def test_a_rig_says_where_it_stands() -> None:
    lines = describe(BENCH)
    assert lines[0].startswith("film at 12000 rpm, 60 um: Re = 128, Ta = 7.0")
    # the widest clearance at full speed is laminar, but the oil's inertia counts there
    assert [line for line in lines if line.startswith("warning")] == [
        "warning: film at 12000 rpm, 160 um: oil inertia counts: rho omega c^2/mu = 2.7, above 1"
    ]
