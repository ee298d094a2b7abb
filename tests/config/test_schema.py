"""Every key by itself: numbers with a least and a greatest value, text with a pattern, and all
faults at once."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Any

import msgspec
import pytest
from msgspec import inspect

from firmware_py import config
from firmware_py.config.convert import FaultedError, convert, ends_of, view
from firmware_py.config.schema import WORDS
from firmware_py.machine import SlowChannel
from tests.first_schema import BENCH


def leaves(kind: inspect.Type, key: str = "") -> Iterator[tuple[str, inspect.Type]]:
    """Every key of the schema and what it takes."""
    if isinstance(kind, inspect.StructType):
        for each in kind.fields:
            yield from leaves(each.type, f"{key}.{each.name}".lstrip("."))
    elif isinstance(kind, inspect.ListType | inspect.VarTupleType):
        yield from leaves(kind.item_type, f"{key}[0]")
    elif isinstance(kind, inspect.UnionType):
        for each in kind.types:
            yield from leaves(each, key)
    else:
        yield key, kind


ALL = list(leaves(inspect.type_info(config.Config)))
OPTIONAL = {key for key, kind in ALL if isinstance(kind, inspect.NoneType)}
LEAVES = [(key, kind) for key, kind in ALL if not isinstance(kind, inspect.NoneType)]
NUMBERS = [
    (key, kind) for key, kind in LEAVES if isinstance(kind, inspect.IntType | inspect.FloatType)
]


@pytest.mark.parametrize(("key", "kind"), NUMBERS, ids=[key for key, _ in NUMBERS])
def test_every_number_has_a_least_and_a_greatest_value(key: str, kind: Any) -> None:
    low, high = kind.ge, kind.le
    assert low is not None, f"{key}: add ge="
    assert high is not None, f"{key}: add le="
    assert kind.gt is None, f"{key}: say the least value itself, ge="
    assert kind.lt is None, f"{key}: say the greatest value itself, le="
    assert math.isfinite(low)
    assert math.isfinite(high)
    assert low < high
    assert ends_of(key) == (low, high)


def test_every_text_has_a_pattern_and_words_for_it() -> None:
    for key, kind in LEAVES:
        if isinstance(kind, inspect.StrType):
            assert kind.pattern in WORDS, f"{key}: add a pattern"
            assert not re.search(kind.pattern, "a\n"), f"{key}: end the pattern with \\Z"
        else:
            assert isinstance(
                kind, inspect.IntType | inspect.FloatType | inspect.BoolType | inspect.LiteralType
            ), key


def table() -> dict[str, Any]:
    """The shipped configuration with every list that may be empty filled."""
    tables: dict[str, Any] = msgspec.to_builtins(config.parse(BENCH)[0])
    tables["machine"]["reading"] = [msgspec.to_builtins(SlowChannel("shaft_power"))]
    tables["machine"]["other_bearing"] = [
        tables["machine"]["bearing"] | {"name": "nde", "load_min_N": 1.0, "load_max_N": 2.0}
    ]
    tables["machine"]["feed_port"] = [{"kind": "port", "angle_deg": 90.0, "bore_mm": 2.0}]
    tables["machine"]["pads"] = {"count": 2, "arc_deg": 150.0, "preload": 0.5}
    tables["machine"]["map"] = [{"signal": "VIB.X", "to": "disp_x", "instant": 0, "every_ms": 100}]
    tables["machine"]["foreign"] = {"dbc": "plant.dbc"}
    tables["limits_at"] = [
        {"bearing": "nde", "displacement_alert_um": 1.0, "displacement_danger_um": 2.0}
    ]
    tables["measure"] = [
        {"name": "disp_x", "alert": 1.0, "danger": 2.0, "alert_delay_s": 1.0,
         "danger_delay_s": 1.0, "hysteresis_share": 0.1}
    ]  # fmt: skip
    tables["group"] = [{"name": "shaft", "measures": ["disp_x", "disp_y"], "vote": "2oo2"}]
    tables["multiply"] = [
        {"name": "critical", "measures": ["disp_x"], "factor": 2.0, "from_rpm": 2000.0,
         "to_rpm": 3000.0, "max_s": 30.0, "reset_rpm": 1000.0}
    ]  # fmt: skip
    return tables


def put(tables: dict[str, Any], key: str, value: object) -> None:
    *path, last = re.findall(r"\w+", key)
    for part in path:
        tables = tables[int(part)] if isinstance(tables, list) else tables[part]
    tables[int(last) if isinstance(tables, list) else last] = value


@pytest.mark.parametrize(("key", "kind"), NUMBERS, ids=[key for key, _ in NUMBERS])
def test_no_number_is_taken_outside_its_ends_or_of_another_kind(key: str, kind: Any) -> None:
    low, high = ends_of(key)
    assert low is not None
    assert high is not None
    wrong: list[object] = [
        math.nan,
        math.inf,
        -math.inf,
        -math.nan,
        1e308,
        -1e308,
        10**400,
        "1",
        "",
    ]
    wrong += [
        True,
        [],
        {},
        [1.0],
        {"a": 1},
        low - 1,
        high + 1,
        None,
    ]
    if isinstance(kind, inspect.IntType):
        wrong.append(1.5)
    if isinstance(kind, inspect.FloatType):
        wrong += [math.nextafter(low, -math.inf), math.nextafter(high, math.inf)]
    if key in OPTIONAL:
        wrong.remove(None)
    for value in wrong:
        changed = table()
        put(changed, key, value)
        faults = convert(changed)[1]
        assert [fault[0] for fault in faults] == [key], value
        assert "; " in faults[0][2]
    for value in (low, high):
        changed = table()
        put(changed, key, value)
        assert convert(changed)[1] == []


def test_toml_dates_and_lists_are_named_as_what_they_are() -> None:
    text = BENCH.replace("rate_um_s = 50.0", "rate_um_s = 2026-01-01").replace(
        "rate_hz = 5000", "rate_hz = 5e3"
    )
    text = text.replace("film_at_outlet = true", 'film_at_outlet = "yes"').replace(
        'rig = "bench"', "rig = 07:30:00"
    )
    text = text.replace("[feed]\npressure_min_bar = 0.5\npressure_max_bar = 3.0", "")
    text = text.replace("[device]", "feed = 3\n[device]")
    text = text.replace('mode_at_start = "monitor"', 'mode_at_start = "automatic"')
    text += "[zenoh]\nlisten = 'tcp/127.0.0.1:1'\nconnect = [3]\n"
    with pytest.raises(config.ConfigError) as caught:
        config.parse(text)
    said = {fault.key: f"{fault.cause}; {fault.next_step}" for fault in caught.value.faults}
    assert said == {
        "feed": "a whole number, not a table; write [feed] and its keys below",
        "device.rig": "a time, not text; write it in quotes",
        "device.mode_at_start": "unknown; write one of auto, manual, monitor",
        "sampling.rate_hz": "a number, not a whole number; write one of 100 .. 10000",
        "oil.film_at_outlet": "text, not true or false; write one, without quotes",
        "actuator.rate_um_s": "a date, not a number; write one of 1 .. 6500",
        "zenoh.listen": "text, not a list; write it in brackets",
        "zenoh.connect[0]": "a whole number, not text; write it in quotes",
    }


def test_all_faults_are_told_at_once_each_with_its_place() -> None:
    text = BENCH.replace("film_max_C = 60.0", "film_max_C = nan").replace(
        "rate_um_s = 50.0", "rate_um_s = 1e9"
    )
    text = text.replace("min_film_um = 10.0", "min_flim_um = 10.0").replace(
        "angle_deg = 135.0", "angle_deg = 45.0"
    )
    text = text.replace("speed_min_rpm = 1500.0", "speed_min_rpm = 0").replace(
        "fresh_age_ms = 20", "fresh_age_ms = 95"
    )
    with pytest.raises(config.ConfigError) as caught:
        config.parse(text)
    faults = {fault.key: fault for fault in caught.value.faults}
    assert set(faults) == {
        "oil.film_max_C",
        "actuator.rate_um_s",
        "limits.min_flim_um",
        "channel[1].angle_deg",
        "operating.speed_min_rpm",
        "sampling.fresh_age_ms",
    }
    rows = text.splitlines()
    for key, fault in faults.items():
        assert key.rpartition(".")[2] in rows[fault.line - 1]
    assert faults["limits.min_flim_um"].next_step == "write min_film_um"
    assert (
        faults["operating.speed_min_rpm"].least,
        faults["operating.speed_min_rpm"].greatest,
    ) == (60.0, 60000.0)
    assert len(str(caught.value).splitlines()) == len(faults)


def test_a_view_reads_like_the_configuration_but_where_it_has_a_fault() -> None:
    changed = table()
    changed["sampling"]["rate_hz"] = 0
    del changed["bus"]
    del changed["limits"]["min_film_um"]
    values, _ = convert(changed)
    seen = view(values, frozenset({"sampling.rate_hz", "machine.channel[2]"}))
    assert seen.machine.lubricant.viscosity_at_40C_Pa_s == 0.010
    assert seen.bus.nominal_bitrate == 1_000_000
    assert seen.device.start_mode.name == "MONITOR"
    assert seen.machine.channel[1].angle_deg == 135.0
    assert seen.machine.contact is not None
    assert seen.machine.contact.circuit_V == 2.0
    assert seen.zenoh.listen == []
    for read in (
        lambda: seen.sampling.period_us,
        lambda: seen.limits.min_film_um,
        lambda: seen.machine.channel[2].scale,
    ):
        with pytest.raises(FaultedError):
            read()


def test_a_json_configuration_is_held_to_the_same() -> None:
    good = config.parse(BENCH)[0]
    path = config.SHIPPED / "x.mcap"
    assert config.decode(msgspec.json.encode(good), path) == good
    for old, new, words in (
        (b'"film_max_C":60.0', b'"film_max_C":null', "lubricant.film_max_C"),
        (b'"film_max_C":60.0', b'"film_max_C":1e999', "no configuration"),
        (b'"speed_min_rpm":1500.0', b'"speed_min_rpm":0', "operating.speed_min_rpm"),
        (b'"angle_deg":135.0', b'"angle_deg":45.0', "channel[1].angle_deg"),
    ):
        with pytest.raises(config.ConfigError, match=re.escape(words)):
            config.decode(msgspec.json.encode(good).replace(old, new), path)
    for junk in (b"", b"[]", b"\xff", b"{" * 100_000, b"null"):
        with pytest.raises(config.ConfigError):
            config.decode(junk, path)
