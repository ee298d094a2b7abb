"""The two references of a duty: the best schedule with full preview, and the best without."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_dilation

from sim_hil.bound.case import BoundCase, LimitVerdict, TargetPlan
from sim_hil.bound.disturbances import (
    SPACING_UM,
    AdmissibleRanges,
    RampLimits,
    in_sight,
    surroundings,
)
from sim_hil.bound.limits import BoundLimits
from sim_hil.bound.maps import Judge, Map, Mapper, build_map, judged_alone
from sim_hil.bound.schedules import NoSchedule, causal, preview
from sim_hil.plant.build import Build
from sim_hil.plant.duty import RAD_S_PER_RPM, Duty
from sim_hil.rigs import RigData

MOST_UM = 12
"""Margins beyond this are not tried."""
_AROUND_BINS = 4


@dataclass(frozen=True)
class ReferenceRun:
    """A schedule and what it came to in the time domain."""

    plan: TargetPlan
    verdict: LimitVerdict


@dataclass(frozen=True)
class References:
    """What any control of a duty is measured against; a reference that keeps no limit is None.

    `map` holds power and margins of every fixed setting over the duty's bins.
    """

    map: Map
    preview: ReferenceRun | None
    causal: ReferenceRun | None


def references(
    rig: RigData,
    duty: Duty,
    *,
    build: Build | None = None,
    thermal: bool = True,
    inlet_C: float | None = None,
    seconds: float | None = None,
    start_m: float | None = None,
    limits: BoundLimits | None = None,
    expected: RampLimits | None = None,
    spacing_um: int = 8,
    mapper: Mapper = map,
    judge: Judge | None = None,
    held_s: float = 0.0,
    pressures_Pa: tuple[float, ...] | None = None,
) -> References:
    """Preview and causal reference of any duty of any build, each feasible in the time domain.

    *Preview* is dynamic programming over the map of fixed clearances with the whole duty known and
    the actuator's rate kept; where a plan breaks a limit in the time domain it keeps 1 um more and
    is made again.  *Causal* knows the machine, its present speed, load and oil, the ramps of
    `expected` that are announced, and of the rest only how fast it may change: it holds the
    cheapest clearance from which the actuator can stay admissible through any unannounced ramp over
    the rig's whole range of speed and load; its margin to the limits is the smallest with which it
    breaks none in the time domain.

    Some 15 s on one core for half a minute of duty; runs are kept in the user's cache, so the same
    question costs next to nothing the second time.  Call it in several processes for several
    episodes.

    Parameters
    ----------
    duty, seconds
        Speed and load, and how long the episode takes; to the duty's end when None.
    build, thermal, inlet_C
        The example of the rig (the drawing when None), whether the film warms the oil, oil inlet,
        Celsius.
    start_m
        Clearance at the start, m; freely chosen by each reference when None.
    limits
        Those of the published duty when None.
    expected
        The declared set of disturbances, for the causal reference.
    spacing_um
        Clearances of the map that are run; between them it is interpolated to 1 um.
    mapper
        A pool's `map`, for several cores.
    judge
        Runs plans, fixed ones and schedules, in the caller's own simulation
        (`TargetPlan.clearance(time_s)` is the target, m) and gives their profiles; the rotor alone
        on the table film, at least 50 samples a turn, when None. Compare watts only within one
        simulation: `sim_hil.bound.episode_references` does so for the environments.
    held_s
        How long that simulation holds a target; preview reads its plan that much further ahead.
    pressures_Pa
        Supply pressures to choose from, on the film that is fed from the groove, the pump's power
        counted; None: clearance alone, on the unfed film.

    Returns
    -------
    References
        `preview.plan.clearance(time_s)`, `preview.verdict.mean_power_W`, ...; None where no plan
        keeps the limits: such an episode is not to be counted.
    """
    limits = BoundLimits.of_rig(rig) if limits is None else limits
    fed, levels_Pa = pressures_Pa is not None, pressures_Pa or (rig.supply.nominal_Pa,)
    case = BoundCase(
        rig, duty if seconds is None else cut(duty, seconds), limits, thermal, build, inlet_C, fed
    )
    found = build_map(case, spacing_um, levels_Pa, judge or judged_alone(case.coarse, mapper))
    judge = judge or judged_alone(case, mapper)
    ends_Pa = tuple(dict.fromkeys((levels_Pa[0], levels_Pa[-1])))
    around = surroundings(case, ends_Pa, mapper, SPACING_UM * len(ends_Pa))
    blind = best_causal(case, found, around, expected or RampLimits.of_rig(rig), judge, start_m)
    lead_s = rig.actuator.time_constant_s + held_s
    return References(found, best_preview(case, found, judge, lead_s, start_m, blind), blind)


def cut(duty: Duty, seconds: float) -> Duty:
    """The first `seconds` of a duty."""
    speed, load = duty.point(seconds)
    kept = [i for i, t in enumerate(duty.time_s) if t < seconds]
    return Duty(
        (*(duty.time_s[i] for i in kept), seconds),
        (*(duty.speed_rpm[i] for i in kept), speed / RAD_S_PER_RPM),
        (*(duty.load_N[i] for i in kept), load),
    )


def rate_of(case: BoundCase) -> float:
    """Rate of the clearance, m/s, that limits and actuator both allow."""
    return min(case.limits.rate_m_s, case.rig.actuator.rate_m_per_s)


def best_preview(
    case: BoundCase,
    found: Map,
    judge: Judge,
    lead_s: float,
    start_m: float | None = None,
    blind: ReferenceRun | None = None,
) -> ReferenceRun | None:
    """The cheapest path that keeps the limits in time, or the causal one `blind` if that is cheaper
    still.

    A map of fixed settings does not know what moving does: where a run breaks a limit, the path
    keeps more distance.
    """
    margin, best = np.zeros(found.power_W.shape[-1], dtype=np.int64), blind
    with suppress(NoSchedule):
        while margin.max() <= MOST_UM:
            plan = preview(found, margin, rate_of(case), lead_s, start_m)
            (profile,) = judge([plan])
            way = ReferenceRun(plan, LimitVerdict.of(profile))
            if way.verdict.feasible:
                cheaper = best is None or way.verdict.mean_power_W < best.verdict.mean_power_W
                return way if cheaper else best
            margin += binary_dilation(profile.violation_s > 0, np.ones(2 * _AROUND_BINS + 1))
    return best


def best_causal(
    case: BoundCase,
    found: Map,
    around: AdmissibleRanges,
    expected: RampLimits,
    judge: Judge,
    start_m: float | None = None,
) -> ReferenceRun | None:
    """The causal path of the smallest margin that keeps the limits in time."""
    ready = around.ready(case, expected, rate_of(case), found.clearance_m.size)
    ramps = in_sight(found, expected, case.duty)
    for margin in range(MOST_UM + 1):
        with suppress(NoSchedule):
            plan = causal(found, margin, ready, ramps, rate_of(case), start_m)
            (profile,) = judge([plan])
            way = ReferenceRun(plan, LimitVerdict.of(profile))
            if way.verdict.feasible:
                return way
    return None
