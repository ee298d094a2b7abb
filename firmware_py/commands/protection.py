"""``orbitd protection``: what protection watches and what it does, generated from the
configuration.

``matrix`` prints causes and effects: every measure with its set points, delays, latches and
effects, every vote, window and possible bypass; ``bypass`` and ``shelve`` ask a running device.  It
describes a monitoring system, which takes the place of no protection system.
"""

from __future__ import annotations

import argparse
import sys
from math import inf
from typing import Final, TypeAlias

import msgspec
from rich.console import Console
from rich.table import Table

from firmware_py import launch
from firmware_py.commands import set_points
from firmware_py.commands.authority import ask
from firmware_py.commands.rig_show import WIDTH
from firmware_py.config import Config
from firmware_py.config.measure_schema import MultiplyConfig
from firmware_py.config.measure_types import Group, Measure, SetPoint
from firmware_py.config.measures import SPEED_HIGH, groups, may_bypass, measures
from firmware_py.machine.folder import METAVAR, find
from firmware_py.options import finite
from firmware_py.records import Severity

CAUTION: Final = (
    "orbitd monitors and controls; it is no machinery protection system in the sense of API 670 "
    "(5th ed., 2014) and takes the place of none"
)

NO_PERMIT: Final = (
    "drive.trip_on_danger = false: a trip latches and retreats, and leaves the run permit alone"
)

TURNS_DELAY: Final = "4 turns"
"""Delay of the speed-high trip: it is counted in turns."""


Actions: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"


class MatrixRow(msgspec.Struct, frozen=True):
    """One set point, as it is printed."""

    measure: str
    source: str
    quantity: str
    alarm: str
    level: str
    set_point: str
    delay: str
    hysteresis: str
    latching: bool
    judged: str
    vote: str
    effect: str
    bypass: bool
    key: str


def main(argv: list[str]) -> int:
    """One action: ``matrix``, ``bypass`` or ``shelve``."""
    parser = argparse.ArgumentParser(prog="orbitd protection", description=__doc__)
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    matrix = actions.add_parser("matrix", help="causes and effects, from the configuration")
    matrix.add_argument(
        "rig", type=find, nargs="?", default=find("bench"), metavar=METAVAR,
        help="shipped rig, or rig folder (default: bench)",
    )  # fmt: skip
    matrix.add_argument("--json", action="store_true", help="the same for programs")
    matrix.set_defaults(run=_matrix)
    _add_bypass(actions)
    _add_shelve(actions)
    options = parser.parse_args(argv)
    code: int = options.run(options)
    return code


def _add_bypass(actions: Actions) -> None:
    bypass = actions.add_parser(
        "bypass", help="bypass a measure or a group for a time, or end that (--end)"
    )
    launch.add_options(bypass)
    bypass.add_argument("target", help="a measure or group for which may_bypass is set")
    bypass.add_argument("--owner", default="", help="who answers for it")
    bypass.add_argument("--reason", default="", help="why")
    _add_time(bypass)
    bypass.set_defaults(run=lambda options: _ask(options, "bypass"))


def _add_shelve(actions: Actions) -> None:
    shelve = actions.add_parser(
        "shelve", help="shelve an alarm for a time, which changes only what is displayed"
    )
    launch.add_options(shelve)
    shelve.add_argument("target", help="name of the alarm")
    _add_time(shelve)
    shelve.set_defaults(run=lambda options: _ask(options, "shelve"), owner="", reason="")


def _add_time(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="the answer as JSON")
    times = parser.add_mutually_exclusive_group(required=True)
    times.add_argument("--minutes", type=finite, metavar="MIN", help="for so long")
    times.add_argument("--end", action="store_true", help="end it")


def _ask(options: argparse.Namespace, verb: str) -> int:
    seconds = 0.0 if options.end else 60.0 * options.minutes
    value: dict[str, object] = {
        "target": options.target, "seconds": seconds, "owner": options.owner,
        "reason": options.reason,
    }  # fmt: skip
    return ask(options, verb, value)


def _matrix(options: argparse.Namespace) -> int:
    config, _ = launch.verified(options.rig)
    rows, votes = matrix_rows(config), groups(config)
    if options.json:
        declared = [group for group in votes if group.declared]
        found = {
            "caution": CAUTION, "rows": rows, "groups": declared,
            "multiply": config.multiply,
        }  # fmt: skip
        sys.stdout.write(msgspec.json.encode(found).decode() + "\n")
        return 0
    console = Console(width=None if Console().is_terminal else WIDTH, highlight=False)
    console.print(_table(f"causes and effects of {config.device.rig}", rows), "")
    for group in votes:
        if group.declared:
            console.print(_said(group), markup=False)
    for window in config.multiply:
        console.print(_window_said(window), markup=False)
    if allowed := may_bypass(config):
        console.print(f"may be bypassed: {', '.join(allowed)}", markup=False)
    if not config.drive.trip_on_danger:
        console.print(NO_PERMIT, markup=False)
    console.print(CAUTION, markup=False)
    return 0


def matrix_rows(config: Config) -> list[MatrixRow]:
    """A row for each set point, in the order in which they are judged."""
    by_measure = {name: group for group in groups(config) for name in group.measures}
    return [
        _row(config, measure, point, by_measure.get(measure.name))
        for measure in measures(config)
        for point in measure.points
    ]


def _row(config: Config, measure: Measure, point: SetPoint, group: Group | None) -> MatrixRow:
    bypassed = may_bypass(config)
    trips = point.effect.name == "TRIP" and group is not None
    effect = point.effect.name.lower()
    if trips and group is not None and group.declared:
        effect = f"authority at once; {effect} by {group.name}"
    return MatrixRow(
        measure.name,
        measure.source,
        measure.quantity,
        point.alarm,
        point.severity.name.lower(),
        set_points.said(config, measure, point),
        TURNS_DELAY if measure.name == SPEED_HIGH else f"{point.delay_ns * 1e-9:g} s",
        f"{100 * measure.hysteresis:g} %",
        point.latching,
        _when(measure, point),
        group.vote if trips and group is not None else "-",
        effect,
        measure.name in bypassed and point.severity is Severity.DANGER,
        point.key,
    )


def _when(measure: Measure, point: SetPoint) -> str:
    low, high = measure.speeds_rpm
    if measure.speeds_rpm == (0.0, inf):
        return point.judged.value
    speeds = f"{low:g} .. {high:g} rpm" if high < inf else f"from {low:g} rpm"
    return f"{point.judged.value}, {speeds}"


def _window_said(window: MultiplyConfig) -> str:
    return (
        f"multiply {window.name}: set points of {', '.join(window.measures)} by {window.factor:g} "
        f"in {window.from_rpm:g} .. {window.to_rpm:g} rpm for at most {window.max_s:g} s, again "
        f"once below {window.reset_rpm:g} rpm; never above the cap by the clearance"
    )


def _said(group: Group) -> str:
    return (
        f"group {group.name}: {group.vote} of {', '.join(group.measures)}; while none is OK: "
        f"{group.all_not_ok.name.lower()}; trips as {group.trip}, latched"
    )


def _table(title: str, rows: list[MatrixRow]) -> Table:
    table = Table(title=title, title_justify="left", show_edge=False)
    columns = ("alarm", "cause", "set point", "delay", "hyst.", "latch", "judged", "vote", "effect")
    for name in columns:
        table.add_column(name, overflow="fold")
    for row in rows:
        table.add_row(
            row.alarm,
            f"{row.quantity}, {row.source}",
            row.set_point,
            row.delay,
            row.hysteresis,
            "latched" if row.latching else "-",
            row.judged,
            row.vote,
            row.effect,
        )
    return table
