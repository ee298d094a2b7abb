"""The wish narrowed to what the guard admits, and what the present is made of."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from firmware_py.acquire.channel_map import ChannelMap
from firmware_py.brain.core import BrainCore
from firmware_py.brain.observation import Observer
from firmware_py.records import Advice, Block

from .machine import CONFIG, Machine, models
from .test_brain_core import feed, guard_state, of


def test_the_wish_is_narrowed_to_what_the_guard_admits() -> None:
    core = BrainCore(CONFIG, models(80e-6), "")
    narrow = guard_state(clearance_low_um=45.0, clearance_high_um=72.0)
    assert of(Advice, feed(core, [narrow, *Machine().run(2.0)]))[-1].clearance_um == pytest.approx(
        72.0
    )


def observer(records: list) -> Observer:
    found = Observer(ChannelMap.wire())
    for record in records:
        found.take(record)
    return found


def test_the_present_is_over_whole_turns() -> None:
    machine = Machine(unbalance_kg_m=1e-4, speed_rpm=1650.0)
    present = observer(machine.run(0.5)).present()
    still = Machine(unbalance_kg_m=0.0, speed_rpm=1650.0)
    quiet = observer(still.run(0.5)).present()
    assert present is not None
    assert quiet is not None
    assert present.mean_m == pytest.approx(quiet.mean_m, abs=2e-8)
    assert present.speed_rad_s == pytest.approx(1650 * np.pi / 30)
    assert present.clearance_m == pytest.approx(machine.clearance_m)


def test_a_jump_of_the_tick_begins_the_present_anew() -> None:
    machine = Machine()
    records = machine.run(0.5)
    assert observer(records).present() is not None
    machine.tick_us += 200
    assert observer(records + machine.run(0.1)).present() is None


def test_no_present_without_a_turning_shaft_or_a_reading() -> None:
    records = Machine().run(0.5)
    assert observer([r for r in records if isinstance(r, Block)]).present() is None
    stopped = [
        msgspec.structs.replace(r, speed_rad_s=0.0) if isinstance(r, Block) else r for r in records
    ]
    assert observer(stopped).present() is None
