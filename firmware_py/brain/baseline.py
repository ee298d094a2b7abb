"""Where the orbit's first order lay while the machine was healthy, learned with hindsight.

A fault shows in the first order at once and in the verdict only when it has filled the averaged
windows.  A window is therefore held back, and enters the baseline when every verdict of the
following :data:`HINDSIGHT_NS` was normal too. Each operating point has a reference of its own: the
median of the first windows there, which then follows so slowly that a growing fault stands out from
it and the changes of weeks do not.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

HINDSIGHT_NS: Final = 5_000_000_000
"""A change has reached every averaged window after this: the longest window (2 s) and ten hops (2.5
s), rounded up."""
FIRST_WINDOWS: Final = 40
"""Windows whose median is the reference: ten seconds."""
FOLLOWS: Final = 1.0 / 57_600.0
"""Share of a later window in the reference: it follows within hours (57 600 windows are four)."""
NEAR: Final = np.array([0.05, 3e-6, 0.1, 5.0])
"""Log speed, clearance (m), eccentricity and oil (K) within which two windows have the same first
order."""
REFERENCES_MAX: Final = 64
"""Operating points remembered; the one that was not visited for longest is forgotten first."""

Floats = NDArray[np.float64]


@dataclass
class _Reference:
    """The healthy first order (m) near one operating point."""

    point: Floats
    used_ns: int = 0
    first: list[complex] = field(default_factory=list)
    value: complex = 0j

    def learn(self, first_order_m: complex) -> None:
        if len(self.first) < FIRST_WINDOWS:
            self.first.append(first_order_m)
            self.value = complex(np.median(np.real(self.first)), np.median(np.imag(self.first)))
        else:
            self.value += FOLLOWS * (first_order_m - self.value)


class FirstOrderBaseline:
    """References of the first order by operating point, learned from what stayed normal."""

    def __init__(self) -> None:
        self._references: list[_Reference] = []
        self._waiting: deque[tuple[int, Floats, complex]] = deque()

    def note(self, t_ns: int, point: Floats, first_order_m: complex, *, normal: bool) -> None:
        """Take the window that ended at ``t_ns``; ``point`` as
        :data:`firmware_py.brain.normal.POINT`.

        A verdict that is not normal drops everything that still waits.
        """
        where = _coordinates(point)
        if not normal:
            self._waiting.clear()
            return
        if np.isfinite(where).all():
            self._waiting.append((t_ns, where, first_order_m))
        while self._waiting and t_ns - self._waiting[0][0] >= HINDSIGHT_NS:
            self._learn(*self._waiting.popleft())

    def drop(self) -> None:
        """There was a window that nothing can be said of: what waits did not stay normal."""
        self._waiting.clear()

    def at(self, point: Floats) -> complex | None:
        """The healthy first order near ``point``, m; None where the machine was not seen normal."""
        found = self._nearest(_coordinates(point))
        return found.value if found else None

    def _nearest(self, where: Floats) -> _Reference | None:
        away = [
            float(np.abs((reference.point - where) / NEAR).max()) for reference in self._references
        ]
        best = int(np.argmin(away)) if away else -1
        return self._references[best] if away and away[best] <= 1.0 else None

    def _learn(self, t_ns: int, where: Floats, first_order_m: complex) -> None:
        reference = self._nearest(where)
        if reference is None:
            reference = _Reference(where)
            if len(self._references) == REFERENCES_MAX:
                oldest = min(range(REFERENCES_MAX), key=lambda i: self._references[i].used_ns)
                del self._references[oldest]
            self._references.append(reference)
        reference.used_ns = t_ns
        reference.learn(first_order_m)


def _coordinates(point: Floats) -> Floats:
    return np.array([np.log(point[0]) if point[0] > 0.0 else np.nan, *point[1:]])
