"""The node's rules as deploy/NODE.md states them, each at its border, and the drive's."""

import pytest

from firmware_py.records import ArmState, Command, DeviceHeartbeat, Mode, NodeMode, Rejected
from sim_hil.hil.node import Node, NodeLimits
from sim_hil.plant.drive import SimulatedDrive
from sim_hil.plant.duty import Duty
from sim_hil.rigs import load_rig

LIMITS = NodeLimits(50.0, 1.0, (40.0, 160.0), (0.5, 3.0), 100, 50.0)
MS = 1000


def command(
    counter: int = 1, session: int = 7, echo_us: int = 0, um: float = 80.0, bar: float = 2.0
) -> Command:
    return Command(counter, session, echo_us, um, bar)


def heartbeat(session: int = 7, permit: bool = True, trip: bool = False) -> DeviceHeartbeat:
    return DeviceHeartbeat(1, session, Mode.AUTO, ArmState.ARMED, permit, trip)


def test_boots_safe() -> None:
    node = Node(LIMITS)
    node.expire(0)
    assert (node.mode, node.clearance_um, node.pressure_bar, node.session) == (
        NodeMode.SAFE,
        50.0,
        1.0,
        0,
    )


def test_obeys_a_good_command_until_it_expires() -> None:
    node = Node(LIMITS)
    node.receive([command()], 0)
    node.expire(100 * MS)
    assert (node.mode, node.clearance_um, node.pressure_bar) == (NodeMode.FOLLOWING, 80.0, 2.0)
    node.expire(100 * MS + 1)
    assert (node.mode, node.clearance_um, node.pressure_bar) == (NodeMode.SAFE, 50.0, 1.0)


def test_only_the_newest_waiting_command_is_judged() -> None:
    node = Node(LIMITS)
    node.receive([command(1, um=10.0), command(2, um=90.0)], 0)
    assert node.clearance_um == 90.0
    assert sum(node.refused.values()) == 0
    node.receive([command(3, um=100.0), command(4, um=500.0)], 0)
    assert node.clearance_um == 90.0
    assert node.refused["range"] == 1


@pytest.mark.parametrize(
    ("age_us", "obeyed"), [(100 * MS, True), (100 * MS + 1, False), (-1, False)]
)
def test_staleness_in_the_nodes_own_clock(age_us: int, obeyed: bool) -> None:
    node = Node(LIMITS)
    now = 2**32 + 5  # the tick has wrapped
    node.receive([command(echo_us=(now - age_us) % 2**32)], now)
    assert (node.mode is NodeMode.FOLLOWING) is obeyed
    assert node.refused["stale"] == (0 if obeyed else 1)


@pytest.mark.parametrize(
    ("counter", "obeyed"),
    [(11, True), (10, False), (9, False), (10 + 32767, True), (10 + 32768, False)],
)
def test_counter_must_be_newer(counter: int, obeyed: bool) -> None:
    node = Node(LIMITS)
    node.receive([command(10)], 0)
    node.receive([command(counter, um=100.0)], 0)
    assert (node.clearance_um == 100.0) is obeyed
    assert node.refused["check"] == (0 if obeyed else 1)


def test_counter_wraps() -> None:
    node = Node(LIMITS)
    node.receive([command(65535)], 0)
    node.receive([command(0, um=100.0)], 0)
    assert node.clearance_um == 100.0


def test_another_session_waits_until_the_present_one_is_silent_for_a_second() -> None:
    node = Node(LIMITS)
    node.receive([command()], 0)
    node.receive([heartbeat()], 500 * MS)
    node.receive([command(session=8, echo_us=1500 * MS)], 1500 * MS)
    assert (node.session, node.refused["session"]) == (7, 1)
    node.receive([heartbeat(session=8)], 1500 * MS)  # not the followed session: keeps nothing alive
    node.receive([command(session=8, echo_us=1500 * MS + 1)], 1500 * MS + 1)
    assert (node.session, node.refused["session"]) == (8, 1)


@pytest.mark.parametrize(
    ("um", "bar", "obeyed"),
    [
        (40.0, 0.5, True),
        (160.0, 3.0, True),
        (39.99, 1.0, False),
        (160.01, 1.0, False),
        (80.0, 3.01, False),
    ],
)
def test_targets_must_lie_in_the_actuators_range(um: float, bar: float, obeyed: bool) -> None:
    node = Node(LIMITS)
    node.receive([command(um=um, bar=bar)], 0)
    assert (node.mode is NodeMode.FOLLOWING) is obeyed


def test_damaged_frames_are_counted_and_forgotten() -> None:
    node = Node(LIMITS)
    node.receive([Rejected("crc", 0x60), Rejected("length", 0x60), Rejected("unknown_id", 0x61)], 0)
    assert node.refused == {"stale": 0, "check": 2, "session": 0, "range": 0}
    assert node.state(3, 2**32 + 9, True).tick_us == 9


def drive() -> SimulatedDrive:
    return SimulatedDrive(load_rig("bench").drive, Duty.hold(6000, 100))


def test_drive_ignores_silence_until_somebody_granted_the_run() -> None:
    d = drive()
    d.hear(heartbeat(permit=False), 0)
    d.watch(10_000 * MS)
    assert not d.coasting


@pytest.mark.parametrize("limit_s", [None, 0.5, 5.0])
@pytest.mark.parametrize(("beyond_us", "coasting"), [(0, False), (1, True)])
def test_drive_coasts_when_its_session_falls_silent(
    limit_s: float | None, beyond_us: int, coasting: bool
) -> None:
    d = (
        drive()
        if limit_s is None
        else SimulatedDrive(
            load_rig("bench").drive, Duty.hold(6000, 100), heartbeat_limit_s=limit_s
        )
    )
    silence_us = round((limit_s or 3.0) * 1000) * MS + beyond_us
    d.hear(heartbeat(), 0)
    d.hear(heartbeat(session=9, permit=False), silence_us)  # a stranger is no comfort
    d.watch(silence_us)
    assert d.coasting is coasting


@pytest.mark.parametrize("limit_s", [0.0, 0.49, 5.01, -1.0, float("nan"), float("inf")])
def test_a_heartbeat_limit_that_protects_nothing_or_stops_everything_is_refused(
    limit_s: float,
) -> None:
    with pytest.raises(ValueError, match=r"0\.5 \.\. 5 s"):
        SimulatedDrive(load_rig("bench").drive, Duty.hold(6000, 100), heartbeat_limit_s=limit_s)


def test_a_withdrawn_permit_stops_the_machine_and_one_that_was_never_granted_does_not() -> None:
    d = drive()
    d.hear(heartbeat(), 0)
    d.hear(heartbeat(session=9, permit=False), 0)
    assert not d.coasting
    d.hear(heartbeat(session=9), 0)  # a guard that was started again takes over
    d.hear(heartbeat(permit=False), 0)
    assert not d.coasting
    d.hear(heartbeat(session=9, permit=False), 0)
    assert (d.coasting, d.reason) == (True, "run permit withdrawn")


def test_drive_may_be_configured_to_run_on() -> None:
    d = SimulatedDrive(load_rig("bench").drive, Duty.hold(6000, 100), coast_on_silence=False)
    d.hear(heartbeat(), 0)
    d.watch(6000 * MS)
    assert not d.coasting
    d.hear(heartbeat(trip=True), 7000 * MS)
    assert d.coasting


def test_trip_of_any_session_coasts_down_and_only_the_operator_starts_again() -> None:
    d = drive()
    d.hear(heartbeat(), 0)
    d.hear(heartbeat(session=99, permit=False, trip=True), 0)
    assert d.coasting
    before = d.speed_rad_s
    rows = d.advance(0.0, 2e-4, 50)
    assert rows[0, 0] == before
    assert rows[-1, 0] == pytest.approx(before - 157.08 * 0.01)
    d.hear(heartbeat(), 0)
    assert d.coasting
    assert d.start()
    assert not d.coasting


def test_operator_cannot_start_without_permission() -> None:
    d = drive()
    d.hear(heartbeat(), 0)
    d.hear(heartbeat(trip=True), 0)
    assert not d.start()
    assert d.coasting


def test_drive_coasts_to_a_standstill_and_runs_up_at_its_rate() -> None:
    d = drive()
    d.hear(heartbeat(trip=True), 0)
    for k in range(500):
        d.advance(k * 0.01, 2e-4, 50)
    assert d.speed_rad_s == 0.0
    d.hear(heartbeat(), 0)
    assert d.start()
    assert d.advance(5.0, 2e-4, 50)[-1, 0] == pytest.approx(418.88 * 0.01)
