"""Order analysis finds what was put in, at every speed and on ramps; features are finite and
fixed."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_py.acquire.features import FEATURE_NAMES, features
from firmware_py.acquire.orders import Orders, analyse, over_angle
from firmware_py.acquire.recorded_windows import iter_windows
from firmware_py.acquire.windows import Window
from firmware_py.config import read_machine

from .synthetic_recording import readings, recording

BENCH = read_machine("bench")


def last_window(rate: int = 5000, **what: object) -> Window:
    counts, marks = recording(rate, **what)  # type: ignore[arg-type]
    return list(iter_windows(counts, 0, marks, rate, readings=readings()))[-1]


def orders(rate: int = 5000, **what: object) -> Orders:
    return analyse(last_window(rate, **what))


def named(window: Window) -> dict[str, float]:
    return dict(zip(FEATURE_NAMES, features(window, BENCH).tolist(), strict=True))


@pytest.mark.parametrize("speed_hz", [12.5, 25.0, 61.7, 200.0])
@pytest.mark.parametrize("rate", [5000, 10000])
def test_amplitudes_of_a_known_orbit(speed_hz: float, rate: int) -> None:
    o = orders(
        rate,
        start_hz=speed_hz,
        forward_m=(10e-6, 2e-6, 1e-6, 0.5e-6),
        backward_m=(3e-6, 0.5e-6),
        half_m=4e-6,
    )
    assert o.speed_rad_s == pytest.approx(2 * np.pi * speed_hz, rel=1e-4)
    assert o.forward[:4] == pytest.approx([10e-6, 2e-6, 1e-6, 0.5e-6], rel=0.02, abs=3e-8)
    assert o.backward[:2] == pytest.approx([3e-6, 0.5e-6], rel=0.02, abs=3e-8)
    assert o.half_forward == pytest.approx(4e-6, rel=0.03)
    assert o.half_backward < 1e-7
    assert o.mean[:2] == pytest.approx([20e-6, -5e-6], abs=3e-7)


def test_a_fast_shaft_has_a_mean_in_every_bin_up_to_the_last_mark() -> None:
    """At 20 samples a turn several of the 32 bins lie in the second half of the last sample."""
    signal = np.ascontiguousarray(np.linspace(0.0, 1.0, 200)[None])
    for last in (199.0, 199.6, 199.999):
        edges = last - np.arange(64, -1, -1) * (20.0 / 32.0) / 2
        means = over_angle(signal, edges)
        assert np.isfinite(means).all()
        assert means[0, -1] == pytest.approx(1.0)


def test_phase_is_counted_from_the_mark() -> None:
    o = orders(forward_m=(10e-6,), phase_rad=0.7)
    assert np.angle(o.harmonics[:2, 0]) == pytest.approx([-0.7, -0.7 - np.pi / 2], abs=2e-3)


@pytest.mark.parametrize("ramp_hz_s", [30.0, -30.0])
def test_a_ramp_does_not_smear_the_first_order(ramp_hz_s: float) -> None:
    o = orders(start_hz=150.0, ramp_hz_s=ramp_hz_s, seconds=3.0, forward_m=(10e-6, 2e-6))
    assert o.forward[:2] == pytest.approx([10e-6, 2e-6], rel=0.02)
    assert o.not_1x[0] == pytest.approx(2e-6 / np.sqrt(2), rel=0.1)


def test_energy_split() -> None:
    o = orders(forward_m=(10e-6,), half_m=10e-6)
    assert o.subsync_share == pytest.approx(0.5, abs=0.02)
    assert o.rms[0] == pytest.approx(10e-6, rel=0.02)
    assert orders(forward_m=(10e-6,)).subsync_share < 1e-4
    assert orders(forward_m=(10e-6,)).peak_to_peak == pytest.approx([20e-6, 20e-6], rel=0.01)


def test_features_are_fixed_finite_and_deterministic() -> None:
    window = last_window()
    vector = features(window, BENCH)
    assert vector.shape == (len(FEATURE_NAMES),) == (len(set(FEATURE_NAMES)),)
    assert vector.dtype == np.float32
    assert np.isfinite(vector).all()
    assert np.array_equal(vector, features(window, BENCH))


def test_features_stay_finite_without_any_signal() -> None:
    window = last_window(forward_m=(), acceleration_m_s2=0.0, noise=0.0)
    assert np.isfinite(features(window, BENCH)).all()


def test_gain_error_moves_absolute_features_only() -> None:
    small = named(last_window(forward_m=(10e-6, 4e-6), acceleration_m_s2=5.0, noise=0.0))
    large = named(last_window(forward_m=(11e-6, 4.4e-6), acceleration_m_s2=5.5, noise=0.0))
    assert large["log_shaft_fwd_1x_m"] - small["log_shaft_fwd_1x_m"] == pytest.approx(
        np.log10(1.1), abs=1e-3
    )
    for name in (
        "shaft_fwd_2x_1x",
        "acc_motor_1x_rms",
        "acc_motor_bearing_1x",
        "acc_motor_kurtosis",
    ):
        assert large[name] == pytest.approx(small[name], abs=2e-3), name


def test_each_cause_moves_its_own_features() -> None:
    plain = named(last_window())
    assert named(last_window(half_m=5e-6))["shaft_half_fwd_rms"] > plain["shaft_half_fwd_rms"] + 1
    assert (
        named(last_window(backward_m=(5e-6,)))["shaft_bwd_fwd_1x"] > plain["shaft_bwd_fwd_1x"] + 1
    )
    assert named(last_window(acceleration_m_s2=50.0))["acc_motor_1x_per_shaft"] == pytest.approx(
        plain["acc_motor_1x_per_shaft"] + 1, abs=0.01
    )
    assert (
        named(last_window(noise=1.0))["acc_motor_band_900_1400"]
        > plain["acc_motor_band_900_1400"] + 1
    )


def test_missing_readings_stay_visible_as_nan() -> None:
    counts, marks = recording()
    vector = features(next(iter_windows(counts, 0, marks, 5000)), BENCH)
    bad = {name for name, value in zip(FEATURE_NAMES, vector, strict=True) if np.isnan(value)}
    assert {"clearance_100um", "log_shaft_power_W", "oil_outlet_50C"} <= bad
    assert "log_shaft_fwd_1x_m" not in bad
