"""What comes again and again is told once, with a count; what is told adds up to what happened."""

from __future__ import annotations

import pytest

from firmware_py.guard.alarms.alarm import Notice
from firmware_py.guard.alarms.event_limit import (
    BURST,
    COMMANDS_BURST,
    EVERY_NS,
    NAMES_MAX,
    EventLimit,
)
from firmware_py.records import Severity


def told_over(
    telling: EventLimit, seconds: int, rate_hz: float, notice: Notice
) -> list[tuple[Notice, int]]:
    found = []
    for cycle in range(int(seconds * rate_hz)):
        found += telling.step([notice], round(cycle * 1e9 / rate_hz))
    return found


@pytest.mark.parametrize("rate_hz", [1.0, 10.5, 200.0])
@pytest.mark.parametrize("severity", [Severity.INFO, Severity.ALERT, Severity.FAULT])
def test_a_minute_of_fluttering_is_a_handful_of_events_with_counts(rate_hz, severity):
    telling = EventLimit()
    found = told_over(telling, 69, rate_hz, Notice(severity, "cycle_gap", "held up"))
    assert len(found) <= BURST + 7
    found += telling.step([], 69 * 10**9 + EVERY_NS)
    assert sum(count for _, count in found) == int(69 * rate_hz)


def test_the_first_is_told_at_once_and_the_held_back_one_with_its_latest_text():
    telling = EventLimit()
    assert telling.step([Notice(Severity.ALERT, "a", "first")], 5) == [
        (Notice(Severity.ALERT, "a", "first"), 1)
    ]
    for number in range(BURST + 3):
        telling.step([Notice(Severity.ALERT, "a", f"{number}")], 6 + number)
    assert telling.step([], 5 + EVERY_NS - 1) == []
    assert telling.step([], 5 + EVERY_NS) == [(Notice(Severity.ALERT, "a", f"{BURST + 2}"), 4)]
    assert telling.step([], 5 + 2 * EVERY_NS) == []


def test_danger_is_never_held_back_and_commands_of_a_person_are_not():
    telling = EventLimit()
    danger = Notice(Severity.DANGER, "tripped", "x")
    commands = [
        Notice(Severity.INFO, "command", f"{verb} accepted")
        for verb in ("arm", "disarm", "mode auto")
    ]
    assert [len(telling.step([danger], n)) for n in range(9)] == [1] * 9
    for n in range(COMMANDS_BURST):
        assert len(telling.step(commands, 9 + n)) == 3
    assert telling.step(commands, 100) == []


def test_names_that_are_remembered_are_bounded():
    telling = EventLimit()
    for number in range(3 * NAMES_MAX):
        telling.step([Notice(Severity.INFO, "command", f"{number} accepted")], 1)
        telling.step([Notice(Severity.INFO, f"{number}", "")], 1)
    assert len(telling.state) <= NAMES_MAX
