"""The drive on the wire (schema 2): executes DRIVE_COMMAND while it is fresh, and tells of itself.

When commands expire the drive goes back to its local setpoints, those of the operator at the rig.
"""

from __future__ import annotations

from typing import Final

from firmware_py.records import (
    DeviceHeartbeat,
    DriveCommand,
    DriveMode,
    DriveState,
    Rejected,
    WireMessage,
)
from sim_hil.hil.follower import COUNTERS, TICKS, Follower
from sim_hil.plant.drive import SimulatedDrive
from sim_hil.plant.duty import RAD_S_PER_RPM
from sim_hil.rigs import RigData

SPEED_OVER: Final = 1.25
LOAD_OVER: Final = (5.0, 3.0)
"""What drive and loader can do over the declared range (a factor, and a fraction)."""


class DriveLink:
    """Judges drive commands and hands them to the drive.

    Parameters
    ----------
    drive
        Of the rig.
    time_to_live_ms
        Of its commands.
    rig
        Its declared speed and load.
    """

    def __init__(self, drive: SimulatedDrive, time_to_live_ms: int, rig: RigData) -> None:
        self.time_to_live_ms = time_to_live_ms
        self.speed_rpm = (0.0, SPEED_OVER * rig.speed_max_rpm)
        self.load_N = (0.0, LOAD_OVER[0] * rig.load_max_N / LOAD_OVER[1])
        self._drive = drive
        self._follower: Follower[DriveCommand] = Follower(time_to_live_ms, self._in_range)
        self._setpoint: DriveCommand | None = None

    def receive(self, messages: list[WireMessage | Rejected], tick_us: int, now_s: float) -> None:
        """Everything that waits, at once; only the newest intact command is judged."""
        newest: DriveCommand | None = None
        for message in messages:
            if isinstance(message, DriveCommand):
                newest = message
            elif isinstance(message, DeviceHeartbeat):
                self._follower.hear(message.session, tick_us)
        if newest is not None and self._follower.judge(newest, tick_us):
            self._setpoint = newest
            drive = self._drive
            present_rpm = drive.speed_rad_s / RAD_S_PER_RPM
            ramp_s = max(
                abs(newest.speed_rpm - present_rpm) / max(newest.speed_ramp_rpm_s, 1),
                abs(newest.load_N - drive.load_N) / max(newest.load_ramp_N_s, 1),
            )
            drive.steer(newest.speed_rpm, newest.load_N, ramp_s, now_s)

    def expire(self, tick_us: int) -> None:
        """Back to the local setpoints when no command was executed for the time to live."""
        if self._setpoint is not None and self._follower.expired(tick_us):
            self._setpoint = None
            self._drive.release()

    def state(self, counter: int, tick_us: int) -> DriveState:
        """The drive's own account."""
        drive, follower, setpoint = self._drive, self._follower, self._setpoint
        mode = DriveMode.LOCAL if setpoint is None else DriveMode.FOLLOWING
        return DriveState(
            counter=counter,
            tick_us=tick_us % TICKS,
            session=follower.session,
            command_counter=follower.counter,
            mode=int(DriveMode.COASTING if drive.coasting else mode),
            speed_setpoint_rpm=setpoint.speed_rpm if setpoint else drive.local_rpm,
            load_setpoint_N=setpoint.load_N if setpoint else drive.local_N,
            speed_rpm=drive.speed_rad_s / RAD_S_PER_RPM,
            load_N=drive.load_N,
            **{f"refused_{name}": count % COUNTERS for name, count in follower.refused.items()},
        )

    def _in_range(self, command: DriveCommand) -> bool:
        return (
            self.speed_rpm[0] <= command.speed_rpm <= self.speed_rpm[1]
            and self.load_N[0] <= command.load_N <= self.load_N[1]
        )
