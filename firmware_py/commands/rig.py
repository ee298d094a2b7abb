"""``orbitd rig``: rig folders: a new one to edit, what follows from one, the DBC of its bus."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from firmware_py import launch
from firmware_py.commands import rig_new, rig_show
from firmware_py.machine.folder import METAVAR, find
from firmware_py.wire import dbc
from firmware_py.wire.layout import WireLayout


def main(argv: list[str]) -> int:
    """One action: ``new``, ``show`` or ``dbc``."""
    parser = argparse.ArgumentParser(prog="orbitd rig", description=__doc__)
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    new = actions.add_parser("new", help="make a rig folder to edit", description=rig_new.__doc__)
    rig_new.add_options(new)
    new.set_defaults(run=rig_new.run)
    shown = actions.add_parser(
        "show", help="what follows from a rig folder", description=rig_show.__doc__
    )
    add_rig(shown)
    shown.add_argument("--json", action="store_true", help="every table, for programs")
    shown.set_defaults(run=rig_show.run)
    written = actions.add_parser("dbc", help="the messages of the rig's bus, as a DBC file")
    add_rig(written)
    written.add_argument(
        "--output", type=Path, metavar="FILE", help="where to (default: standard output)"
    )
    written.set_defaults(run=_dbc)
    options = parser.parse_args(argv)
    code: int = options.run(options)
    return code


def add_rig(parser: argparse.ArgumentParser) -> None:
    """The rig that an action is about."""
    parser.add_argument(
        "rig",
        type=find,
        nargs="?",
        default=find("bench"),
        metavar=METAVAR,
        help="shipped rig, rig folder, or file of the first schema (default: bench)",
    )


def _dbc(options: argparse.Namespace) -> int:
    config, _ = launch.verified(options.rig)
    bus = config.bus
    text = dbc.text(WireLayout.of(config), bus.nominal_bitrate, bus.data_bitrate)
    if options.output is None:
        sys.stdout.write(text)
    else:
        options.output.write_text(text, encoding="ascii")
    return 0
