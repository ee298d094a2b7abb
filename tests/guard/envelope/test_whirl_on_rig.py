"""The guard's bound of whirl against rotors of the rig whose clearance opens slowly."""

from functools import cache
from math import exp, pi

import numpy as np
import pytest

from firmware_py.guard.envelope import shield
from firmware_py.machine.film import static_film
from models.control.commissioned import apparent_mass_kg
from models.control.episodes import untripped
from sim_hil.gym.control_task import CONTROL_S, Disturbances, actions_of
from sim_hil.gym.vector_environment import RotorVectorEnv
from sim_hil.plant.duty import Duty
from sim_hil.rigs import load_rig
from sim_hil.rotor.parameters import CLEARANCE, OIL

RIG = load_rig("bench")
SEEDS = [1135, 65, 2845, 99, 2048, 2409, 1842, 3520, 3149, 2180]
"""Machines of all unbalances, 0.1 to 0.6 of the load, that whirl within the actuator's reach; speed
and load held."""


HARDEST = Duty.hold(12000.0, 30.0)
"""The fastest and lightest: whirl within 62 to 82 um, nearly round the centre, where unbalance
counts most."""


@cache
def opened(duty: Duty | None) -> list[tuple[float, float, float]]:
    """Clearance in which each begins to whirl, over the guard's bound with none, the share and all
    of its unbalance.

    At an operating point of its own, where no ``duty`` is given.
    """
    held = Disturbances(hold_s=(1e4, 1e4), developing=0.0, inlet_C=(40.0, 40.0))
    rotors = RotorVectorEnv(
        len(SEEDS), "bench", episode_s=400.0, limits=untripped(RIG), duty=duty, disturbances=held
    )
    rotors.reset(seed=list(SEEDS))
    found: dict[int, tuple[float, float, float]] = {}
    for clearance_m in np.arange(80e-6 if duty is None else 55e-6, 160e-6, 1e-6 * CONTROL_S):
        *_, seen = rotors.step(actions_of(RIG, np.full((len(SEEDS), 1), clearance_m)))
        for i in np.flatnonzero(seen["peak_to_peak_m"] > 0.5 * seen["clearance_m"]).tolist():
            found.setdefault(i, _over_the_bound(rotors, i))
    return [found[i] for i in range(len(SEEDS))]


def _over_the_bound(rotors: RotorVectorEnv, i: int) -> tuple[float, float, float]:
    build, (speed, load_N) = rotors.episodes[i].build, rotors.episodes[i].duty.point(0.0)
    oil, film = RIG.oil, static_film(RIG.bearing.radius_m, RIG.bearing.length_m)
    warmer_K = rotors._scalar[i, OIL] - oil.reference_C
    viscosity = oil.viscosity_Pa_s * build.viscosity * exp(-oil.slope_per_K * warmer_K)
    mass_kg = apparent_mass_kg(RIG.rotor, build, 12000 * pi / 60)
    per_number = load_N / (mass_kg * speed * speed)
    tie, shaken = (
        per_number**2 * load_N / (viscosity * speed),
        build.unbalance_kg_m * speed * speed / load_N,
    )
    built_m = rotors._scalar[i, CLEARANCE] + build.clearance_error_m
    none, share, whole = (
        float(built_m * film.whirl_share(tie, s * shaken) / per_number)
        for s in (0.0, shield.WHIRL_MEASURED, 1.0)
    )
    return none, share, whole


@pytest.mark.parametrize("duty", [None, HARDEST])
def test_with_a_measured_unbalance_no_machine_whirls_within_the_bound_and_some_soon_after_it(
    duty: Duty | None,
) -> None:
    assert 1.01 < min(share for _, share, _ in opened(duty)) < 1.03


@pytest.mark.parametrize("duty", [None, HARDEST])
def test_all_of_the_unbalance_is_too_much_and_none_too_little(duty: Duty | None) -> None:
    assert min(whole for *_, whole in opened(duty)) > 1.03
    assert min(none for none, *_ in opened(duty)) < 0.92
