"""Film, position and power held against each other: nothing where the laws hold, each cause in its own feature."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from firmware_py.acquire import film_check as fc
from firmware_py.acquire.orders import CONTACT, Orders, analyse
from firmware_py.acquire.windows import Window

from .test_features import last_window

SPEED_HZ, CLEARANCE_M, RATIO, OIL_C = 100.0, 60e-6, 0.5, 45.0


def volt(gap_m: float) -> float:
    ratio = gap_m / fc.FILM_PER_RATIO_M
    return fc.CIRCUIT_V * ratio / (1.0 + ratio)


def ideal(ratio: float = RATIO, gap_m: float | None = None, power: float = 1.0) -> tuple[Window, Orders]:
    """A window and its orders on a shaft that floats where the short bearing has it."""
    window = last_window(start_hz=SPEED_HZ, forward_m=(1e-7,), noise=0.0)
    rest = 1.0 - ratio**2
    attitude = math.atan2(0.25 * math.pi * math.sqrt(rest), ratio)
    samples = window.samples.copy()
    samples[:, :2] += ratio * CLEARANCE_M * np.array([math.sin(attitude), -math.cos(attitude)]) - samples[:, :2].mean(0)
    samples[:, 7] = volt(CLEARANCE_M * (1.0 - ratio) if gap_m is None else gap_m)
    omega = 2 * math.pi * SPEED_HZ
    viscosity = fc.VISCOSITY_PA_S * math.exp(-fc.VISCOSITY_PER_K * (OIL_C - fc.REFERENCE_C))
    petroff = 2 * math.pi * viscosity * omega**2 * fc.RADIUS_M**3 * fc.LENGTH_M / CLEARANCE_M
    window = replace(window, samples=samples, clearance_m=CLEARANCE_M, oil_outlet_C=OIL_C,
                     shaft_power_W=power * fc.SHEAR_SHARE * petroff / math.sqrt(rest))  # fmt: skip
    return window, analyse(window)


def named(*what: object, **more: object) -> dict[str, float]:
    return dict(zip(fc.names(), fc.film_check(*ideal(*what, **more)).tolist(), strict=True))  # type: ignore[arg-type]


@pytest.mark.parametrize("ratio", [0.2, 0.5, 0.8])
def test_a_bearing_that_follows_the_laws_shows_nothing(ratio: float) -> None:
    found = named(ratio)
    for name in ("film_gap_over_position", "film_side_position", "film_power_excess"):
        assert found[name] == pytest.approx(0.0, abs=0.03), name


def test_a_wider_gap_than_the_position_s_and_more_power_show_in_their_scale() -> None:
    assert named(gap_m=CLEARANCE_M * (1 - RATIO) + 5e-6)["film_gap_over_position"] == pytest.approx(1.0, abs=0.02)
    assert named(power=1.5)["film_power_excess"] > 3.0 > -3.0 > named(power=0.5)["film_power_excess"]


@pytest.mark.parametrize("ratio", [0.2, 0.5, 0.8])
def test_load_is_near_that_of_the_guard_s_table(ratio: float) -> None:
    from firmware_py.guard.bearing_laws import static_film

    omega = 2 * math.pi * SPEED_HZ
    viscosity = fc.VISCOSITY_PA_S * math.exp(-fc.VISCOSITY_PER_K * (OIL_C - fc.REFERENCE_C))
    expected = viscosity * omega * static_film(fc.RADIUS_M, fc.LENGTH_M).load_per_viscous_speed(ratio, CLEARANCE_M)
    assert 10 ** named(ratio)["film_log_load_N"] == pytest.approx(expected, rel=0.15)


@pytest.mark.parametrize("ratio", [0.15, 0.5, 0.85])
def test_response_to_a_rotating_force_is_that_of_the_film_differentiated(ratio: float) -> None:
    """Stiffness and damping by differences of the short bearing's forces, instead of their closed forms."""
    carried, omega = 40.0, 500.0

    def force(e: float, angle: float, e_rate: float, angle_rate: float) -> np.ndarray:
        slow, rest = 1.0 - 2.0 * angle_rate / omega, 1.0 - e * e
        inward = 4.0 * e * e * slow / rest**2 + 2.0 * math.pi * e_rate / omega * (1.0 + 2.0 * e * e) / rest**2.5
        along = math.pi * e * slow / rest**1.5 + 8.0 * e * e_rate / omega / rest**2
        radial, around = np.array([math.cos(angle), math.sin(angle)]), np.array([-math.sin(angle), math.cos(angle)])
        return carried * (-inward * radial + along * around)

    step, unit = 1e-6, 1.0 / CLEARANCE_M
    rest = force(ratio, 0.0, 0.0, 0.0)
    stiffness = -np.column_stack([force(ratio + step, 0.0, 0.0, 0.0) - rest,
                                  force(ratio, step / ratio, 0.0, 0.0) - rest]) / step * unit  # fmt: skip
    damping = -np.column_stack([force(ratio, 0.0, step, 0.0) - rest,
                                force(ratio, 0.0, 0.0, step / ratio) - rest]) / step * unit  # fmt: skip
    whole = stiffness + 1j * omega * damping - fc.MASS_KG * omega**2 * np.eye(2)
    expected = np.linalg.solve(whole, np.array([1.0, -1.0j]))
    assert np.array(fc._moves_per_N(carried, CLEARANCE_M, ratio, omega)) == pytest.approx(expected, rel=1e-4)


def test_unbalance_is_found_again_from_the_swing_of_the_film() -> None:
    window, orders = ideal()
    omega, unbalance = orders.speed_rad_s, 3e-5
    load = 10 ** fc.film_check(window, orders)[3]
    rest = 1.0 - RATIO**2
    carried = load * rest**2 / RATIO / math.sqrt(16.0 * RATIO**2 + math.pi**2 * rest)
    swing_m = unbalance * omega**2 * abs(fc._moves_per_N(carried, CLEARANCE_M, RATIO, omega)[0])
    per_metre = (fc.CIRCUIT_V - volt(CLEARANCE_M * (1 - RATIO))) ** 2 / (fc.FILM_PER_RATIO_M * fc.CIRCUIT_V)
    harmonics = orders.harmonics.copy()
    harmonics[CONTACT, 0] = swing_m * per_metre
    found = fc.film_check(window, replace(orders, harmonics=harmonics))[4]
    assert 10**found == pytest.approx(unbalance, rel=0.02)


def test_readings_that_are_missing_stay_visible() -> None:
    window, orders = ideal()
    assert np.isnan(fc.film_check(replace(window, shaft_power_W=math.nan), orders)[2])
    assert np.isnan(fc.film_check(replace(window, clearance_m=math.nan), orders)).any()
