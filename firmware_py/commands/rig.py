"""``orbitd rig``: what a rig folder says, for tools and node builders."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from firmware_py import launch
from firmware_py.machine.folder import METAVAR, find
from firmware_py.wire import dbc
from firmware_py.wire.layout import WireLayout


def main(argv: list[str]) -> int:
    """``dbc``: the messages of the rig's bus, as a DBC file."""
    parser = argparse.ArgumentParser(prog="orbitd rig", description=__doc__)
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    written = actions.add_parser("dbc", help="the messages of the rig's bus, as a DBC file")
    written.add_argument(
        "rig",
        type=find,
        nargs="?",
        default=find("bench"),
        metavar=METAVAR,
        help="shipped rig, rig folder, or file of the first schema (default: bench)",
    )
    written.add_argument(
        "--output", type=Path, metavar="FILE", help="where to (default: standard output)"
    )
    options = parser.parse_args(argv)
    config, _ = launch.verified(options.rig)
    bus = config.bus
    text = dbc.text(WireLayout.of(config), bus.nominal_bitrate, bus.data_bitrate)
    if options.output is None:
        sys.stdout.write(text)
    else:
        options.output.write_text(text, encoding="ascii")
    return 0
