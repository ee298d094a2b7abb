"""The oil supply: what the pump gives, how long the accumulator lasts, and what the guard makes of
it."""

from __future__ import annotations

from math import exp, inf, log

import msgspec
import pytest

from firmware_py import config
from firmware_py.machine import Machine, supply

BENCH = config.read_machine("bench")


def changed(machine: Machine, **figures: float | None) -> Machine:
    """``machine`` with figures of its feed or actuator replaced."""
    feed, actuator = machine.feed, machine.actuator
    of_feed = {k: v for k, v in figures.items() if hasattr(feed, k)}
    of_actuator = {k: v for k, v in figures.items() if k not in of_feed}
    return msgspec.structs.replace(
        machine,
        feed=msgspec.structs.replace(feed, **of_feed),
        actuator=msgspec.structs.replace(actuator, **of_actuator),
    )


def test_an_old_folder_that_says_nothing_of_its_supply_keeps_its_laws() -> None:
    old = config.load(config.SHIPPED.parents[1] / "tests/config/first_schema/bench.toml")[0].machine
    assert supply.source_bar(old) == inf
    assert supply.full_film_bar(old.feed) == 0.5 * old.feed.pressure_min_bar
    assert supply.held_s(old.feed, 1.0) == 0.0
    assert supply.slowest_s(old.actuator) == (0.0, 1.0)
    assert supply.slowest_slew_bar_s(old.actuator) is None
    assert supply.target_slew_bar_s(old) == 2.5


def test_the_weakest_pump_at_the_greatest_flow() -> None:
    # w R L c at 12000 rpm and 160 um + 2 um, and 15 % less pump
    assert supply.flow_most_m3_s(BENCH) == pytest.approx(1256.637 * 0.02 * 0.02 * 162e-6)
    given = 0.85 * 6.0 * (1.0 - supply.flow_most_m3_s(BENCH) / (0.85 * 2.5e-4))
    assert supply.source_bar(BENCH) == pytest.approx(given)
    assert supply.source_bar(changed(BENCH, pump_flow_max_m3_s=5e-5)) == 0.0


def test_how_long_the_film_stays_full() -> None:
    held = supply.held_s(BENCH.feed, 0.4)
    assert held == pytest.approx(0.85 * 8.0 * log(0.4 / 0.25))
    assert 0.4 * exp(-held / (0.85 * 8.0)) == pytest.approx(supply.full_film_bar(BENCH.feed))
    assert supply.held_s(BENCH.feed, 0.2) == 0.0
    assert supply.held_s(changed(BENCH, full_film_bar=0.3).feed, 0.4) < held


def test_the_retreat_from_the_farthest_clearance() -> None:
    # 110 um at 50 um/s, time to live, lag, age of a reading
    assert supply.retreat_s(BENCH) == pytest.approx(2.2 + 0.1 + 0.05 + 0.1)


def test_the_target_moves_no_faster_than_the_slowest_supply() -> None:
    assert supply.target_slew_bar_s(BENCH) == pytest.approx(5.0 * 0.8)
    assert supply.target_slew_bar_s(changed(BENCH, pressure_slew_bar_s=50.0)) == 12.5
    assert supply.slowest_s(BENCH.actuator) == pytest.approx((0.06, 0.24))
