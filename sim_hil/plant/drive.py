"""The rig's drive: follows a duty, coasts down when the device asks or falls silent
(``deploy/NODE.md``, 7)."""

from __future__ import annotations

from typing import Final

import numpy as np

from firmware_py.machine.simulation import DriveRamps
from firmware_py.records import DeviceHeartbeat
from sim_hil.plant.duty import RAD_S_PER_RPM, Duty
from sim_hil.rotor.parameters import Floats

HEARTBEAT_LIMIT_S: Final = (0.5, 5.0)
"""Least and greatest heartbeat limit that a drive may have: a guard that was killed is back within
1 to 2 s, and nothing protects the machine for longer than the limit and the time it takes to
stop."""

HEARTBEAT_LIMIT_DEFAULT_S: Final = 3.0


class SimulatedDrive:
    """Speed and load over time.

    Parameters
    ----------
    data
        How fast the drive lets go and runs up.
    duty
        What to follow from time 0 on.
    coast_on_silence
        Whether a lost heartbeat stops the machine once a session has granted ``run_permit``.
    heartbeat_limit_s
        How long that session may be silent.

    Raises
    ------
    ValueError
        The heartbeat limit lies outside :data:`HEARTBEAT_LIMIT_S`.
    """

    def __init__(
        self,
        data: DriveRamps,
        duty: Duty,
        *,
        coast_on_silence: bool = True,
        heartbeat_limit_s: float = HEARTBEAT_LIMIT_DEFAULT_S,
    ) -> None:
        low_s, high_s = HEARTBEAT_LIMIT_S
        if not low_s <= heartbeat_limit_s <= high_s:
            raise ValueError(
                f"heartbeat limit {heartbeat_limit_s:g} s: outside {low_s:g} .. {high_s:g} s"
            )
        self.heartbeat_limit_s = heartbeat_limit_s
        self.coasts_on_silence = coast_on_silence
        self._silence_us = round(heartbeat_limit_s * 1e6)
        self._data = data
        self.coasting = False
        self.reason = ""
        self._granted: int | None = None
        self._permit = False
        self._heard_us = 0
        self._local: tuple[Duty, float] | None = None
        self.follow(duty, 0.0)
        self.speed_rad_s, self.load_N = duty.point(0.0)

    def follow(self, duty: Duty, now_s: float) -> None:
        """Follow ``duty``, whose time 0 is ``now_s``; while steered, from its release on."""
        if self._local is None:
            self._duty, self._start_s = duty, now_s
        else:
            self._local = (duty, now_s)

    def steer(self, speed_rpm: float, load_N: float, ramp_s: float, now_s: float) -> None:
        """Go to a setpoint of the device in ``ramp_s``; the local duty waits."""
        local = self._local or (self._duty, self._start_s)
        self._local = None
        self.operate(speed_rpm, load_N, ramp_s, now_s)
        self._local = local

    def release(self) -> None:
        """The device steers no more: back to the local duty."""
        if self._local is not None:
            self._duty, self._start_s = self._local
            self._local = None

    @property
    def local_rpm(self) -> float:
        """Speed at the end of the local duty."""
        return (self._local or (self._duty, 0.0))[0].speed_rpm[-1]

    @property
    def local_N(self) -> float:
        """Load at the end of the local duty."""
        return (self._local or (self._duty, 0.0))[0].load_N[-1]

    def operate(self, speed_rpm: float, load_N: float, ramp_s: float, now_s: float) -> None:
        """Go to a speed and load in ``ramp_s`` and stay."""
        present_rpm = self.speed_rad_s / RAD_S_PER_RPM
        self.follow(
            Duty((0.0, max(ramp_s, 0.0)), (present_rpm, speed_rpm), (self.load_N, load_N)), now_s
        )

    def start(self) -> bool:
        """The operator's hand: run again; False while a device is there that does not permit it."""
        if self._granted is not None and not self._permit:
            return False
        self.coasting, self.reason = False, ""
        return True

    def hear(self, heartbeat: DeviceHeartbeat, tick_us: int) -> None:
        """One intact heartbeat of a device."""
        if heartbeat.trip_request:
            self._coast("trip request")
        elif heartbeat.session == self._granted and not heartbeat.run_permit:
            self._coast("run permit withdrawn")
        self._permit = heartbeat.run_permit and not heartbeat.trip_request
        if heartbeat.run_permit:
            self._granted = heartbeat.session
        if heartbeat.session == self._granted:
            self._heard_us = tick_us

    def watch(self, tick_us: int) -> None:
        """Coast down when the session that granted the run has fallen silent."""
        silent = self._granted is not None and tick_us - self._heard_us > self._silence_us
        if silent:
            self._permit = False
            if self.coasts_on_silence:
                self._coast("device heartbeat lost")

    def advance(self, start_s: float, period_s: float, n: int) -> Floats:
        """Speed, rad/s, and load, N, at the borders of the next ``n`` periods, shape (n + 1, 2).

        Linear over the call, so calls should be short (a few milliseconds).
        """
        span_s = n * period_s
        speed, load = self._duty.point(start_s - self._start_s + span_s)
        up, down = self._data.run_up_rad_s2 * span_s, self._data.coast_rad_s2 * span_s
        if self.coasting:
            speed = max(self.speed_rad_s - down, 0.0)
        else:
            speed = min(max(speed, self.speed_rad_s - up), self.speed_rad_s + up)
        rows = np.empty((n + 1, 2))
        share = np.arange(n + 1) / n
        rows[:, 0] = self.speed_rad_s + share * (speed - self.speed_rad_s)
        rows[:, 1] = self.load_N + share * (load - self.load_N)
        self.speed_rad_s, self.load_N = speed, load
        return rows

    def _coast(self, reason: str) -> None:
        if not self.coasting:
            self.coasting, self.reason = True, reason
