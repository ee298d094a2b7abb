"""Run-downs, hard stops and cut cables: what the guard tells of a shaft whose mark stays away."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from functools import cache
from math import pi

import pytest
from msgspec.structs import replace

from firmware_py.acquire.speed import SpeedState
from firmware_py.guard import facts, report
from firmware_py.guard.measurement.motion import ShaftMotion
from firmware_py.guard.plausibility.rest import Rest
from firmware_py.machine.probes import PROBES

from .scripted_node import MS, Bench, bench, working

STANDS_S = 8.0
"""2 pi s without a mark, 1.5 s of a quiet shaft, one window of it."""


@cache
def _running(rpm: float) -> Bench:
    b = Bench()
    b.node.speed_rpm = rpm
    b.run(1.2)
    assert b.core.stages.acquire.speed.known
    b.events.clear()
    return b


def running(rpm: float) -> Bench:
    """A machine that turns at a speed, its orbit 10 um peak to peak."""
    return deepcopy(_running(rpm))


def cut(b: Bench) -> None:
    """The mark's cable is cut; the node still calls the mark valid."""
    b.node.edge_seen = lambda number: False


def told(b: Bench) -> tuple[float, bool]:
    """Speed (rpm) and whether it is known."""
    speed = b.core.stages.acquire.speed
    return speed.speed_rad_s * 30 / pi, speed.known


def sure_of_rest(b: Bench) -> bool:
    return b.core.stages.acquire.speed.surely_below(b.core.stages.turning_rad_s)


def seize(b: Bench) -> None:
    b.node.speed_rpm = 0.0


def brake(b: Bench) -> None:
    """Ten times the declared ramp: too fast, but with marks that tell of it."""
    b.ramp_to(0.0, 40_000.0)


@pytest.mark.parametrize("stop", [seize, brake])
def test_a_hard_stop_is_unknown_at_first_and_then_told_as_standing_and_counted(
    stop: Callable[[Bench], None],
) -> None:
    b = running(6000.0)
    stop(b)
    b.run(1.0)
    assert not told(b)[1]
    assert not sure_of_rest(b), "the oil is protected until it is known to stand"
    b.run(STANDS_S - 1.0)
    assert told(b) == (0.0, True)
    assert b.names().count("hard_stop") == 1
    assert b.core.counters["hard_stops"] == 1
    assert "mark_lost" not in [alarm.name for alarm in report.standing(b.core.stages)]
    assert sure_of_rest(b)
    b.node.pressure_bar = 0.0
    b.run(1.5)
    assert not b.core.tripped
    b.node.pressure_bar = b.node.target_bar
    b.events.clear()
    b.ramp_to(3000.0)
    b.run(0.2)
    assert told(b) == (pytest.approx(3000.0, rel=1e-3), True)
    assert not {"speed_implausible", "mark_lost", "hard_stop"} & set(b.names())


@pytest.mark.parametrize(
    ("rpm", "amplitude_um"), [(6000.0, 5.0), (6000.0, 0.6), (6000.0, 0.2), (1000.0, 0.6)]
)
def test_a_cable_cut_on_a_running_machine_is_never_told_as_standing(
    rpm: float, amplitude_um: float
) -> None:
    """An orbit as small as noise, too: it has not fallen."""
    b = running(rpm)
    b.node.amplitude_um = amplitude_um
    b.run(0.5)
    cut(b)
    for _ in range(14):
        b.run(0.5)
        assert told(b)[0] > 0.0
        assert not sure_of_rest(b)
    assert not told(b)[1]
    assert "mark_lost" in b.names()
    assert b.core.counters["hard_stops"] == 0
    b.node.pressure_bar = 0.0
    b.run(1.2)
    assert b.core.tripped == ["oil_pressure_low_danger"]
    b.node.pressure_bar = b.node.target_bar
    b.node.edge_seen = lambda number: True
    b.run(0.3)
    assert told(b) == (pytest.approx(rpm, rel=1e-3), True)


def test_a_cable_cut_in_a_run_down_ends_standing_only_once_the_shaft_does() -> None:
    b = running(1800.0)
    b.ramp_to(1200.0, 2000.0)
    cut(b)
    b.ramp_to(400.0, 100.0)  # 8 s, to 400 rpm
    assert not told(b)[1]
    b.ramp_to(0.0, 1000.0)
    b.run(2.0)
    assert told(b) == (0.0, True)
    assert b.core.counters["hard_stops"] == 0, "no ramp was exceeded as far as the marks told"


def test_a_machine_that_starts_with_a_cable_cut_at_rest_is_not_told_as_standing_for_long() -> None:
    b = Bench()
    b.node.speed_rpm = 0.0
    b.node._mark_tick -= 60_000_000
    b.run(2.5)
    assert told(b) == (0.0, True)
    for amplitude_um in (5.0, 0.7):
        started = deepcopy(b)
        started.node.amplitude_um = amplitude_um
        cut(started)
        started.ramp_to(6000.0)
        started.run(3.2)
        assert not told(started)[1]
        assert not sure_of_rest(started)


def test_a_probe_that_is_not_ok_cannot_say_that_the_shaft_stands() -> None:
    b = running(6000.0)
    b.node.frozen_channel = 0
    b.run(0.5)
    seize(b)
    b.run(STANDS_S)
    assert not told(b)[1]
    assert b.core.counters["hard_stops"] == 0


@pytest.mark.parametrize(
    ("p2p_um", "complete", "probes_ok", "seen"),
    [
        (0.9, True, True, (1.0, 0.0)),
        (1.1, True, True, (0.0, 1.0)),
        (0.9, False, True, (0.0, 0.0)),
        (1.1, False, True, (0.0, 0.0)),
        (0.9, True, False, (0.0, 0.0)),
        (1.1, True, False, (0.0, 0.0)),
    ],
)
def test_only_both_probes_that_are_ok_say_that_a_shaft_is_quiet_or_moves(
    p2p_um: float, complete: bool, probes_ok: bool, seen: tuple[float, float]
) -> None:
    rest = Rest(bench().machine)
    motion = ShaftMotion(complete, (0.2, p2p_um), (0.0, 0.0, 0.0), 0.0, 0.0)
    rest.look(motion, probes_ok, SpeedState(), 0)
    assert rest.look(motion, probes_ok, SpeedState(), 1000 * MS) == seen


@pytest.mark.parametrize(
    ("noise_m", "scale", "quiet_um"), [(5e-7, 1e-8, 5.0), (1e-9, 1e-8, 0.2), (1e-7, 1e-7, 2.0)]
)
def test_how_quiet_a_standing_shaft_is_follows_from_its_probes(
    noise_m: float, scale: float, quiet_um: float
) -> None:
    """Five times the noise: the shaft of a noisier probe would else never stand."""
    machine = bench().machine
    channels = [
        replace(channel, noise_rms=noise_m, scale=scale) if i < PROBES else channel
        for i, channel in enumerate(machine.channel)
    ]
    assert Rest(replace(machine, channel=channels)).quiet_um == pytest.approx(quiet_um)


def test_the_speed_told_while_the_mark_stays_away_never_widens_the_envelope() -> None:
    """Light and fast, where whirl bounds the clearance: at half the speed it would be wider."""
    b = working()
    b.advise_um = 50.0
    b.node.amplitude_um, b.node.mean_um = 1.0, (-5.0, -5.0)
    b.ramp_to(11_000.0)
    b.run(1.5)
    facts.look_around(b.core.stages, b.now_ns)
    before = b.core.stages.memory.interval_m
    level_m = b.core.stages.envelope.vibration.state.level_m
    assert before is not None
    assert level_m > 0.0
    cut(b)
    lowest_rpm = 11_000.0
    for _ in range(30):
        b.cycle()
        facts.look_around(b.core.stages, b.now_ns)
        if b.core.stages.acquire.speed.known:
            lowest_rpm = min(lowest_rpm, told(b)[0])
            found = b.core.stages.memory.interval_m
            assert found is None or (found[0] >= before[0] - 1e-7 and found[1] <= before[1] + 1e-7)
    assert 5400.0 < lowest_rpm < 8000.0, "it was told lower, for less than a turn"
    assert b.core.stages.memory.interval_m is None
    assert b.core.stages.envelope.vibration.state.level_m == level_m, (
        "what it vibrated is not forgotten"
    )


def test_a_run_down_is_told_between_the_marks_and_costs_no_alarm() -> None:
    b = running(1500.0)
    b.ramp_to(0.0, 2000.0)
    start_ns, before_rpm = b.now_ns, told(b)[0]
    while b.now_ns - start_ns < 6000 * MS:
        b.run(0.2)
        rpm, known = told(b)
        assert known
        assert rpm < before_rpm
        before_rpm = rpm
    b.run(1.0)
    assert told(b) == (0.0, True)
    assert not {"mark_lost", "speed_implausible", "hard_stop"} & set(b.names())
