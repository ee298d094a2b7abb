"""What the shaft power tells of the oil: credible at every corner, kept, and forgotten when it is
contradicted."""

from functools import cache
from math import pi

import msgspec
import pytest

from firmware_py.config import Config
from firmware_py.guard.envelope.load_estimate import LoadEstimator, Look
from firmware_py.guard.envelope.oil_estimate import OilEstimator, OilState, SteadyInstant
from firmware_py.machine.film import StaticFilm
from firmware_py.machine.lubricant import viscosity_Pa_s
from sim_hil.film import Equilibrium, equilibrium

from ..scripted_node import bench

RPM = pi / 30
FAST = 12000.0 * RPM


def estimator(config: Config) -> OilEstimator:
    return OilEstimator(
        config, StaticFilm(config.machine.bearing.journal_radius_m, config.machine.bearing.length_m)
    )


def learnt(share: float, error_W: float, built_m: float, clearance_m: float = 60e-6) -> OilState:
    """After a second at 12000 rpm and 60 N with oil of that share of the law."""
    config, state = bench(), estimator(bench()).unknown()
    film = equilibrium(
        load_N=60.0, radius_m=0.02, length_m=0.02, clearance_m=clearance_m + built_m,
        viscosity_Pa_s=share * viscosity_Pa_s(config.machine.lubricant, 45.0), speed_rad_s=FAST,
    )  # fmt: skip
    power_W = (
        float(film.film.friction_torque_N_m) * FAST
        + config.machine.rotor.windage_W_s3 * FAST**3
        + error_W
    )
    knot = int(film.eccentricity_ratio / 0.0025)
    for tick in range(21):
        now = SteadyInstant(0.05 * tick, FAST, clearance_m, 45.0, power_W)
        estimator(config).learn(state, now, (knot - 2, knot + 3))
    return state


@pytest.mark.parametrize("share", [0.88, 1.0, 1.12])
@pytest.mark.parametrize("error_W", [-5.0, 5.0])
@pytest.mark.parametrize("built_m", [-2e-6, 2e-6])
def test_the_true_oil_stays_credible_under_every_error(
    share: float, error_W: float, built_m: float
) -> None:
    state = learnt(share, error_W, built_m)
    assert state.thinnest <= share <= state.thickest
    assert state.thickest - state.thinnest < 0.16


def test_a_zeroed_torque_meter_tells_more_of_the_oil() -> None:
    config = bench()
    zeroed = config.replaced(
        rotor=msgspec.structs.replace(config.machine.rotor, shaft_power_error_W=1.0)
    )
    widths = []
    for known in (zeroed, config):
        oil, state = estimator(known), estimator(known).unknown()
        for tick in range(21):
            oil.learn(state, SteadyInstant(0.05 * tick, FAST, 60e-6, 45.0, 230.0), (80, 90))
        widths.append(state.thickest - state.thinnest)
    assert widths[0] < widths[1]


def test_nothing_is_learnt_while_the_speed_changes_nor_from_a_film_that_is_not_known() -> None:
    config = bench()
    for changed in (
        config.replaced(
            bearing=msgspec.structs.replace(config.machine.bearing, friction_error_share=1.0)
        ),
        config.replaced(
            lubricant=msgspec.structs.replace(config.machine.lubricant, film_at_outlet=False)
        ),
    ):
        oil, state = estimator(changed), estimator(changed).unknown()
        for tick in range(40):
            oil.learn(state, SteadyInstant(0.05 * tick, FAST, 60e-6, 45.0, 250.0), (80, 90))
        assert oil.interval(state) == oil.interval(oil.unknown())
    oil, state = estimator(config), estimator(config).unknown()
    for tick in range(40):
        oil.learn(
            state,
            SteadyInstant(0.05 * tick, FAST * (1 + 0.0005 * tick), 60e-6, 45.0, 250.0),
            (80, 90),
        )
    assert oil.interval(state) == oil.interval(oil.unknown())


def test_a_contradiction_forgets_and_an_hour_of_silence_too() -> None:
    state, oil = learnt(0.9, 0.0, 0.0), estimator(bench())
    narrow = oil.interval(state)
    for tick in range(21):
        oil.learn(state, SteadyInstant(2.0 + 0.05 * tick, FAST, 60e-6, 45.0, 400.0), (80, 90))
    assert oil.interval(state) == oil.interval(oil.unknown()) != narrow
    state = learnt(0.9, 0.0, 0.0)
    for tick in range(21):
        oil.learn(state, SteadyInstant(3600.0 + 0.05 * tick, 300.0, 60e-6, 45.0, 5.0), (80, 90))
    assert oil.interval(state) == oil.interval(oil.unknown())


def test_a_film_that_may_be_colder_than_its_outlet_may_be_thicker() -> None:
    config = bench()
    oil = msgspec.structs.replace(config.machine.lubricant, film_at_outlet=False)
    cold = estimator(config.replaced(lubricant=oil))
    known = cold.interval(cold.unknown())
    thicker = viscosity_Pa_s(config.machine.lubricant, 35.0) / viscosity_Pa_s(
        config.machine.lubricant, 45.0
    )
    assert cold.thickest(known, 45.0) == pytest.approx(known.thickest * thicker)
    assert cold.thickest(known, 30.0) == known.thickest
    assert estimator(config).thickest(known, 45.0) == known.thickest


def test_the_estimator_of_the_load_gains_by_what_was_learnt() -> None:
    config = bench()
    film = equilibrium(
        load_N=60.0,
        radius_m=0.02,
        length_m=0.02,
        clearance_m=60e-6,
        speed_rad_s=FAST,
        viscosity_Pa_s=viscosity_Pa_s(config.machine.lubricant, 45.0),
    )
    power_W = (
        float(film.film.friction_torque_N_m) * FAST + config.machine.rotor.windage_W_s3 * FAST**3
    )
    loads = LoadEstimator(config)
    x, y = film.position_m.tolist()
    found = [
        loads.estimate(Look(0.05 * k, x, y, 5e-6, 60e-6, FAST, 45.0, power_W)) for k in range(40)
    ]
    assert found[0].low_N < 0.96 * found[-1].low_N < 60.0 < found[-1].high_N < found[0].high_N


@pytest.mark.parametrize("share", [0.88, 1.1])
@pytest.mark.parametrize("built_m", [-2e-6, 0.0, 2e-6])
@pytest.mark.parametrize("learnt_m", [42e-6, 75e-6])
@pytest.mark.parametrize("error_W", [-5.0, 5.0])
def test_the_load_stays_credible_in_every_clearance_after_learning_in_another(
    share: float, built_m: float, learnt_m: float, error_W: float
) -> None:
    """Oil and clearance at their worst together, where thicker oil and a wider bearing look
    alike."""
    loads = LoadEstimator(bench())
    steady = seen(learnt_m, built_m, share, 60.0, FAST, error_W)
    for tick in range(21):
        loads.estimate(msgspec.structs.replace(steady, time_s=0.05 * tick))
    assert loads.oil != LoadEstimator(bench()).oil
    for clearance_m in (45e-6, 70e-6, 110e-6, 160e-6):
        for load_N, speed in ((35.0, FAST), (60.0, 0.6 * FAST)):
            now = seen(clearance_m, built_m, share, load_N, speed, error_W)
            found = loads.estimate(msgspec.structs.replace(now, time_s=9.0 + 1e6 * clearance_m))
            assert found.measured
            assert found.low_N <= load_N <= found.high_N


@cache
def standing(clearance_m: float, share: float, load_N: float, speed: float) -> Equilibrium:
    """Where the journal stands in oil at 45 °C of so many times the declared viscosity."""
    return equilibrium(
        load_N=load_N,
        radius_m=0.02,
        length_m=0.02,
        clearance_m=clearance_m,
        speed_rad_s=speed,
        viscosity_Pa_s=share * viscosity_Pa_s(bench().machine.lubricant, 45.0),
    )


def seen(
    clearance_m: float, built_m: float, share: float, load_N: float, speed: float, error_W: float
) -> Look:
    """What a machine shows whose bearing, oil and power reading are off by so much."""
    config = bench()
    film = standing(clearance_m + built_m, share, load_N, speed)
    power_W = (
        float(film.film.friction_torque_N_m) * speed
        + config.machine.rotor.windage_W_s3 * speed**3
        + error_W
    )
    x, y = film.position_m.tolist()
    return Look(0.0, x, y, 5e-6, clearance_m, speed, 45.0, power_W)


def held(change: dict[str, float], ticks: int = 60) -> bool:
    """Whether anything is learnt while one quantity goes on changing by so much a tick of 50 ms."""
    oil, state = estimator(bench()), estimator(bench()).unknown()
    start = {"speed_rad_s": FAST, "clearance_m": 60e-6, "temperature_C": 45.0, "power_W": 250.0}
    for tick in range(ticks):
        now = SteadyInstant(
            0.05 * tick,
            **{name: value + tick * change.get(name, 0.0) for name, value in start.items()},
        )
        oil.learn(state, now, (80, 90))
    return oil.interval(state) == oil.interval(oil.unknown())


@pytest.mark.parametrize(
    "change",
    [
        {"clearance_m": 2.5e-6},
        {"clearance_m": -2.5e-6},
        {"clearance_m": 0.2e-6},
        {"temperature_C": 0.05},
        {"power_W": -5.0},
        {"speed_rad_s": 0.3},
    ],
)
def test_nothing_is_learnt_while_clearance_temperature_power_or_speed_move(
    change: dict[str, float],
) -> None:
    assert held(change)
    assert not held({})


def test_one_reading_that_jumps_teaches_nothing_and_a_gap_begins_anew() -> None:
    oil, state = estimator(bench()), estimator(bench()).unknown()
    for tick in range(15):
        oil.learn(
            state,
            SteadyInstant(0.05 * tick, FAST, 60e-6, 45.0, 250.0 + 400.0 * (tick == 12)),
            (80, 90),
        )
    assert oil.interval(state) == oil.interval(oil.unknown())
    for tick in range(15):
        oil.learn(state, SteadyInstant(5.0 + 0.3 * tick, FAST, 60e-6, 45.0, 250.0), (80, 90))
    assert oil.interval(state) == oil.interval(oil.unknown())


def test_what_was_learnt_is_forgotten_while_the_power_is_not_ok() -> None:
    loads = LoadEstimator(bench())
    steady = seen(60e-6, 0.0, 0.9, 60.0, FAST, 0.0)
    for tick in range(41):
        loads.estimate(msgspec.structs.replace(steady, time_s=0.05 * tick))
    assert loads.oil != LoadEstimator(bench()).oil
    loads.estimate(msgspec.structs.replace(steady, time_s=3600.0, power_W=None))
    assert loads.oil == LoadEstimator(bench()).oil
