"""Why a model is not used."""

from __future__ import annotations

from firmware_py.errors import OrbitdError


class ModelError(OrbitdError):
    """A model cannot be used; the text names file, cause, value, limit and next step."""


class ModelMissingError(ModelError):
    """There is no such file, or it cannot be read."""


class ModelTrustError(ModelError):
    """The bytes are not those that the manifest or a trusted key vouches for (truncated, tampered,
    unsigned)."""


class ModelUnfitError(ModelError):
    """The file is no usable model, or was made for another rig, sampling, window or interface."""


class ModelAnswerError(ModelError):
    """The model answered with something that is not a finite number."""


class EstimateLostError(OrbitdError):
    """What is measured fits no state of this bearing, so that nothing can be forecast from it."""
