"""``orbitd demo``: the whole device against the rotor rig in software, told as a story."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from firmware_py.errors import OrbitdError
from firmware_py.machine.folder import METAVAR
from firmware_py.options import finite, seed
from sim_hil.demo.story import FAULT_VERDICTS, LONGEST_S, SHORTEST_S


class DemoError(OrbitdError):
    """The demo cannot be played as asked."""

    exit_code = 2


def main(argv: list[str]) -> int:
    """Play one demo; exit code 0 when every term of ``ok`` holds, 1 when not."""
    options = _parser().parse_args(argv)
    _check(options)
    from sim_hil.demo.play import play  # brings the simulator: only when a demo is played

    return play(options)


def _check(options: argparse.Namespace) -> None:
    """Refuse before anything is played.

    Raises
    ------
    DemoError
        Length, combination or file.
    """
    if options.seconds < SHORTEST_S:
        raise DemoError(
            f"--seconds {options.seconds:g}: shorter than {SHORTEST_S:g} s, the shortest story; "
            f"raise it"
        )
    if options.seconds > LONGEST_S:
        raise DemoError(
            f"--seconds {options.seconds:g}: longer than {LONGEST_S:g} s, the longest story; "
            f"lower it"
        )
    if options.clock == "sim" and options.link == "serial":
        raise DemoError("--link serial needs --clock real: a port has no simulated clock")
    if options.record is not None:
        where = options.record if options.record.exists() else options.record.parent
        if options.record.is_dir() or not os.access(where, os.W_OK):
            raise DemoError(
                f"--record {options.record}: cannot be written there; give a file in a folder of "
                f"your own"
            )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="orbitd demo",
        description=__doc__,
        epilog="Acts: healthy running, a duty with changing speed and load, an unbalance, a second "
        "fault, the brain "
        "killed. Under 60 s the second fault is left out, under 50 s the kill too; the rest is "
        "shortened. Faults, "
        "severities, times and the build of the rig are drawn from --seed and unknown to the "
        "device. Exit code 0: "
        "every term of `ok` held; 1: the summary names those that did not.",
    )
    parser.add_argument(
        "--seconds", type=finite, default=120.0, help=f"length (120; at least {SHORTEST_S:g})"
    )
    parser.add_argument("--seed", type=seed, default=1, help="draws story, build and noise (1)")
    parser.add_argument("--rig", default="bench", metavar=METAVAR, help="which rig (bench)")
    parser.add_argument(
        "--fault", choices=sorted(FAULT_VERDICTS), help="the second fault (default: a drawn bolt)"
    )
    parser.add_argument(
        "--link", choices=("can", "serial"), default="can", help="CAN FD or MAVLink serial (can)"
    )
    parser.add_argument(
        "--clock",
        choices=("real", "sim"),
        default="real",
        help="processes in real time, or one "
        "process on a simulated clock: deterministic, faster (real)",
    )
    parser.add_argument(
        "--record", type=Path, metavar="FILE", help="keep the flight recording (MCAP) as FILE"
    )
    parser.add_argument("--json", action="store_true", help="only the result, as JSON")
    return parser
