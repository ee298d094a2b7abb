"""`orbitd bound`: how much power any control of the clearance could save on a duty.

Four ways, each checked in the time domain against every limit: the nominal fixed clearance, the best feasible fixed
one (1 um grid), the best schedule with full preview, and the best of one causal family (knows the set points of the
ramp it is on, not when the next one begins; follows the cheapest clearance that weathers it, never above a cap).
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from firmware_py.errors import OrbitdError

if TYPE_CHECKING:
    from sim_hil.bound.study import Entry
    from sim_hil.rigs import RigData

BASELINES = ("nominal fixed", "best feasible fixed")
KINDS = {"isothermal": False, "thermal": True}


class DutyFileError(OrbitdError):
    """The duty file cannot be read."""

    exit_code = 2


def main(argv: list[str]) -> int:
    """Compute the bound and print it; 1 when no fixed clearance is feasible."""
    from sim_hil.bound.fixed import Case
    from sim_hil.bound.limits import Limits, duty_of
    from sim_hil.bound.study import study
    from sim_hil.rigs import load_rig

    parser = argparse.ArgumentParser(prog="orbitd bound", description=__doc__)
    parser.add_argument("--duty", type=Path, help="duty file like the published one (default)")
    parser.add_argument("--oil", choices=[*KINDS, "both"], default="both", help="whether the film warms the oil")
    parser.add_argument("--json", action="store_true", help="for programs")
    options = parser.parse_args(argv)
    table = read_duty(options.duty)
    rig = load_rig("bench")
    try:
        duty, limits = duty_of(table), Limits.of(table)
    except (KeyError, TypeError) as error:
        raise DutyFileError(f"{options.duty}: {error!r} missing or of the wrong kind; see duty_bench.json") from error
    kinds = [options.oil] if options.oil != "both" else list(KINDS)
    results = {kind: study(Case(rig, duty, limits, KINDS[kind])) for kind in kinds}
    if options.json:
        print(json.dumps({kind: _records(rig, entries) for kind, entries in results.items()}))
    else:
        _print(rig, results)
    return 0 if all(any(e.name == "best feasible fixed" for e in entries) for entries in results.values()) else 1


def read_duty(path: Path | None) -> dict[str, Any]:
    """The duty file, or the published duty.

    Raises
    ------
    DutyFileError
        It cannot be read or is not JSON.
    """
    from sim_hil.rigs import read_json

    if path is None:
        return read_json("duty_bench.json")
    try:
        table: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise DutyFileError(f"{path}: {error}") from error
    return table


def pump_power_W(rig: RigData, pressure_Pa: float) -> float:
    """Power to feed the jacket flow at a supply pressure, W."""
    return pressure_Pa * rig.thermal.jacket_flow_m3_s / rig.supply.pump_efficiency


def _records(rig: RigData, entries: list[Entry]) -> dict[str, Any]:
    records = [asdict(entry) | {"saving": _savings(entry, entries)} for entry in entries]
    return {"clearance_alone": records, "with_pressure": _with_pressure(rig, entries)}


def _savings(entry: Entry, entries: list[Entry]) -> dict[str, float]:
    """Share of power saved against each baseline."""
    return {
        base.name: 1 - entry.verdict.mean_power_W / base.verdict.mean_power_W
        for base in entries
        if base.name in BASELINES
    }


def _with_pressure(rig: RigData, entries: list[Entry]) -> list[dict[str, Any]]:
    """Clearance with supply pressure, pump power counted.

    The film of this plant takes no load from its supply: above half the lowest pressure that may be set, pressure
    costs pump power and gives nothing, so every best pair holds the lowest pressure.
    """
    supply = rig.supply
    pairs = []
    for entry in entries:
        pressure = supply.nominal_Pa if entry.name == "nominal fixed" else supply.min_Pa
        total = entry.verdict.mean_power_W + pump_power_W(rig, pressure)
        pairs.append({"name": entry.name, "how": entry.how, "pressure_Pa": pressure, "total_power_W": total})
    return pairs


def _print(rig: RigData, results: dict[str, list[Entry]]) -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console(width=None if Console().is_terminal else 150)
    for kind, entries in results.items():
        table = Table(title=f"Clearance alone, {kind}", title_justify="left", show_edge=False)
        for name in ("way", "clearance", "mean power", "film >=", "orbit <=", "limits", "vs nominal", "vs best fixed"):
            table.add_column(name, justify="left" if name in ("way", "clearance") else "right")
        for entry in entries:
            v, saving = entry.verdict, _savings(entry, entries)
            changes = [f"{-100 * saving[b]:+.2f} %" if b in saving else "-" for b in BASELINES]
            table.add_row(
                entry.name, entry.how, f"{v.mean_power_W:.2f} W", f"{v.min_film_m * 1e6:.2f} um",
                f"{100 * v.orbit_share:.1f} % c", "kept" if v.feasible else "BROKEN",
                *changes,
            )  # fmt: skip
        console.print(table)
        pairs = ", ".join(f"{p['name']} {p['total_power_W']:.1f} W" for p in _with_pressure(rig, entries))
        console.print(f"with supply pressure and pump power (best pressure is always the lowest): {pairs}\n")
