"""CanLink on a real hub and on absent buses; time is handed in."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import can
import pytest

from firmware_py.config import SHIPPED, load
from firmware_py.records import RawFrame
from firmware_py.wire.can_link import BATCH, RETRY_NS, CanLink, bus_opener
from firmware_py.wire.codec import CanCodec
from firmware_py.wire.hub_bus import OrbitdHubBus
from firmware_py.wire.hub_connect import DIRECTORY_VARIABLE
from firmware_py.wire.link import codec_for, open_link

MS = 1_000_000
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(autouse=True)
def directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(DIRECTORY_VARIABLE, str(tmp_path))
    return tmp_path


@pytest.fixture
def pair() -> Iterator[tuple[CanLink, CanLink]]:
    links = CanLink(bus_opener("orbitd_hub", "t")), CanLink(bus_opener("orbitd_hub", "t"))
    yield links
    for link in links:
        link.close()


def kill_hub(link: CanLink) -> None:
    with socket.socket(fileno=os.dup(link.fileno())) as peer:
        credentials = peer.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12)
    os.kill(int.from_bytes(credentials[:4], sys.byteorder), signal.SIGKILL)


def receive_until(link: CanLink, count: int, now_ns: int) -> list[RawFrame]:
    """Wait, without a deadline of our own, until ``count`` frames have come."""
    frames: list[RawFrame] = []
    while len(frames) < count:
        assert link.up
        frames += link.receive(now_ns)
        time.sleep(0.001)
    return frames


def test_frames_cross_in_order_and_are_counted(pair: tuple[CanLink, CanLink]) -> None:
    here, there = pair
    sent = [RawFrame(0, 0x0C0, bytes([i]) * 64) for i in range(100)]
    assert all(here.send(frame) for frame in sent)
    received = receive_until(there, 100, time.monotonic_ns())
    assert [(f.frame_id, f.data) for f in received] == [(f.frame_id, f.data) for f in sent]
    assert here.counters["frames_out"] == there.counters["frames_in"] == 100
    assert here.receive(0) == []


def test_one_call_takes_a_bounded_batch(pair: tuple[CanLink, CanLink]) -> None:
    here, there = pair
    with OrbitdHubBus("t") as witness:
        for _ in range(BATCH + 5):
            here.send(RawFrame(0, 1, b""))
            assert witness.recv(5) is not None  # so the hub has passed it on
        assert len(there.receive(0)) == BATCH
        assert len(there.receive(0)) == 5


def test_a_frame_that_waited_is_stamped_with_its_arrival(pair: tuple[CanLink, CanLink]) -> None:
    here, there = pair
    before_ns = time.monotonic_ns()
    assert there.receive(before_ns) == []
    here.send(RawFrame(0, 1, b""))
    time.sleep(0.1)
    now_ns = time.monotonic_ns()
    (frame,) = receive_until(there, 1, now_ns)
    assert before_ns <= frame.arrival_ns <= now_ns - 50 * MS
    assert there.counters["stamps_refused"] == 0


class StampedBus:
    """What python-can gives on SocketCAN: messages with the calendar stamps of the kernel."""

    def __init__(self) -> None:
        self.waiting: list[can.Message] = []

    def put(self, stamp_s: float | None, count: int = 1) -> None:
        message = can.Message(1, is_extended_id=False, is_fd=True)
        message.timestamp = stamp_s  # type: ignore[assignment]
        self.waiting += [message] * count

    def recv(self, timeout: float) -> can.Message | None:
        return self.waiting.pop(0) if self.waiting else None

    def shutdown(self) -> None:
        """Nothing to leave."""


class Stamped:
    """A link on a :class:`StampedBus`, a monotonic clock, and a calendar that may be set."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.bus, self.now_ns, self.calendar_ns = StampedBus(), 5_000 * MS, 1_700_000_000_000 * MS
        monkeypatch.setattr("time.time_ns", lambda: self.calendar_ns)
        self.link = CanLink(lambda wait_s: self.bus)  # type: ignore[arg-type,return-value]
        self.link.receive(self.now_ns)

    def wait(self, ms: int) -> None:
        self.now_ns += ms * MS
        self.calendar_ns += ms * MS

    def put(self, count: int = 1) -> None:
        self.bus.put(self.calendar_ns * 1e-9, count)

    def read(self) -> list[int]:
        return [frame.arrival_ns for frame in self.link.receive(self.now_ns)]


@pytest.mark.parametrize(
    "step_ms", [20, 50, 1000, 3_600_000, 10**9, -1, -50, -3_600_000, -1_699_999_999_000]
)
@pytest.mark.parametrize(("before_ms", "waits_ms"), [(1, 1), (1, 40), (30, 10)])
def test_a_step_of_the_calendar_while_frames_wait_makes_none_older_or_younger_than_it_can_be(
    monkeypatch: pytest.MonkeyPatch, step_ms: int, before_ms: int, waits_ms: int
) -> None:
    s = Stamped(monkeypatch)
    s.wait(before_ms)
    put_ns = s.now_ns
    s.put()
    s.wait(waits_ms)
    s.calendar_ns += step_ms * MS
    s.put()
    (old, new) = s.read()
    assert put_ns - 1000 <= old <= s.now_ns
    assert new == pytest.approx(s.now_ns, abs=1000)
    s.wait(3)
    s.put()
    s.wait(2)
    assert s.read() == [pytest.approx(s.now_ns - 2 * MS, abs=1000)], (
        "believed again once the queue was empty"
    )


def test_what_waits_in_a_new_queue_has_no_age(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing tells whether the calendar was set since."""
    s = Stamped(monkeypatch)
    s.link.close()
    s.link._retry_ns = 0
    s.wait(1)
    s.bus.put(s.calendar_ns * 1e-9 - 3600.0)
    assert s.read() == [s.now_ns]


@pytest.mark.parametrize("step_ms", [50, 3_600_000, -50])
def test_a_step_while_nothing_waits_costs_nothing(
    monkeypatch: pytest.MonkeyPatch, step_ms: int
) -> None:
    s = Stamped(monkeypatch)
    s.calendar_ns += step_ms * MS
    s.wait(1)
    assert s.read() == []
    s.put()
    s.wait(1)
    assert s.read() == [pytest.approx(s.now_ns - MS, abs=1000)]
    assert s.link.counters["stamps_refused"] == 0


def test_more_than_a_batch_with_stamps_from_before_a_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """No frame of the second batch is believed either: it waited when the calendar was set."""
    s = Stamped(monkeypatch)
    s.wait(1)
    s.put(BATCH + 10)
    s.calendar_ns += 50 * MS
    assert set(s.read()) == {s.now_ns}
    s.wait(1)
    assert s.read() == [s.now_ns] * 10
    assert s.link.counters["stamps_refused"] == BATCH + 10


def test_a_calendar_that_is_set_again_and_again_never_ages_a_frame(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    s = Stamped(monkeypatch)
    for k in range(100):
        s.wait(1)
        s.put()
        s.calendar_ns += (-70, 50, 3_600_000)[k % 3] * MS
        assert s.read() == [s.now_ns]


@pytest.mark.parametrize("stamp_s", [0.0, None, float("nan"), float("inf"), -5.0, 1e30, 12.5])
def test_a_frame_without_a_usable_stamp_arrives_when_it_is_read(
    monkeypatch: pytest.MonkeyPatch, stamp_s: float | None
) -> None:
    s = Stamped(monkeypatch)
    s.bus.put(stamp_s)
    assert s.read() == [s.now_ns]
    assert s.link.counters["stamps_refused"] == bool(stamp_s)


def test_a_29_bit_identifier_never_passes_for_an_11_bit_one(pair: tuple[CanLink, CanLink]) -> None:
    _, there = pair
    with OrbitdHubBus("t") as stranger:
        stranger.send(
            can.Message(arbitration_id=0x0C0, is_extended_id=True, is_fd=True, data=bytes(64))
        )
        (frame,) = receive_until(there, 1, 0)
    assert frame.frame_id == 0x8000_00C0


def test_error_and_remote_frames_are_counted_and_kept_away(pair: tuple[CanLink, CanLink]) -> None:
    _, there = pair
    with OrbitdHubBus("t") as stranger:
        stranger.send(can.Message(arbitration_id=0x0C0, is_extended_id=False, is_remote_frame=True))
        stranger.send(can.Message(arbitration_id=0x0C0, is_extended_id=False, is_error_frame=True))
        stranger.send(can.Message(arbitration_id=0x0C1, is_extended_id=False, data=b"\x01"))
        (frame,) = receive_until(there, 1, 0)
    assert frame == RawFrame(frame.arrival_ns, 0x0C1, b"\x01")
    assert there.counters["error_frames"] == 2


def test_a_killed_hub_takes_the_link_down_and_a_new_one_brings_it_back(
    pair: tuple[CanLink, CanLink],
) -> None:
    here, there = pair
    kill_hub(here)
    while here.up or there.up:
        assert here.receive(0) == there.receive(0) == []
        time.sleep(0.001)
    assert "hub lost" in here.fault
    assert here.fileno() == -1
    assert here.counters["link_lost"] == 1
    assert not here.send(RawFrame(0, 1, b""))
    assert here.counters["send_failed"] == 1
    now_ns = 0
    while not (here.up and there.up):
        now_ns += RETRY_NS
        assert here.receive(now_ns) == there.receive(now_ns) == []
        time.sleep(0.05)
    assert here.fault == ""
    assert here.counters["link_lost"] == there.counters["link_lost"] == 1
    assert here.send(RawFrame(0, 1, b"back"))
    assert receive_until(there, 1, now_ns)[0].data == b"back"


def test_an_absent_bus_is_named_and_tried_again_twice_a_second() -> None:
    tries: list[float] = []

    def absent(wait_s: float) -> can.BusABC:
        tries.append(wait_s)
        raise can.CanInitializationError("no such adapter")

    link = CanLink(absent)
    assert (link.up, link.fault, link.fileno()) == (False, "no such adapter", -1)
    for now_ms in range(2000):
        assert link.receive(now_ms * MS) == []
    assert tries == [5.0, 0.0, 0.0, 0.0, 0.0]
    link.close()


def test_an_absent_socketcan_interface_is_named(caplog: pytest.LogCaptureFixture) -> None:
    link = CanLink(bus_opener("socketcan", "orbitd-none"))
    assert not link.up
    assert link.fault
    assert not link.send(RawFrame(0, 1, b""))
    assert not caplog.records


def test_the_configuration_chooses_link_and_codec() -> None:
    config, _ = load(SHIPPED / "bench")
    assert isinstance(codec_for(config), CanCodec)
    device, rig = open_link(config, "device"), open_link(config, "rig")
    assert rig.send(RawFrame(0, 0x0C0, bytes(64)))
    while not (frames := device.receive(0)):
        time.sleep(0.001)
    assert frames[0].frame_id == 0x0C0
    device.close()
    rig.close()


def test_a_library_of_log_files_is_not_loaded_with_the_bus_and_stays_usable(tmp_path: Path) -> None:
    """Beside the trainers it would hold up every start by a second."""
    (tmp_path / "asammdf.py").write_text("print('loaded')\n")
    program = "import firmware_py.wire.can_link; print('link'); import asammdf"
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])},
    )
    assert done.stdout.split() == ["link", "loaded"]
