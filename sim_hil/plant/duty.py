"""Speed and load over time: piecewise linear, published or drawn from a seed."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass
from itertools import accumulate

import numpy as np

from firmware_py.errors import OrbitdError
from sim_hil.rigs import RigData
from sim_hil.rotor.parameters import Floats

RAD_S_PER_RPM = 2 * math.pi / 60


class NoDuty(OrbitdError, ValueError):
    """The rig has no duty of its own."""

    exit_code = 2


@dataclass(frozen=True)
class Duty:
    """Corners of speed and static bearing load; the first is held before, the last after.

    ``time_s``, ``speed_rpm``, ``load_N``: equal lengths, times not falling.
    """

    time_s: tuple[float, ...]
    speed_rpm: tuple[float, ...]
    load_N: tuple[float, ...]

    @property
    def seconds(self) -> float:
        """Time of the last corner."""
        return self.time_s[-1]

    @classmethod
    def hold(cls, speed_rpm: float, load_N: float, seconds: float = 0.0) -> Duty:
        """Constant speed and load."""
        return cls((0.0, seconds), (speed_rpm, speed_rpm), (load_N, load_N))

    @classmethod
    def published(cls, rig: RigData) -> Duty:
        """The duty of the rig's ``simulation.toml``.

        Raises
        ------
        NoDuty
            It has none.
        """
        if not rig.duty:
            raise NoDuty(f"rig {rig.name}: no table [[duty]] in its simulation.toml; write one")
        return cls(
            tuple(accumulate(corner.seconds for corner in rig.duty)),
            tuple(corner.speed_rpm for corner in rig.duty),
            tuple(corner.load_N for corner in rig.duty),
        )

    @classmethod
    def random(
        cls,
        rig: RigData,
        rng: np.random.Generator,
        seconds: float,
        *,
        hold_s: tuple[float, float] = (3.0, 8.0),
        load_rate_N_s: float = 50.0,
        speed_rate_rpm_s: float = 2000.0,
    ) -> Duty:
        """Holds of random speed (uniform) and load (log-uniform) joined by ramps within the
        rates."""
        corners: list[tuple[float, float, float]] = []
        while not corners or corners[-1][0] < seconds:
            speed = float(rng.uniform(rig.speed_min_rpm, rig.speed_max_rpm))
            load = math.exp(rng.uniform(math.log(rig.load_min_N), math.log(rig.load_max_N)))
            if not corners:
                corners.append((0.0, speed, load))
            else:
                t, before_speed, before_load = corners[-1]
                ramp = max(
                    abs(load - before_load) / load_rate_N_s,
                    abs(speed - before_speed) / speed_rate_rpm_s,
                )
                corners.append((t + ramp, speed, load))
            corners.append((corners[-1][0] + float(rng.uniform(*hold_s)), speed, load))
        return cls._of(corners)

    @classmethod
    def _of(cls, corners: list[tuple[float, float, float]]) -> Duty:
        time_s, speed, load = zip(*corners, strict=True)
        return cls(tuple(time_s), tuple(speed), tuple(load))

    def point(self, time_s: float) -> tuple[float, float]:
        """Speed, rad/s, and load, N, at one time: :meth:`at` without arrays."""
        i = bisect_right(self.time_s, time_s)
        if i == 0 or i == len(self.time_s):
            k = max(i - 1, 0)
            return self.speed_rpm[k] * RAD_S_PER_RPM, self.load_N[k]
        share = (time_s - self.time_s[i - 1]) / (self.time_s[i] - self.time_s[i - 1])
        speed = self.speed_rpm[i - 1] + share * (self.speed_rpm[i] - self.speed_rpm[i - 1])
        return speed * RAD_S_PER_RPM, self.load_N[i - 1] + share * (
            self.load_N[i] - self.load_N[i - 1]
        )

    def at(self, time_s: Floats) -> Floats:
        """Speed, rad/s, and load, N, at the given times, shape (n, 2)."""
        speed = np.interp(time_s, self.time_s, self.speed_rpm) * RAD_S_PER_RPM
        return np.column_stack([speed, np.interp(time_s, self.time_s, self.load_N)])
