"""The event list shows changes and the alarm list what stands, whatever repeats."""

from __future__ import annotations

import msgspec
import pytest

from firmware_py.commands.status import _lines
from firmware_py.gate.losses import HOLD_NS, Losses
from firmware_py.gate.view import SAME_WITHIN_NS, View
from firmware_py.records import Alarm, Event, Severity

S = 1_000_000_000


def event(seq: int, name: str = "foreign_device", text: str = "a frame", count: int = 1) -> Event:
    return Event(seq, seq * S // 10, Severity.FAULT, name, text, count=count)


def test_equal_events_are_one_with_a_count_and_do_not_bury_the_others(bench):
    view = View(bench)
    view.step(event(0, "armed"), 0)
    for seq in range(1, 724):
        view.step(event(seq), 0)
    assert [(e.name, e.count, e.seq) for e in view.events()] == [
        ("armed", 1, 0),
        ("foreign_device", 723, 723),
    ]
    view.step(event(724, text="another frame"), 0)
    assert [e.count for e in view.events()] == [1, 723, 1]


def test_two_events_that_alternate_are_two(bench):
    view = View(bench)
    for seq in range(0, 200, 2):
        view.step(event(seq, "authority_lost"), 0)
        view.step(event(seq + 1, "authority_gained"), 0)
    assert [(e.name, e.count) for e in view.events()] == [
        ("authority_lost", 100),
        ("authority_gained", 100),
    ]


@pytest.mark.parametrize(("name", "apart_ns"), [("command", 1), ("foreign_device", SAME_WITHIN_NS)])
def test_commands_and_what_comes_back_later_stand_alone(bench, name, apart_ns):
    view = View(bench)
    for seq in (0, 1):
        view.step(msgspec.structs.replace(event(seq, name), t_ns=seq * apart_ns), 0)
    assert [e.count for e in view.events()] == [1, 1]


@pytest.mark.parametrize(
    "name",
    [
        "room_lost_gate",
        "lost_brain",
        "link_queue_overflow",
        "link_send_failed",
        "events_dropped",
        "trip_file_failures",
        "recorder_lost",
        "replies_dropped_questions",
    ],
)
def test_a_loss_that_goes_on_is_an_alarm_and_one_that_is_over_is_none(name):
    losses = Losses()
    for second, count in enumerate((7, 7, 9)):
        losses.step({name: count, "frames_in": second}, second * S)
        assert bool(losses.standing()) == (second == 2), "what was lost before the start is no news"
    assert f"{name} = 9" in losses.standing()[0].text
    losses.step({name: 9}, 2 * S + HOLD_NS)
    assert losses.standing() == []


def test_status_shows_every_standing_alarm_with_its_text(stage, make_state):
    standing = [
        Alarm(
            "link_fault",
            Severity.FAULT,
            stage.now_ns,
            0.0,
            0.0,
            False,
            "the CAN controller is bus-off",
        ),
        Alarm("disp_x_danger", Severity.DANGER, stage.now_ns, 81.0, 70.0, True),
        Alarm("disp_y_danger", Severity.DANGER, 0, 0.0, 0.0, True, "latched before"),
    ]
    stage.guard.send("gate", make_state(alarms=standing))
    stage.until(lambda: stage.gate.view.guard is not None)
    shown = "\n".join(_lines(stage.gate.state(stage.now_ns)))
    for words in (
        "fault link_fault for 0 s: the CAN controller is bus-off",
        "danger disp_x_danger",
        "latched: 81 (limit 70)",
        "fault brain_silent",
        "danger disp_y_danger since before the start, latched: latched before",
    ):
        assert words in shown
