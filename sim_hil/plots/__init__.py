"""`orbitd plot KIND -o FILE`: figures of the rotor and its film as PNG or SVG."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from firmware_py.errors import OrbitdError
from firmware_py.options import finite

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SUFFIXES = (".png", ".svg")
KINDS = {
    "orbit": "path of the journal in the clearance, with its spectrum",
    "pressure": "pressure of the film around and along the bearing, and where it is ruptured",
    "waterfall": "spectra over speed during a run-up",
    "map": "power, film and vibration over speed and clearance, with the admissible region",
    "campbell": "natural frequencies over speed, on the film's own stiffness and damping",
    "duty": "speed, load, film, power and orbit through a duty at a fixed clearance",
}


class PlotError(OrbitdError):
    """The figure cannot be drawn or written."""

    exit_code = 2


def main(argv: list[str]) -> int:
    """Draw one figure into a file."""
    options = _parser().parse_args(argv)
    output: Path = options.output
    if output.suffix not in SUFFIXES:
        raise PlotError(
            f"{output}: a figure is written as {' or '.join(SUFFIXES)}; name the file so"
        )
    if output.is_dir() or not os.access(output if output.exists() else output.parent, os.W_OK):
        raise PlotError(f"{output}: cannot be written there; name a file in a folder of your own")
    try:
        import matplotlib
    except ModuleNotFoundError as error:
        raise PlotError(
            "matplotlib is not installed; it comes with the extra: pip install 'orbitd[train]'"
        ) from error
    if options.kind == "orbit" and options.rpm == 0:
        raise PlotError("--rpm 0: an orbit is drawn over turns; give a speed")
    matplotlib.use("Agg")
    figure = _drawer(options.kind)(options)
    try:
        figure.savefig(output, dpi=150)
    except OSError as error:
        raise PlotError(f"{output}: {error.strerror}") from error
    print(output)
    return 0


def _parser() -> argparse.ArgumentParser:
    listed = "; ".join(f"{name}: {what}" for name, what in KINDS.items())
    parser = argparse.ArgumentParser(prog="orbitd plot", description=__doc__, epilog=listed)
    parser.add_argument("kind", choices=KINDS)
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="FILE", help="a .png or .svg file"
    )
    parser.add_argument("--rig", default="bench", help="rig: bench (default) or seed")
    parser.add_argument("--rpm", type=finite, default=6000.0, help="speed, rpm (default 6000)")
    parser.add_argument(
        "--load",
        type=finite,
        default=100.0,
        metavar="N",
        help="static bearing load, N (default 100)",
    )
    parser.add_argument(
        "--clearance", type=finite, default=60.0, metavar="UM", help="radial, um (default 60)"
    )
    parser.add_argument(
        "--film", choices=["table", "direct", "linear"], default="table", help="film of the runs"
    )
    return parser


def _drawer(kind: str) -> Callable[[argparse.Namespace], Figure]:
    from sim_hil.plots import fields, rotor

    drawers: dict[str, Callable[[argparse.Namespace], Figure]] = {
        "orbit": rotor.orbit,
        "pressure": fields.pressure,
        "waterfall": rotor.waterfall,
        "map": fields.power_and_limits,
        "campbell": rotor.campbell,
        "duty": rotor.duty,
    }
    return drawers[kind]
