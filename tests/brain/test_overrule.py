"""What makes a clearance good, and what is advised instead of one that is not."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_py.brain.overrule import (
    FILM_RESERVE_M,
    WHIRL_RESERVE,
    OverruleLimits,
    choose,
    fault,
    good,
)
from firmware_py.brain.prediction import Outlook

from .machine import CONFIG

LIMITS = OverruleLimits.of(CONFIG)
FILM_M = CONFIG.limits.min_film_um * 1e-6
PRESENT_M = 60e-6


def outlook(
    *,
    film_m: float = 30e-6,
    whirl: float = 0.4,
    swing_m: float = 5e-6,
    residual_m: float = 0.0,
    possible: bool = True,
    power_W: tuple[float, ...] = (100.0,),
) -> Outlook:
    """The same forecast for clearances 60, 70, 80 ... um, but for the power."""
    n = len(power_W)

    def triple(value: float) -> np.ndarray:
        return np.tile([value - 1e-9, value, value + 1e-9], (n, 1))

    return Outlook(
        PRESENT_M + 10e-6 * np.arange(n),
        triple(swing_m),
        np.column_stack([power_W] * 3),
        triple(film_m),
        triple(whirl),
        np.full(n, possible),
        residual_m,
        triple(100.0),
        np.zeros((n, 4)),
        ("steady",) * n,
    )


@pytest.mark.parametrize(
    ("changed", "passes"),
    [
        ({}, True),
        ({"film_m": FILM_M + FILM_RESERVE_M + 1e-8}, True),
        ({"film_m": FILM_M + FILM_RESERVE_M - 1e-8}, False),
        ({"whirl": WHIRL_RESERVE + 1e-3}, True),
        ({"whirl": WHIRL_RESERVE - 1e-3}, False),
        ({"swing_m": 0.5 * PRESENT_M - 1e-8}, True),
        ({"swing_m": 0.5 * PRESENT_M + 1e-8}, False),
        ({"swing_m": 20e-6, "residual_m": 9.9e-6}, True),
        ({"swing_m": 20e-6, "residual_m": 10.1e-6}, False),
        ({"possible": False}, False),
    ],
)
def test_each_limit_decides(changed: dict[str, float], passes: bool) -> None:
    o = outlook(**changed)  # type: ignore[arg-type]
    assert good(o, PRESENT_M, LIMITS).tolist() == [passes]
    assert (fault(o, 0, PRESENT_M, LIMITS) == "") is passes


def test_swing_is_judged_by_the_smaller_clearance() -> None:
    o = outlook(swing_m=28e-6)
    assert good(o, 100e-6, LIMITS)[0]
    assert not good(o, 50e-6, LIMITS)[0]


def test_the_cheapest_good_candidate_inside_the_guards_interval() -> None:
    o = outlook(power_W=(100.0, 90.0, 80.0, 70.0))
    o.possible[-1] = False  # the actor's wish
    everything = choose(o, PRESENT_M, (0.0, 1.0), LIMITS)
    assert everything[0] == pytest.approx(80e-6)
    assert everything[1] == "actor's 90 um overruled: the film may not carry the load"
    assert choose(o, PRESENT_M, (0.0, 75e-6), LIMITS)[0] == pytest.approx(70e-6)
    safe, why = choose(o, PRESENT_M, (0.0, 50e-6), LIMITS)
    assert safe == pytest.approx(CONFIG.machine.actuator.safe_radial_clearance_um * 1e-6)
    assert why.endswith("; no candidate is good")
