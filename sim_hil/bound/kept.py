"""Profiles are computed once: a file in the user's cache, named after everything that decides
it."""

from __future__ import annotations

import hashlib
import os
import pickle
from contextlib import suppress
from dataclasses import astuple
from functools import cache
from pathlib import Path

import numpy as np

from sim_hil.bound.case import BoundCase, Profile, TargetPlan
from sim_hil.whole_file import whole_file

_SOURCES = Path(__file__).parent.parent
_FOLDERS = (".", "bound", "film", "film/data", "gym", "plant", "rotor", "rigs")


def kept_profile(case: BoundCase, plan: TargetPlan) -> Profile:
    """`case.profile(plan)`, from the cache when it lies there already; one that cannot be written
    is no fault."""
    decides = pickle.dumps(
        (astuple(case), plan.clearance_m, plan.pressure_Pa, plan.lead_s), protocol=5
    )
    path = _folder() / f"{hashlib.sha256(decides).hexdigest()[:24]}.npz"
    if path.exists():
        with np.load(path) as stored:
            return Profile(*stored["profile"])
    profile = case.profile(plan)
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as stream:
            np.savez(stream, profile=np.stack(astuple(profile)))
    return profile


@cache
def _folder() -> Path:
    """One folder for each state of the sources and data that a run depends on."""
    digest = hashlib.sha256()
    for folder in _FOLDERS:
        for path in sorted((_SOURCES / folder).glob("*.*")):
            if path.suffix in (".py", ".npz"):
                digest.update(path.read_bytes())
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "orbitd" / f"bound-{digest.hexdigest()[:16]}"
