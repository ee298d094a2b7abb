"""The vibration that the shield counts with: up at once, down only with a reason."""

import msgspec
import pytest

from firmware_py.guard.envelope.vibration_hold import HOLD_NS, VibrationHold, VibrationHoldState

STEP_NS = 20_000_000


class Held:
    """A hold that is asked every 20 ms."""

    def __init__(self) -> None:
        self.hold, self.now_ns = VibrationHold(), 0

    def run(
        self, seconds: float, um: float, clearance_um: float = 50.0, speed: float = 600.0
    ) -> float:
        """Vibration counted with at the end, um."""
        found = 0.0
        for _ in range(round(seconds * 1e9 / STEP_NS)):
            self.now_ns += STEP_NS
            found = self.hold.step(um * 1e-6, clearance_um * 1e-6, speed, self.now_ns) * 1e6
        return found


@pytest.fixture
def held() -> Held:
    h = Held()
    assert h.run(3.0, 10.0) == pytest.approx(10.0)
    return h


@pytest.mark.parametrize("um", [9.0, 5.0, 2.0, 0.0])
def test_a_fall_at_the_same_speed_and_clearance_does_not_count(held: Held, um: float) -> None:
    assert held.run(60.0, um) == pytest.approx(10.0)


def test_a_fall_counts_after_two_minutes(held: Held) -> None:
    held.run(HOLD_NS * 1e-9 + 2.0, 2.0)
    assert held.run(0.1, 2.0) == pytest.approx(2.0)


def test_a_rise_counts_at_once_and_is_forgotten_when_it_was_short(held: Held) -> None:
    assert held.run(0.02, 30.0) == pytest.approx(30.0)
    assert held.run(3.0, 10.0) == pytest.approx(10.0)
    assert held.run(3.0, 12.0) == held.run(3.0, 8.0) == pytest.approx(12.0)


def test_another_speed_explains_a_fall(held: Held) -> None:
    assert held.run(0.1, 2.0, speed=630.0) == pytest.approx(2.0)
    assert held.run(0.02, 1.0, speed=float("nan")) == pytest.approx(1.0)


def test_a_narrower_clearance_explains_the_square_and_a_wider_one_nothing(held: Held) -> None:
    assert held.run(0.1, 2.0, clearance_um=40.0) == pytest.approx(6.4)
    assert held.run(0.1, 2.0, clearance_um=100.0) == pytest.approx(10.0)
    assert held.run(0.1, 2.0, clearance_um=50.0) == pytest.approx(10.0)


def test_it_survives_a_snapshot(held: Held) -> None:
    held.hold.state = msgspec.msgpack.decode(
        msgspec.msgpack.encode(held.hold.state), type=VibrationHoldState
    )
    assert held.run(1.0, 2.0) == pytest.approx(10.0)
