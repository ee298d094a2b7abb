"""Best schedules of judged episodes, with preview and causal: computed once, one small file an
episode."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from models import PHYSICS_VERSION
from models.control.episodes import Board
from models.control.rivals import settings_Pa
from models.manifest import write_whole
from models.workers import map_in_order
from sim_hil.bound import ReferenceRun, episode_references

SPACING = 0.1
"""Clearances of the map that are run, apart by this share of the range: half the time of
the standard spacing, and every schedule is judged in time."""

Floats = NDArray[np.float64]


class ReferencePower(msgspec.Struct, frozen=True):
    """Mean power, W, of the references of one episode; None where no schedule keeps the limits."""

    preview_W: float | None
    causal_W: float | None


def reference_powers(
    out: Path, board: Board, seeds: Sequence[int], workers: int, progress: Callable[[int], None]
) -> tuple[Floats, Floats]:
    """Preview and causal power of the episodes of ``seeds``, W; nan where there is none.

    Some 5 s an episode on one core the first time, 20 s where the pressure may be set.
    """
    rig = board.data
    name = f"{rig.name}-{rig.digest}-{board.seconds:g}s{'-pair-supplied' if board.pressure else ''}"
    folder = out / f"references-{name}-physics{PHYSICS_VERSION}"
    folder.mkdir(parents=True, exist_ok=True)
    found = []
    for done, power in enumerate(map_in_order(partial(_kept, folder, board), seeds, workers), 1):
        found.append((power.preview_W, power.causal_W))
        progress(done)
    preview, causal = np.array(found, dtype=np.float64).T
    return preview, causal


def _kept(folder: Path, board: Board, seed: int) -> ReferencePower:
    path = folder / f"{seed}.json"
    if path.exists():
        return msgspec.json.decode(path.read_bytes(), type=ReferencePower)
    _, found = episode_references(
        seed,
        rig=board.rig,
        episode_s=board.seconds,
        spacing_um=max(1, round(1e6 * SPACING * float(np.ptp(board.reach[:, 0])))),
        pressures_Pa=settings_Pa(board.data) if board.pressure else None,
    )
    power = ReferencePower(_power(found.preview), _power(found.causal))
    write_whole(path, msgspec.json.encode(power))
    return power


def _power(reference: ReferenceRun | None) -> float | None:
    return None if reference is None else reference.verdict.mean_power_W
