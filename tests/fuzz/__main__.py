"""``python -m tests.fuzz [TARGET ...]``: the long form of each fuzz target; told where it stands,
it goes on there.

Exit code 1 when anything fails.  A target is a row of :data:`TARGETS`.
"""

from __future__ import annotations

import argparse
import importlib
import json
import sys
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

from .targets import INPUTS


class Target(NamedTuple):
    """``module:function`` of ``run(seed, n, folder, first) -> Outcome``; cases in all, in one step,
    and words.

    Further parts after ``function`` are handed to it first.
    """

    function: str
    cases: int
    step: int
    words: str


TARGETS: Final = {
    "configurations": Target(
        "configurations:run", 3000, 50, "configurations built in process (3 minutes)"
    ),
    "starts": Target(
        "configurations:run_started", 100, 5, "configurations started as processes (8 minutes)"
    ),
    "recordings": Target(
        "damaged_recordings:run", 20_000, 500, "damaged recordings read (8 minutes)"
    ),
    "machines": Target("machines:run", 400, 10, "random machines in the closed loop (20 minutes)"),
} | {
    each.name: Target(f"inputs:run:{each.name}", each.cases, each.cases // 100, each.words)
    for each in INPUTS
}


ON_ITS_OWN: Final = frozenset({"machines"})
"""Targets that run when they are named only."""


def main() -> int:
    """Run the named targets; without a name all but those of :data:`ON_ITS_OWN`."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument(
        "targets",
        nargs="*",
        metavar="TARGET",
        help="; ".join(f"{k}: {t.words}" for k, t in TARGETS.items()),
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--cases", type=int, help="instead of the target's own number")
    parser.add_argument(
        "--state",
        type=Path,
        default=Path(tempfile.gettempdir()) / "orbitd-fuzz.json",
        help="file with what is done (default: %(default)s); remove it to begin anew",
    )
    options = parser.parse_args()
    state = json.loads(options.state.read_text()) if options.state.exists() else {}
    failed = 0
    for name in options.targets or [name for name in TARGETS if name not in ON_ITS_OWN]:
        target = TARGETS[name]
        cases = options.cases or target.cases
        done = state.setdefault(
            f"{name} {options.seed}", {"next": 0, "good": 0, "failures": [], "seconds": 0.0}
        )
        while done["next"] < cases:
            began = time.monotonic()
            with tempfile.TemporaryDirectory(prefix="orbitd-fuzz-") as folder:
                n = min(target.step, cases - done["next"])
                module, function, *first = target.function.split(":")
                run = partial(
                    getattr(importlib.import_module(f".{module}", __package__), function), *first
                )
                outcome = run(options.seed, n, Path(folder), done["next"])
            done["next"] += n
            done["good"] += outcome.good
            done["failures"] += outcome.failures
            done["seconds"] += time.monotonic() - began
            options.state.write_text(json.dumps(state))
            print(
                "\n".join(
                    [
                        f"{name}: {done['next']} of {cases}, {done['good']} called good, "
                        f"{len(done['failures'])} failures, {done['seconds']:.0f} s",
                        *outcome.failures,
                    ]
                ),
                flush=True,
            )
        failed += len(done["failures"])
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
