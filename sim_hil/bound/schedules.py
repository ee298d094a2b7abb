"""Schedules over the bins of a map: with full preview, and without."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import binary_dilation, binary_erosion

from sim_hil.bound.case import BIN_S, TargetPlan
from sim_hil.bound.maps import Map
from sim_hil.rotor.parameters import Floats


class NoSchedule(Exception):
    """No path keeps the limits at the rate of the actuator."""


def narrowed(admissible: np.ndarray, margin_um: np.ndarray) -> np.ndarray:
    """Admissible cells that keep `margin_um` of each bin, shape (bins,), away from those that are
    not."""
    kept, layer = admissible.copy(), admissible
    for margin in range(1, int(margin_um.max()) + 1):
        layer = binary_erosion(layer, np.ones((1, 3, 1)), border_value=1)
        kept[..., margin_um >= margin] = layer[..., margin_um >= margin]
    return kept


def reach_of(rate_m_s: float) -> int:
    """Cells of 1 um that the actuator moves in a bin."""
    return int(rate_m_s * BIN_S * 1e6 + 1e-9)


def preview(
    found: Map, margin_um: np.ndarray, rate_m_s: float, lead_s: float, start_m: float | None = None
) -> TargetPlan:
    """Cheapest path through the admissible cells at the rate of the actuator: dynamic programming.

    The clearance moves at most `rate_m_s`, the pressure freely from bin to bin; the path begins at
    `start_m` where that is given. `margin_um` is kept to what is not admissible, shape (bins,).

    Raises
    ------
    NoSchedule
        There is none.
    """
    allowed = narrowed(found.admissible, margin_um)
    cost = np.where(allowed, found.power_W, np.inf)
    level, cost = cost.argmin(axis=0), cost.min(axis=0)  # the pressure is free in each bin
    cells, count = cost.shape
    reach = reach_of(rate_m_s)
    offsets = np.arange(-reach, reach + 1)
    onward = cost[:, -1]
    choice = np.zeros((cells, count), dtype=np.int64)
    for k in range(count - 2, -1, -1):
        options = np.stack([_shifted(onward, o, reach) for o in offsets.tolist()])
        best = options.argmin(axis=0)
        choice[:, k] = offsets[best]
        onward = cost[:, k] + options[best, np.arange(cells)]
    first = int(onward.argmin()) if start_m is None else cell_of(found, start_m)
    if not np.isfinite(onward[first]):
        raise NoSchedule(
            f"no path keeps margins up to {margin_um.max()} um at {rate_m_s * 1e6:g} um/s"
        )
    path = [first]
    for k in range(count - 1):
        path.append(path[-1] + int(choice[path[-1], k]))
    cell = np.array(path)
    return plan_of(found, cell, level[cell, np.arange(count)], lead_s)


def _shifted(row: Floats, offset: int, reach: int) -> Floats:
    padded = np.pad(row, reach, constant_values=np.inf)
    return np.asarray(padded[reach + offset : reach + offset + row.size])


def causal(
    found: Map,
    margin: int,
    ready: np.ndarray,
    ramps: list[tuple[int, int, int]],
    rate_m_s: float,
    start_m: float | None = None,
) -> TargetPlan:
    """Follow the cheapest setting that is admissible now and ready for what may come, at the rate
    of the actuator.

    Each bin's target comes from what is known in the bin before: the power and limits of every
    setting there (on an announced ramp, of the bin itself), the declared disturbances by way of
    `ready`, and the announced ramps in sight.

    Parameters
    ----------
    ready
        Clearances that are ready for every unannounced ramp, shape (cells, bins):
        `Surroundings.ready`.
    ramps
        For each announced ramp the bin from which it is known, its first and its last bin.

    Raises
    ------
    NoSchedule
        The path leaves the admissible settings.
    """
    reach = reach_of(rate_m_s)
    allowed = narrowed(found.admissible, np.full(found.power_W.shape[-1], margin))
    held = allowed & foreseen(np.asarray(allowed.any(axis=0)), ready, ramps, reach)
    power = np.where(held, found.power_W, np.inf)
    cell = (
        cell_of(found, start_m) if start_m is not None else int(power[..., 0].min(axis=0).argmin())
    )
    cells, levels = [cell], [int(power[:, cell, 0].argmin())]
    for k in range(1, found.power_W.shape[-1]):
        announced = any(first <= k <= last for _, first, last in ramps)
        now = power[..., k if announced else k - 1]
        if np.isfinite(now).any():
            cell += int(np.clip(int(now.min(axis=0).argmin()) - cell, -reach, reach))
        cells.append(cell)
        levels.append(int(now[:, cell].argmin()))
    path, level = np.array(cells), np.array(levels)
    if not found.admissible[level, path, np.arange(path.size)].all():
        raise NoSchedule(f"following without preview {margin} um inside leaves the limits")
    return plan_of(found, path, level, 0.0)


def foreseen(
    allowed: np.ndarray, ready: np.ndarray, ramps: list[tuple[int, int, int]], reach: int
) -> np.ndarray:
    """Clearances that are ready for what may come, and for the announced ramps in sight; shape
    (cells, bins).

    While an announced ramp runs, nothing else comes: what counts is that the actuator can stay
    admissible to its end and is ready there.
    """
    kept = ready.copy()
    for _, first, last in ramps:
        kept[:, first:last] = True
    for known, first, last in ramps:
        along = allowed[:, first : last + 1].copy()
        along[:, -1] &= ready[:, last]
        along = viable(along, reach)
        kept[:, first : last + 1] &= along
        for k in range(known, first):
            kept[:, k] &= _within(along[:, 0], reach * max(0, first - k - 2))
    return np.asarray(kept)


def viable(allowed: np.ndarray, reach: int) -> np.ndarray:
    """Allowed cells from which a path of at most `reach` cells a bin stays allowed to the end."""
    kept = allowed.copy()
    for k in range(allowed.shape[1] - 2, -1, -1):
        kept[:, k] &= _within(kept[:, k + 1], reach)
    return kept


def _within(cells: np.ndarray, reach: int) -> np.ndarray:
    return np.asarray(binary_dilation(cells, np.ones(2 * reach + 1, dtype=np.bool_)))


def cell_of(found: Map, clearance_m: float) -> int:
    """Nearest cell of a clearance."""
    return int(np.abs(found.clearance_m - clearance_m).argmin())


def plan_of(found: Map, cell: np.ndarray, level: np.ndarray, lead_s: float) -> TargetPlan:
    """The plan along cells and pressure levels, shape (bins,)."""
    power = found.power_W[level, cell, np.arange(cell.size)].mean()
    return TargetPlan(found.clearance_m[cell], found.pressure_Pa[level], lead_s, float(power))
