"""Which models the brain thinks with, and what one set says beside the other."""

from __future__ import annotations

from typing import Final

import msgspec

from firmware_py.records.base import Record

MODELS_ACTIONS: Final = ("add", "shadow", "promote", "rollback")

LOST: Final = "lost"
"""``role`` of a brain that has not found the sets that it should use."""


class ModelsInUse(Record, frozen=True, tag=True):
    """The sets of models at work, once a second and whenever they change.

    Sets are named by the start of their manifest's SHA-256, on top of the device's own folder: none
    is that folder alone.  ``beside`` runs along, as ``role`` says: ``shadow`` (a candidate) or
    ``former`` (what was in use before the last promotion); None: nothing does.  Where ``role`` is
    :data:`LOST` the sets that should be in use were not found.  ``former`` comes back with
    ``rollback``.  ``rolled_back`` says why a set was taken out of use, until a person
    acts.  ``compared`` are sums and counts over this run of the brain
    (:mod:`firmware_py.brain.comparison`).
    """

    seq: int
    t_ns: int
    active: list[str]
    beside: list[str] | None = None
    role: str = ""
    former: list[str] | None = None
    rolled_back: str = ""
    labels: list[str] = msgspec.field(default_factory=list)
    """Models in use, as in diagnoses and forecasts."""
    beside_labels: list[str] = msgspec.field(default_factory=list)
    compared: dict[str, float] = msgspec.field(default_factory=dict)
