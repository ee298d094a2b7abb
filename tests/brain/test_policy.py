"""What makes a clearance good, who may overrule the actor, and what the present is made of."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from firmware_py.acquire.windows import ChannelMap
from firmware_py.brain.core import BrainCore
from firmware_py.brain.observation import Observer
from firmware_py.brain.policy import FILM_RESERVE_M, WHIRL_RESERVE, Policy
from firmware_py.brain.prediction import Outlook
from firmware_py.records import Advice, Block

from .machine import CONFIG, Machine, models
from .test_brain_core import feed, guard_state, of

POLICY = Policy(models(), CONFIG)
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
    ("changed", "good"),
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
def test_each_limit_decides(changed: dict[str, float], good: bool) -> None:
    assert POLICY.good(outlook(**changed), PRESENT_M).tolist() == [good]  # type: ignore[arg-type]
    assert (POLICY._fault(outlook(**changed), 0, PRESENT_M) == "") is good  # type: ignore[arg-type]


def test_swing_is_judged_by_the_smaller_clearance() -> None:
    o = outlook(swing_m=28e-6)
    assert POLICY.good(o, 100e-6)[0]
    assert not POLICY.good(o, 50e-6)[0]


def test_the_cheapest_good_candidate_inside_the_guards_interval() -> None:
    o = outlook(power_W=(100.0, 90.0, 80.0, 70.0))
    o.possible[-1] = False  # the actor's wish
    everything = POLICY._check(1e-4, PRESENT_M, o, (0.0, 1.0))
    assert everything[0] == pytest.approx(80e-6)
    assert everything[1] == "actor's 100 um overruled: the film may not carry the load"
    assert POLICY._check(1e-4, PRESENT_M, o, (0.0, 75e-6))[0] == pytest.approx(70e-6)
    safe, why = POLICY._check(1e-4, PRESENT_M, o, (0.0, 50e-6))
    assert safe == pytest.approx(CONFIG.machine.actuator.safe_radial_clearance_um * 1e-6)
    assert why.endswith("; no candidate is good")


def test_the_wish_is_narrowed_to_what_the_guard_admits() -> None:
    core = BrainCore(CONFIG, models(80e-6), "")
    narrow = guard_state(clearance_low_um=45.0, clearance_high_um=72.0)
    assert of(Advice, feed(core, [narrow, *Machine().run(2.0)]))[-1].clearance_um == pytest.approx(
        72.0
    )


def observer(records: list) -> Observer:
    found = Observer(ChannelMap.wire())
    for record in records:
        found.take(record)
    return found


def test_the_present_is_over_whole_turns() -> None:
    machine = Machine(unbalance_kg_m=1e-4, speed_rpm=1650.0)
    present = observer(machine.run(0.5)).present()
    still = Machine(unbalance_kg_m=0.0, speed_rpm=1650.0)
    quiet = observer(still.run(0.5)).present()
    assert present is not None
    assert quiet is not None
    assert present.mean_m == pytest.approx(quiet.mean_m, abs=2e-8)
    assert present.speed_rad_s == pytest.approx(1650 * np.pi / 30)
    assert present.clearance_m == pytest.approx(machine.clearance_m)


def test_a_jump_of_the_tick_begins_the_present_anew() -> None:
    machine = Machine()
    records = machine.run(0.5)
    assert observer(records).present() is not None
    machine.tick_us += 200
    assert observer(records + machine.run(0.1)).present() is None


def test_no_present_without_a_turning_shaft_or_a_reading() -> None:
    records = Machine().run(0.5)
    assert observer([r for r in records if isinstance(r, Block)]).present() is None
    stopped = [
        msgspec.structs.replace(r, speed_rad_s=0.0) if isinstance(r, Block) else r for r in records
    ]
    assert observer(stopped).present() is None
