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
    paths = {seed: folder / f"{seed}.json" for seed in seeds}
    missing = [seed for seed, path in paths.items() if not path.exists()]
    progress(len(paths) - len(missing))
    made = map_in_order(partial(_reference, board), missing, workers)
    for done, (seed, power) in enumerate(zip(missing, made, strict=True), 1):
        write_whole(paths[seed], msgspec.json.encode(power))
        progress(len(paths) - len(missing) + done)
    kept = [msgspec.json.decode(p.read_bytes(), type=ReferencePower) for p in paths.values()]
    preview, causal = np.array([(p.preview_W, p.causal_W) for p in kept], dtype=np.float64).T
    return preview, causal


def _reference(board: Board, seed: int) -> ReferencePower:
    _, found = episode_references(
        seed,
        rig=board.rig,
        episode_s=board.seconds,
        spacing_um=max(1, round(1e6 * SPACING * float(np.ptp(board.reach[:, 0])))),
        pressures_Pa=settings_Pa(board.data) if board.pressure else None,
    )
    return ReferencePower(_power(found.preview), _power(found.causal))


def _power(reference: ReferenceRun | None) -> float | None:
    return None if reference is None else reference.verdict.mean_power_W
