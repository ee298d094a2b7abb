"""What a controller without preview must be ready for: the declared disturbances."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sim_hil.bound.case import BIN_S, BoundCase
from sim_hil.bound.maps import Map, Mapper, build_map, judged_alone
from sim_hil.plant.duty import RAD_S_PER_RPM, Duty
from sim_hil.rigs import RigData
from sim_hil.rotor.parameters import Floats

_POINTS, SPACING_UM = 5, 8
_HOLD_S, _RAMP_S = 1.2, 0.3
_LOOK_BINS = 4
_REACTION_S = 0.25
"""From the begin of a ramp until the bearing moves: a bin to see it, a bin to command it, the
actuator's lag."""


@dataclass(frozen=True)
class RampLimits:
    """How fast load and speed may change unannounced, and how long before its start a faster ramp
    is announced.

    An announcement tells when the ramp starts and ends and the speed and load at its end.
    """

    load_ramp_N_s: float = 50.0
    speed_ramp_rpm_s: float = 2000.0
    announced_s: float = 3.0

    @classmethod
    def of_rig(cls, rig: RigData) -> RampLimits:
        """What the rig declares."""
        return cls(rig.load_ramp_N_s, rig.speed_ramp_rpm_s)

    def announced(self, duty: Duty) -> list[tuple[int, int]]:
        """First and last bin of each ramp of the duty that is faster than what may come
        unannounced."""
        found = []
        for i in range(1, len(duty.time_s)):
            seconds = duty.time_s[i] - duty.time_s[i - 1]
            load, speed = (abs(row[i] - row[i - 1]) for row in (duty.load_N, duty.speed_rpm))
            if (
                load > self.load_ramp_N_s * seconds + 1e-9
                or speed > self.speed_ramp_rpm_s * seconds + 1e-9
            ):
                found.append(
                    (int(duty.time_s[i - 1] / BIN_S), int(np.ceil(duty.time_s[i] / BIN_S - 1e-9)))
                )
        return found

    def seconds_to(self, duty: Duty, times_s: Floats, speed_rpm: Floats, load_N: Floats) -> Floats:
        """Shortest unannounced way from the duty at `times_s` to points, s, shape (points,
        times)."""
        here = duty.at(times_s)
        speed = np.abs(speed_rpm[:, None] - here[:, 0] / RAD_S_PER_RPM) / self.speed_ramp_rpm_s
        load = np.abs(load_N[:, None] - here[:, 1]) / self.load_ramp_N_s
        return np.asarray(np.maximum(speed, load))


@dataclass(frozen=True)
class AdmissibleRanges:
    """Admissible clearances, cells `low` to `high` of the map's grid, at operating points: all of
    shape (points,).

    `low` and `high` of the points where no clearance is admissible are the one of the thickest
    film.
    """

    speed_rpm: Floats
    load_N: Floats
    low: Floats
    high: Floats

    def ready(
        self, case: BoundCase, expected: RampLimits, rate_m_s: float, cells: int
    ) -> np.ndarray:
        """Clearances from which every point can be met in time, whatever unannounced ramp leads
        there.

        Shape (cells, bins).  With unannounced ramps of limited rate a point is `t` away at least,
        and the actuator moves at its own rate meanwhile; where the admissible clearances of each
        point are an interval this is the largest set that a controller without preview can promise
        to stay in.
        """
        times_s = np.arange(case.bins, dtype=np.float64) * BIN_S
        seconds = expected.seconds_to(case.duty, times_s, self.speed_rpm, self.load_N)
        moved = rate_m_s * 1e6 * np.maximum(seconds - _REACTION_S, 0.0)
        high, low = (
            (self.high[:, None] + moved).min(axis=0),
            (self.low[:, None] - moved).max(axis=0),
        )
        grid = np.arange(cells)[:, None]
        return np.asarray((grid >= low) & (grid <= high))


def surroundings(
    case: BoundCase,
    pressures_Pa: tuple[float, ...],
    mapper: Mapper = map,
    spacing_um: int = SPACING_UM,
) -> AdmissibleRanges:
    """Admissible clearances over the rig's speeds and loads, from runs that visit a grid and the
    duty's corners.

    A clearance is admissible if it is with one of the pressures: of the two, pressure follows
    sooner.
    """
    tour, speed, load = _tour(case.rig, case.duty)
    round_trip = replace(case.coarse, duty=tour)
    found = build_map(round_trip, spacing_um, pressures_Pa, judged_alone(round_trip, mapper))
    ends = np.floor((np.arange(speed.size) * (_HOLD_S + _RAMP_S) + _HOLD_S) / BIN_S + 1e-6).astype(
        np.int64
    )
    look = ends[:, None] - 1 - np.arange(_LOOK_BINS)
    allowed = np.asarray(found.admissible[..., look].all(axis=-1).any(axis=0))
    film = found.film_margin_m[..., look].min(axis=-1).max(axis=0)
    low, high = np.array([_widest(allowed[:, i], film[:, i]) for i in range(speed.size)]).T
    return AdmissibleRanges(speed, load, low, high)


def _tour(rig: RigData, duty: Duty) -> tuple[Duty, Floats, Floats]:
    """A duty that holds each operating point of a grid and each corner of `duty` in turn, and those
    points."""
    speeds = np.geomspace(rig.speed_min_rpm, rig.speed_max_rpm, _POINTS)
    loads = np.geomspace(rig.load_min_N, rig.load_max_N, _POINTS)
    points = [
        (s, w)
        for i, s in enumerate(speeds.tolist())
        for w in (loads if i % 2 == 0 else loads[::-1]).tolist()
    ]
    points += [
        p for p in dict.fromkeys(zip(duty.speed_rpm, duty.load_N, strict=True)) if p not in points
    ]
    corners = []
    for i, (speed, load) in enumerate(points):
        start = i * (_HOLD_S + _RAMP_S)
        corners += [(start, speed, load), (start + _HOLD_S, speed, load)]
    speed, load = np.array(points, dtype=np.float64).T
    return Duty(*zip(*corners, strict=True)), speed, load


def _widest(allowed: np.ndarray, film: Floats) -> tuple[int, int]:
    """First and last cell of the longest run of allowed ones; the cell of the thickest film if
    there is none."""
    if not allowed.any():
        thickest = int(film.argmax())
        return thickest, thickest
    edges = np.flatnonzero(np.diff(np.concatenate([[0], allowed.astype(np.int8), [0]])))
    starts, stops = edges[::2], edges[1::2]
    longest = int((stops - starts).argmax())
    return int(starts[longest]), int(stops[longest] - 1)


def in_sight(found: Map, expected: RampLimits, duty: Duty) -> list[tuple[int, int, int]]:
    """Bin from which an announced ramp is known, and its first and last bin."""
    last, ahead = found.power_W.shape[-1] - 1, round(expected.announced_s / BIN_S)
    return [(max(0, m - ahead), m, min(e, last)) for m, e in expected.announced(duty) if m <= last]
