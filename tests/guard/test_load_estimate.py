from math import pi

import msgspec
import numpy as np
import pytest

from firmware_py.guard.load_estimate import LoadEstimator
from sim_hil.film import equilibrium

from .scripted_node import bench

RPM = pi / 30
RNG = np.random.default_rng(7)


def position(load_N: float, rpm: float, clearance_m: float, temperature_C: float = 40.0) -> tuple[float, float]:
    config = bench()
    state = equilibrium(
        load_N=load_N,
        radius_m=config.bearing.journal_radius_m,
        length_m=config.bearing.length_m,
        clearance_m=clearance_m,
        viscosity_Pa_s=config.oil.viscosity_Pa_s(temperature_C),
        speed_rad_s=rpm * RPM,
    )
    return float(state.position_m[0]), float(state.position_m[1])


@pytest.mark.parametrize("load_N", [30.0, 100.0, 300.0])
@pytest.mark.parametrize("rpm", [1500.0, 12000.0])
@pytest.mark.parametrize("clearance_um", [45.0, 140.0])
def test_the_interval_holds_the_true_load_under_every_sensor_error(
    load_N: float, rpm: float, clearance_um: float
) -> None:
    estimator = LoadEstimator(bench())
    for _ in range(2):
        built_m = (clearance_um + RNG.uniform(-2, 2)) * 1e-6
        x, y = position(load_N, rpm, built_m, RNG.uniform(39, 42))
        gains, zeros = 1 + RNG.uniform(-0.03, 0.03, 2), RNG.uniform(-2e-6, 2e-6, 2)
        found = estimator.estimate(
            x * gains[0] + zeros[0], y * gains[1] + zeros[1], clearance_um * 1e-6, rpm * RPM, 41.0, 5e-6
        )
        assert found.low_N <= load_N <= found.high_N


def test_the_zero_procedure_narrows_the_interval_and_its_errors_are_still_covered() -> None:
    config = bench()
    done = [msgspec.structs.replace(c, zeroed=c.name.startswith("disp")) for c in config.channel]
    zeroed, plain = LoadEstimator(msgspec.structs.replace(config, channel=done)), LoadEstimator(config)
    for load_N, rpm in ((30.0, 9000.0), (100.0, 6000.0), (250.0, 3000.0)):
        x, y = position(load_N, rpm, 81e-6, 41.0)
        seen = (x * 1.01 + 0.5e-6, y * 0.99 - 0.5e-6, 80e-6, rpm * RPM, 41.0, 5e-6)
        narrow, wide = zeroed.estimate(*seen), plain.estimate(*seen)
        assert wide.low_N <= narrow.low_N <= load_N <= narrow.high_N <= wide.high_N
        assert narrow.high_N - narrow.low_N < wide.high_N - wide.low_N


def test_the_estimate_is_worth_having_in_the_middle_of_the_range() -> None:
    x, y = position(100.0, 6000.0, 80e-6)
    found = LoadEstimator(bench()).estimate(x, y, 80e-6, 6000 * RPM, 40.0, 5e-6)
    assert found.measured
    assert 45.0 < found.low_N < 100.0 < found.high_N < 210.0


def test_a_shifted_zero_is_seen_by_the_direction_and_falls_back_to_the_declared_range() -> None:
    x, y = position(100.0, 6000.0, 80e-6)
    found = LoadEstimator(bench()).estimate(x - 30e-6, y, 80e-6, 6000 * RPM, 40.0, 5e-6)
    assert (found.low_N, found.high_N, found.measured) == (30.0, 300.0, False)


@pytest.mark.parametrize(
    ("speed", "p2p_m", "measured"), [(0.0, 5e-6, False), (600.0, 49e-6, False), (600.0, 47e-6, True)]
)
def test_a_standing_or_whirling_shaft_says_nothing(speed: float, p2p_m: float, measured: bool) -> None:
    x, y = position(100.0, 6000.0, 80e-6)
    assert LoadEstimator(bench()).estimate(x, y, 80e-6, speed, 40.0, p2p_m).measured == measured
