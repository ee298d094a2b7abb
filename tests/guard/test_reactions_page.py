"""`docs/reactions.md` against the code: no reaction is missing there, and none is named that does
not exist."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

import firmware_py
from firmware_py.config import SHIPPED, Config, load
from firmware_py.config.measures import SPEED_HIGH
from firmware_py.gate.core import Gate
from firmware_py.gate.losses import Losses
from firmware_py.gate.queries import QUESTIONS
from firmware_py.gate.view import View
from firmware_py.guard.alarms.alarm import AlarmState
from firmware_py.guard.alarms.condition import Condition
from firmware_py.guard.authority.failsafe import FAILSAFES
from firmware_py.guard.core import GuardCore
from firmware_py.guard.plausibility.pair_window import KINDS
from firmware_py.guard.plausibility.speed_check import NAME as SPEED_IMPLAUSIBLE
from firmware_py.guard.protection.permit import ROWS, UNREADABLE
from firmware_py.guard.supervision.standing import Supervised
from firmware_py.records import Advice, CommissionState, Cycle
from firmware_py.wire.codec import CanCodec
from firmware_py.wire.peers import PeerServer

PACKAGE = Path(firmware_py.__file__).parent
PAGE = PACKAGE.parent / "docs/reactions.md"
NAME_COLUMN, COLUMNS = 1, 5
NO_LOSS = {"frames_in"}
"""Counters of the guard that count what is well."""

BACKTICKS = re.compile(r"`([^`]+)`")
SECOND_NS, CYCLE_NS = 1_000_000_000, 1_000_000


@cache
def config() -> Config:
    return load(SHIPPED / "bench")[0]


@cache
def core() -> GuardCore:
    return GuardCore(config(), CanCodec(), 7)


def named(text: str) -> set[str]:
    """What stands in backticks."""
    return set(BACKTICKS.findall(text))


def in_name_column(text: str) -> set[str]:
    """What stands in backticks in the second column of tables of five."""
    rows = [line.strip("|").split(" | ") for line in text.splitlines() if line.startswith("| ")]
    return {name for cells in rows if len(cells) == COLUMNS for name in named(cells[NAME_COLUMN])}


@cache
def trees() -> list[ast.Module]:
    """Every module of the device."""
    return [
        ast.parse(path.read_text())
        for path in sorted(PACKAGE.rglob("*.py"))
        if path.name != "mav_dialect.py"
    ]


# ---------------------------------------------------------------------- what the code has


def alarms_within(part: Any, seen: set[int]) -> set[str]:
    """Names of every alarm that an object of the device holds, however deep."""
    if id(part) in seen:
        return set()
    seen.add(id(part))
    found = {part.name} if isinstance(part, AlarmState | Supervised) else set()
    if isinstance(part, Condition):
        found.add(part._name)
    if isinstance(part, msgspec.Struct):
        inside = [getattr(part, name) for name in part.__struct_fields__]
    elif isinstance(part, dict):
        inside = list(part.values())
    elif isinstance(part, list | tuple):
        inside = list(part)
    else:
        inside = (
            list(vars(part).values())
            if type(part).__module__.startswith("firmware_py") and hasattr(part, "__dict__")
            else []
        )
    return found.union(*(alarms_within(each, seen) for each in inside))


def gate_alarms() -> set[str]:
    """Names of every alarm of the gate, all of them standing."""
    bad = SimpleNamespace(trouble="x")
    doors = SimpleNamespace(recorder=bad, normal=bad, models=bad)
    view = View(config())
    troubles = Gate._troubles.fget(SimpleNamespace(_parts=doors))  # type: ignore[attr-defined]
    found = view.alarms(0, troubles)
    view.step(Advice(0, 0, 0, 0, None, None, True, [], None), 0)
    view.step(CommissionState(0, 0, "refused", "x"), 0)
    losses = Losses()
    losses.step({"events_dropped": 0}, 0)
    losses.step({"events_dropped": 1}, 1)
    return {alarm.name for alarm in [*found, *view.alarms(0), *losses.standing()]}


def alarms() -> set[str]:
    return (
        alarms_within(core(), set())
        | {f"disp_pair_{kind}" for kind in KINDS}
        | {SPEED_HIGH, SPEED_IMPLAUSIBLE, UNREADABLE}
        | gate_alarms()
    )


def events() -> set[str]:
    """Names of every event that the code writes as such, and those of connections that go and
    come."""
    calls = [node for tree in trees() for node in ast.walk(tree) if isinstance(node, ast.Call)]
    names = [
        call.args[1]
        for call in calls
        if isinstance(call.func, ast.Name) and call.func.id == "Notice"
    ]
    both = [
        part
        for name in names
        for part in ([name.body, name.orelse] if isinstance(name, ast.IfExp) else [name])
    ]
    found = {part.value for part in both if isinstance(part, ast.Constant)}
    guard = GuardCore(config(), CanCodec(), 7)
    for seq, well in enumerate((True, False, True)):
        decision = guard.step(
            Cycle(
                seq,
                SECOND_NS + seq * CYCLE_NS,
                [],
                None,
                [],
                well,
                well,
                well,
                "" if well else "x",
                "" if well else "x",
            )
        )
        found |= {event.name for event in decision.events}
    return {str(name) for name in found}


def counters() -> set[str]:
    """Names of counters: those of the guard, and every one that some function counts by name."""
    found = set(core().counters)
    functions = [
        node
        for tree in trees()
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef) and "counters" in ast.unparse(node)
    ]
    for node in (node for function in functions for node in ast.walk(function)):
        constants = (
            node.keys
            if isinstance(node, ast.Dict)
            else list(ast.walk(node.slice))
            if isinstance(node, ast.Subscript) and "counters" in ast.unparse(node.value)
            else []
        )
        found |= {
            each.value
            for each in constants
            if isinstance(each, ast.Constant) and isinstance(each.value, str)
        }
    found |= {f"questions_refused_{name}" for name in QUESTIONS}
    found |= {f"replies_dropped_{name}" for name in ("disarm", "commands", "questions")}
    refused = re.findall(r"``(refused_\w+)``", PeerServer.__doc__ or "")
    rooms = [
        f"{what}_{role}"
        for what in ("lost", "oversized", "malformed")
        for role in ("guard", "brain", "gate")
    ]
    return (
        found | {f"link_{name}" for name in found} | {f"room_{name}" for name in [*refused, *rooms]}
    )


# ---------------------------------------------------------------------- the page


def missing(text: str) -> set[str]:
    """What the code has and the page lacks: alarms and rows in the column of names, events and
    counters anywhere."""
    rows = {row.name for row in (*FAILSAFES, *ROWS)}
    return (rows | alarms() | set(core().counters) - NO_LOSS) - in_name_column(
        text
    ) | events() - named(text)


def invented(text: str) -> set[str]:
    """What the column of names has and the code lacks."""
    return (
        in_name_column(text)
        - {row.name for row in (*FAILSAFES, *ROWS)}
        - alarms()
        - events()
        - counters()
    )


def test_every_reaction_stands_on_the_page() -> None:
    assert not missing(PAGE.read_text())


def test_every_name_on_the_page_exists() -> None:
    assert not invented(PAGE.read_text())


def test_every_key_and_constant_on_the_page_exists() -> None:
    text = named(PAGE.read_text())
    tables = {
        name: getattr(part, name)
        for part in (config(), config().machine)
        for name in part.__struct_fields__
    }
    keys = {
        name
        for name in text
        if re.fullmatch(r"[a-z]+\.[A-Za-z0-9_]+", name) and name.split(".")[0] in tables
    }
    lacking = {key for key in keys if not hasattr(tables[key.split(".")[0]], key.split(".")[1])}
    constants = {
        node.target.id
        for tree in trees()
        for node in tree.body
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)
    }
    lacking |= {name for name in text if re.fullmatch(r"[A-Z]+(_[A-Z]+)*", name)} - constants
    assert len(keys) > 30
    assert not lacking


@pytest.mark.parametrize(
    "name",
    [
        FAILSAFES[-1].name,
        ROWS[0].name,
        "acc_motor_danger",
        "disp_pair_copied",
        SPEED_HIGH,
        "queue_losses",
        "reject_crc",
        "clock_leap",
        "brain_lost",
    ],
)
def test_a_name_that_is_left_out_or_wrong_is_found(name: str) -> None:
    text = PAGE.read_text()
    assert name in missing(text.replace(f"`{name}`", "`another`"))
    assert "another" in invented(text.replace(f"`{name}`", "`another`"))
