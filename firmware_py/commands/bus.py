"""``orbitd bus``: what crosses the bus, decoded by the published interface."""

from __future__ import annotations

import argparse
import math

from firmware_py import launch
from firmware_py.options import finite
from firmware_py.wire.monitor import dump, monitor


def main(argv: list[str]) -> int:
    """Watch counts, rates, losses and newest values; or every frame with ``--dump``."""
    parser = argparse.ArgumentParser(prog="orbitd bus", description=__doc__)
    launch.add_options(parser)
    parser.add_argument(
        "--seconds", type=finite, default=math.inf, help="end after this long (default: Ctrl-C)"
    )
    parser.add_argument(
        "--dump", action="store_true", help="one line for every frame instead of the table"
    )
    parser.add_argument("--json", action="store_true", help="JSON for programs")
    options = parser.parse_args(argv)
    config = launch.from_options(options).config
    return (dump if options.dump else monitor)(config, options.seconds, options.json)
