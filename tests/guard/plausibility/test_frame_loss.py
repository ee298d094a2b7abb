"""The alarm of sample frames that are lost again and again."""

from collections.abc import Callable

import msgspec
import pytest

from firmware_py.guard import report
from firmware_py.guard.state import CoreState
from firmware_py.records import RawFrame, SampleFrame, Severity

from ..scripted_node import Bench, working


def losing(b: Bench, lose: Callable[[int], bool]) -> None:
    """Lose each sample frame of whose number ``lose`` says so."""
    count = 0

    def tamper(frames: list[RawFrame]) -> list[RawFrame]:
        nonlocal count
        kept = []
        for frame in frames:
            if isinstance(b.node.codec.decode(frame), SampleFrame):
                count += 1
                if lose(count):
                    continue
            kept.append(frame)
        return kept

    b.tamper = tamper


def alarms(b: Bench) -> dict[str, str]:
    return {alarm.name: alarm.text for alarm in report.standing(b.core.stages)}


@pytest.mark.parametrize(
    ("lose", "alarm", "acts"),
    [
        (lambda n: False, False, True),
        (lambda n: n % 500 == 0, False, True),
        (lambda n: n % 70 == 0, False, True),
        (lambda n: 400 <= n < 425, False, True),
        (lambda n: 400 <= n < 475, False, False),  # stale samples, for a moment
        (lambda n: n % 33 == 0, True, True),
        (lambda n: n % 10 == 0, True, False),
        (lambda n: n % 2 == 0, True, False),
        (lambda n: n % 300 < 25, True, False),
    ],
)
def test_losses_that_go_on_are_an_alarm_and_cost_authority_when_they_are_many(
    lose: Callable[[int], bool], alarm: bool, acts: bool
) -> None:
    b = working()
    b.events.clear()
    losing(b, lose)
    b.run(3.0)
    assert ("frames_lost" in alarms(b)) is alarm
    assert b.core.stages.arming.state.authority.held is acts
    assert b.names().count("frames_lost") == alarm
    if alarm:
        assert all(
            word in alarms(b)["frames_lost"] for word in ("%", "above 2 %", "check bus load")
        )
        assert next(e for e in b.events if e.name == "frames_lost").severity == Severity.ALERT


def test_the_alarm_ends_after_a_while_without_losses_and_its_state_survives_encoding() -> None:
    b = working()
    losing(b, lambda n: n % 10 == 0)
    b.run(3.0)
    b.tamper = list
    b.run(4.0)
    assert "frames_lost" in alarms(b)
    snapshot = b.core.snapshot(b.seq, b.now_ns)
    assert msgspec.msgpack.decode(snapshot.state, type=CoreState).frame_loss.heavy
    b.core.restore(snapshot)
    b.run(3.0)
    assert "frames_lost" not in alarms(b)
    assert "frames_lost_ended" in b.names()
