"""`orbitd verify`: this project beside closed forms, published tables and the properties a film
must have.

With `--json` one object goes to standard output: `failed`, the number of rows outside their
tolerance, and `rows`, each with `group`, `quantity`, `value` (this project's), `reference`,
`source`, `difference` (value less reference; over the reference where `kind` is `relative`, in the
quantity's unit where it is `absolute`), `tolerance` (of the difference) and `pass`; numbers that
are not finite are null.  The exit code is 1 when a row fails, else 0.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable, Iterator

from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table

from sim_hil.verify.row import ComparisonRow

Group = Callable[[], Iterator[ComparisonRow]]


def groups(quick: bool) -> dict[str, Group]:
    """The groups of rows by title; `quick` leaves out the integrated rotor and the larger
    tables."""
    from sim_hil.verify import (
        closed_forms,
        facts,
        oil,
        pads,
        properties,
        published,
        restrictors,
        rotor,
        turbulence,
    )

    short = {
        "Short bearing": closed_forms.short_bearing,
        "Short bearing forces": closed_forms.short_bearing_forces,
        "Squeeze film and Petroff": closed_forms.squeeze_film,
        "Long bearing": closed_forms.long_bearing,
        "Lightly loaded bearing of any length": closed_forms.light_load,
        "Raimondi and Boyd, stored excerpt": published.raimondi_boyd_excerpt,
        "Scaling and symmetry": properties.scaling,
        "Whirl and dissipation": properties.whirl_and_dissipation,
        "Complementarity": properties.complementarity,
        "Table and direct film": properties.fast_films,
        "Flow balance": properties.flow_balance,
        "Fed film": oil.feeds,
        "Hydrostatic rows and pockets": restrictors.hydrostatic,
        "Feeds behind restrictors": restrictors.restricted,
        "Fixed pads": pads.pads,
        "Turbulent film": turbulence.turbulent,
        "Rigid-rotor modes": rotor.rigid_modes,
        "Facts of the rig bench": facts.bench,
        "Facts of the rig seed": facts.seed,
        "Duty and sensors": facts.duty_and_sensors,
    }
    if quick:
        return short
    return short | {
        "Raimondi and Boyd": published.raimondi_boyd,
        "Bearing with two axial grooves": published.two_axial_grooves,
        "Bearing with two lobes": pads.two_lobes,
        "Grid convergence": properties.grid_convergence,
        "Tabulated fed film": oil.fed_table,
        "Tabulated film with feed ports": restrictors.port_table,
        "Warm oil": oil.warm_oil,
        "Rotor on springs": rotor.linear_rotor,
        "Step halving": rotor.step_halving,
        "Whirl": rotor.whirl_onset,
    }


def main(argv: list[str]) -> int:
    """Print the table; 1 when a row is outside its tolerance."""
    what, _, report = str(__doc__).partition("\n\n")
    parser = argparse.ArgumentParser(prog="orbitd verify", description=what, epilog=report)
    parser.add_argument(
        "--quick", action="store_true", help="without the integrated rotor and the larger tables"
    )
    parser.add_argument("--json", action="store_true", help="for programs")
    options = parser.parse_args(argv)
    results = {title: list(group()) for title, group in groups(options.quick).items()}
    rows = [row for group in results.values() for row in group]
    failed = sum(row.passed is False for row in rows)
    if options.json:
        print(
            json.dumps(
                {"rows": [_record(t, r) for t, g in results.items() for r in g], "failed": failed}
            )
        )
    else:
        _print(results)
        judged = sum(row.passed is not None for row in rows)
        print(f"{judged - failed} of {judged} within tolerance, {len(rows) - judged} shown only")
    return 1 if failed else 0


def _record(title: str, row: ComparisonRow) -> dict[str, object]:
    numbers = {"value": row.value, "reference": row.reference, "difference": row.difference}
    finite = {name: x if math.isfinite(x) else None for name, x in numbers.items()}
    kind = "absolute" if row.absolute else "relative"
    return {
        "group": title,
        "quantity": row.quantity,
        **finite,
        "source": row.source,
        "tolerance": row.tolerance,
        "kind": kind,
        "pass": row.passed,
    }


def _print(results: dict[str, list[ComparisonRow]]) -> None:
    """The groups as tables; sources stand below, where they may be long."""
    console = Console(width=None if Console().is_terminal else 100)
    for title, rows in results.items():
        table = Table(
            title=title, title_justify="left", box=SIMPLE, pad_edge=False, padding=(0, 1, 0, 0)
        )
        table.add_column("quantity", overflow="fold", ratio=1)
        for name in ("this project", "reference", "difference", "tolerance", "pass", "src"):
            table.add_column(name, justify="right", no_wrap=True)
        sources = list(dict.fromkeys(row.source for row in rows))
        for row in rows:
            value, reference, letter = (
                f"{row.value:.6g}",
                f"{row.reference:.6g}",
                _letter(sources.index(row.source)),
            )
            table.add_row(row.quantity, value, reference, *_judgement(row), letter)
        console.print(table)
        for i, source in enumerate(sources):
            console.print(f" {_letter(i)}  {source}", markup=False, highlight=False)
        console.print()


def _letter(i: int) -> str:
    return chr(ord("a") + i)


def _judgement(row: ComparisonRow) -> tuple[str, str, str]:
    def amount(x: float) -> str:
        return f"{x:.3g}" if row.absolute else f"{100 * x:.3g} %"

    if row.tolerance is None:
        return amount(row.difference), "-", "-"
    return amount(row.difference), amount(row.tolerance), "yes" if row.passed else "NO"
