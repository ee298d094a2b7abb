"""The way of the target: slew, dither and reversals."""

from itertools import pairwise

import msgspec
import pytest

from firmware_py.guard.authority.slew import DEAD_BAND_UM, Slew, SlewState
from firmware_py.guard.envelope.target import Target
from firmware_py.records import Command, GuardState
from firmware_py.wire.codec import CanCodec

from ..scripted_node import MS, Bench, bench, working

CODEC = CanCodec()
WIDE, PRESSURES = (40.0, 160.0), (0.5, 3.0)


def state(b: Bench) -> GuardState:
    return next(d.state for d in iter(b.cycle, None) if d.state)


def commanded(b: Bench, seconds: float) -> list[tuple[int, float]]:
    """Time and clearance of every command sent."""
    sent = []
    for _ in range(round(seconds * 1000)):
        for frame in b.cycle().frames_out:
            message = CODEC.decode(frame)
            if isinstance(message, Command):
                sent.append((b.now_ns, message.clearance_um))
    return sent


class Way:
    """A slew by itself, a millisecond a step."""

    def __init__(self, most: int = 120) -> None:
        config = bench()
        actuator = msgspec.structs.replace(config.machine.actuator, reversals_per_minute_max=most)
        self.slew = Slew(config.replaced(actuator=actuator), Target(50.0, 1.0))
        self.now_ns = 0
        self.notices = []

    def go(
        self, wish: float, ms: int, clearances: tuple[float, float] = WIDE, bar: float = 1.0
    ) -> Target:
        for _ in range(ms):
            self.now_ns += MS
            target = self.slew.follow(Target(wish, bar), clearances, PRESSURES, self.now_ns)
            self.notices += self.slew.watch(self.now_ns)
        return target

    @property
    def names(self) -> list[str]:
        return [notice.name for notice in self.notices]


@pytest.mark.parametrize(
    ("wish", "ms", "expected"), [(90.0, 101, 55.0), (90.0, 2000, 90.0), (42.0, 101, 45.0)]
)
def test_the_target_moves_as_fast_as_the_actuator(wish: float, ms: int, expected: float) -> None:
    assert Way().go(wish, ms).clearance_um == pytest.approx(expected)


def test_the_pressure_moves_no_faster_than_the_slowest_supply() -> None:
    way = Way()
    assert way.go(50.0, 251, bar=3.0).pressure_bar == pytest.approx(2.0)
    assert way.go(50.0, 401, bar=3.0).pressure_bar == 3.0


@pytest.mark.parametrize("to_um", [70.0, 45.0])
def test_a_narrower_interval_and_the_retreat_are_taken_at_once(to_um: float) -> None:
    way = Way()
    way.go(90.0, 2000)
    assert way.go(90.0, 1, clearances=(40.0, to_um)).clearance_um == to_um
    assert way.slew.retreat(way.now_ns + MS) == Target(50.0, 1.0)


@pytest.mark.parametrize("swing", [0.05, 0.2, DEAD_BAND_UM])
def test_dither_within_the_dead_band_does_not_pass(swing: float) -> None:
    way = Way()
    way.go(70.0, 1000)
    seen = {way.go(70.0 - swing * (k % 2), 20).clearance_um for k in range(200)}
    assert seen == {70.0}
    assert way.slew.state.total == 0


def test_dither_of_the_admissible_end_does_not_pass_either() -> None:
    way = Way()
    way.go(160.0, 3000, clearances=(40.0, 90.0))
    seen = [
        way.go(160.0, 20, clearances=(40.0, 90.0 - 0.3 * (k % 2))).clearance_um for k in range(20)
    ]
    assert seen[1:] == [89.7] * 19
    assert way.go(160.0, 1050, clearances=(40.0, 91.0)).clearance_um == 91.0


@pytest.mark.parametrize("period_ms", [10, 40, 200])
def test_reversals_are_counted_and_too_many_hold_the_target_until_they_are_few(
    period_ms: int,
) -> None:
    way = Way()
    way.go(70.0, 1000)
    for k in range(140):
        way.go(70.0 + (8.0 if k % 2 else -8.0), period_ms)
    assert way.names == ["target_reverses"]
    assert "limit actuator.reversals_per_minute_max = 120" in way.notices[0].text
    held = way.go(58.0, 1)
    assert way.go(82.0, 1000) == held
    assert way.go(82.0, 1, clearances=(40.0, 55.0)).clearance_um == 55.0
    assert [alarm.name for alarm in way.slew.standing()] == ["target_reverses"]
    way.go(82.0, 62_000)
    assert way.names == ["target_reverses", "target_reverses_ended"]
    assert way.go(82.0, 1000).clearance_um == 82.0


def test_a_few_reversals_are_none() -> None:
    way = Way()
    for k in range(60):
        way.go(80.0 if k % 2 else 60.0, 1000)
    assert way.names == []
    assert 55 <= way.slew.state.total <= 60


def test_the_memory_is_bounded() -> None:
    way = Way(most=6000)
    for k in range(20_000):
        way.go(70.0 if k % 2 else 60.0, 10)
    assert len(way.slew.state.reversals) <= 62


# ------------------------------------------------------------------ in the whole guard


def test_what_is_commanded_never_outruns_the_actuator() -> None:
    b = working()
    b.advise_um = 50.0
    sent = commanded(b, 1.0)
    b.advise_um = 95.0
    sent += commanded(b, 2.0)
    rates = [(u2 - u1) / (t2 - t1) * 1e9 for (t1, u1), (t2, u2) in pairwise(sent)]
    assert max(rates) <= b.config.machine.actuator.rate_um_s * 1.02
    assert max(u for _, u in sent) == 95.0


def limited(most: int = 40) -> Bench:
    config = bench()
    actuator = msgspec.structs.replace(config.machine.actuator, reversals_per_minute_max=most)
    return Bench(config.replaced(actuator=actuator))


def test_a_policy_that_swings_loses_authority_and_a_person_reads_why() -> None:
    b = limited().armed()
    b.advise_um = 70.0
    b.run(3.0)
    for k in range(60):
        b.advise_um = 80.0 if k % 2 else 60.0
        b.run(0.1)
        if "target_reverses" in b.names():
            break
    b.run(0.5)
    found = state(b)
    assert not found.authority
    assert found.target_clearance_um == 50.0
    assert "target_reverses" in [alarm.name for alarm in found.alarms]
    assert any("turned back" in reason for reason in found.authority_reasons)
    assert 39 <= k < 50


def test_a_set_point_holds_while_a_person_swings_it() -> None:
    b = limited().armed(mode=1)
    for k in range(80):
        b.ask("set_clearance", 80.0 if k % 2 else 60.0)
        b.run(0.04)
    assert "target_reverses" in b.names()
    held = {u for _, u in commanded(b, 0.5)}
    b.ask("set_clearance", 70.0)
    assert {u for _, u in commanded(b, 1.0)} == held
    assert len(held) == 1


def test_a_snapshot_carries_the_way_and_an_old_one_may_lack_it() -> None:
    b = working()
    arming = b.core.stages.arming
    taken = arming.state
    assert isinstance(taken.slew, SlewState)
    assert taken.slew.clearance.value == 70.0
    arming.state = msgspec.structs.replace(taken, slew=None)
    b.run(0.1)


@pytest.mark.parametrize("period_ms", [20, 40, 200, 700])
def test_an_end_of_the_range_that_flutters_does_not_move_the_actuator_at_every_look(
    period_ms: int,
) -> None:
    way = Way(most=300)
    way.go(90.0, 2000)
    for k in range(60_000 // period_ms):
        end_um = 80.0 + (3.0 if k % 2 else -3.0)
        assert way.go(100.0, period_ms, clearances=(40.0, end_um)).clearance_um <= end_um
    assert way.slew.state.total <= 2 * 60
    assert not way.names


def test_after_a_push_the_target_goes_out_again_when_the_range_has_stayed_away_for_a_second() -> (
    None
):
    way = Way()
    way.go(90.0, 2000)
    way.go(90.0, 1, clearances=(40.0, 70.0))
    assert way.go(90.0, 998).clearance_um == 70.0
    assert way.go(90.0, 500).clearance_um == 90.0
    assert way.go(90.0, 1, clearances=(40.0, 80.0)).clearance_um == 80.0
    assert way.go(60.0, 300, clearances=(40.0, 80.0)).clearance_um < 70.0
