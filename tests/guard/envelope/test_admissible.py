"""The envelope as guard and evaluation ask it: what each thing that is not known does to it."""

from __future__ import annotations

from math import pi

import pytest

from firmware_py.config import SHIPPED, load
from firmware_py.guard.envelope.admissible import Envelope, EnvelopeInput, Known

CONFIG = load(SHIPPED / "bench")[0]
SAFE_M = CONFIG.machine.actuator.safe_radial_clearance_um * 1e-6
SPEED = 6000 * pi / 30
SEEN = EnvelopeInput(
    (30e-6, -28e-6), 8e-6, True, True, SPEED, SPEED, Known(41.0, 80.0, 1.0, 60.0), 41.0, 80.0
)
SECOND = 1_000_000_000


def upper(envelope: Envelope, seen: EnvelopeInput = SEEN, now_ns: int = 0) -> float:
    interval_m = envelope.step(seen, (), now_ns).interval_m
    assert interval_m is not None
    return interval_m[1]


def test_a_measured_load_leaves_room() -> None:
    found = Envelope(CONFIG).step(SEEN, (), 0)
    assert found.load.measured
    assert found.interval_m is not None
    assert found.interval_m[0] < SAFE_M < found.interval_m[1] - 20e-6


@pytest.mark.parametrize(
    "changed", [{"readings": None}, {"displacement_ok": False}, {"whole": False}]
)
def test_without_readings_or_position_the_load_is_the_declared_range(
    changed: dict[str, object],
) -> None:
    found = Envelope(CONFIG).step(SEEN._replace(**changed), (), 0)  # type: ignore[arg-type]
    assert not found.load.measured
    assert found.interval_m is not None


def test_a_vibration_that_is_not_known_narrows_to_safe() -> None:
    unknown = SEEN._replace(displacement_ok=False)
    first = upper(Envelope(CONFIG), unknown)
    assert SAFE_M < first < 0.8 * upper(Envelope(CONFIG))
    assert upper(Envelope(CONFIG), unknown._replace(narrow_um=SAFE_M * 1e6)) == SAFE_M


def test_without_a_speed_nothing_is_admissible() -> None:
    assert Envelope(CONFIG).step(SEEN._replace(fast_rad_s=None), (), 0).interval_m is None


def test_the_smaller_clearance_decides_what_vibration_may_fill() -> None:
    shaken = SEEN._replace(peak_to_peak_m=30e-6)
    wide, narrow = (upper(Envelope(CONFIG), shaken._replace(narrow_um=um)) for um in (80.0, 65.0))
    assert narrow < wide


def test_a_vibration_that_falls_for_no_reason_does_not_widen() -> None:
    envelope, shaken = Envelope(CONFIG), SEEN._replace(peak_to_peak_m=35e-6)
    before = [upper(envelope, shaken, k * SECOND // 10) for k in range(25)][-1]
    assert upper(envelope, SEEN, 26 * SECOND // 10) == pytest.approx(before, abs=1e-7)
    assert upper(Envelope(CONFIG)) > before + 5e-6
