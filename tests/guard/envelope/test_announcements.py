"""Announced ramps: accepted in time, refused with every reason, replayed and forgotten."""

from math import pi

import pytest

from firmware_py.guard.core import GuardCore
from firmware_py.guard.envelope.announcements import LATE_MAX_S, WAITING_MAX, Announcements
from firmware_py.guard.envelope.retreat import Ramp
from firmware_py.records import CommandRequest, Cycle, PlannedRamp
from firmware_py.wire.codec import CanCodec

from ..scripted_node import MS, bench

S = 1_000_000_000
LEAD_S = 2.4


def asked(
    start_s: float = 3.0, end_s: float = 5.0, rpm: float = 9000.0, load_N: float = 60.0
) -> CommandRequest:
    return CommandRequest(1, "announce", ramp=PlannedRamp(start_s, end_s, rpm, load_N))


def test_an_accepted_ramp_comes_nearer_and_expires_after_its_end() -> None:
    announcements = Announcements(bench(), LEAD_S)
    assert announcements.request(asked(), 100 * S) == []
    (ramp,) = announcements.ahead(101 * S)
    assert ramp == Ramp(2.0, 4.0, pytest.approx(9000 * pi / 30), 60.0)
    assert len(announcements.ahead(105 * S + round(LATE_MAX_S * 1e9))) == 1
    assert announcements.ahead(105 * S + round(LATE_MAX_S * 1e9) + 1) == []


@pytest.mark.parametrize(("request_", "cause"), [
    (CommandRequest(1, "announce"), "needs a ramp"),
    (asked(start_s=float("nan")), "all finite"),
    (asked(end_s=float("inf")), "all finite"),
    (asked(start_s=2.3), "needs 2.4 s to be ready"),
    (asked(end_s=2.9), "outside start_s .. 3600"),
    (asked(end_s=3601.0), "outside start_s .. 3600"),
    (asked(rpm=12001.0), "operating.speed_min_rpm"),
    (asked(rpm=1499.0), "operating.speed_min_rpm"),
    (asked(load_N=301.0), "operating.load_min_N"),
])  # fmt: skip
def test_what_cannot_be_met_is_refused_and_not_remembered(
    request_: CommandRequest, cause: str
) -> None:
    announcements = Announcements(bench(), LEAD_S)
    (reason,) = announcements.request(request_, 0)
    assert cause in reason
    assert announcements.state == []


def test_all_reasons_are_given_at_once() -> None:
    assert len(Announcements(bench(), LEAD_S).request(asked(1.0, 0.5, 20000.0, 1.0), 0)) == 4


def test_ramps_follow_one_another_up_to_a_number() -> None:
    announcements = Announcements(bench(), LEAD_S)
    for k in range(WAITING_MAX):
        assert announcements.request(asked(3.0 + 2 * k, 5.0 + 2 * k), 0) == []
    assert (
        "another announced ramp ends at 19.000 s" in announcements.request(asked(18.9, 21.0), 0)[0]
    )
    assert "8 announced ramps already wait" in announcements.request(asked(30.0, 31.0), 0)[-1]


def test_the_guard_answers_and_keeps_the_ramp_over_a_snapshot() -> None:
    guard = GuardCore(bench(), CanCodec(), 7)
    decision = guard.step(Cycle(0, S, [], None, [asked(), asked(1.0)], True, True, True))
    assert [reply.accepted for reply in decision.replies] == [True, False]
    assert any("announce accepted" in event.text for event in decision.events)
    heir = GuardCore(bench(), CanCodec(), 7)
    heir.restore(guard.snapshot(1, S))
    following = Cycle(1, S + MS, [], None, [asked(4.0, 6.0)], True, True, True)
    assert heir.step(following).replies == guard.step(following).replies
    (reply,) = heir.step(
        Cycle(2, S + 2 * MS, [], None, [asked(4.0, 6.0)], True, True, True)
    ).replies
    assert "another announced ramp" in reply.reasons[0]
