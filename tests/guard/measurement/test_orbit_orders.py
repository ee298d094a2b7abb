"""Orders of the shaft's motion as evidence for or against the marks, on exact waves."""

from __future__ import annotations

from itertools import count
from math import pi

import msgspec
import numpy as np
import pytest

from firmware_py.acquire.speed import SpeedState, Turn
from firmware_py.guard.measurement.orbit_orders import Evidence, OrbitOrders
from firmware_py.guard.plausibility.speed_check import CLEAN_NS, SpeedCheck
from firmware_py.records import Block, Quality

from ..scripted_node import bench

PERIOD_US = 200
ROWS = 30
_ALL_OK = 0xFF


class Shaft:
    """Blocks of a shaft whose displacement has an amplitude (um) at each order of its true
    speed."""

    def __init__(
        self, rpm: float, told: float = 1.0, orders: dict[float, float] | None = None
    ) -> None:
        self.rpm, self.told, self.orders = rpm, told, orders or {1.0: 5.0}
        self.ok, self.quality, self.drift_um_s = _ALL_OK, 0, 0.0
        self._seq = count()

    def block(self) -> Block:
        seq = next(self._seq)
        turns = (seq * ROWS + np.arange(ROWS)) * PERIOD_US * 1e-6 * self.rpm / 60
        counts = np.full((ROWS, 8), -1200, "<i2")
        for k, shift in enumerate((0.0, 0.25)):
            wave = sum(
                a * 100 * np.cos(2 * pi * order * (turns - shift))
                for order, a in self.orders.items()
            )
            seconds = (seq * ROWS + np.arange(ROWS)) * PERIOD_US * 1e-6
            counts[:, k] = np.round(-1500 + wave + 100 * self.drift_um_s * seconds)
        return Block(
            seq,
            0,
            PERIOD_US * 1000,
            seq * ROWS * PERIOD_US,
            PERIOD_US,
            self.quality,
            self.ok,
            self.told * self.rpm * pi / 30,
            0,
            [],
            counts.tobytes(),
        )


def evidence(shaft: Shaft, windows: int = 3, stage: OrbitOrders | None = None) -> list[Evidence]:
    """Of each window."""
    stage = stage or OrbitOrders(bench())
    found = []
    while len(found) < windows:
        block = shaft.block()
        said = stage.step(block, block.speed_rad_s)
        if stage.state.samples == 0:
            found.append(said)
    return found


@pytest.mark.parametrize("rpm", [450.0, 700.0, 1500.0])
@pytest.mark.parametrize("drift_um_s", [-20.0, 8.0, 20.0])
def test_a_clearance_that_moves_is_no_evidence_against_the_marks(
    rpm: float, drift_um_s: float
) -> None:
    """A round and balanced shaft, which follows its bearing, has no first order of its own."""
    shaft, stage = Shaft(rpm, 1.0, {1.0: 0.1}), OrbitOrders(bench())
    evidence(shaft, 1, stage)
    shaft.drift_um_s = drift_um_s
    assert Evidence.CONTRADICTS not in evidence(shaft, 6, stage)


SPEEDS = pytest.mark.parametrize("rpm", [1500.0, 4321.0, 12_000.0])


@SPEEDS
@pytest.mark.parametrize(
    "orders", [{1.0: 1.5}, {1.0: 3.0, 2.0: 2.5}, {1.0: 3.0, 0.48: 1.0}, {1.0: 3.0, 3.0: 2.0}]
)
def test_a_shaft_that_turns_as_told_agrees(rpm: float, orders: dict[float, float]) -> None:
    assert set(evidence(Shaft(rpm, 1.0, orders))) == {Evidence.AGREES}


@SPEEDS
@pytest.mark.parametrize("told", [2.0, 3.0, 0.5, 1 / 3])
@pytest.mark.parametrize("orders", [{1.0: 1.5}, {1.0: 3.0, 2.0: 2.0}])
def test_false_edges_are_contradicted_and_the_true_order_is_named(
    rpm: float, told: float, orders: dict[float, float]
) -> None:
    if told * rpm < 1000.0:
        rpm = 3000.0
    stage = OrbitOrders(bench())
    assert set(evidence(Shaft(rpm, told, orders), stage=stage)) == {Evidence.CONTRADICTS}
    assert stage.seen_order == pytest.approx(1.0 / told)


@pytest.mark.parametrize("told", [1.0, 2.0, 0.5])
def test_motion_within_noise_and_runout_says_nothing(told: float) -> None:
    assert set(evidence(Shaft(6000.0, told, {1.0: 0.8}))) == {Evidence.NONE}
    config = bench()
    channels = [
        msgspec.structs.replace(channel, slow_roll_um=2.0) for channel in config.machine.channel
    ]
    known = OrbitOrders(config.replaced(channel=channels))
    assert set(evidence(Shaft(6000.0, told, {1.0: 4.5}), stage=known)) == {Evidence.NONE}


def test_a_second_order_twice_as_large_as_the_first_says_nothing() -> None:
    assert set(evidence(Shaft(6000.0, 1.0, {1.0: 2.0, 2.0: 4.0}))) == {Evidence.NONE}


@pytest.mark.parametrize("why", ["gap", "channel"])
def test_a_window_with_a_gap_or_a_bad_channel_says_nothing(why: str) -> None:
    shaft, stage = Shaft(6000.0), OrbitOrders(bench())
    stage.step(shaft.block(), 200 * pi)
    shaft.ok, shaft.quality = (_ALL_OK, Quality.GAP_BEFORE) if why == "gap" else (_ALL_OK & ~2, 0)
    stage.step(shaft.block(), 200 * pi)
    shaft.ok, shaft.quality = _ALL_OK, 0
    assert evidence(shaft, 2, stage) == [Evidence.NONE, Evidence.AGREES]


@pytest.mark.parametrize(("told", "said"), [(1.0, Evidence.AGREES), (2.0, Evidence.CONTRADICTS)])
def test_lost_frames_in_every_window_do_not_silence_the_orbit(told: float, said: Evidence) -> None:
    shaft, stage, found = Shaft(4321.0, told), OrbitOrders(bench()), []
    for k in range(400):
        shaft.quality = 0
        if k % 40 == 17:
            for _ in range(k % 7):
                shaft.block()
            shaft.quality = int(Quality.GAP_BEFORE) * (k % 7 > 0)
        evidence = stage.step(shaft.block(), told * 4321.0 * pi / 30)
        found += [evidence] * (stage.state.samples == 0)
    assert set(found) == {said}


def test_a_gap_of_unknown_length_silences_its_window() -> None:
    shaft, stage = Shaft(6000.0), OrbitOrders(bench())
    stage.step(shaft.block(), shaft.told * shaft.rpm * pi / 30)
    for _ in range(60):
        shaft.block()
    shaft.quality = int(Quality.GAP_BEFORE)
    stage.step(shaft.block(), shaft.told * shaft.rpm * pi / 30)
    shaft.quality = 0
    assert evidence(shaft, 2, stage) == [Evidence.NONE, Evidence.AGREES]


def test_marks_that_the_orbit_contradicts_half_of_the_time_are_doubted() -> None:
    check, told = SpeedCheck(bench()), list[str]()
    right, wrong = Shaft(6000.0), Shaft(6000.0, 2.0)
    for _ in range(15):
        told += checked(check, right, 0.504) + checked(check, wrong, 0.504)
    assert told == ["speed_implausible"]
    assert check.standing()[0].value == pytest.approx(12_000.0)


def test_a_shaft_that_is_told_to_stand_and_swings_is_contradicted() -> None:
    assert evidence(Shaft(1500.0, 0.0)) == [
        Evidence.NONE,
        Evidence.CONTRADICTS,
        Evidence.CONTRADICTS,
    ]
    assert set(evidence(Shaft(1500.0, 0.0, {1.0: 0.5}))) == {Evidence.NONE}


# ------------------------------------------------------------------ the check on top of it


def checked(
    check: SpeedCheck, shaft: Shaft, seconds: float, start_ns: int = 0, lost: bool = False
) -> list[str]:
    """Names of the notices; the end is at ``start_ns`` and ``seconds``."""
    names = []
    told_rad_s = shaft.told * shaft.rpm * pi / 30
    speed = SpeedState(speed_rad_s=told_rad_s, reading_rad_s=told_rad_s, lost=lost)
    for k in range(round(seconds / (ROWS * PERIOD_US * 1e-6))):
        now_ns = start_ns + k * ROWS * PERIOD_US * 1000
        names += [notice.name for notice in check.step([], [shaft.block()], speed, now_ns)]
    return names


def test_a_confirmed_mark_is_not_contradicted_by_a_whirl_until_it_was_lost() -> None:
    check, whirl = SpeedCheck(bench()), Shaft(6000.0, 1.0, {1.0: 2.0, 0.5: 9.0})
    assert checked(check, Shaft(6000.0), 2.0) == []
    assert checked(check, whirl, 3.0) == []
    assert checked(check, whirl, 0.1, lost=True) == []
    assert checked(check, whirl, 3.0) == ["speed_implausible"]
    assert check.doubted


def test_a_doubt_ends_after_its_time_when_the_orbit_agrees_and_not_while_the_mark_is_lost() -> None:
    check, shaft = SpeedCheck(bench()), Shaft(6000.0)
    step = check.step([Turn(5000, 1256.0, "ramp", 630.0)], [], SpeedState(lost=False), 0)
    assert [notice.name for notice in step] == ["speed_implausible"]
    assert check.step([Turn(5000, 1256.0, "ramp", 630.0)], [], SpeedState(lost=False), 0) == [], (
        "told once"
    )
    assert check.standing()[0].text == step[0].text
    assert checked(check, shaft, 2.0, CLEAN_NS - 3_000_000_000) == []
    assert checked(check, shaft, 0.1, CLEAN_NS, lost=True) == []
    assert checked(check, shaft, 2.0, CLEAN_NS) == ["speed_plausible"]
    assert check.standing() == []
    assert check.reset() == []


@pytest.mark.parametrize("cause", ["count", "ahead"])
def test_a_shaft_that_stands_ends_a_doubt(cause: str) -> None:
    check = SpeedCheck(bench())
    check.step([Turn(0, 0.0, cause)], [], SpeedState(lost=False), 0)
    assert checked(check, Shaft(0.0, 0.0), 0.1) == ["speed_plausible"]


def test_a_shaft_that_swings_does_not_end_the_doubt_that_it_stands() -> None:
    check, shaft = SpeedCheck(bench()), Shaft(1500.0, 0.0)
    assert checked(check, shaft, 4.0) == ["speed_implausible"]
    assert check.standing()[0].value == 0.0
    assert [notice.name for notice in check.reset()] == ["speed_plausible"]


def test_no_evidence_breaks_no_row_of_it() -> None:
    check = SpeedCheck(bench())
    assert checked(check, Shaft(6000.0, 2.0), 0.6) == []
    assert checked(check, Shaft(6000.0, 2.0, {1.0: 0.2}), 1.2) == []
    assert checked(check, Shaft(6000.0, 2.0), 1.5) == ["speed_implausible"]
