"""`orbitd bound`: how much power any control of the clearance could save on a duty, and of the
supply pressure with it.

Four ways, each checked in the time domain against every limit: the nominal fixed setting, the best
feasible fixed one (1 um grid), the best schedule with full preview (dynamic programming), and the
best causal one.  That knows the machine and its present state; of the future only the ramps that
are announced 3 s ahead, and that none may come unannounced that is faster than 50 N/s and 2000
rpm/s: it is ready for all of those.  Clearance alone stands on the unfed film; clearance with
supply pressure on the film with the rig's groove, the pump's power counted.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from firmware_py.errors import OrbitdError
from firmware_py.machine.folder import add_option, find

if TYPE_CHECKING:
    from sim_hil.bound.case import BoundCase, TargetPlan
    from sim_hil.bound.disturbances import RampLimits
    from sim_hil.bound.episodes import episode_references
    from sim_hil.bound.reference import ReferenceRun, References, references
    from sim_hil.bound.study import Entry

__all__ = [
    "DutyFileError",
    "RampLimits",
    "ReferenceRun",
    "References",
    "TargetPlan",
    "episode_references",
    "main",
    "references",
]

KINDS = {"isothermal": False, "thermal": True}
BOARDS = {"clearance": "clearance alone", "pair": "clearance with supply pressure"}

_HOMES = {
    "RampLimits": "disturbances",
    "TargetPlan": "case",
    "ReferenceRun": "reference",
    "References": "reference",
    "episode_references": "episodes",
    "references": "reference",
}


def __getattr__(name: str) -> Any:
    """Import the simulator only when it is asked for."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)


class DutyFileError(OrbitdError):
    """The duty file cannot be read."""

    exit_code = 2


def main(argv: list[str]) -> int:
    """Compute the bound and print it; 1 when no fixed clearance is feasible."""
    parser = argparse.ArgumentParser(prog="orbitd bound", description=__doc__)
    add_option(parser, "shipped rig or rig folder (bench)", find("bench"))
    parser.add_argument(
        "--duty", type=Path, help="duty file; that of the rig's simulation.toml is the default"
    )
    parser.add_argument(
        "--oil", choices=[*KINDS, "both"], default="both", help="whether the film warms the oil"
    )
    parser.add_argument(
        "--board", choices=[*BOARDS, "both"], default="both", help="what may be set"
    )
    parser.add_argument(
        "--quick", action="store_true", help="coarser map: sooner done, schedules less sharp"
    )
    parser.add_argument("--json", action="store_true", help="for programs")
    options = parser.parse_args(argv)
    kinds = [options.oil] if options.oil != "both" else list(KINDS)
    boards = [options.board] if options.board != "both" else list(BOARDS)
    results = _studies(_cases(options.rig, options.duty, kinds, boards), options.quick)
    if options.json:
        print(json.dumps({" ".join(key): _records(entries) for key, entries in results.items()}))
    else:
        from sim_hil.bound.report import show

        show(
            {
                f"{BOARDS[board].capitalize()}, {kind}": entries
                for (board, kind), entries in results.items()
            }
        )
    return (
        0
        if all(
            any(e.name == "best feasible fixed" for e in entries) for entries in results.values()
        )
        else 1
    )


def _cases(
    folder: Path, path: Path | None, kinds: list[str], boards: list[str]
) -> dict[tuple[str, str], BoundCase]:
    """The machine on the duty for each board, with and without warming oil."""
    from sim_hil.bound.case import BoundCase
    from sim_hil.bound.limits import BoundLimits, duty_of
    from sim_hil.plant.duty import Duty
    from sim_hil.rigs import load_rig

    rig = load_rig(folder)
    if path is None:
        duty, limits = Duty.published(rig), BoundLimits.of_rig(rig)
    else:
        table = read_duty(path)
        try:
            duty, limits = duty_of(table), BoundLimits.of(table)
        except (KeyError, TypeError) as error:
            raise DutyFileError(
                f"{path}: {error!r} missing or of the wrong kind; a duty file has start (rpm, "
                "load_N), segments (to_rpm, to_load_N, seconds) and constraints (h_min_um, "
                "clearance_rate_um_s)"
            ) from error
    return {
        (b, k): BoundCase(rig, duty, limits, KINDS[k], fed=b == "pair")
        for b in boards
        for k in kinds
    }


def _studies(
    cases: dict[tuple[str, str], BoundCase], quick: bool
) -> dict[tuple[str, str], list[Entry]]:
    """All cases on all cores, with a line that counts the runs."""
    import os
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    from sim_hil.bound.study import FINE, QUICK, study
    from sim_hil.processes import end_with_parent

    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}: {task.completed:.0f} runs"),
        TimeElapsedColumn(),
    )
    with (
        Progress(*columns, console=Console(stderr=True), transient=True) as shown,
        ProcessPoolExecutor(
            os.cpu_count(), mp_context=get_context("spawn"), initializer=end_with_parent
        ) as pool,
    ):
        results = {}
        for key, case in cases.items():
            line = shown.add_task(", ".join(key), total=None)

            def counted(
                work: Callable[[Any], Any], items: Iterable[Any], /, line: Any = line
            ) -> Iterable[Any]:
                for result in pool.map(work, items):
                    shown.advance(line)
                    yield result

            results[key] = study(case, QUICK if quick else FINE, counted)
    return results


def read_duty(path: Path) -> dict[str, Any]:
    """The duty file.

    Raises
    ------
    DutyFileError
        It cannot be read or is not JSON.
    """
    try:
        table: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise DutyFileError(f"{path}: {error}") from error
    return table


def _records(entries: list[Entry]) -> list[dict[str, Any]]:
    from sim_hil.bound.report import savings

    return [
        asdict(entry) | {"feasible": entry.verdict.feasible, "saving": savings(entry, entries)}
        for entry in entries
    ]
