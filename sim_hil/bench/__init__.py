"""`orbitd bench sim`: speed of the simulator, as ratios to a reference kernel timed in the same
run."""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Final

REFERENCE_CALLS: Final = 2000
SPEEDS_RPM: Final = (3000, 10000)
ORBIT_ERROR: Final = 5e-3
POWER_ERROR: Final = 1e-2
WHIRL_CLEARANCE_M: Final = 160e-6
ROTOR_CALLS: Final = 700.0
RIG_CALLS: Final = 4000.0
"""A simulated second costs at most so many calls of the reference kernel."""
RIG_SECONDS: Final = 0.5
RIG_FACTOR: Final = 30.0
"""Own bar: the whole rig, with its eight sensors, so many times faster than real time."""
HIL_SECONDS: Final = 10.0
HIL_MISSED: Final = 0.01
HIL_CPU: Final = 0.5
"""Own bars: the rig misses one period of 1 ms in a hundred more than an empty loop, and leaves half
a core free."""


@dataclass(frozen=True)
class Figure:
    """One measured figure; `limit` is the least (`at_least`) or the largest that is wanted, None to
    show only."""

    name: str
    value: float
    unit: str
    limit: float | None = None
    at_least: bool = False

    @property
    def passed(self) -> bool | None:
        """None when not judged."""
        if self.limit is None:
            return None
        return self.value >= self.limit if self.at_least else self.value <= self.limit


def main(argv: list[str]) -> int:
    """Measure and print; 1 when a figure misses its target."""
    parser = argparse.ArgumentParser(prog="orbitd bench", description=__doc__)
    parser.add_argument("what", choices=["sim"], help="what to measure: the simulator")
    parser.add_argument(
        "--quick", action="store_true", help="without many rotors, HIL loop and start times"
    )
    parser.add_argument("--json", action="store_true", help="for programs")
    options = parser.parse_args(argv)
    figures = [*film_figures(), *rotor_figures(), *whirl_figures(), *rig_figures()]
    if not options.quick:
        figures += [*many_figures(), *hil_figures(), *start_figures()]
    missed = [figure.name for figure in figures if figure.passed is False]
    if options.json:
        print(
            json.dumps(
                {"figures": [asdict(f) | {"pass": f.passed} for f in figures], "missed": missed}
            )
        )
    else:
        _print(figures)
    return 1 if missed else 0


def film_figures() -> Iterator[Figure]:
    """Reference kernel, direct film and table film, each call on its own."""
    from sim_hil.bench.film import film_timings

    timings = film_timings(REFERENCE_CALLS)
    yield Figure(
        "reference: cyclic tridiagonal, 64 nodes x 4", timings["reference"].seconds * 1e6, "us"
    )
    for name, limit in (("direct", 10.0), ("table", None)):
        yield Figure(f"{name} film force", timings[name].seconds * 1e6, "us")
        yield Figure(f"{name} film force over reference", timings[name].ratio, "", limit)


def rotor_figures() -> Iterator[Figure]:
    """One rotor on the direct and on the table film: real-time factor on the processor's clock, and
    orbit error."""
    from sim_hil.bench.film import repeat_of_reference
    from sim_hil.bench.rotors import orbit
    from sim_hil.bench.timing import beside

    reference = repeat_of_reference(REFERENCE_CALLS)
    cases = (("direct", 0.05, 5.0, None), ("table", 0.5, 60.0, ROTOR_CALLS))
    for force, seconds, wanted, calls in cases:
        for rpm in SPEEDS_RPM:
            one = orbit(force, rpm)
            timing = beside(reference, one.run(seconds), (REFERENCE_CALLS, 1))
            case = f"one rotor, {force}, {rpm} rpm:"
            yield Figure(f"{case} real-time factor", seconds / timing.seconds, "x", wanted, True)
            yield Figure(
                f"{case} simulated second over reference", timing.ratio / seconds, "", calls
            )
            yield Figure(f"{case} orbit error", one.error(), "of the orbit", ORBIT_ERROR)


def whirl_figures() -> Iterator[Figure]:
    """Whirl that fills the clearance, at 60 steps a turn: cost, and errors against an eighth of the
    step."""
    from sim_hil.bench.film import repeat_of_reference
    from sim_hil.bench.rotors import WHIRL_RPM, WHIRL_STEP_S, whirl, whirling
    from sim_hil.bench.timing import beside

    case = f"whirl in {WHIRL_CLEARANCE_M * 1e6:g} um, table, {WHIRL_RPM:g} rpm:"
    seconds = 0.5
    one = whirling(WHIRL_CLEARANCE_M).run(seconds, step_s=WHIRL_STEP_S)
    timing = beside(repeat_of_reference(REFERENCE_CALLS), one, (REFERENCE_CALLS, 1))
    yield Figure(f"{case} simulated second over reference", timing.ratio / seconds, "")
    coarse, fine = (whirl(WHIRL_CLEARANCE_M, WHIRL_STEP_S / cut) for cut in (1, 8))
    radius, power = coarse.radius_m / fine.radius_m, coarse.power_W / fine.power_W
    yield Figure(f"{case} orbit error", abs(radius - 1), "of the orbit", ORBIT_ERROR)
    yield Figure(f"{case} error of the mean power", abs(power - 1), "of the power", POWER_ERROR)


def rig_figures() -> Iterator[Figure]:
    """The machine with pedestal, motor, joints and sensors: what recordings and the HIL loop
    cost."""
    from sim_hil.bench.film import repeat_of_reference
    from sim_hil.bench.rotors import whole_rig
    from sim_hil.bench.timing import beside

    timing = beside(
        repeat_of_reference(REFERENCE_CALLS), whole_rig(RIG_SECONDS), (REFERENCE_CALLS, 1)
    )
    yield Figure(
        "whole rig, 5 kHz: real-time factor", RIG_SECONDS / timing.seconds, "x", RIG_FACTOR, True
    )
    yield Figure(
        "whole rig, 5 kHz: simulated second over reference",
        timing.ratio / RIG_SECONDS,
        "",
        RIG_CALLS,
    )


def many_figures() -> Iterator[Figure]:
    """Many table rotors at once: their gain from threads beside the reference's, and training
    beside one alone.

    What many rotors share is Python and the call; the kernel takes them one after another.
    """
    from sim_hil.bench.rotors import environment_steps, kernel_share, speed_ups

    threads = os.cpu_count() or 1
    if threads > 1:
        reference, rotors = speed_ups(32, threads, 0.1)
        yield Figure(f"reference: {threads} threads over one", reference, "x")
        yield Figure(f"32 rotors: {threads} threads over one", rotors, "x")
        yield Figure(
            "32 rotors: gain from threads over the reference's", rotors / reference, "", 0.9, True
        )
    step, share = environment_steps(32)
    yield Figure("training, 32 rotors: environment steps a second", 1 / step.seconds, "1/s")
    yield Figure("training, 32 rotors: one step over reference", step.ratio, "")
    yield Figure(
        "training, 32 rotors: one step over that of one alone in its environment", share, "", 1.0
    )
    yield Figure("training, 32 rotors: the same, compiled kernel alone", kernel_share(32), "")


def hil_figures() -> Iterator[Figure]:
    """The real-time loop of the rig beside an empty loop; both share the machine with whatever runs
    there."""
    from sim_hil.bench.hil import RATE_HZ, rig_beside_empty

    found = rig_beside_empty(HIL_SECONDS)
    rig, empty = found["rig"], found["empty"]
    for name, unit in (
        ("late_p50_us", "us"),
        ("late_p99_us", "us"),
        ("late_max_us", "us"),
        ("missed_share", ""),
    ):
        what = name.removesuffix("_us").replace("_", " ")
        yield Figure(f"HIL {RATE_HZ // 1000} kHz, rig loop: {what}", rig[name], unit)
        yield Figure(f"HIL {RATE_HZ // 1000} kHz, empty loop: {what}", empty[name], unit)
    beyond = rig["missed_share"] - empty["missed_share"]
    yield Figure("HIL: periods missed beyond the empty loop's", beyond, "of all", HIL_MISSED)
    yield Figure("HIL: processor share of the rig", rig["cpu_share"], "of a core", HIL_CPU)


def start_figures() -> Iterator[Figure]:
    """Cold and warm start."""
    from sim_hil.bench.start import start_times

    for name, value in start_times().items():
        yield Figure(name.removesuffix("_s").replace("_", " "), value, "s")


def _print(figures: list[Figure]) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(
        title="Speed of the simulator (medians; processor time of one thread)", show_edge=False
    )
    for name in ("figure", "value", "unit", "wanted", "met"):
        table.add_column(
            name, justify="left" if name in ("figure", "unit") else "right", overflow="fold"
        )
    for f in figures:
        wanted = "-" if f.limit is None else f"{'>=' if f.at_least else '<='} {f.limit:g}"
        table.add_row(
            f.name,
            f"{f.value:.4g}",
            f.unit,
            wanted,
            {None: "-", True: "yes", False: "NO"}[f.passed],
        )
    Console(width=None if Console().is_terminal else 130).print(table)
