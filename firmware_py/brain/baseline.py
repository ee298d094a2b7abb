"""Where the orbit's first order lay while the machine was healthy, learned with hindsight.

A fault shows in the first order at once and in the verdict only when it has filled the averaged
windows.  A window is therefore held back, and enters the baseline when every verdict of the
following :data:`HINDSIGHT_NS` was normal too. Each operating point has a reference of its own: the
median of the first windows there, which then follows so slowly that a growing fault stands out from
it and the changes of weeks do not.
"""

from __future__ import annotations

from typing import Final

import msgspec
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


class Reference(msgspec.Struct):
    """The healthy first order (m) near one operating point."""

    point: Floats
    used_ns: int = 0
    first: list[complex] = []
    value: complex = 0j

    def learn(self, first_order_m: complex) -> None:
        """Take one healthy first order: of the first ones the median, later ones slowly."""
        if len(self.first) < FIRST_WINDOWS:
            self.first.append(first_order_m)
            self.value = complex(np.median(np.real(self.first)), np.median(np.imag(self.first)))
        else:
            self.value += FOLLOWS * (first_order_m - self.value)


class Waiting(msgspec.Struct, frozen=True, array_like=True):
    """A window that is held back: its end, operating point and first order (m)."""

    t_ns: int
    point: Floats
    first_order_m: complex


class BaselineState(msgspec.Struct):
    """What the baseline has learned, and the windows that wait for hindsight."""

    references: list[Reference] = []
    waiting: list[Waiting] = []


class FirstOrderBaseline:
    """References of the first order by operating point, learned from what stayed normal."""

    def __init__(self) -> None:
        self.state = BaselineState()

    def note(self, t_ns: int, point: Floats, first_order_m: complex, *, normal: bool) -> None:
        """Take the window that ended at ``t_ns``; ``point`` as
        :data:`firmware_py.brain.normal.POINT`.

        A verdict that is not normal drops everything that still waits.
        """
        where, waiting = _coordinates(point), self.state.waiting
        if not normal:
            waiting.clear()
            return
        if np.isfinite(where).all():
            waiting.append(Waiting(t_ns, where, first_order_m))
        while waiting and t_ns - waiting[0].t_ns >= HINDSIGHT_NS:
            self._learn(waiting.pop(0))

    def drop(self) -> None:
        """There was a window that nothing can be said of: what waits did not stay normal."""
        self.state.waiting.clear()

    def at(self, point: Floats) -> complex | None:
        """The healthy first order near ``point``, m; None where the machine was not seen normal."""
        found = self._nearest(_coordinates(point))
        return found.value if found else None

    def _nearest(self, where: Floats) -> Reference | None:
        known = self.state.references
        away = [float(np.abs((reference.point - where) / NEAR).max()) for reference in known]
        best = int(np.argmin(away)) if away else -1
        return known[best] if away and away[best] <= 1.0 else None

    def _learn(self, window: Waiting) -> None:
        reference, known = self._nearest(window.point), self.state.references
        if reference is None:
            reference = Reference(window.point)
            if len(known) == REFERENCES_MAX:
                del known[min(range(REFERENCES_MAX), key=lambda i: known[i].used_ns)]
            known.append(reference)
        reference.used_ns = window.t_ns
        reference.learn(window.first_order_m)


def _coordinates(point: Floats) -> Floats:
    return np.array([np.log(point[0]) if point[0] > 0.0 else np.nan, *point[1:]])
