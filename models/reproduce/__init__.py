"""``orbitd reproduce``: the paper's three series of tests on its rig, in one report beside what the
paper prints."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from firmware_py.options import seed


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="orbitd reproduce", description=__doc__)
    parser.add_argument(
        "--quick",
        action="store_true",
        help="every step, too short to mean anything: under a minute",
    )
    parser.add_argument("--seed", type=seed, default=0, help="every random number follows from it")
    parser.add_argument(
        "--out", type=Path, default=Path("runs/reproduce"), help="folder for the report"
    )
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Entry of ``orbitd reproduce``; returns the exit code."""
    args = _parser().parse_args(argv)
    from models.reproduce import (
        control,
        faults,
        report,
        trajectories,
    )  # brings torch and numba: only when asked for

    started = time.monotonic()
    series = [
        trajectories.run(args.quick, np.random.default_rng([args.seed, 1]), args.out / "kept"),
        faults.run(args.quick, np.random.default_rng([args.seed, 2])),
        control.run(args.quick, args.seed),
    ]
    command = f"orbitd reproduce --seed {args.seed}{' --quick' if args.quick else ''}"
    page = report.write(args.out, series, command, time.monotonic() - started)
    for row in (row for one in series for row in one.rows):
        print(
            f"{row.claim}\n  by the paper's method: {row.paper_method}\n  by ours: "
            f"{row.our_method}\n"
        )
    print(f"report: {page}")
    return 0
