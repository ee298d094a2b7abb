"""The four figures of one case: nominal, best fixed, best with preview, best without."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from itertools import product

import numpy as np

from sim_hil.bound.fixed import Case, Map, build_map, in_parallel
from sim_hil.bound.limits import Verdict
from sim_hil.bound.schedules import NoSchedule, Plan, best_causal, preview

MARGINS_UM = (1, 2, 4, 8)
MARGIN_BINS = (2, 4, 8)
_TRIED = 1


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
    plans = [plan for m, b in product(MARGINS_UM, MARGIN_BINS) for plan in best_causal(found, m, b, rate)[:_TRIED]]
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


def _previews(found: Map, rate_m_s: float, lead_s: float) -> list[Plan]:
    """Cheapest paths at several distances from what is not admissible."""
    plans = []
    for margin, bins in product(MARGINS_UM, MARGIN_BINS):
        with suppress(NoSchedule):
            plans.append(preview(found, margin, bins, rate_m_s, lead_s))
    return plans


def _first_feasible(case: Case, name: str, plans: list[Plan]) -> list[Entry]:
    """The cheapest plan that keeps the limits in time: a map of fixed clearances does not know what moving does."""
    for plan in sorted(plans, key=lambda each: each.power_W):
        verdict = case.judged(plan)
        if verdict.feasible:
            low, high = float(plan.clearance_m.min()), float(plan.clearance_m.max())
            return [Entry(name, f"{low * 1e6:.0f} to {high * 1e6:.0f} um", verdict, low, high)]
    return []
