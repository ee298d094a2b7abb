"""Fields of the messages of actuator node and device."""

from __future__ import annotations

from typing import Final, cast

import msgspec

from firmware_py.records import (
    ArmState,
    Command,
    DeviceHeartbeat,
    Mode,
    NodeInfo,
    NodeMode,
    NodeState,
    RigStatus,
)
from firmware_py.wire.counts import (
    CLEARANCE_UM,
    POWER_W,
    PRESSURE_BAR,
    RANGE,
    RATE_UM_S,
    TEMPERATURE_C,
    Fields,
    counts,
)

RUN_PERMIT: Final = 1
TRIP_REQUEST: Final = 2


def read_status(f: Fields) -> RigStatus:
    """Record of slow readings of schema 1."""
    counter, tick, power, oil, clearance, pressure = cast(tuple[int, ...], f)
    return RigStatus(
        counter,
        tick,
        power * POWER_W,
        oil * TEMPERATURE_C,
        clearance * CLEARANCE_UM,
        pressure * PRESSURE_BAR,
    )


def write_status(m: RigStatus) -> Fields:
    """Fields of slow readings of schema 1."""
    return (
        m.counter,
        m.tick_us,
        counts(m.shaft_power_W, POWER_W, -(2**31), 2**31 - 1),
        counts(m.oil_outlet_C, TEMPERATURE_C, -(2**15), 2**15 - 1),
        counts(m.clearance_actual_um, CLEARANCE_UM),
        counts(m.pressure_actual_bar, PRESSURE_BAR),
    )


def read_state(f: Fields) -> NodeState | str:
    """Record of what the node follows; a reason where the fields name no state."""
    counter, tick, session, command, mode, arrived, clearance, pressure, *refused = cast(
        tuple[int, ...], f
    )
    if mode > max(NodeMode) or arrived > 1:
        return RANGE
    return NodeState(
        counter,
        tick,
        mode,
        session,
        command,
        clearance * CLEARANCE_UM,
        pressure * PRESSURE_BAR,
        bool(arrived),
        *refused,
    )


def write_state(m: NodeState) -> Fields:
    """Fields of what the node follows."""
    return (
        m.counter,
        m.tick_us,
        m.session,
        m.command_counter,
        NodeMode(m.mode),
        bool(m.at_target),
        counts(m.target_clearance_um, CLEARANCE_UM),
        counts(m.target_pressure_bar, PRESSURE_BAR),
        m.refused_stale,
        m.refused_check,
        m.refused_session,
        m.refused_range,
    )


def read_info(f: Fields) -> NodeInfo | str:
    """Record of what the node is; a reason where the fields name no state."""
    counter, tick, schema, period, clearance, pressure, time_to_live, rate = cast(
        tuple[int, ...], f
    )
    if not (period and time_to_live):
        return RANGE
    return NodeInfo(
        counter,
        tick,
        schema,
        period,
        clearance * CLEARANCE_UM,
        pressure * PRESSURE_BAR,
        time_to_live,
        rate * RATE_UM_S,
    )


def write_info(m: NodeInfo) -> Fields:
    """Fields of what the node is."""
    if not (m.sample_period_us and m.time_to_live_ms):
        raise ValueError("sample_period_us and time_to_live_ms are at least 1")
    return (
        m.counter,
        m.tick_us,
        m.schema,
        m.sample_period_us,
        counts(m.boot_clearance_um, CLEARANCE_UM),
        counts(m.boot_pressure_bar, PRESSURE_BAR),
        m.time_to_live_ms,
        counts(m.rate_um_s, RATE_UM_S),
    )


def read_command(f: Fields) -> Command:
    """Record of a target for the actuator."""
    counter, session, echo, clearance, pressure = cast(tuple[int, ...], f)
    return Command(counter, session, echo, clearance * CLEARANCE_UM, pressure * PRESSURE_BAR)


def write_command(m: Command) -> Fields:
    """Fields of a target for the actuator."""
    return (
        m.counter,
        m.session,
        m.echo_tick_us,
        counts(m.clearance_um, CLEARANCE_UM),
        counts(m.pressure_bar, PRESSURE_BAR),
    )


def read_heartbeat(f: Fields) -> DeviceHeartbeat | str:
    """Record of the device's heartbeat; a reason where the fields name no state."""
    counter, session, mode, arm_state, flags = cast(tuple[int, ...], f)
    if mode > max(Mode) or arm_state > max(ArmState):
        return RANGE
    return DeviceHeartbeat(
        counter, session, mode, arm_state, bool(flags & RUN_PERMIT), bool(flags & TRIP_REQUEST)
    )


def write_heartbeat(m: DeviceHeartbeat) -> Fields:
    """Fields of the device's heartbeat."""
    flags = RUN_PERMIT * bool(m.run_permit) | TRIP_REQUEST * bool(m.trip_request)
    return m.counter, m.session, Mode(m.mode), ArmState(m.arm_state), flags


def read_info_2(f: Fields) -> NodeInfo | str:
    """As :func:`read_info`, with the hash of the layout."""
    info, layout_hash = read_info(f[:-1]), cast(int, f[-1])
    return info if isinstance(info, str) else msgspec.structs.replace(info, layout_hash=layout_hash)


def write_info_2(m: NodeInfo) -> Fields:
    """Fields of what the node is, with the hash of the layout."""
    return *write_info(m), m.layout_hash
