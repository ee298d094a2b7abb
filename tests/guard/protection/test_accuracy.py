"""Set points and delays by slow ramps: within 0.5 % of the range, and 20 ms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import pi, sqrt

import pytest

from firmware_py.guard.alarms.alarm import QUIET_NS

from ..scripted_node import MS, Bench
from .test_voting import at_work

RANGE_SHARE, DELAY_WITHIN_S = 0.005, 0.02
DELAY_S = 0.5

ROWS = f"""
[[measure]]
name = "disp_x"
alert = 60.0
alert_delay_s = {DELAY_S}
[[measure]]
name = "smax_de"
quantity = "smax"
unit = "um"
alert = 10.0
alert_delay_s = {DELAY_S}
[[measure]]
name = "first"
quantity = "amplitude_1x"
source = "disp_y"
unit = "um"
alert = 20.0
alert_delay_s = {DELAY_S}
[[measure]]
name = "velocity"
quantity = "velocity_rms"
source = "acc_motor"
unit = "mm/s"
alert = 7.1
alert_delay_s = {DELAY_S}
[[measure]]
name = "metal"
quantity = "reading"
source = "oil_outlet"
unit = "degC"
alert = 42.0
alert_delay_s = {DELAY_S}
"""
PER_MM_S = 2 * pi * 100.0 * 1e-3
"""Acceleration in m/s2 of 1 mm/s at 6000 rpm."""


@dataclass(frozen=True)
class Ramp:
    """How a measure is driven: to a value, from where, so much a second; and its range."""

    name: str
    put: Callable[[Bench, float], None]
    begin: float
    rate: float
    range: float


def orbit(per_um: float) -> Callable[[Bench, float], None]:
    def put(b: Bench, value: float) -> None:
        b.node.amplitude_um = value * per_um

    return put


def shaken(b: Bench, value: float) -> None:
    b.node.acceleration_m_s2 = value * PER_MM_S


def heated(b: Bench, value: float) -> None:
    b.node.oil_C = value


RAMPS = (
    Ramp("disp_x", orbit(0.5), 18.0, 4.0, 490.0),
    Ramp("smax_de", orbit(1.0), 7.0, 4.0, 245.0),
    Ramp("first", orbit(0.5), 16.0, 4.0, 490.0),
    Ramp("velocity", shaken, 5.0, 2.0, 195.0 / PER_MM_S / sqrt(2.0)),
    Ramp("metal", heated, 41.2, 0.4, 150.0),
)


@pytest.mark.parametrize("ramp", RAMPS, ids=lambda ramp: ramp.name)
def test_a_set_point_is_met_where_it_is_and_after_its_delay(ramp: Ramp) -> None:
    b, name = at_work(ROWS), f"{ramp.name}_alert"
    assert b.ask("disarm")[0], "so that the clearance, and the cap with it, stays"
    b.run(1.5)
    states = {k: v for each in b.core.stages.set_points for k, v in each.states.items()}
    value, passed_ns = ramp.begin, 0
    ramp.put(b, value)
    b.run(1.1)
    assert states[name].over_ns == QUIET_NS
    for _ in range(4000):
        value += ramp.rate * 1e-3
        ramp.put(b, value)
        b.cycle()
        if not passed_ns and states[name].over_ns != QUIET_NS:
            passed_ns = b.now_ns
            assert value == pytest.approx(states[name].limit, abs=RANGE_SHARE * ramp.range)
        if name in b.names():
            break
    told_ns = next(event.t_ns for event in b.events if event.name == name)
    assert abs(told_ns - passed_ns - DELAY_S * 1000 * MS) <= DELAY_WITHIN_S * 1000 * MS
