"""Offline training of the three learned parts: film surrogate, fault classifier, clearance actor.

Nothing here runs on the device.  torch, onnx, scikit-learn and matplotlib are imported by the
modules that use them, so that ``import models`` stays cheap.
"""

from pathlib import Path

ARTIFACTS = Path(__file__).parent / "artifacts"
"""The shipped models: one ONNX file each, their reports and cards, and the manifest that trusts
them."""

PHYSICS_VERSION = "2"
"""Raised when film, rotor, faults or sensors change so that a model made before no longer fits."""
