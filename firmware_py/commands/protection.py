"""``orbitd protection``: what protection watches and what it does, generated from the
configuration.

``matrix`` prints causes and effects: every measure with its set points, delays, latches and
effects, and every vote.  It describes a monitoring system, which takes the place of no protection
system.
"""

from __future__ import annotations

import argparse
import sys
from typing import Final

import msgspec
from rich.console import Console
from rich.table import Table

from firmware_py import launch
from firmware_py.commands.rig_show import WIDTH
from firmware_py.config import Config
from firmware_py.config.measure_types import Group, Measure, SetPoint
from firmware_py.config.measures import SPEED_HIGH, groups, measures
from firmware_py.machine.folder import METAVAR, find

CAUTION: Final = (
    "orbitd monitors and controls; it is no machinery protection system in the sense of API 670 "
    "(5th ed., 2014) and takes the place of none"
)

NO_PERMIT: Final = (
    "drive.trip_on_danger = false: a trip latches and retreats, and leaves the run permit alone"
)

TURNS_DELAY: Final = "4 turns"
"""Delay of the speed-high trip: it is counted in turns."""


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
    key: str


def main(argv: list[str]) -> int:
    """One action: ``matrix``."""
    parser = argparse.ArgumentParser(prog="orbitd protection", description=__doc__)
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    matrix = actions.add_parser("matrix", help="causes and effects, from the configuration")
    matrix.add_argument(
        "rig", type=find, nargs="?", default=find("bench"), metavar=METAVAR,
        help="shipped rig, or rig folder (default: bench)",
    )  # fmt: skip
    matrix.add_argument("--json", action="store_true", help="the same for programs")
    options = parser.parse_args(argv)
    config, _ = launch.verified(options.rig)
    rows, votes = matrix_rows(config), groups(config)
    if options.json:
        declared = [group for group in votes if group.declared]
        found = {"caution": CAUTION, "rows": rows, "groups": declared}
        sys.stdout.write(msgspec.json.encode(found).decode() + "\n")
        return 0
    console = Console(width=None if Console().is_terminal else WIDTH, highlight=False)
    console.print(_table(f"causes and effects of {config.device.rig}", rows), "")
    for group in votes:
        if group.declared:
            console.print(_said(group), markup=False)
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
    side = "above" if measure.sign > 0.0 else "below"
    cap = (
        f", at most {config.limits.clearance_share:g} of the radial clearance"
        if measure.capped
        else ""
    )
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
        f"{side} {point.limit:.5g} {measure.unit}{cap}",
        TURNS_DELAY if measure.name == SPEED_HIGH else f"{point.delay_ns * 1e-9:g} s",
        f"{100 * measure.hysteresis:g} %",
        point.latching,
        point.judged.value,
        group.vote if trips and group is not None else "-",
        effect,
        point.key,
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
