"""What `check` says of channels and readings under both wire schemas: each fault by its name, all
in one go."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest

from firmware_py import config
from firmware_py.config import Config
from firmware_py.config.instances import places, slow_signals
from firmware_py.machine import FastChannel, SlowChannel
from tests.wire.layouts import channels, readings, rig

replace = msgspec.structs.replace


def said(changed: Config) -> list[str]:
    """The faults of a configuration as a file would have them."""
    try:
        config.decode(msgspec.json.encode(changed), Path("rig.json"))
    except config.ConfigError as error:
        return [str(fault) for fault in error.faults]
    return []


def channel_changed(base: Config, i: int, **values: Any) -> Config:
    rows = list(base.machine.channel)
    rows[i] = replace(rows[i], **values)
    return base.replaced(channel=rows)


def reading_changed(base: Config, i: int, **values: Any) -> Config:
    rows = list(base.machine.reading)
    rows[i] = replace(rows[i], **values)
    return base.replaced(reading=rows)


def probes_last(base: Config) -> Config:
    rows = list(base.machine.channel)
    return base.replaced(channel=[*rows[2:], *rows[:2]])


NINE = rig(9, 2)

FAULTS: dict[str, tuple[Callable[[], Config], str]] = {
    "probes not in front": (lambda: probes_last(NINE), "must begin with disp_x, disp_y"),
    "a standard channel of another kind": (
        lambda: channel_changed(NINE, 5, kind="voltage", unit="V", scale=1e-4),
        "the channel microphone is of kind sound_pressure; leave it out",
    ),
    "a wire scale under schema 1": (
        lambda: channel_changed(rig(8, schema=1), 2, wire_scale=0.01),
        "schema 1 has the scales of orbitd.dbc",
    ),
    "readings under schema 1": (
        lambda: rig(8, schema=1).replaced(reading=readings(1)),
        "schema 1 carries the four of RIG_STATUS",
    ),
    "a standard reading is missing": (
        lambda: NINE.replaced(reading=readings(2)[1:]),
        "is missing, which the guard rests on; add it",
    ),
    "a standard reading of another kind": (
        lambda: reading_changed(NINE, 0, kind="humidity"),
        "no kind of slow reading",
    ),
    "a standard reading of a kind that exists": (
        lambda: reading_changed(NINE, 0, kind="flow"),
        "; leave it out",
    ),
    "too many channels": (lambda: rig(25), "25 channels, the wire carries 2 .. 24"),
    "too many samples": (lambda: rig(24, rate_hz=10_000), "make 240000 samples/s, at most 120000"),
    "a frame that spans too long": (lambda: rig(4, rate_hz=100), "a frame spans at most 5000 us"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_each_fault_is_named(name: str) -> None:
    make, words = FAULTS[name]
    found = said(make())
    assert any(words in fault for fault in found), found


def test_what_can_be_is_good() -> None:
    assert said(NINE) == []
    assert said(rig(2)) == []


def test_a_channel_of_no_kind_has_no_place_of_one() -> None:
    """The checks name it; what is asked meanwhile must not fail."""
    odd = [*channels(8), FastChannel("odd", "m", 1e-8, -1e-4, 1e-4)]
    found = places(odd)
    assert (found.names[8], found.kinds[8]) == ("odd", "")
    assert 8 not in found.shaking
    changed = NINE.replaced(reading=[*NINE.machine.reading, SlowChannel("odd", "colour")])
    assert "odd" not in [signal.name for signal in slow_signals(changed)]
