"""One line of the verification: a value beside its reference."""

from __future__ import annotations

import json
from dataclasses import dataclass
from importlib import resources
from typing import Any


@dataclass(frozen=True)
class ComparisonRow:
    """A quantity here and in the reference.

    `difference` and `tolerance` are relative, or in the unit of the quantity where `absolute`; a
    row without a tolerance is shown, not judged.
    """

    quantity: str
    value: float
    reference: float
    source: str
    tolerance: float | None
    absolute: bool = False

    @property
    def difference(self) -> float:
        """Value less reference, over the reference unless `absolute`."""
        gap = self.value - self.reference
        return gap if self.absolute else gap / abs(self.reference)

    @property
    def passed(self) -> bool | None:
        """Within the tolerance; None when the row is not judged. NaN never passes."""
        return None if self.tolerance is None else abs(self.difference) <= self.tolerance


def residual(quantity: str, value: float, source: str, tolerance: float) -> ComparisonRow:
    """A quantity that should be zero."""
    return ComparisonRow(quantity, value, 0.0, source, tolerance, absolute=True)


def reference(name: str) -> dict[str, Any]:
    """One of the shipped reference tables."""
    text = resources.files(__package__).joinpath("data", name).read_text(encoding="utf-8")
    table: dict[str, Any] = json.loads(text)
    return table
