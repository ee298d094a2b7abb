"""Random configurations: what is called good is built and runs, what is refused is refused with every fault named.

Case ``i`` of a seed is always the same.  :func:`run` judges in process: within :data:`SECONDS_MAX`, no exception
but :class:`~firmware_py.config.ConfigError`, each fault with a file, a cause and a next step; a good one is built as
``orbitd check`` does, and guard and brain of every tenth run :data:`RUN_S` of scripted frames.  :func:`run_started`
starts the real processes.
"""

from __future__ import annotations

import datetime
import json
import math
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, Final, cast

import msgspec
import numpy as np
from msgspec import inspect

from firmware_py import launch
from firmware_py.brain.core import BrainCore
from firmware_py.brain.store import Models, load_models
from firmware_py.commands import building
from firmware_py.config import SHIPPED, Config, ConfigError, parse
from firmware_py.config.convert import ends_of
from firmware_py.records import RoomRecord

from ..guard.scripted_node import Bench
from .outcome import Outcome

SECONDS_MAX: Final = 2.0
RUN_S: Final = 1.2
"""Long enough for the first window of the diagnosis (0.8 s) and some advices."""

DRIVE_EVERY: Final = 10
STARTED_S: Final = 1.0
ROLES: Final = ("guard", "brain", "gate")
BASES: Final = ("bench", "seed")
NUMBERS: Final = (math.nan, math.inf, -math.inf, 0.0, -0.0, 5e-324, 1e-300, 1e-12, -1.0, -1e-6, 1e9, 1e308, -1e308,
                  0, 1, -1, 2**31, 2**63, 10**30, 0.1 + 0.2)
TEXTS: Final = ("", " ", "x", "X", "../evil", "/", "/dev/null", "/proc/self/mem", "a" * 300, "ä", "\x1b[31m", "a\nb", "\0",
                "nan", "tcp/0.0.0.0:7447", "tls/[::1]:7447", "tcp/[::1]:0", "tcp/127.0.0.1:99999", "udp/localhost:1",
                "tcp/127.0.0.1:1#x", "quic/h:1", "serial//dev/ttyS0", "unixsock-stream//tmp/x", "-rf", "can0", "monitor")
OTHERS: Final[tuple[Any, ...]] = (
    True, False, "5", [], [1], {}, {"a": 1}, [[]], datetime.date(2026, 1, 1), datetime.time(7, 30),
    datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC), [{}],
)  # fmt: skip


# ---------------------------------------------------------------------- one case


def case(seed: int, i: int) -> bytes:
    """The file of case ``i``."""
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
    text = to_toml(table)
    return _tear(rng, text.encode()) if rng.random() < 0.06 else text.encode()


def varied(seed: int, i: int) -> bytes:
    """A file without faults of its own keys: another machine."""
    rng = random.Random(f"varied {seed}:{i}")
    table = _table(_base(rng.choice(BASES)))
    _vary(rng, table)
    return to_toml(table).encode()


@cache
def _base(name: str) -> Config:
    return parse((SHIPPED / f"{name}.toml").read_text(encoding="utf-8"))[0]


def _table(config: Config) -> dict[str, Any]:
    """As TOML would be read: without what is None."""
    return {name: value for name, value in msgspec.to_builtins(config).items() if value is not None}


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
        "operating": {"load_min_N": (4, 1), "load_max_N": (4, 1), "load_ramp_unannounced_N_s": (4, 1),
                      "speed_min_rpm": (0, 1), "speed_max_rpm": (0, 1)},
        "rotor": {"effective_mass_at_bearing_kg": (4, -1), "unbalance_normal_kg_m": (4, -1), "windage_W_s3": (4, -1)},
    }
    for section, keys in powers.items():
        for key, (with_size, with_speed) in keys.items():
            if key in table[section]:
                table[section][key] *= size**with_size * speed**with_speed
    if rng.random() < 0.3:
        angle = rng.uniform(-360.0, 360.0)
        for channel, apart in zip(table["channel"], (0.0, rng.uniform(30.0, 150.0)), strict=False):
            channel["angle_deg"] = angle + apart if -360.0 <= angle + apart <= 360.0 else angle - apart


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
            ends = (low, high, math.nextafter(low, -1e9), math.nextafter(high, 1e99), inside, inside, inside)
            value = rng.choice((*NUMBERS, *ends))
            integer = isinstance(kind, inspect.IntType) and math.isfinite(value) and rng.random() < 0.8
            place[name] = int(value) if integer else value
        elif isinstance(kind, inspect.ListType):
            place[name] = [rng.choice((*TEXTS, *OTHERS)) for _ in range(rng.choice((0, 1, 2, 40)))]
        elif isinstance(kind, inspect.BoolType):
            place[name] = rng.random() < 0.5
        else:
            place[name] = rng.choice(TEXTS)
    if rng.random() < 0.05:
        _spoil_tables(rng, table)


def _spoil_tables(rng: random.Random, table: dict[str, Any]) -> None:
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


def _places(rng: random.Random, table: dict[str, Any], key: str) -> list[tuple[dict[str, Any], str]]:
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
    junk = rng.choice((b"\0" * 64, rng.randbytes(8), b"\xef\xbb\xbf", b"[", b"]]", b'"""', b"'", b"=", b"#", b"\r", b"\n"))
    made: tuple[Callable[[], bytes], ...] = (
        lambda: data[:at], lambda: data[:at] + data[to:], lambda: data[:at] + junk + data[at:], lambda: data + data,
        lambda: data.replace(b"\n", b"\r\n"), lambda: data.decode().encode("utf-16"), lambda: b"\xef\xbb\xbf" + data,
        lambda: b"", lambda: data[:at] + b"[" * (to - at) + data[at:], lambda: data + b"x = 1\n" * rng.randrange(20_000),
    )  # fmt: skip
    return rng.choice(made)()


def to_toml(table: dict[str, Any]) -> str:
    """``table`` as TOML, whatever it holds."""
    rows = [f"{_key(name)} = {_toml(value)}" for name, value in table.items() if not _headed(value)]
    for name, value in table.items():
        if _headed(value):
            for entry in value if isinstance(value, list) else [value]:
                head = f"[[{_key(name)}]]" if isinstance(value, list) else f"[{_key(name)}]"
                rows += ["", head, *(f"{_key(inner)} = {_toml(each)}" for inner, each in entry.items())]
    return "\n".join(rows) + "\n"


def _headed(value: object) -> bool:
    return isinstance(value, dict) or (isinstance(value, list) and bool(value) and all(isinstance(v, dict) for v in value))


def _key(name: str) -> str:
    return name if name.isascii() and name.replace("_", "a").replace("-", "a").isalnum() else _quoted(name)


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=True) if text.isprintable() or text.isascii() else json.dumps(text)


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return _quoted(value)
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_key(name)} = {_toml(each)}" for name, each in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return value.isoformat() if isinstance(value, datetime.date | datetime.time) else repr(value)


# ---------------------------------------------------------------------- in process


def judge(data: bytes, folder: Path, *, drive: bool) -> tuple[bool, str]:
    """Whether the configuration is called good, and what is wrong with that; empty when nothing is."""
    path = folder / "fuzz.toml"
    path.write_bytes(data)
    began = time.process_time()
    try:
        config = launch.verified(path)[0]
        list(building.surroundings(config, folder, {"STATE_DIRECTORY": str(folder)}))
        building.build(config, _models(config))
    except ConfigError as error:
        return False, _complaint(error) or _late(began)
    except Exception as error:  # noqa: BLE001 -- any other exception is what is looked for
        return False, f"{type(error).__name__}: {error}"
    late = _late(began)
    if late or not drive:
        return True, late
    try:
        run_device(config)
    except Exception as error:  # noqa: BLE001 -- the same
        return True, f"called good, but running: {type(error).__name__}: {error}"
    return True, ""


def _late(began: float) -> str:
    took = time.process_time() - began
    return f"took {took:.1f} s" if took > SECONDS_MAX else ""


def _complaint(error: ConfigError) -> str:
    """What is wrong with a refusal."""
    if error.exit_code != 2 or not error.faults:
        return "refused without exit code 2 or without a fault"
    for fault in error.faults:
        if not (fault.file and fault.cause and fault.next_step and str(fault).isprintable()):
            return f"a fault that does not say all: {fault!r}"
    return ""


def _models(config: Config) -> Models:
    """The models, loaded once for all configurations that they tell apart no further."""
    bearing, models = config.bearing, config.models
    key = (config.device.rig, config.sampling.rate_hz, bearing.length_m / bearing.journal_radius_m, models.directory,
           *models.public_keys)
    if key not in _LOADED:
        if len(_LOADED) > 20:
            _LOADED.clear()
        _LOADED[key] = load_models(config)
    return _LOADED[key]


_LOADED: dict[tuple[Any, ...], Models] = {}


def run_device(config: Config) -> None:
    """The guard on scripted frames at a declared speed, armed, and the brain on what the guard says."""
    with np.errstate(all="ignore"):
        bench = Bench(config)
        bench.node.speed_rpm = 0.5 * (config.operating.speed_min_rpm + config.operating.speed_max_rpm)
        bench.node.oil_C = config.oil.inlet_max_C
        brain = BrainCore(config, _models(config))
        for step in range(round(RUN_S * 1000)):
            decision = bench.cycle()
            records: list[RoomRecord] = [*decision.blocks, *decision.readings]
            if decision.state is not None:
                records.append(decision.state)
            if step % 20 == 0 or records:
                brain.step(records, bench.now_ns)
            if step == 1000:
                bench.ask("mode", mode=2)
                bench.ask("arm")


def run(seed: int, n: int, folder: Path, first: int = 0) -> Outcome:
    """Judge ``n`` cases from ``first`` on, with files in ``folder``."""
    outcome = Outcome()
    for i in range(first, first + n):
        good, wrong = judge(case(seed, i), folder, drive=i % DRIVE_EVERY == 0)
        outcome.add(f"seed {seed} case {i}", good, [wrong] if wrong else [])
    return outcome


# ---------------------------------------------------------------------- real processes


def run_started(seed: int, n: int, folder: Path, first: int = 0) -> Outcome:
    """Start guard, brain and gate of ``n`` cases, let good ones run a second each, and end them."""
    outcome = Outcome()
    for i in range(first, first + n):
        good, wrong = _start(case(seed, i), folder / f"case{i}")
        outcome.add(f"seed {seed} case {i}", good, wrong)
    return outcome


def _start(data: bytes, folder: Path) -> tuple[bool, list[str]]:
    """Whether the configuration is called good, and what is wrong with the starts."""
    folder.mkdir(parents=True)
    path = folder / "fuzz.toml"
    path.write_bytes(data)
    environment = {**os.environ, "ORBITD_BUS_DIR": str(folder), "STATE_DIRECTORY": str(folder / "state"),
                   "HOME": str(folder), "PYTHONWARNINGS": "default"}
    checked = _called_good(path, folder)
    if checked is None:
        return False, []
    processes = {role: _process(role, path, folder, environment) for role in ROLES}
    wrong = []
    try:
        if checked:
            deadline = time.monotonic() + 30.0
            sockets = [folder / "guard.sock", folder / "gate.sock"]
            while time.monotonic() < deadline and not all(socket.exists() for socket in sockets):
                time.sleep(0.05)
            time.sleep(STARTED_S)
            for role, process in processes.items():
                if process.poll() is not None:
                    wrong.append(f"called good, but {role} ended with {process.returncode}")
                process.send_signal(signal.SIGTERM)
        for role, process in processes.items():
            try:
                _, said = process.communicate(timeout=30.0)
            except subprocess.TimeoutExpired:
                process.kill()
                _, said = process.communicate()
                wrong.append(f"{role} did not end")
            if b"Traceback" in said:
                wrong.append(f"{role}: {said.decode(errors='replace').strip().splitlines()[-1]}")
            if process.returncode != (0 if checked else 2) and not wrong:
                wrong.append(f"{role}: exit code {process.returncode}, {said[-300:]!r}")
            if not checked and b"config error: " not in said:
                wrong.append(f"{role}: refused without a word, {said[-300:]!r}")
    finally:
        for process in processes.values():
            if process.poll() is None:
                process.kill()
    return checked, wrong


def _called_good(path: Path, folder: Path) -> bool | None:
    """None where only the machine lacks something, which not every process needs."""
    try:
        config = launch.verified(path)[0]
    except ConfigError:
        return False
    return None if list(building.surroundings(config, folder, {"STATE_DIRECTORY": str(folder)})) else True


def _process(role: str, path: Path, folder: Path, environment: dict[str, str]) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "firmware_py", role, "--config", str(path), "--runtime-dir", str(folder)]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env=environment)
