"""Schedules of the clearance over the bins of a map: with full preview, and without."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_dilation, binary_erosion

from sim_hil.bound.fixed import BIN_S, Map
from sim_hil.rotor.parameters import Floats


class NoSchedule(Exception):
    """No path keeps the limits at the rate of the actuator."""


@dataclass(frozen=True)
class Plan:
    """Clearance at the start of each bin, m, and the map's mean power of it, W; `lead_s` shifts it ahead."""

    clearance_m: Floats
    power_W: float
    lead_s: float

    def __call__(self, time_s: float) -> float:
        """Target at a time."""
        return float(np.interp((time_s + self.lead_s) / BIN_S, np.arange(self.clearance_m.size), self.clearance_m))


def narrowed(admissible: np.ndarray, margin: int, bins: int) -> np.ndarray:
    """Admissible cells that keep `margin` um and `bins` bins away from those that are not."""
    inside = np.pad(admissible, ((0, 0), (bins, bins)), mode="edge")
    around = np.ones((2 * margin + 1, 2 * bins + 1), dtype=np.bool_)
    shrunk = binary_erosion(inside, around, border_value=1)[:, bins : inside.shape[1] - bins]
    return np.asarray(shrunk)


def preview(found: Map, margin: int, bins: int, rate_m_s: float, lead_s: float) -> Plan:
    """Cheapest path through the admissible cells at the rate of the actuator: dynamic programming.

    Raises
    ------
    NoSchedule
        There is none.
    """
    allowed = narrowed(found.admissible, margin, bins)
    reach = _reach(rate_m_s)
    cells, count = allowed.shape
    cost = np.where(allowed[:, -1], found.power_W[:, -1], np.inf)
    choice = np.zeros((cells, count), dtype=np.int64)
    offsets = np.arange(-reach, reach + 1)
    for k in range(count - 2, -1, -1):
        padded = np.pad(cost, reach, constant_values=np.inf)
        options = np.stack([padded[reach + o : reach + o + cells] for o in offsets])
        best = options.argmin(axis=0)
        choice[:, k] = offsets[best]
        cost = np.where(allowed[:, k], found.power_W[:, k] + options[best, np.arange(cells)], np.inf)
    if not np.isfinite(cost).any():
        raise NoSchedule(f"no path keeps a margin of {margin} um at {rate_m_s * 1e6:g} um/s")
    path = [int(cost.argmin())]
    for k in range(count - 1):
        path.append(path[-1] + int(choice[path[-1], k]))
    return _plan(found, np.array(path), lead_s)


def causal(found: Map, margin: int, bins: int, cap: int, rate_m_s: float) -> Plan:
    """Follow the cheapest clearance that is viable now, but never above cell `cap`, at the rate of the actuator.

    All that is known of the future is the ramp that the machine is on, with the set points at its end: a clearance is
    viable if the actuator can stay admissible through that stage. When the next ramp begins, and where to, is unknown,
    and each bin's target comes from the bin before.

    Raises
    ------
    NoSchedule
        The path leaves the admissible cells.
    """
    reach = _reach(rate_m_s)
    starts = np.flatnonzero(np.diff(found.stage)) + 1
    parts = np.split(found.admissible, starts, axis=1)
    below = np.concatenate([viable(narrowed(part, margin, bins), reach) for part in parts], axis=1)
    below[cap + 1 :] = False
    count = below.shape[1]
    cheapest = np.where(below, found.power_W, np.inf).argmin(axis=0)
    path = [int(cheapest[0])]
    for k in range(1, count):
        wanted = int(cheapest[k - 1]) if below[:, k - 1].any() else path[-1]
        path.append(path[-1] + int(np.clip(wanted - path[-1], -reach, reach)))
    if not found.admissible[path, np.arange(count)].all():
        raise NoSchedule(f"following without preview below {found.clearance_m[cap] * 1e6:.0f} um leaves the limits")
    return _plan(found, np.array(path), 0.0)


def viable(allowed: np.ndarray, reach: int) -> np.ndarray:
    """Allowed cells from which a path of at most `reach` cells a bin stays allowed to the end."""
    kept = allowed.copy()
    for k in range(allowed.shape[1] - 2, -1, -1):
        kept[:, k] &= binary_dilation(kept[:, k + 1], np.ones(2 * reach + 1, dtype=np.bool_))
    return kept


def best_causal(found: Map, margin: int, bins: int, rate_m_s: float) -> list[Plan]:
    """Causal plans of every cap that keep the limits on the map, cheapest first."""
    plans = []
    for cap in range(found.clearance_m.size):
        with suppress(NoSchedule):
            plans.append(causal(found, margin, bins, cap, rate_m_s))
    return sorted(plans, key=lambda plan: plan.power_W)


def _reach(rate_m_s: float) -> int:
    """Cells of 1 um that the actuator moves in a bin."""
    return int(rate_m_s * BIN_S * 1e6 + 1e-9)


def _plan(found: Map, path: np.ndarray, lead_s: float) -> Plan:
    power = found.power_W[path, np.arange(path.size)].mean()
    return Plan(found.clearance_m[path], float(power), lead_s)
