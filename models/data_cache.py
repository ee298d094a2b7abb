"""Recordings are made once: a file in the runs folder named after everything that decides them."""

from __future__ import annotations

import hashlib
from dataclasses import fields
from pathlib import Path

import numpy as np

from firmware_py.acquire.features import FEATURE_NAMES
from models import PHYSICS_VERSION
from models.dataset import Dataset
from models.recordings import Plan, Views, record_builds
from models.runs import progress_bar


def recorded(out: Path, plan: Plan, builds: int, workers: int) -> Views:
    """The recordings of ``plan``, from ``out`` when they lie there already."""
    key = repr((PHYSICS_VERSION, FEATURE_NAMES, plan.rig, plan.seed, plan.rate_hz, plan.seconds, plan.draw.__name__))
    name = hashlib.sha256(f"{key} {builds}".encode()).hexdigest()[:12]
    path = out / f"recordings-{plan.draw.__name__}-{name}.npz"
    if path.exists():
        return _load(path)
    with progress_bar(f"recordings of {builds} builds", builds) as bar:
        views = record_builds(plan, range(builds), workers, bar)
    out.mkdir(parents=True, exist_ok=True)
    columns = {
        f"{view}_{f.name}": getattr(getattr(views, view), f.name) for view in ("orders", "raw") for f in fields(Dataset)
    }
    part = path.with_suffix(".part.npz")
    np.savez(part, **columns)
    part.replace(path)
    return views


def _load(path: Path) -> Views:
    with np.load(path) as stored:
        return Views(*(Dataset(*(stored[f"{view}_{f.name}"] for f in fields(Dataset))) for view in ("orders", "raw")))
