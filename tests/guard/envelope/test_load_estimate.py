from functools import cache
from math import pi, radians

import msgspec
import numpy as np
import pytest

from firmware_py.config import Config
from firmware_py.guard.envelope.load_estimate import LoadEstimator, LoadInterval, Look
from firmware_py.machine.lubricant import viscosity_Pa_s
from sim_hil.film import equilibrium

from ..scripted_node import bench

RPM = pi / 30
RNG = np.random.default_rng(7)
PROBES = radians(45.0), radians(135.0)


@cache
def position(load_N: float, rpm: float, clearance_m: float, viscosity: float = 0.01) -> np.ndarray:
    bearing = bench().machine.bearing
    return equilibrium(
        load_N=load_N,
        radius_m=bearing.journal_radius_m,
        length_m=bearing.length_m,
        clearance_m=clearance_m,
        viscosity_Pa_s=viscosity,
        speed_rad_s=rpm * RPM,
    ).position_m


def look(
    place: np.ndarray,
    clearance_m: float,
    rpm: float,
    *,
    gain: tuple[float, float] = (0.0, 0.0),
    zero_m: tuple[float, float] = (0.0, 0.0),
    temperature_C: float = 40.0,
    p2p_m: float = 5e-6,
    time_s: float = 0.0,
    power_W: float = 0.0,
) -> Look:
    """What the probes make of a place, with their errors."""
    axes = np.array([[np.cos(a), np.sin(a)] for a in PROBES])
    seen = (axes @ place) * (1 + np.array(gain)) + np.array(zero_m)
    x, y = np.linalg.solve(axes, seen)
    return Look(time_s, float(x), float(y), p2p_m, clearance_m, rpm * RPM, temperature_C, power_W)


def zeroed() -> Config:
    config = bench()
    done = [
        msgspec.structs.replace(c, zeroed=c.name.startswith("disp")) for c in config.machine.channel
    ]
    return config.replaced(channel=done)


@pytest.mark.parametrize(
    ("config", "zero_m", "gain"), [(bench(), 2e-6, 0.03), (zeroed(), 0.5e-6, 0.01)]
)
@pytest.mark.parametrize("load_N", [30.0, 100.0, 300.0])
@pytest.mark.parametrize(("rpm", "clearance_um"), [(1500.0, 45.0), (6000.0, 90.0), (12000.0, 70.0)])
def test_the_interval_holds_the_true_load_at_every_corner_of_the_errors(
    config: Config, zero_m: float, gain: float, load_N: float, rpm: float, clearance_um: float
) -> None:
    """Probes, clearance and oil at their worst, and the thinnest oil's share of the film's load
    with them."""
    estimator, law = LoadEstimator(config), viscosity_Pa_s(config.machine.lubricant, 40.0)
    for built_m in (-2e-6, 2e-6):
        for oil in (estimator.oil.thinnest, 1.0, estimator.oil.thickest):
            place = position(load_N, rpm, clearance_um * 1e-6 + built_m, law * oil)
            for signs in np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1], [-1, 1])).T.reshape(-1, 4):
                seen = look(
                    place,
                    clearance_um * 1e-6,
                    rpm,
                    gain=tuple(signs[:2] * gain),
                    zero_m=tuple(signs[2:] * zero_m),
                )
                found = LoadEstimator(config).estimate(seen)
                assert found.measured
                assert found.low_N <= load_N <= found.high_N
                assert found.film_N >= min(300.0, load_N / oil * estimator.oil.thinnest) * (
                    1 - 1e-9
                )


def test_the_zero_procedure_narrows_the_interval() -> None:
    for load_N, rpm in ((40.0, 9000.0), (100.0, 6000.0), (250.0, 3000.0)):
        seen = look(
            position(load_N, rpm, 81e-6), 80e-6, rpm, gain=(0.01, -0.01), zero_m=(0.5e-6, -0.5e-6)
        )
        narrow, wide = LoadEstimator(zeroed()).estimate(seen), LoadEstimator(bench()).estimate(seen)
        assert wide.low_N <= narrow.low_N <= load_N <= narrow.high_N <= wide.high_N
        assert narrow.high_N - narrow.low_N < wide.high_N - wide.low_N


def test_the_estimate_is_worth_having_in_the_middle_of_the_range() -> None:
    found = LoadEstimator(bench()).estimate(look(position(100.0, 6000.0, 80e-6), 80e-6, 6000.0))
    assert found.measured
    assert 60.0 < found.low_N < 100.0 < found.high_N < 160.0


def test_a_less_known_film_gives_a_wider_interval() -> None:
    config = bench()
    bearing = msgspec.structs.replace(
        config.machine.bearing, load_error_share=0.21, attitude_error_deg=15.0
    )
    seen = look(position(100.0, 6000.0, 80e-6), 80e-6, 6000.0)
    sure, unsure = (
        LoadEstimator(c).estimate(seen) for c in (config, config.replaced(bearing=bearing))
    )
    assert unsure.low_N < sure.low_N
    assert unsure.high_N > sure.high_N


def test_a_clearance_that_was_measured_counts_as_it_is() -> None:
    config, place = bench(), position(100.0, 6000.0, 83e-6)
    known = msgspec.structs.replace(
        config.machine.bearing, radial_clearance_offset_um=3.0, radial_clearance_error_um=0.5
    )
    measured = LoadEstimator(config.replaced(bearing=known)).estimate(look(place, 80e-6, 6000.0))
    told, right = (LoadEstimator(config).estimate(look(place, c, 6000.0)) for c in (80e-6, 83e-6))
    assert right.low_N < measured.low_N < 100.0 < measured.high_N < right.high_N
    assert told != right


def test_a_shifted_zero_is_seen_by_the_direction_and_falls_back_to_the_declared_range() -> None:
    seen = look(position(100.0, 6000.0, 80e-6) - np.array([30e-6, 0.0]), 80e-6, 6000.0)
    assert LoadEstimator(bench()).estimate(seen) == LoadInterval(30.0, 300.0, 300.0, False)


@pytest.mark.parametrize(
    ("rpm", "p2p_m", "measured"),
    [(0.0, 5e-6, False), (6000.0, 49e-6, False), (6000.0, 47e-6, True)],
)
def test_a_standing_or_whirling_shaft_says_nothing(
    rpm: float, p2p_m: float, measured: bool
) -> None:
    seen = look(position(100.0, 6000.0, 80e-6), 80e-6, rpm, p2p_m=p2p_m)
    assert LoadEstimator(bench()).estimate(seen).measured == measured


def test_a_moving_clearance_counts_as_it_was_amid_the_window() -> None:
    """Readings 50 ms apart: the shaft's mean belongs to the earlier one."""
    place, estimator = position(100.0, 6000.0, 80e-6), LoadEstimator(bench())
    still = LoadEstimator(bench()).estimate(look(place, 80e-6, 6000.0))
    estimator.estimate(look(place, 80e-6, 6000.0, time_s=1.0))
    assert estimator.estimate(look(place, 82.5e-6, 6000.0, time_s=1.05)) == still
    assert estimator.estimate(look(place, 82.5e-6, 6000.0, time_s=9.0)) != still
