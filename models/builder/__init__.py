"""``orbitd build FOLDER``: the models of a machine, made for it from its rig folder alone.

Simulation, film surrogate (the shipped one where its dimensionless domain covers the bearing),
predictor, classifier, policies where there is an actuator, sealed test: then ``FOLDER/models``,
moved in as a whole with one report.  Interrupted, it goes on where it stopped; the same folder,
size and seed give the same bytes.  ``--size trial`` does the same in minutes, and what it makes is
provisional.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import sys
from pathlib import Path
from typing import Final

from firmware_py.errors import OrbitdError
from firmware_py.options import count, seed

NEEDED: Final = {
    "numba": "sim",
    "scipy": "sim",
    "gymnasium": "sim",
    "torch": "train",
    "onnx": "train",
    "sklearn": "train",
}
"""Packages that a build needs, and the extra that brings each."""

INTERRUPTED: Final = 130
"""Exit code after Ctrl-C, as of every command."""

WITHOUT: Final = (
    "What this device does without them: it runs the models of FOLDER/models that another computer "
    "built (build there, copy the folder: it carries them), protects, analyses the orbit, and "
    "learns the machine's own normal state (`orbitd commission start`)."
)


class BuildError(OrbitdError, ValueError):
    """The build cannot be made as asked; the text names cause, value and next step."""

    exit_code = 2


def main(argv: list[str]) -> int:
    """Build; exit code 0 when the set is in the folder, or when the machine has no use for one."""
    options = _parser().parse_args(argv)
    if missing := [name for name in NEEDED if importlib.util.find_spec(name) is None]:
        extras = ",".join(sorted({NEEDED[name] for name in missing}))
        raise BuildError(
            f"build: {', '.join(missing)} not installed: pip install 'orbitd[{extras}]'. {WITHOUT}"
        )
    try:
        from models.builder.run import build  # brings torch: only when something is built

        return build(options)
    except KeyboardInterrupt:
        print(
            f"orbitd build: interrupted; the same command goes on where it was "
            f"({options.folder}/build)",
            file=sys.stderr,
        )
        return INTERRUPTED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="orbitd build",
        description="make the models of a machine from its rig folder",
        epilog="What is done stands in FOLDER/build; delete it when the set is there. Exit code 0: "
        "FOLDER/models is there, or the machine has no use for it; 2: wrong input; 130: "
        "interrupted, the same command goes on.",
    )
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="rig folder (`orbitd rig new`)")
    parser.add_argument(
        "--size",
        choices=("trial", "full"),
        default="full",
        help="full: about half an hour on two cores, sealed test apart; trial: minutes, "
        "provisional",
    )
    parser.add_argument("--seed", type=seed, default=0, help="every random number follows from it")
    parser.add_argument(
        "--workers",
        type=count,
        default=len(os.sched_getaffinity(0)),
        help="processes side by side (default: one a core)",
    )
    parser.add_argument(
        "--spread",
        metavar="ADDRESS",
        default="",
        help="scheduler of Dask whose workers play the episodes, tcp://HOST:8786 (extra `spread`)",
    )
    parser.add_argument(
        "--data",
        type=Path,
        metavar="DIR",
        help="own recordings to judge by, beside the simulated figures (default: "
        "FOLDER/recordings where it is there)",
    )
    return parser


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
