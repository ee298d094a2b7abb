"""The four figures of one case: nominal, best fixed, best with preview, best without."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from sim_hil.bound.fixed import Case, Map, build_map, in_parallel
from sim_hil.bound.limits import Verdict
from sim_hil.bound.schedules import NoSchedule, Plan, best_causal, preview
from sim_hil.response import Schedule

MARGINS_UM = (0, 1, 2, 3, 4, 6, 8)
_TRIED = 3


@dataclass(frozen=True)
class Entry:
    """A way to run the duty: what it is, its verdict in the time domain, and the clearances it uses, m."""

    name: str
    how: str
    verdict: Verdict
    lowest_m: float
    highest_m: float


def study(case: Case, spacing_um: int = 4) -> list[Entry]:
    """Compute and check all four; an entry without a feasible answer is left out."""
    found = build_map(case, spacing_um)
    nominal = case.rig.bearing.clearance_nominal_m
    entries = [Entry("nominal fixed", _at(nominal), case.judged(nominal), nominal, nominal)]
    entries += _best_fixed(case, found, spacing_um)
    rate, lag = min(case.limits.rate_m_s, case.rig.actuator.rate_m_per_s), case.rig.actuator.time_constant_s
    entries += _first_feasible(case, "preview schedule", _previews(found, rate, lag))
    plans = ((m, plan) for m in MARGINS_UM for plan in best_causal(found, m, rate)[:_TRIED])
    entries += _first_feasible(case, "causal schedule", plans)
    return entries


def _at(clearance_m: float) -> str:
    return f"{clearance_m * 1e6:.0f} um"


def _best_fixed(case: Case, found: Map, spacing_um: int) -> list[Entry]:
    """Check in time the 1 um grid around the cheapest clearance that is admissible throughout the map."""
    throughout = found.admissible.all(axis=1)
    power = np.where(throughout, found.power_W.mean(axis=1), np.inf)
    if not throughout.any():
        return []
    best = int(power.argmin())
    near = [float(c) for c in found.clearance_m[max(0, best - spacing_um) : best + spacing_um + 1]]
    verdicts = in_parallel(case.judged, near)
    feasible = [(v.mean_power_W, c, v) for c, v in zip(near, verdicts, strict=True) if v.feasible]
    if not feasible:
        return []
    _, clearance, verdict = min(feasible, key=lambda each: each[0])
    return [Entry("best feasible fixed", _at(clearance), verdict, clearance, clearance)]


def _previews(found: Map, rate_m_s: float, lead_s: float) -> Iterable[tuple[int, Plan]]:
    for margin in MARGINS_UM:
        try:
            yield margin, preview(found, margin, rate_m_s, lead_s)
        except NoSchedule:
            return


def _first_feasible(case: Case, name: str, plans: Iterable[tuple[int, Plan]]) -> list[Entry]:
    """The plan of the smallest margin that keeps the limits in time."""
    for margin, plan in plans:
        schedule: Schedule = plan
        verdict = case.judged(schedule)
        if verdict.feasible:
            low, high = float(plan.clearance_m.min()), float(plan.clearance_m.max())
            how = f"{low * 1e6:.0f} to {high * 1e6:.0f} um, margin {margin} um"
            return [Entry(name, how, verdict, low, high)]
    return []
