"""Fields of the messages about the drive, and of the figures that a node declares (schema 2)."""

from __future__ import annotations

from typing import Final, cast

from firmware_py.records import DriveCommand, DriveMode, DriveState, NodeFigures
from firmware_py.wire.counts import (
    CLEARANCE_UM,
    LOAD_N,
    PRESSURE_BAR,
    RANGE,
    SPEED_RPM,
    Fields,
    counts,
)

COASTS_ON_SILENCE: Final = 1
DRIVE_COMMANDABLE: Final = 2


def read_figures(f: Fields) -> NodeFigures | str:
    """Record of declared figures of actuator and drive; a reason where the fields name no state."""
    counter, tick, limit_ms, flags, cmin, cmax, pmin, pmax, clag, plag, ttl, *drive = cast(
        tuple[int, ...], f
    )
    return NodeFigures(
        counter,
        tick,
        limit_ms,
        bool(flags & COASTS_ON_SILENCE),
        bool(flags & DRIVE_COMMANDABLE),
        cmin * CLEARANCE_UM,
        cmax * CLEARANCE_UM,
        pmin * PRESSURE_BAR,
        pmax * PRESSURE_BAR,
        clag,
        plag,
        ttl,
        drive[0] * SPEED_RPM,
        drive[1] * SPEED_RPM,
        drive[2] * LOAD_N,
        drive[3] * LOAD_N,
    )


def write_figures(m: NodeFigures) -> Fields:
    """Fields of declared figures of actuator and drive."""
    return (
        m.counter,
        m.tick_us,
        m.heartbeat_limit_ms,
        COASTS_ON_SILENCE * bool(m.coasts_on_silence)
        | DRIVE_COMMANDABLE * bool(m.drive_commandable),
        counts(m.clearance_min_um, CLEARANCE_UM),
        counts(m.clearance_max_um, CLEARANCE_UM),
        counts(m.pressure_min_bar, PRESSURE_BAR),
        counts(m.pressure_max_bar, PRESSURE_BAR),
        m.clearance_lag_ms,
        m.pressure_lag_ms,
        m.drive_time_to_live_ms,
        *(counts(rpm, SPEED_RPM, 0, 2**32 - 1) for rpm in (m.speed_min_rpm, m.speed_max_rpm)),
        *(counts(load_N, LOAD_N, 0, 2**32 - 1) for load_N in (m.load_min_N, m.load_max_N)),
    )


def read_drive_command(f: Fields) -> DriveCommand:
    """Record of setpoints for the drive."""
    counter, session, echo, speed, load, speed_ramp, load_ramp = cast(tuple[int, ...], f)
    return DriveCommand(
        counter, session, echo, speed * SPEED_RPM, load * LOAD_N, speed_ramp, load_ramp
    )


def write_drive_command(m: DriveCommand) -> Fields:
    """Fields of setpoints for the drive."""
    return (
        m.counter,
        m.session,
        m.echo_tick_us,
        counts(m.speed_rpm, SPEED_RPM, 0, 2**32 - 1),
        counts(m.load_N, LOAD_N, 0, 2**32 - 1),
        m.speed_ramp_rpm_s,
        m.load_ramp_N_s,
    )


def read_drive_state(f: Fields) -> DriveState | str:
    """Record of what the drive does; a reason where the fields name no state."""
    counter, tick, session, command, mode, speed_to, load_to, speed, load, *refused = cast(
        tuple[int, ...], f
    )
    if mode > max(DriveMode):
        return RANGE
    return DriveState(
        counter,
        tick,
        session,
        command,
        mode,
        speed_to * SPEED_RPM,
        load_to * LOAD_N,
        speed * SPEED_RPM,
        load * LOAD_N,
        *refused,
    )


def write_drive_state(m: DriveState) -> Fields:
    """Fields of what the drive does."""
    return (
        m.counter,
        m.tick_us,
        m.session,
        m.command_counter,
        DriveMode(m.mode),
        counts(m.speed_setpoint_rpm, SPEED_RPM, 0, 2**32 - 1),
        counts(m.load_setpoint_N, LOAD_N, 0, 2**32 - 1),
        counts(m.speed_rpm, SPEED_RPM, -(2**31), 2**31 - 1),
        counts(m.load_N, LOAD_N, -(2**31), 2**31 - 1),
        m.refused_stale,
        m.refused_check,
        m.refused_session,
        m.refused_range,
    )
