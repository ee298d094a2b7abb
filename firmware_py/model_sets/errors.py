"""Why a set of models is not taken."""

from __future__ import annotations

from firmware_py.errors import OrbitdError


class SetError(OrbitdError):
    """A set, the shelf of sets or a key cannot be used; the text names cause, value and next
    step."""
