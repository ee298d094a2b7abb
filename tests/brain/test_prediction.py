"""Synchronisation finds the machine's parameters over the declared range, and says how well."""

from __future__ import annotations

import dataclasses
import time

import numpy as np
import pytest

from firmware_py.brain.estimate import POWER_ERROR_W, ZERO_ERROR_M, Measured, Synchroniser
from firmware_py.brain.film import Points
from firmware_py.brain.power import PowerFilter
from firmware_py.brain.prediction import CANDIDATES, Predictor
from firmware_py.brain.unbalance import ImbalanceFilter

from .machine import CONFIG, film, model
from .onnx_models import short_film

FILM = film()
SYNCHRONISER = Synchroniser(FILM, CONFIG)
CASES = [(6000.0, 100.0, 50.0, 60e-6), (12000.0, 30.0, 55.0, 50e-6), (3000.0, 300.0, 45.0, 70e-6),
         (1500.0, 200.0, 42.0, 60e-6), (9000.0, 200.0, 58.0, 90e-6)]


def truth(rpm: float, load_N: float, oil_C: float, clearance_m: float) -> tuple[Points, float]:
    viscosity = CONFIG.oil.viscosity_Pa_s(oil_C)
    return Points(*(np.array([v]) for v in (rpm * np.pi / 30, clearance_m, viscosity, load_N))), viscosity


def measure(rpm: float, load_N: float, oil_C: float, clearance_m: float,
            rng: np.random.Generator | None = None) -> Measured:
    """What sensors with the declared errors would say."""
    p, _ = truth(rpm, load_N, oil_C, clearance_m)
    position, _, torque = FILM.equilibrium(p)
    x, y, power = *position[0], torque[0] * p.speed_rad_s[0]
    if rng is not None:
        x, y = np.array([x, y]) * (1 + rng.uniform(-0.03, 0.03)) + rng.normal(0, ZERO_ERROR_M / 2, 2)
        power += rng.normal(0, POWER_ERROR_W / 2)
        oil_C = oil_C + rng.uniform(-1, 1)
    return Measured(float(p.speed_rad_s[0]), clearance_m, float(x), float(y), 5e-6, float(power), oil_C)


@pytest.mark.parametrize("case", CASES)
def test_perfect_sensors_give_the_parameters_back(case: tuple[float, float, float, float]) -> None:
    estimate = SYNCHRONISER.step(measure(*case))
    low, expected, high = estimate.load_interval_N
    assert low < case[1] < high
    assert expected == pytest.approx(case[1], rel=0.15) or case[1] == 30.0  # there the zero error hides it
    assert estimate.viscosity_Pa_s == pytest.approx(truth(*case)[1], rel=0.05)


def test_intervals_cover_the_truth_about_as_often_as_they_say() -> None:
    rng = np.random.default_rng(5)
    inside, total = np.zeros(2), 0
    for _ in range(12):
        for case in CASES:
            estimate = SYNCHRONISER.step(measure(*case, rng))
            viscosity = truth(*case)[1]
            inside += [estimate.load_interval_N[0] <= case[1] <= estimate.load_interval_N[2],
                       estimate.viscosity_interval_Pa_s[0] <= viscosity <= estimate.viscosity_interval_Pa_s[2]]
            total += 1
    assert (inside / total >= 0.88).all()


def test_load_and_viscosity_cannot_be_told_apart_without_power_and_temperature() -> None:
    """At low speed the friction says nothing: the two errors move together, as the similarity rule demands."""
    slow, fast = (SYNCHRONISER.step(measure(*case)).log_covariance for case in (CASES[3], CASES[4]))
    correlation = slow[0, 1] / np.sqrt(slow[0, 0] * slow[1, 1])
    assert correlation > 0.4
    assert fast[1, 1] < 0.5 * slow[1, 1]


def test_outlook_orders_and_truth() -> None:
    predictor = Predictor(model(short_film()), CONFIG)
    m = measure(6000.0, 100.0, 50.0, 60e-6)
    outlook = predictor.forecast(m, predictor.estimate(m), predictor.candidates_m)
    assert outlook.clearance_m.shape == (CANDIDATES,)
    assert outlook.clearance_m[[0, -1]] == pytest.approx([40e-6, 160e-6])
    for quantity in (outlook.power_W, outlook.min_film_m, outlook.whirl_margin, outlook.peak_to_peak_m):
        assert quantity.shape == (CANDIDATES, 3)
        assert (np.diff(quantity, axis=1) >= 0).all()
    assert (np.diff(outlook.power_W[:, 1]) < 0).all()  # friction falls with clearance
    p = Points(np.full(CANDIDATES, m.speed_rad_s), predictor.candidates_m,
               np.full(CANDIDATES, CONFIG.oil.viscosity_Pa_s(50.0)), np.full(CANDIDATES, 100.0))
    true = FILM.steady(p)
    assert ((outlook.power_W[:, 0] <= true.power_W) & (true.power_W <= outlook.power_W[:, 2])).all()
    assert outlook.power_W[:, 1] == pytest.approx(true.power_W, rel=0.03)
    assert outlook.whirl_margin[:, 1] == pytest.approx(true.damping_ratio, abs=0.03)


def test_runout_and_unbalance_are_told_apart_once_the_speed_has_moved() -> None:
    runout, unbalance = 6e-6 * np.exp(1j), 2e-5 * np.exp(-2j)
    f = ImbalanceFilter(1.7e-5)
    gains = {rpm: 0.5 * complex(1, 0) * (lambda q: q[0] + 1j * q[1])(
        FILM.steady(truth(rpm, 100.0, 50.0, 60e-6)[0]).response_m_per_kg_m[0]) for rpm in (3000.0, 6000.0, 11000.0)}
    for i in range(20):
        state = f.step(i * 250_000_000, runout + gains[3000.0] * unbalance, gains[3000.0])
    assert state.sd_kg_m > 1e-5  # not identifiable yet, and it says so
    for rpm in (6000.0, 11000.0):
        for i in range(20):
            state = f.step((20 + i) * 250_000_000, runout + gains[rpm] * unbalance, gains[rpm])
    assert state.runout_m == pytest.approx(runout, abs=4e-7)
    assert state.unbalance_kg_m == pytest.approx(unbalance, abs=3e-6)
    assert abs(state.unbalance_kg_m - unbalance) < 3 * state.sd_kg_m


def test_a_growing_unbalance_is_not_taken_for_runout() -> None:
    f = ImbalanceFilter(1.7e-5)
    gain = 0.5 + 0.1j
    for gain in (0.2 + 0j, 0.5 + 0.1j):
        for i in range(40):
            f.step(i * 250_000_000, 3e-6 + gain * 1e-5, gain)
    before = f.state
    for i in range(40, 80):
        state = f.step(i * 250_000_000, 3e-6 + gain * 8e-5, gain)
    assert state.runout_m == pytest.approx(before.runout_m, abs=1.5e-6)
    assert state.size_kg_m == pytest.approx(8e-5, rel=0.05)


def test_the_power_channels_offset_is_learned_over_operating_points() -> None:
    f = PowerFilter()
    for i in range(20):
        f.step(i * 250_000_000, 84.0 * 1.08 + 3.5, 84.0)
    assert f.offset_sd_W > 2.0  # one operating point cannot tell offset from factor, and it says so
    for j, expected_W in enumerate((8.0, 260.0)):
        for i in range(20):
            f.step((20 * (j + 1) + i) * 250_000_000, expected_W * 1.08 + 3.5, expected_W)
    assert f.offset_W == pytest.approx(3.5, abs=0.5)
    assert abs(f.offset_W - 3.5) < 3 * f.offset_sd_W


def test_after_learning_the_forecast_of_a_slow_shaft_is_close() -> None:
    predictor = Predictor(model(short_film()), CONFIG)
    slow = measure(1500.0, 300.0, 45.0, 60e-6)
    for j, case in enumerate(((6000.0, 100.0, 45.0, 60e-6), (1500.0, 300.0, 45.0, 60e-6))):
        m = measure(*case)
        for i in range(20):
            biased = dataclasses.replace(m, shaft_power_W=m.shaft_power_W + 4.0)
            predictor.learn((20 * j + i) * 250_000_000, biased, 0j)
    reported = dataclasses.replace(slow, shaft_power_W=slow.shaft_power_W + 4.0)
    outlook = predictor.forecast(reported, predictor.estimate(reported), np.array([60e-6]))
    assert outlook.power_W[0, 1] == pytest.approx(slow.shaft_power_W, rel=0.08)  # reported: 60 % off


@pytest.mark.slow
def test_sixteen_candidates_within_their_budget() -> None:
    predictor = Predictor(model(short_film()), CONFIG)
    m = measure(6000.0, 100.0, 50.0, 60e-6)
    times = []
    for _ in range(50):
        start = time.perf_counter()
        predictor.forecast(m, predictor.estimate(m), predictor.candidates_m)
        times.append(time.perf_counter() - start)
    print(f"synchronise and forecast {CANDIDATES} candidates: best {min(times) * 1e3:.1f} ms")
    assert min(times) < 0.020
