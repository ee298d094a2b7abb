"""Stiffness of the device's law beside that of the film equation, and modes of the rotor on it."""

from __future__ import annotations

from math import pi

import msgspec
import pytest

from firmware_py.config import read_machine
from firmware_py.machine.film import static_film
from firmware_py.machine.static import resting
from sim_hil.rotor.linear_film import linear_film

MACHINE = read_machine("bench")


@pytest.mark.parametrize(("rpm", "load_N"), [(1500.0, 100.0), (12000.0, 300.0)])
def test_the_stiffness_of_the_table_is_that_of_the_film_equation(rpm: float, load_N: float) -> None:
    at = (50e-6, 0.0094, rpm * pi / 30.0, load_N)
    solved = linear_film(MACHINE, *at)
    law = resting(static_film(0.02, 0.02), *at)
    assert law is not None
    for row, expected in zip(law.stiffness_N_m, solved.stiffness_N_m, strict=True):
        assert row == pytest.approx(expected, rel=0.03)
    assert solved.damping_N_s_m[0][1] == pytest.approx(solved.damping_N_s_m[1][0], rel=0.01)


def test_a_rotor_that_was_weighed_has_its_modes_on_the_film_alone() -> None:
    rotor = msgspec.structs.replace(
        MACHINE.rotor, effective_mass_at_bearing_kg=1.74, coupling_stiffness_N_m=None
    )
    drawn = linear_film(MACHINE, 50e-6, 0.0094, 12000 * pi / 30, 30.0).modes[0]
    machine = msgspec.structs.replace(MACHINE, rotor=rotor)
    weighed = linear_film(machine, 50e-6, 0.0094, 12000 * pi / 30, 30.0).modes
    assert weighed[0].frequency_rpm == pytest.approx(drawn.frequency_rpm, rel=0.03)
    assert weighed[0].sense == 1
