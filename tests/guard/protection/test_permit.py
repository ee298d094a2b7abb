"""Every row of the run permit, and what a restart, a crash and a lost link do to it."""

import pytest

from firmware_py.config import Drive
from firmware_py.guard.protection.permit import ROWS, UNREADABLE, Permit, PermitFacts, Start
from firmware_py.records import ArmState, DeviceHeartbeat
from firmware_py.wire.codec import CanCodec

from ..scripted_node import MS, Bench, armed

S = 1_000_000_000
CODEC = CanCodec()


class Watched:
    """A permit on a clock of milliseconds."""

    def __init__(self, start: Start | None = None, blind_max_s: float = 3.0) -> None:
        self.permit = Permit(Drive(blind_max_s=blind_max_s), start or Start())
        self.now_ns = 77 * S
        self.names: list[str] = []

    def run(
        self,
        seconds: float,
        *,
        fresh: bool = True,
        ok: bool = True,
        tripped: tuple[str, ...] = (),
        foreign: bool = False,
    ) -> bool:
        for _ in range(round(seconds * 1000)):
            self.now_ns += MS
            facts = PermitFacts(self.now_ns, fresh, fresh and ok, list(tripped), foreign)
            self.names += [notice.name for notice in self.permit.step(facts)]
        return self.permit.state.granted

    def reasons(self) -> list[str]:
        return [text.partition(":")[0] for text in self.permit.state.reasons]


@pytest.mark.parametrize("start", [Start(), Start(restart=True)], ids=["cold", "restart"])
def test_nothing_is_granted_before_ok_samples(start: Start) -> None:
    w = Watched(start)
    assert not w.run(60.0, fresh=False)
    assert not w.run(1.0, ok=False)
    assert w.reasons() == ["unseen"]
    assert w.run(0.001)
    assert w.names.count("run_permit_granted") == 1


@pytest.mark.parametrize(
    ("start", "blind_max_s", "limit_s"),
    [
        (Start(), 3.0, 3.0),
        (Start(), 0.5, 0.5),
        (Start(restart=True), 3.0, 2.0),
        (Start(restart=True), 1.0, 1.0),
    ],
)
def test_blind_withdraws_after_its_time_and_not_before(
    start: Start, blind_max_s: float, limit_s: float
) -> None:
    w = Watched(start, blind_max_s)
    w.run(5.0)
    assert w.run(limit_s, fresh=False)
    assert not w.run(0.001, fresh=False)
    assert w.reasons() == ["blind"]
    assert w.run(0.001)
    assert w.names.count("run_permit_withdrawn") == 1


def test_a_frame_now_and_then_is_not_seeing_and_a_stall_now_and_then_is_not_blindness() -> None:
    trickle, stalls = Watched(), Watched()
    trickle.run(1.0)
    stalls.run(1.0)
    for _ in range(4):
        trickle.run(0.95, fresh=False)
        trickle.run(0.02)
    for _ in range(20):
        assert stalls.run(0.4, fresh=False)
        assert stalls.run(0.6)
    assert trickle.reasons() == ["blind"]


def test_after_long_blindness_samples_must_be_back_for_a_second() -> None:
    w = Watched()
    w.run(1.0)
    w.run(60.0, fresh=False)
    assert not w.run(0.9)
    assert w.run(0.2)


def test_probation_ends_after_ten_minutes_or_when_a_person_has_looked() -> None:
    looked, waited = Watched(Start(restart=True)), Watched(Start(restart=True))
    looked.run(0.01)
    looked.permit.reset()
    assert looked.run(2.9, fresh=False)
    waited.run(0.01)
    waited.now_ns += 600 * S
    waited.run(0.01)
    assert waited.run(2.9, fresh=False)


def test_a_second_restart_bars_until_a_person_has_looked() -> None:
    w = Watched(Start(restart=True, barred=True))
    assert not w.run(10.0)
    assert w.reasons() == ["restarts"]
    w.permit.reset()
    assert w.run(0.001)


def test_tripped_withdraws_and_requests_a_trip_at_once_and_an_unreadable_file_does_not() -> None:
    w = Watched()
    w.run(1.0)
    assert not w.run(0.001, tripped=("disp_x_danger",))
    assert w.permit.state.trip_request
    w.run(0.001, tripped=(UNREADABLE,))
    assert (w.permit.state.granted, w.permit.state.trip_request) == (False, False)
    w.run(0.001, tripped=(UNREADABLE, "disp_x_danger"))
    assert w.permit.state.trip_request
    assert w.run(0.001)


def test_a_foreign_hand_withdraws() -> None:
    w = Watched()
    w.run(1.0)
    assert not w.run(0.001, foreign=True)
    assert w.reasons() == ["foreign"]


def test_every_reason_is_shown_and_told_when_it_withdraws() -> None:
    w = Watched(Start(barred=True))
    w.run(0.001, fresh=False, tripped=("disp_x_danger",), foreign=True)
    assert w.reasons() == ["tripped", "foreign", "restarts", "unseen"]
    assert {row.name for row in ROWS} == {"tripped", "foreign", "restarts", "unseen", "blind"}
    assert all(row.text.startswith(f"{row.name}: ") for row in ROWS)


# ------------------------------------------------------------------ no samples


def test_no_samples_is_an_alarm_at_once_and_over_when_they_are_back_for_a_second() -> None:
    w = Watched()
    w.run(1.0)
    w.run(0.1, fresh=False)
    assert w.permit.standing() == []
    w.run(0.001, fresh=False)
    assert [alarm.name for alarm in w.permit.standing()] == ["no_samples"]
    w.run(0.999)
    assert w.permit.standing()
    w.run(0.002)
    assert not w.permit.standing()
    assert [n for n in w.names if "sample" in n] == ["no_samples", "samples_back"]


def test_samples_that_flicker_are_one_event() -> None:
    w = Watched()
    w.run(1.0)
    for _ in range(50):
        w.run(0.2, fresh=False)
        w.run(0.2)
    assert w.names.count("no_samples") == 1


@pytest.mark.parametrize(("start", "after_s"), [(Start(), 3.0), (Start(restart=True), 0.1)])
def test_samples_that_never_came_are_told_sooner_after_a_restart(
    start: Start, after_s: float
) -> None:
    w = Watched(start)
    w.run(after_s, fresh=False)
    assert not w.permit.standing()
    w.run(0.01, fresh=False)
    assert w.permit.standing()


# ------------------------------------------------------------------ in the guard


def beats(b: Bench, seconds: float) -> list[DeviceHeartbeat]:
    frames = [frame for decision in b.run(seconds) for frame in decision.frames_out]
    return [m for m in map(CODEC.decode, frames) if isinstance(m, DeviceHeartbeat)]


def test_the_first_heartbeats_grant_nothing_and_the_permit_comes_with_the_first_block() -> None:
    b = Bench()
    b.node.running = False
    assert not any(beat.run_permit for beat in beats(b, 1.0))
    b.node.running = True
    assert beats(b, 1.0)[-1].run_permit
    state = next(d.state for d in b.run(0.2) if d.state)
    assert (state.run_permit, state.permit_reasons) == (True, [])


def test_a_guard_that_sees_nothing_withdraws_the_permit_without_a_trip() -> None:
    b = armed()
    b.run(0.5)
    b.node.running = False
    assert all(beat.run_permit for beat in beats(b, 2.9))
    last = beats(b, 0.3)[-1]
    assert (last.run_permit, last.trip_request) == (False, False)
    state = next(d.state for d in b.run(0.2) if d.state)
    assert [text.partition(":")[0] for text in state.permit_reasons] == ["blind"]
    assert "no_samples" in [alarm.name for alarm in state.alarms]


def test_an_unreadable_trip_file_protects_bars_arming_and_asks_for_no_stop() -> None:
    b = Bench(latched=[UNREADABLE])
    said = beats(b, 1.5)
    assert not any(beat.run_permit or beat.trip_request for beat in said)
    assert said[-1].arm_state == ArmState.TRIPPED
    b.ask("mode", mode=2)
    accepted, _ = b.ask("arm")
    assert not accepted
    assert UNREADABLE in next(e.text for e in b.events if e.name == "tripped")
    assert "look at the machine, then `reset`" in next(
        e.text for e in b.events if e.name == UNREADABLE
    )
    b.node.amplitude_um = 40.0
    assert beats(b, 1.5)[-1].trip_request, "it protects"
    b.node.amplitude_um = 5.0
    b.run(1.0)
    assert b.ask("reset") == (True, [])
    assert beats(b, 0.5)[-1].run_permit
    assert b.ask("arm")[0]


@pytest.mark.parametrize("verb", ["reset", "arm"])
def test_a_barred_guard_permits_again_after_a_person_has_looked(verb: str) -> None:
    b = Bench(start=Start(restart=True, barred=True))
    assert not any(beat.run_permit for beat in beats(b, 1.5))
    assert b.core.barred
    assert b.ask("mode", mode=2)[0]
    assert not beats(b, 0.2)[-1].run_permit
    assert b.ask(verb)[0]
    assert beats(b, 0.2)[-1].run_permit
    assert not b.core.barred
    assert not b.core.probation


def test_a_restart_is_told_once_and_a_cold_start_is_not() -> None:
    again, cold = Bench(start=Start(restart=True)), Bench()
    again.run(1.0)
    cold.run(1.0)
    assert again.names().count("guard_restarted") == 1
    assert "guard_restarted" not in cold.names()


def test_a_refused_arm_does_not_lift_the_bar() -> None:
    b = Bench(start=Start(restart=True, barred=True))
    b.run(1.5)
    assert not b.ask("arm")[0], "mode is monitor"
    assert b.core.barred


def test_killing_the_guard_does_not_reset_a_danger_delay() -> None:
    b = armed()
    b.node.amplitude_um = 40.0
    b.run(0.7)
    heir = Bench(timers=b.core.timers, start=Start(restart=True))
    heir.node.amplitude_um = 40.0
    heir.run(0.4)
    assert "tripped" in heir.names()
    fresh = Bench(start=Start(restart=True))
    fresh.node.amplitude_um = 40.0
    fresh.run(0.4)
    assert "tripped" not in fresh.names()


def test_a_timer_of_an_alarm_that_this_version_has_not_is_left_out() -> None:
    assert Bench(timers={"of_an_older_version_danger": S, "disp_x_alert": S}).core.timers == {}


def test_files_that_cannot_be_written_are_an_alarm_until_they_can() -> None:
    b = Bench()
    b.memory_fault = "/var/lib/orbitd/trips.json: No space left on device"
    state = next(d.state for d in b.run(0.2) if d.state)
    assert {"trip_file_unwritable": b.memory_fault}.items() <= {
        a.name: a.text for a in state.alarms
    }.items()
    b.memory_fault = ""
    b.run(0.2)
    assert [n for n in b.names() if n.startswith("trip_file")] == [
        "trip_file_unwritable",
        "trip_file_written",
    ]


def test_the_permit_is_part_of_a_snapshot() -> None:
    b = Bench(start=Start(restart=True, barred=True))
    b.run(0.5)
    other = Bench()
    other.core.restore(b.core.snapshot(0, b.now_ns))
    assert other.core.barred
    assert other.core.snapshot(0, b.now_ns) == b.core.snapshot(0, b.now_ns)
