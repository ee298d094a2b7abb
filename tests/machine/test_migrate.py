"""A file of the first schema stays good, and its faults are told in its own words."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import pytest

from firmware_py import config
from firmware_py.machine.migrate import MOVED, first_key, upgrade

BENCH = (config.SHIPPED / "bench.toml").read_text(encoding="utf-8")


def faults(text: str) -> dict[str, config.Fault]:
    """What is wrong with ``text``, by the key of the file."""
    try:
        config.parse(text, Path("rotor.toml"))
    except config.ConfigError as error:
        return {fault.key: fault for fault in error.faults}
    return {}


def first(good: config.Config) -> dict[str, Any]:
    """``good`` as a recording of the first schema carries it."""
    table = msgspec.to_builtins(good)
    machine = table.pop("machine")
    return table | {old: machine[new] for old, new in MOVED.items()}


@pytest.mark.parametrize("name", ["bench", "seed"])
def test_a_configuration_recorded_under_the_first_schema_is_read(name: str) -> None:
    good = config.load(config.SHIPPED / f"{name}.toml")[0]
    old = msgspec.json.encode(first(good))
    assert b'"machine"' not in old
    assert config.decode(old, Path("old.mcap")) == good
    assert config.decode(msgspec.json.encode(good), Path("new.mcap")) == good


def test_the_machine_is_called_as_the_rig() -> None:
    assert upgrade({"device": {"rig": "press-3"}})["machine"]["name"] == "press-3"
    for device in ({}, {"rig": 3}, {"rig": "../x"}, 1, None):
        assert upgrade({"device": device})["machine"]["name"] == "unnamed"


@pytest.mark.parametrize(("old", "new", "key", "step"), [
    ("[bearing]", "[bearng]", "bearng", "write bearing"),
    ("[operating]", "[operatng]", "operatng", "write operating"),
    ("[limits]", "[limts]", "limts", "write limits"),
    ("[oil]", "[lubricant]", "lubricant", "known are device, bearing, oil, feed, rotor,"),
    ("film_max_C = 60.0", "film_maxC = 60.0", "oil.film_maxC", "write film_max_C"),
])  # fmt: skip
def test_a_wrong_name_is_told_with_the_right_one_of_that_file(
    old: str, new: str, key: str, step: str
) -> None:
    found = faults(BENCH.replace(old, new, 1))[key]
    assert found.line == BENCH[: BENCH.index(old)].count("\n") + 1
    assert step in found.next_step


def test_no_fault_of_an_old_file_speaks_of_what_it_does_not_know() -> None:
    changed = BENCH.replace("film_max_C = 60.0", "film_max_C = 41.0")
    changed = changed.replace("min_film_um = 10.0", "min_film_um = 31.0")
    changed = changed.replace("[feed]\npressure_min_bar = 0.5\npressure_max_bar = 3.0", "feed = 3")
    changed = changed.replace("rate_um_s = 50.0", "rate_um_s = 10.0")
    found = faults(changed.replace("speed_min_rpm = 1500.0\n", ""))
    assert {"oil.film_max_C", "limits.min_film_um", "actuator.rate_um_s"} <= set(found)
    assert "operating.speed_min_rpm" in found
    assert not [str(fault) for fault in found.values() if "machine." in str(fault)]
    assert not [str(fault) for fault in found.values() if "lubricant" in str(fault)]


def test_keys_are_called_as_in_the_file() -> None:
    assert first_key("machine.lubricant.film_max_C") == "oil.film_max_C"
    assert first_key("machine.channel[2].scale") == "channel[2].scale"
    assert first_key("machine.contact") == "contact"
    assert first_key("limits.min_film_um") == "limits.min_film_um"
