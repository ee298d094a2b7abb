"""The four figures of one case: nominal, best fixed, best with preview, best without."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim_hil.bound.case import BoundCase, LimitVerdict, TargetPlan
from sim_hil.bound.disturbances import RampLimits, surroundings
from sim_hil.bound.maps import Judge, Map, Mapper, build_map, judged_alone
from sim_hil.bound.reference import ReferenceRun, best_causal, best_preview
from sim_hil.bound.schedules import cell_of

FINE, QUICK = (4, 12), (10, 20)
"""A map runs clearances every so many um: on the unfed film, and at each supply pressure."""
PRESSURE_SHARES = (0.0, 0.1, 0.2, 0.4, 1.0)
"""Supply pressures that are tried, over the rig's range."""

NOMINAL, FIXED, PREVIEW, CAUSAL = (
    "nominal fixed",
    "best feasible fixed",
    "preview schedule",
    "causal schedule",
)


@dataclass(frozen=True)
class Entry:
    """A way to run the duty: what it is, its verdict in the time domain, and the settings it uses,
    m and Pa."""

    name: str
    verdict: LimitVerdict
    clearance_m: tuple[float, float]
    pressure_Pa: tuple[float, float]

    @classmethod
    def of(cls, name: str, found: ReferenceRun) -> Entry:
        """From a plan and its verdict."""
        c, p = found.plan.clearance_m, found.plan.pressure_Pa
        return cls(
            name, found.verdict, (float(c.min()), float(c.max())), (float(p.min()), float(p.max()))
        )


def pressures(case: BoundCase) -> tuple[float, ...]:
    """Supply pressures to choose from, Pa: the nominal one where the film is not fed."""
    supply = case.rig.supply
    if not case.fed:
        return (supply.nominal_Pa,)
    return tuple(
        supply.min_Pa + share * (supply.max_Pa - supply.min_Pa) for share in PRESSURE_SHARES
    )


def study(
    case: BoundCase, spacings_um: tuple[int, int] = FINE, mapper: Mapper = map
) -> list[Entry]:
    """Compute and check all four; an entry without a feasible answer is left out."""
    judge, levels_Pa = judged_alone(case, mapper), pressures(case)
    found = build_map(
        case.coarse, spacings_um[case.fed], levels_Pa, judged_alone(case.coarse, mapper)
    )
    nominal = TargetPlan.fixed(case.rig.bearing.clearance_nominal_m, case.rig.supply.nominal_Pa)
    around = surroundings(case, tuple(dict.fromkeys((levels_Pa[0], levels_Pa[-1]))), mapper)
    blind = best_causal(case, found, around, RampLimits.of_rig(case.rig), judge)
    ways = {
        NOMINAL: ReferenceRun(nominal, LimitVerdict.of(judge([nominal])[0])),
        FIXED: best_fixed(found, judge),
        PREVIEW: best_preview(case, found, judge, case.rig.actuator.time_constant_s, blind=blind),
        CAUSAL: blind,
    }
    return [Entry.of(name, way) for name, way in ways.items() if way is not None]


def best_fixed(found: Map, judge: Judge) -> ReferenceRun | None:
    """The cheapest setting that keeps the limits in time, on a grid of 1 um around the map's
    best."""
    power = np.where(found.admissible.all(axis=-1), found.power_W.mean(axis=-1), np.inf)
    level, cell = (int(i) for i in np.unravel_index(int(power.argmin()), power.shape))
    if not np.isfinite(power[level, cell]):
        return None
    best = None
    for step in (4, 1):
        near = range(
            max(0, cell - 3 * step), min(found.clearance_m.size, cell + 3 * step + 1), step
        )
        plans = [
            TargetPlan.fixed(float(found.clearance_m[i]), float(found.pressure_Pa[level]))
            for i in near
        ]
        tried = [
            ReferenceRun(plan, LimitVerdict.of(profile))
            for plan, profile in zip(plans, judge(plans), strict=True)
        ]
        feasible = [each for each in tried if each.verdict.feasible]
        best = min(feasible, key=lambda each: each.verdict.mean_power_W, default=None)
        cell = cell_of(found, float(best.plan.clearance_m[0])) if best else cell
    return best
