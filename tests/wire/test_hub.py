"""The hub with real processes: who hears what, who loses what, and how it comes and goes."""

from __future__ import annotations

import errno
import os
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import can
import pytest

from firmware_py.wire import hub
from firmware_py.wire.hub_bus import OrbitdHubBus
from firmware_py.wire.hub_connect import DIRECTORY_VARIABLE

LISTENER = """
import sys, time, can
bus = can.Bus(channel="t", interface="orbitd_hub", fd=True, ignore_config=True)
print("ready", flush=True)
received = 0
while (message := bus.recv(20)) and message.arbitration_id != 0x7FF:
    received += 1
print(received, bus.lost, flush=True)
bus.shutdown()
"""


@pytest.fixture
def bus(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[], OrbitdHubBus]]:
    """Opens buses of channel `t` in an own directory; closes them all at the end."""
    monkeypatch.setenv(DIRECTORY_VARIABLE, str(tmp_path))
    opened: list[OrbitdHubBus] = []

    def open_bus(**options: bool) -> OrbitdHubBus:
        opened.append(OrbitdHubBus("t", **options))  # type: ignore[arg-type]
        return opened[-1]

    yield open_bus
    for each in opened:
        each.shutdown()


def hub_pid(each: OrbitdHubBus) -> int:
    """Process at the other end of the bus's socket (kernel's word)."""
    credentials = each._socket.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12)
    return int.from_bytes(credentials[:4], sys.byteorder)


def frame(arbitration_id: int = 0x123, data: bytes = b"\x01\x02", **flags: bool) -> can.Message:
    return can.Message(
        arbitration_id=arbitration_id,
        data=data,
        **{"is_extended_id": False, "is_fd": True, "bitrate_switch": True, **flags},
    )


def send_many(sender: OrbitdHubBus, count: int) -> None:
    for _ in range(count):
        sender.send(frame(data=bytes(64)))


def send_patiently(sender: OrbitdHubBus, count: int) -> None:
    """As a sender that waits while the hub has no processor to run on."""
    for _ in range(count):
        while True:
            try:
                sender.send(frame(data=bytes(64)))
                break
            except can.CanOperationError as busy:
                if busy.error_code != errno.EAGAIN:
                    raise
                time.sleep(0.001)


@pytest.mark.parametrize(
    "message",
    [
        frame(data=bytes(range(64))),
        frame(data=b""),
        frame(0x1FFFFFFF, is_extended_id=True, error_state_indicator=True),
        frame(is_fd=False, bitrate_switch=False),
        can.Message(arbitration_id=0x7FF, is_extended_id=False, is_remote_frame=True, dlc=0),
        can.Message(arbitration_id=0x1, is_extended_id=True, is_error_frame=True),
    ],
)
def test_a_frame_reaches_all_others_unchanged(
    bus: Callable[[], OrbitdHubBus], message: can.Message
) -> None:
    sender, first, second = bus(), bus(), bus()
    before = time.time()
    sender.send(message)
    for receiver in (first, second):
        received = receiver.recv(5)
        assert received is not None
        assert received.equals(message, timestamp_delta=None)
        assert before - 1e-3 <= received.timestamp <= time.time() + 1e-3
    assert sender.recv(0) is None


def test_own_frames_come_back_only_when_asked_for(bus: Callable[..., OrbitdHubBus]) -> None:
    sender, other = bus(receive_own_messages=True), bus()
    sender.send(frame())
    own, heard = sender.recv(5), other.recv(5)
    assert own is not None
    assert heard is not None
    assert not own.is_rx
    assert heard.is_rx


def test_filters_apply(bus: Callable[[], OrbitdHubBus]) -> None:
    sender, receiver = bus(), bus()
    receiver.set_filters([{"can_id": 0x100, "can_mask": 0x7FF, "extended": False}])
    sender.send(frame(0x101))
    sender.send(frame(0x100))
    received = receiver.recv(5)
    assert received is not None
    assert received.arbitration_id == 0x100


def test_a_stopped_listener_costs_the_others_nothing(bus: Callable[[], OrbitdHubBus]) -> None:
    """20 000 frames pass a stopped process; another gets all, the stopped one is told what it
    lost."""
    sender, receiver = bus(), bus()
    stopped = subprocess.Popen([sys.executable, "-c", LISTENER], stdout=subprocess.PIPE, text=True)
    assert stopped.stdout is not None
    assert stopped.stdout.readline() == "ready\n"
    os.kill(stopped.pid, signal.SIGSTOP)
    sent = received = 0
    try:
        for _ in range(200):
            send_patiently(sender, 100)
            sent += 100
            while receiver.recv(0 if received < sent - 100 else 0.002):
                received += 1
        while received < sent and receiver.recv(5):
            received += 1
    finally:
        os.kill(stopped.pid, signal.SIGCONT)
    assert (received, receiver.lost) == (sent, 0)
    heard, lost, closing = finish(stopped, sender)
    assert lost > 0
    assert sent <= heard + lost < sent + closing


def finish(listener: subprocess.Popen[str], sender: OrbitdHubBus) -> tuple[int, int, int]:
    """Send closing frames until ``listener`` has seen one; frames that it received, lost, and the
    closing ones."""
    assert listener.stdout is not None
    closing = 0
    while listener.poll() is None:
        sender.send(frame(0x7FF))
        closing += 1
        time.sleep(0.02)
    heard, lost = map(int, listener.stdout.read().split())
    listener.stdout.close()
    return heard, lost, closing


def test_a_stopped_hub_blocks_nobody(bus: Callable[[], OrbitdHubBus]) -> None:
    sender, receiver = bus(), bus()
    pid = hub_pid(sender)
    os.kill(pid, signal.SIGSTOP)
    try:
        with pytest.raises(can.CanOperationError) as refused:
            send_many(sender, 100_000)
        assert refused.value.error_code == errno.EAGAIN
        assert receiver.recv(0) is None
    finally:
        os.kill(pid, signal.SIGCONT)
    assert receiver.recv(5) is not None


def test_the_death_of_the_hub_is_an_unplugged_adapter(bus: Callable[[], OrbitdHubBus]) -> None:
    sender, receiver = bus(), bus()
    os.kill(hub_pid(sender), signal.SIGKILL)
    for each in (sender, receiver):
        with pytest.raises(can.CanOperationError, match="hub lost"):
            each.recv(5)
    with pytest.raises(can.CanOperationError, match="hub lost"):
        sender.send(frame())
    fresh, other = bus(), bus()  # a dead hub's socket is in nobody's way
    fresh.send(frame())
    assert other.recv(5) is not None


def test_many_that_come_first_start_one_hub(bus: Callable[[], OrbitdHubBus]) -> None:
    listeners = [
        subprocess.Popen([sys.executable, "-c", LISTENER], stdout=subprocess.PIPE, text=True)
        for _ in range(4)
    ]
    for each in listeners:
        assert each.stdout is not None
        assert each.stdout.readline() == "ready\n"
    sender = bus()
    sender.send(frame())
    for each in listeners:
        assert finish(each, sender)[:2] == (1, 0)


def test_the_hub_leaves_when_all_have_left(bus: Callable[[], OrbitdHubBus], tmp_path: Path) -> None:
    only = bus()
    path = tmp_path / "t.sock"
    assert path.exists()
    only.shutdown()
    for _ in range(600):
        if not path.exists():
            break
        time.sleep(0.05)
    assert not path.exists()
    assert bus().recv(0) is None  # and the next one starts another


def test_a_client_that_sends_no_frames_is_put_out(
    bus: Callable[[], OrbitdHubBus], tmp_path: Path
) -> None:
    sender, receiver = bus(), bus()
    for junk in (b"x", bytes(hub.HEADER.size - 1) + b"\x05", bytes(500)):
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as client:
            client.connect(str(tmp_path / "t.sock"))
            client.settimeout(5)
            assert client.recv(100) == hub.WELCOME
            client.send(junk)
            assert client.recv(100) == b""
    sender.send(frame())
    received = receiver.recv(5)
    assert received is not None
    assert received.arbitration_id == 0x123


def test_the_last_words_of_a_client_that_leaves_are_heard(bus: Callable[[], OrbitdHubBus]) -> None:
    leaving, receiver = bus(), bus()
    receiver.send(frame())  # stays unread: the kernel then resets the connection on close
    assert select.select([leaving], [], [], 5)[0]
    send_many(leaving, 50)
    leaving.shutdown()
    assert [receiver.recv(5) is not None for _ in range(50)] == [True] * 50


def test_an_invalid_frame_is_refused_before_it_leaves(bus: Callable[[], OrbitdHubBus]) -> None:
    with pytest.raises(ValueError, match="64"):
        bus().send(frame(data=bytes(65)))


@pytest.mark.parametrize("channel", ["", "a/b", "x" * 81, "../t"])
def test_an_unusable_channel_is_named(channel: str) -> None:
    with pytest.raises(can.CanInitializationError, match="channel"):
        OrbitdHubBus(channel)


def test_an_unusable_directory_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(can.CanInitializationError, match=DIRECTORY_VARIABLE):
        OrbitdHubBus("t", directory=tmp_path / "file" / "below")
    with pytest.raises(can.CanInitializationError, match="too long"):
        OrbitdHubBus("t", directory=tmp_path / ("x" * 120))
