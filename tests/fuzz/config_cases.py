"""Rig folders and files that might be configurations: other machines, values nobody writes on
purpose, torn bytes."""

from __future__ import annotations

import datetime
import json
import math
import random
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, Final, cast

import msgspec
from msgspec import inspect

from firmware_py.config import SHIPPED, Config, load
from firmware_py.config.convert import ends_of
from firmware_py.machine.folder import DEVICE, MACHINE
from firmware_py.machine.migrate import MOVED

BASES: Final = ("bench", "seed")
FIRST: Final = "fuzz.toml"
NUMBERS: Final = (
    math.nan,
    math.inf,
    -math.inf,
    0.0,
    -0.0,
    5e-324,
    1e-300,
    1e-12,
    -1.0,
    -1e-6,
    1e9,
    1e308,
    -1e308,
    0,
    1,
    -1,
    2**31,
    2**63,
    10**30,
    0.1 + 0.2,
)
TEXTS: Final = (
    "",
    " ",
    "x",
    "X",
    "../evil",
    "/",
    "/dev/null",
    "/proc/self/mem",
    "a" * 300,
    "ä",
    "\x1b[31m",
    "a\nb",
    "\0",
    "nan",
    "tcp/0.0.0.0:7447",
    "tls/[::1]:7447",
    "tcp/[::1]:0",
    "tcp/127.0.0.1:99999",
    "udp/localhost:1",
    "tcp/127.0.0.1:1#x",
    "quic/h:1",
    "serial//dev/ttyS0",
    "unixsock-stream//tmp/x",
    "-rf",
    "can0",
    "monitor",
)
OTHERS: Final[tuple[Any, ...]] = (
    True, False, "5", [], [1], {}, {"a": 1}, [[]], datetime.date(2026, 1, 1), datetime.time(7, 30),
    datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC), [{}],
)  # fmt: skip


Files = dict[str, bytes]
"""A rig folder, or the one file of the first schema, by name."""


def case(seed: int, i: int) -> Files:
    """The files of case ``i``."""
    rng = random.Random(f"{seed}:{i}")
    table = _table(_base(rng.choice(BASES)))
    kind = rng.random()
    if kind < 0.35:
        _vary(rng, table)
    elif kind < 0.5:
        _vary(rng, table)
        _spoil(rng, table)
    else:
        for _ in range(rng.choice((1, 1, 1, 2, 3, 8))):
            _spoil(rng, table)
    files = _files(rng, table)
    if rng.random() < 0.06:
        torn = rng.choice(list(files))
        files[torn] = _tear(rng, files[torn])
    return files


def varied(seed: int, i: int) -> Files:
    """Files without faults of its own keys: another machine."""
    rng = random.Random(f"varied {seed}:{i}")
    table = _table(_base(rng.choice(BASES)))
    _vary(rng, table)
    return _files(rng, table)


def written(files: Files, place: Path) -> Path:
    """``files`` in a folder ``place``, or the one file there."""
    place.mkdir(parents=True, exist_ok=True)
    for name, data in files.items():
        (place / name).write_bytes(data)
    return place / FIRST if list(files) == [FIRST] else place


def _files(rng: random.Random, table: dict[str, Any]) -> Files:
    """As a rig folder, or as a file of the first schema."""
    device, machine = dict(table), table.get("machine")
    if isinstance(machine, dict):
        del device["machine"]
        if rng.random() < 0.3:
            old = {_OLD.get(name, name): value for name, value in machine.items() if name != "name"}
            return {FIRST: to_toml(device | old).encode()}
        return {MACHINE: to_toml(machine).encode(), DEVICE: to_toml(device).encode()}
    return {DEVICE: to_toml(device).encode()}


_OLD: Final = {new: old for old, new in MOVED.items()}


@cache
def _base(name: str) -> Config:
    return load(SHIPPED / name)[0]


def _table(config: Config) -> dict[str, Any]:
    """As TOML would be read: without what is None."""

    def written(value: Any) -> Any:
        if isinstance(value, dict):
            return {name: written(each) for name, each in value.items() if each is not None}
        return [written(each) for each in value] if isinstance(value, list) else value

    table: dict[str, Any] = written(msgspec.to_builtins(config))
    del table["machine"]["absent"]  # found by what a file leaves out
    return table


@cache
def _keys() -> dict[str, inspect.Type]:
    """Every key of the schema with ``[]`` for the entry of a list."""

    def leaves(kind: inspect.Type, key: str) -> Iterator[tuple[str, inspect.Type]]:
        if isinstance(kind, inspect.StructType):
            for each in kind.fields:
                yield from leaves(each.type, f"{key}.{each.name}".lstrip("."))
        elif isinstance(kind, inspect.ListType) and isinstance(kind.item_type, inspect.StructType):
            yield from leaves(kind.item_type, f"{key}[]")
        elif isinstance(kind, inspect.UnionType):
            yield from leaves(kind.types[0], key)
        else:
            yield key, kind

    return dict(leaves(inspect.type_info(Config), ""))


def _vary(rng: random.Random, table: dict[str, Any]) -> None:
    """Another machine and another device: every number of some sections moved, more or less far."""
    if rng.random() < 0.5:
        _scale(rng, table)
    width = rng.choice((0.01, 0.03, 0.1, 0.3, 1.0))
    share = rng.choice((0.03, 0.1, 0.3, 1.0))
    for key, kind in _keys().items():
        if not isinstance(kind, inspect.IntType | inspect.FloatType) or rng.random() > share:
            continue
        for place, name in _places(rng, table, key):
            value = place.get(name)
            if not isinstance(value, int | float) or isinstance(value, bool):
                continue
            low, high = cast(tuple[float, float], ends_of(key.replace("[]", "[0]")))
            moved = min(max(value * math.exp(width * rng.gauss(0.0, 1.0)), low), high)
            place[name] = round(moved) if isinstance(kind, inspect.IntType) else moved
    table["sampling"]["rate_hz"] = rng.choice((2000, 2500, 4000, 5000, 5000, 5000, 8000, 10000))


def _scale(rng: random.Random, table: dict[str, Any]) -> None:
    """A larger or smaller machine of the same shape: the same film at other loads."""
    size, speed = math.exp(rng.gauss(0.0, 0.8)), math.exp(rng.gauss(0.0, 0.3))
    powers = {
        "bearing": {"journal_radius_m": (1, 0), "length_m": (1, 0)},
        "operating": {
            "load_min_N": (4, 1),
            "load_max_N": (4, 1),
            "load_ramp_unannounced_N_s": (4, 1),
            "speed_min_rpm": (0, 1),
            "speed_max_rpm": (0, 1),
        },
        "rotor": {
            "effective_mass_at_bearing_kg": (4, -1),
            "mass_kg": (4, -1),
            "diametral_inertia_kg_m2": (4, -1),
            "unbalance_normal_kg_m": (4, -1),
            "windage_W_s3": (4, -1),
        },
    }
    for section, keys in powers.items():
        for key, (with_size, with_speed) in keys.items():
            if key in table["machine"][section]:
                table["machine"][section][key] *= size**with_size * speed**with_speed
    if rng.random() < 0.3:
        angle = rng.uniform(-360.0, 360.0)
        for channel, apart in zip(
            table["machine"]["channel"], (0.0, rng.uniform(30.0, 150.0)), strict=False
        ):
            channel["angle_deg"] = (
                angle + apart if -360.0 <= angle + apart <= 360.0 else angle - apart
            )


def _spoil(rng: random.Random, table: dict[str, Any]) -> None:
    """One fault, or what might be one."""
    key = rng.choice(list(_keys()))
    kind, (low, high) = _keys()[key], ends_of(key.replace("[]", "[0]"))
    for place, name in _places(rng, table, key):
        chance = rng.random()
        if chance < 0.05:
            place.pop(name, None)
        elif chance < 0.1:
            place[rng.choice((name + "_", name[1:] or "x", "x" * 200, "a b", "ü"))] = 1
        elif chance < 0.2:
            other = rng.choice(list(place))
            place[name], place[other] = place[other], place.get(name, 0)
        elif chance < 0.35:
            place[name] = rng.choice(OTHERS)
        elif low is not None and high is not None:
            inside = low + (high - low) * rng.random() ** rng.choice((1, 4, 20))
            ends = (
                low,
                high,
                math.nextafter(low, -1e9),
                math.nextafter(high, 1e99),
                inside,
                inside,
                inside,
            )
            value = rng.choice((*NUMBERS, *ends))
            integer = (
                isinstance(kind, inspect.IntType) and math.isfinite(value) and rng.random() < 0.8
            )
            place[name] = int(value) if integer else value
        elif isinstance(kind, inspect.ListType | inspect.VarTupleType):
            place[name] = [rng.choice((*TEXTS, *OTHERS)) for _ in range(rng.choice((0, 1, 2, 40)))]
        elif isinstance(kind, inspect.BoolType):
            place[name] = rng.random() < 0.5
        else:
            place[name] = rng.choice(TEXTS)
    if rng.random() < 0.05:
        _spoil_tables(rng, table)


def _spoil_tables(rng: random.Random, table: dict[str, Any]) -> None:
    if rng.random() < 0.6 and isinstance(table.get("machine"), dict) and table["machine"]:
        table = table["machine"]
    section = rng.choice(list(table))
    match rng.randrange(5):
        case 0:
            del table[section]
        case 1:
            table[section] = rng.choice((*OTHERS, *NUMBERS))
        case 2 if isinstance(table.get("channel"), list):
            rng.shuffle(table["channel"])
        case 3 if isinstance(table.get("channel"), list):
            table["channel"] = (table["channel"] * rng.choice((0, 2, 20)))[: rng.randrange(100)]
        case _:
            table["unknown"] = {"deep": {"deeper": [1, {"x": 2}]}}


def _places(
    rng: random.Random, table: dict[str, Any], key: str
) -> list[tuple[dict[str, Any], str]]:
    """Where ``key`` stands: of a list in one entry; nowhere when the table is no table any more."""
    *path, name = key.split(".")
    here: Any = table
    for part in path:
        here = here.get(part.removesuffix("[]")) if isinstance(here, dict) else None
        if part.endswith("[]"):
            here = rng.choice(here) if isinstance(here, list) and here else None
    return [(here, name)] if isinstance(here, dict) and here else []


def _tear(rng: random.Random, data: bytes) -> bytes:
    """The file after a bad editor, copy or disk."""
    at, to = sorted(rng.randrange(len(data) + 1) for _ in range(2))
    junk = rng.choice(
        (
            b"\0" * 64,
            rng.randbytes(8),
            b"\xef\xbb\xbf",
            b"[",
            b"]]",
            b'"""',
            b"'",
            b"=",
            b"#",
            b"\r",
            b"\n",
        )
    )
    made: tuple[Callable[[], bytes], ...] = (
        lambda: data[:at],
        lambda: data[:at] + data[to:],
        lambda: data[:at] + junk + data[at:],
        lambda: data + data,
        lambda: data.replace(b"\n", b"\r\n"),
        lambda: data.decode().encode("utf-16"),
        lambda: b"\xef\xbb\xbf" + data,
        lambda: b"",
        lambda: data[:at] + b"[" * (to - at) + data[at:],
        lambda: data + b"x = 1\n" * rng.randrange(20_000),
    )
    return rng.choice(made)()


def to_toml(table: dict[str, Any], above: str = "") -> str:
    """``table`` as TOML, whatever it holds."""
    rows = [f"{_key(name)} = {_toml(value)}" for name, value in table.items() if not _headed(value)]
    for name, value in table.items():
        if _headed(value):
            path = f"{above}{_key(name)}"
            for entry in value if isinstance(value, list) else [value]:
                head = f"[[{path}]]" if isinstance(value, list) else f"[{path}]"
                rows += ["", head, to_toml(entry, f"{path}.")]
    return "\n".join(rows) + "\n"


def _headed(value: object) -> bool:
    return isinstance(value, dict) or (
        isinstance(value, list) and bool(value) and all(isinstance(v, dict) for v in value)
    )


def _key(name: str) -> str:
    return (
        name
        if name.isascii() and name.replace("_", "a").replace("-", "a").isalnum()
        else _quoted(name)
    )


def _quoted(text: str) -> str:
    return (
        json.dumps(text, ensure_ascii=True)
        if text.isprintable() or text.isascii()
        else json.dumps(text)
    )


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return _quoted(value)
    if isinstance(value, dict):
        return (
            "{" + ", ".join(f"{_key(name)} = {_toml(each)}" for name, each in value.items()) + "}"
        )
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return value.isoformat() if isinstance(value, datetime.date | datetime.time) else repr(value)
