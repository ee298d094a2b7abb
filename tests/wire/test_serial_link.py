"""SerialLink on real pseudo terminals, and over the software cable."""

from __future__ import annotations

import os
import subprocess
import sys
import termios
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from firmware_py.records import Command, RawFrame, SampleFrame
from firmware_py.wire.mav_codec import MavCodec
from firmware_py.wire.pty_cable import ends
from firmware_py.wire.serial_link import BATCH, RETRY_NS, SerialLink

ROOT = Path(__file__).resolve().parents[2]
CODEC = MavCodec()
BAUD = 3_000_000


def samples(counter: int) -> RawFrame:
    return CODEC.encode(SampleFrame(counter, counter, 0, 0, 0, bytes(range(1, 49))))


def until(condition: Callable[[], bool], what: str) -> None:
    """Wait for the kernel or another process; the limit only ends a broken run."""
    for _ in range(2000):
        if condition():
            return
        time.sleep(0.005)
    pytest.fail(f"never happened: {what}")


class Terminal:
    """The far end of a line, held by the test; ``path`` is what the link opens."""

    def __init__(self, path: Path) -> None:
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        os.set_blocking(self.master, False)
        path.unlink(missing_ok=True)
        path.symlink_to(os.ttyname(self.slave))
        self.path = path

    def unplug(self) -> None:
        self.path.unlink(missing_ok=True)
        os.close(self.slave)
        os.close(self.master)


@pytest.fixture
def terminal(tmp_path: Path) -> Iterator[Terminal]:
    end = Terminal(tmp_path / "port")
    yield end
    if end.path.exists():
        end.unplug()


@pytest.fixture
def link(terminal: Terminal) -> Iterator[SerialLink]:
    port = SerialLink(str(terminal.path), BAUD)
    assert port.up
    yield port
    port.close()


def collect(link: SerialLink, count: int) -> list[RawFrame]:
    frames: list[RawFrame] = []

    def enough() -> bool:
        frames.extend(link.receive(7))
        return len(frames) >= count

    until(enough, f"{count} frames")
    return frames


def test_nothing_waiting_is_an_empty_list(link: SerialLink) -> None:
    assert link.receive(0) == []
    assert link.fault == ""
    assert link.fileno() >= 0


def test_packets_arrive_with_id_and_stamp(link: SerialLink, terminal: Terminal) -> None:
    os.write(terminal.master, samples(1).data)
    assert collect(link, 1) == [RawFrame(7, 52005, samples(1).data)]
    assert link.counters["frames_in"] == 1


def test_packets_leave_whole(link: SerialLink, terminal: Terminal) -> None:
    command = CODEC.encode(Command(1, 2, 3, 50.0, 1.0))
    assert link.send(command)
    assert os.read(terminal.master, 4096) == command.data
    assert link.counters["frames_out"] == 1


def test_every_byte_value_passes_unchanged(link: SerialLink, terminal: Terminal) -> None:
    for start in range(0, 256, 48):
        content = bytes((start + i) % 256 for i in range(48))
        frame = CODEC.encode(SampleFrame(1, 2, 3, 4, 5, content))
        assert link.send(frame)
        assert os.read(terminal.master, 4096) == frame.data
        os.write(terminal.master, frame.data)
        assert collect(link, 1)[0].data == frame.data


def test_one_call_gives_a_bounded_number(link: SerialLink, terminal: Terminal) -> None:
    packet = CODEC.encode(Command(0, 0, 0, 0.0, 0.0)).data
    got: list[int] = []
    for _ in range(8):
        os.write(terminal.master, packet * 100)
    while not got or got[-1]:
        got.append(len(link.receive(0)))
    assert max(got) == BATCH
    assert sum(got) == 800


def test_full_output_queue_refuses_and_never_tears_a_packet(
    link: SerialLink, terminal: Terminal
) -> None:
    taken = 0
    while link.send(samples(taken % 60_000)):
        taken += 1
    assert link.counters["send_failed"] == 1
    sent = b""
    while len(sent) < taken * 74:
        try:
            sent += os.read(terminal.master, 65536)
        except BlockingIOError:
            link.receive(0)  # pushes the rest of the last packet out
    assert sent == b"".join(samples(n).data for n in range(taken))
    assert link.send(samples(1))


def test_absent_port_is_named_and_found_later(tmp_path: Path) -> None:
    path = tmp_path / "port"
    link = SerialLink(str(path), BAUD)
    assert not link.up
    assert (
        link.fault
        == f"serial port {path}: no such port; plug the adapter in or correct bus.serial_port"
    )
    assert link.fileno() == -1
    assert not link.send(samples(1))
    assert link.counters["send_failed"] == 1
    assert link.receive(0) == []
    terminal = Terminal(path)
    link.receive(RETRY_NS - 1)
    assert not link.up
    link.receive(RETRY_NS)
    assert link.up
    assert link.fault == ""
    link.close()
    terminal.unplug()


def test_port_of_another_program_is_named_busy(link: SerialLink, terminal: Terminal) -> None:
    second = SerialLink(str(terminal.path), BAUD)
    assert not second.up
    assert "busy; stop the program that has it" in second.fault
    link.close()
    second.receive(RETRY_NS)
    assert second.up
    second.close()


def test_something_that_is_no_port_is_named(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_text("")
    link = SerialLink(str(path), BAUD)
    assert not link.up
    assert "check bus.serial_port" in link.fault


@pytest.fixture
def cable(tmp_path: Path) -> Iterator[Path]:
    process = subprocess.Popen(
        [sys.executable, "-m", "firmware_py.wire.pty_cable", str(tmp_path)], cwd=ROOT
    )
    until(lambda: ends(tmp_path)[1].exists(), "the cable is laid")
    yield tmp_path
    process.terminate()
    assert process.wait() == 0
    assert not any(end.exists() or end.is_symlink() for end in ends(tmp_path))


def test_the_cable_carries_both_ways(cable: Path) -> None:
    device, rig = (SerialLink(str(end), BAUD) for end in ends(cable))
    command = CODEC.encode(Command(9, 2, 3, 50.0, 1.0))
    assert device.send(command)
    for counter in range(20):
        assert rig.send(samples(counter))
    assert [frame.data for frame in collect(device, 20)] == [
        samples(counter).data for counter in range(20)
    ]
    assert collect(rig, 1)[0].data == command.data
    device.close()
    rig.close()


def test_the_cable_echoes_nothing_before_a_program_opens_it(cable: Path) -> None:
    for end in ends(cable):
        fd = os.open(end, os.O_RDWR | os.O_NOCTTY)
        local_flags = termios.tcgetattr(fd)[3]
        os.close(fd)
        assert not local_flags & (termios.ECHO | termios.ICANON)


def test_an_end_that_nobody_reads_loses_bytes_and_the_cable_lives(cable: Path) -> None:
    device, rig = (SerialLink(str(end), BAUD) for end in ends(cable))
    for counter in range(4000):
        rig.send(samples(counter))
        if counter % 50 == 0:
            time.sleep(0.001)  # lets the cable take what is written
    heard: list[bytes] = []

    def last_is_heard() -> bool:
        rig.send(samples(60_000))
        heard.extend(frame.data for frame in device.receive(0))
        return samples(60_000).data in heard

    until(last_is_heard, "the line works again")
    counters = [int.from_bytes(data[18:20], "little") for data in heard]
    assert counters == sorted(counters)
    assert len(set(counters)) < 4000
    device.close()
    rig.close()


def test_the_cable_wants_a_directory(capsys: pytest.CaptureFixture[str]) -> None:
    from firmware_py.wire.pty_cable import main

    assert main(["/nonexistent"]) == 2
    assert "DIRECTORY" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("sent", "words"), [(b"", "no data"), (b"\x00\x55" * 40, "bytes but no whole packet")]
)
def test_a_line_without_packets_is_named_by_what_comes(sent, words) -> None:
    controller, port = os.openpty()
    link = SerialLink(os.ttyname(port), 115200)
    link.receive(1)
    assert (link.up, link.fault) == (True, "")
    for tenths in range(1, 15):
        os.write(controller, sent)
        link.receive(tenths * 100_000_000)
    assert link.up
    assert words in link.fault
    link.close()
    os.close(controller)
    os.close(port)
