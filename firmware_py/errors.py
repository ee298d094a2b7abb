"""The root of every refusal a person may see."""

from __future__ import annotations


class OrbitdError(Exception):
    """A named refusal: its text gives cause, value, limit, place and next step.

    ``exit_code`` is what a command ends with: 1 refused or failed, 2 wrong input, 3 no answer.
    """

    exit_code = 1
