"""The four figures of one case: nominal, best fixed, best with preview, best without."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim_hil.bound.case import Case, Plan, Verdict
from sim_hil.bound.disturbances import Disturbances, surroundings
from sim_hil.bound.maps import Judge, Map, Mapper, build_map, judged_alone
from sim_hil.bound.reference import Reference, best_causal, best_preview

NOMINAL, FIXED, PREVIEW, CAUSAL = "nominal fixed", "best feasible fixed", "preview schedule", "causal schedule"


@dataclass(frozen=True)
class Entry:
    """A way to run the duty: what it is, its verdict in the time domain, and the settings it uses, m and Pa."""

    name: str
    verdict: Verdict
    clearance_m: tuple[float, float]
    pressure_Pa: tuple[float, float]

    @classmethod
    def of(cls, name: str, found: Reference) -> Entry:
        """From a plan and its verdict."""
        c, p = found.plan.clearance_m, found.plan.pressure_Pa
        return cls(name, found.verdict, (float(c.min()), float(c.max())), (float(p.min()), float(p.max())))


def study(case: Case, spacing_um: int, pressures_Pa: tuple[float, ...], mapper: Mapper = map) -> list[Entry]:
    """Compute and check all four; an entry without a feasible answer is left out."""
    judge = judged_alone(case, mapper)
    found = build_map(case, spacing_um, pressures_Pa, judge)
    nominal = Plan.fixed(case.rig.bearing.clearance_nominal_m, case.rig.supply.nominal_Pa)
    blind = best_causal(case, found, surroundings(case, pressures_Pa, mapper), Disturbances(), judge)
    ways = {
        NOMINAL: Reference(nominal, Verdict.of(judge([nominal])[0])),
        FIXED: best_fixed(found, spacing_um, judge),
        PREVIEW: best_preview(case, found, judge, case.rig.actuator.time_constant_s, blind=blind),
        CAUSAL: blind,
    }
    return [Entry.of(name, way) for name, way in ways.items() if way is not None]


def best_fixed(found: Map, spacing_um: int, judge: Judge) -> Reference | None:
    """Check in time the 1 um grid around the cheapest setting that is admissible throughout the map."""
    power = np.where(found.admissible.all(axis=-1), found.power_W.mean(axis=-1), np.inf)
    level, cell = np.unravel_index(int(power.argmin()), power.shape)
    if not np.isfinite(power[level, cell]):
        return None
    near = found.clearance_m[max(0, int(cell) - spacing_um) : int(cell) + spacing_um + 1]
    plans = [Plan.fixed(c, float(found.pressure_Pa[level])) for c in near.tolist()]
    tried = [Reference(plan, Verdict.of(profile)) for plan, profile in zip(plans, judge(plans), strict=True)]
    feasible = [each for each in tried if each.verdict.feasible]
    return min(feasible, key=lambda each: each.verdict.mean_power_W, default=None)
