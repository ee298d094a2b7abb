"""A sick CAN bus is named, with its next step, and its recovery too."""

from __future__ import annotations

import errno

import can
import pytest

from firmware_py.records import RawFrame
from firmware_py.wire.can_health import HOLD_NS, CanHealth
from firmware_py.wire.can_link import CanLink


class ScriptedBus:
    """Gives the messages it is handed; refuses to send with ``code``."""

    def __init__(self) -> None:
        self.waiting: list[can.Message] = []
        self.code: int | None = None

    def fileno(self) -> int:
        return -1

    def recv(self, timeout: float) -> can.Message | None:
        return self.waiting.pop(0) if self.waiting else None

    def send(self, message: can.Message, timeout: float | None = None) -> None:
        if self.code:
            raise can.CanOperationError("no", self.code)

    def shutdown(self) -> None:
        pass


def error_frame(classes: int, controller: int = 0) -> can.Message:
    data = bytes([0, controller, 0, 0, 0, 0, 0, 0])
    return can.Message(arbitration_id=classes, is_error_frame=True, dlc=8, data=data, timestamp=0.0)


GOOD = can.Message(arbitration_id=1, is_extended_id=False, is_fd=True, data=bytes(8), timestamp=0.0)


@pytest.fixture
def bus() -> ScriptedBus:
    return ScriptedBus()


@pytest.fixture
def link(bus: ScriptedBus) -> CanLink:
    return CanLink(lambda wait_s: bus)  # type: ignore[arg-type, return-value]


@pytest.mark.parametrize(
    ("classes", "controller", "words"),
    [
        (0x040, 0, "bus-off"),
        (0x004, 0x10, "error-passive"),
        (0x004, 0x20, "error-passive"),
        (0x004, 0x04, "warning"),
        (0x004, 0x08, "warning"),
        (0x004, 0x01, "lost frames"),
        (0x004, 0x02, "lost frames"),
        (0x020, 0, "acknowledges"),
        (0x001, 0, "could not send"),
        (0x008, 0, "bus errors"),
        (0x080, 0, "bus errors"),
        (0x010, 0, "transceiver"),
    ],
)
def test_each_error_is_named_with_what_to_look_at(bus, link, classes, controller, words):
    bus.waiting = [error_frame(classes, controller)]
    assert link.receive(1) == []
    assert words in link.fault
    assert any(step in link.fault for step in ("check", "lower"))
    assert link.up == (classes != 0x040)


def test_a_full_queue_is_named_until_sends_succeed_for_a_while(bus, link):
    bus.code = errno.ENOBUFS
    link.receive(1)
    assert not link.send(RawFrame(0, 1, b""))
    assert "send queue" in link.fault
    bus.code = None
    assert link.send(RawFrame(0, 1, b""))
    link.receive(HOLD_NS)
    assert "send queue" in link.fault
    link.receive(HOLD_NS + 2)
    assert link.fault == ""


@pytest.mark.parametrize(
    "sign", [GOOD, error_frame(0x100), error_frame(0x004, 0x40)], ids=["frame", "restart", "active"]
)
def test_bus_off_lasts_until_the_controller_takes_part_again(bus, link, sign):
    bus.waiting = [error_frame(0x040)]
    link.receive(1)
    link.receive(100 * HOLD_NS)
    assert not link.up
    bus.waiting = [sign]
    link.receive(101 * HOLD_NS)
    assert link.up
    assert link.fault == ""


def test_the_worst_is_told_first_and_the_others_by_name(bus, link):
    bus.waiting = [error_frame(0x020), error_frame(0x040)]
    link.receive(1)
    assert link.fault.startswith("the CAN controller is bus-off")
    assert link.fault.endswith("(also: no_ack)")
    assert link.counters["bus_off"] == 1


def test_a_bus_opened_anew_is_well():
    health = CanHealth()
    health.error_frame(0x040, b"", 1)
    health.error_frame(0x004, b"", 1)
    health.reset()
    assert health.text == ""


def test_passive_gives_way_to_warning_and_both_to_active():
    health = CanHealth()
    health.error_frame(0x004, bytes([0, 0x20]), 1)
    health.error_frame(0x004, bytes([0, 0x08]), 2)
    assert "warning" in health.text
    health.error_frame(0x004, bytes([0, 0x40]), 3)
    assert health.text == ""
