"""The static film of the plain journal bearing that the guard stands on: load, attitude, friction,
whirl.

Radius ``R``, length ``L``, ``lam = L/2R``, radial clearance ``c``, eccentricity ratio ``eps``.
Ocvirk's short bearing with pi-film (Dubois & Ocvirk, NACA Report 1157, 1953) times shares of the
Reynolds solution that a table holds (``film_table.json``, written by
:mod:`sim_hil.film.static_table`, which says what they are).  Only + - * / and sqrt in a fixed
order: the same bits on every machine.
"""

from __future__ import annotations

from bisect import bisect_right
from functools import cache
from importlib import resources
from math import pi, sqrt
from typing import Final

import msgspec

LENGTH_OVER_DIAMETER_MAX: Final = 1.0
"""The table ends here."""

ECCENTRICITY_MAX: Final = 0.97
KNOTS: Final = 388
"""Eccentricities that are looked up: evenly from 0 to :data:`ECCENTRICITY_MAX`, 0.0025 apart."""


class StaticFilm:
    """Film at rest of one bearing shape, at evenly spaced eccentricities.

    Parameters
    ----------
    radius_m, length_m
        ``L/2R`` up to :data:`LENGTH_OVER_DIAMETER_MAX`; a longer bearing is taken as one of that
        shape.

    Attributes
    ----------
    eccentricity, load, sine, cosine
        At each knot: ``eps``, ``W c^2 / (mu w)`` in m^4 (inf beyond the last knot is the caller's),
        sine and cosine of the attitude, which is counted from the load in the sense of rotation.
    friction
        At each knot ``T c / (mu w)`` in m^4: Petroff's torque over ``sqrt(1 - eps^2)`` and half ``e
        W sin(phi)``.
    """

    def __init__(self, radius_m: float, length_m: float) -> None:
        self._size_m4 = 0.25 * radius_m * length_m * length_m * length_m
        self._shape = min(0.5 * length_m / radius_m, LENGTH_OVER_DIAMETER_MAX)
        self.eccentricity = [i * ECCENTRICITY_MAX / KNOTS for i in range(KNOTS + 1)]
        self.load = [self._load(e) for e in self.eccentricity]
        attitudes = [self._attitude(e) for e in self.eccentricity]
        self.sine, self.cosine = [a[0] for a in attitudes], [a[1] for a in attitudes]
        petroff = 2.0 * pi * radius_m * radius_m * radius_m * length_m
        self.friction = [
            petroff / sqrt(1.0 - e * e) + 0.5 * e * load * sine
            for e, load, sine in zip(self.eccentricity, self.load, self.sine, strict=True)
        ]
        self._whirl = self._running_whirl()
        self._onset = _table().onset
        self._onset_rows = self._onset.of_shape(self._shape)
        self._ties = [
            load * share * share for load, share in zip(self.load, self._whirl, strict=True)
        ]

    def load_per_viscous_speed(self, eccentricity: float, clearance_m: float) -> float:
        """Static load carried at ``eccentricity`` per viscosity and speed, ``W / (mu w)`` in
        m^2."""
        return self._load(eccentricity) / (clearance_m * clearance_m)

    def whirl_share(self, tie_m4: float, unbalance_share: float = 0.0) -> float:
        """``1 / Omega^2`` of a rigid rotor in the clearance that just makes it whirl; ``Omega = w
        sqrt(c m / W)``.

        In that clearance ``c = Omega^2 W / (m w^2)`` the film carries ``W``: ``tie_m4 = W^3 / (m^2
        w^5 mu)`` is ``(W c^2 / (mu w)) / Omega^4`` and names the eccentricity.  A film that is more
        stable than a less eccentric one is taken to be as that: it may get there through it.

        An unbalance ``U`` of ``unbalance_share = U w^2 / W`` shakes the film at twice the whirl's
        frequency, and whirl sets in before its threshold, the earlier the less eccentric
        (:mod:`sim_hil.film.whirl_onset`).
        """
        k = bisect_right(self._ties, tie_m4)
        if k > KNOTS:
            share, eccentricity = self._whirl[KNOTS], ECCENTRICITY_MAX
        else:
            low, high = self._ties[k - 1], self._ties[k]
            share = self._whirl[k - 1] + (tie_m4 - low) / (high - low) * (
                self._whirl[k] - self._whirl[k - 1]
            )
            eccentricity = self.eccentricity[k - 1]
        return share / self._onset_share(eccentricity, unbalance_share)

    def _onset_share(self, eccentricity: float, unbalance_share: float) -> float:
        """Clearance in which a rotor out of balance begins to whirl, over that of one without; held
        beyond its ends."""
        onset = self._onset
        i, down = _place(onset.eccentricity, eccentricity)
        j, across = _place(onset.unbalance_share, unbalance_share)
        upper, lower = (
            row[j] + across * (row[j + 1] - row[j]) for row in self._onset_rows[i : i + 2]
        )
        return upper + down * (lower - upper)

    def _load(self, eccentricity: float) -> float:
        e2 = eccentricity * eccentricity
        rest = 1.0 - e2
        short = eccentricity * sqrt(16.0 * e2 + pi * pi * rest) / (rest * rest)
        return self._size_m4 * short * _share(_table().load_share, self._shape, eccentricity)

    def _attitude(self, eccentricity: float) -> tuple[float, float]:
        """Sine and cosine; of the short bearing ``tan(phi) = pi sqrt(1 - eps^2) / (4 eps)``."""
        share = _share(_table().tangent_share, self._shape, eccentricity)
        across = pi * sqrt(1.0 - eccentricity * eccentricity) * share
        along = 4.0 * eccentricity
        length = sqrt(across * across + along * along)
        return across / length, along / length

    def _running_whirl(self) -> list[float]:
        """Largest ``1 / Omega^2`` up to each knot."""
        found: list[float] = []
        for e in self.eccentricity:
            share = _share(_table().whirl_share, self._shape, e)
            found.append(max(share, found[-1]) if found else share)
        return found


@cache
def static_film(radius_m: float, length_m: float) -> StaticFilm:
    """:class:`StaticFilm`, made once for all that share a bearing."""
    return StaticFilm(radius_m, length_m)


class _Onset(msgspec.Struct, frozen=True):
    """Where whirl begins with unbalance: a block a length over diameter, a row an eccentricity."""

    length_over_diameter: list[float]
    eccentricity: list[float]
    unbalance_share: list[float]
    clearance_share: list[list[list[float]]]

    def of_shape(self, length_over_diameter: float) -> list[list[float]]:
        """Rows between those of the two nearest lengths."""
        i, share = _place(self.length_over_diameter, length_over_diameter)
        return [
            [a + share * (b - a) for a, b in zip(*rows, strict=True)]
            for rows in zip(self.clearance_share[i], self.clearance_share[i + 1], strict=True)
        ]


class _Table(msgspec.Struct, frozen=True):
    """``film_table.json``: a row for each length over diameter, a column for each eccentricity."""

    length_over_diameter: list[float]
    eccentricity: list[float]
    load_share: list[list[float]]
    tangent_share: list[list[float]]
    whirl_share: list[list[float]]
    onset: _Onset


@cache
def _table() -> _Table:
    text = resources.files("firmware_py.machine").joinpath("film_table.json").read_bytes()
    return msgspec.json.decode(text, type=_Table)


def _share(rows: list[list[float]], length_over_diameter: float, eccentricity: float) -> float:
    """Bilinear in the table; held beyond its ends."""
    table = _table()
    i, down = _place(table.length_over_diameter, length_over_diameter)
    j, across = _place(table.eccentricity, eccentricity)
    upper, lower = (row[j] + across * (row[j + 1] - row[j]) for row in (rows[i], rows[i + 1]))
    return upper + down * (lower - upper)


def _place(knots: list[float], value: float) -> tuple[int, float]:
    """Knot below ``value`` and the part of the way to the next."""
    i, last = bisect_right(knots, value) - 1, len(knots) - 2
    i = 0 if i < 0 else last if i > last else i
    share = (value - knots[i]) / (knots[i + 1] - knots[i])
    return i, 0.0 if share < 0.0 else 1.0 if share > 1.0 else share
