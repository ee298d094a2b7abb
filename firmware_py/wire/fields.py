"""Records <-> the integer fields that both wires carry: one conversion, whatever the transport.

A field tuple holds counts in the order of ``orbitd.dbc`` (and of ``orbitd.xml``), counter first.
Reading is total: fields that name no state give None.  Writing a value that does not fit is a
programming error and raises ``ValueError``.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, cast

from firmware_py.records import (
    ArmState,
    Command,
    DeviceHeartbeat,
    Mode,
    NodeInfo,
    NodeMode,
    NodeState,
    RigStatus,
    SampleFrame,
    WireMessage,
)

SCHEMA: Final = 1
"""Version of the interface that ``orbitd.dbc`` and ``orbitd.xml`` describe
(``NodeInfo.schema``)."""


class SampleFlag(enum.IntFlag):
    """Bits of ``SampleFrame.flags``."""

    BEHIND = 1
    MARK_VALID = 2
    COASTING = 4


SAMPLE_FLAGS: Final = 0x7
RUN_PERMIT: Final = 1
TRIP_REQUEST: Final = 2

# Resolution of each scaled field (unit per count).
CLEARANCE_UM: Final = 0.01
PRESSURE_BAR: Final = 0.001
POWER_W: Final = 0.01
TEMPERATURE_C: Final = 0.01
RATE_UM_S: Final = 0.1


def _counts(value: float, resolution: float, low: int = 0, high: int = 0xFFFF) -> int:
    """``value`` in counts of ``resolution``; ValueError when it is not finite or does not fit."""
    if not (math.isfinite(value) and low <= (counts := round(value / resolution)) <= high):
        raise ValueError(
            f"{value} does not fit a field of {low * resolution:g} .. {high * resolution:g}"
        )
    return counts


# Fields as the struct module gives and takes them: without the CRC, counter first.
Fields = tuple[int | bytes, ...]


def _read_samples(f: Fields) -> SampleFrame:
    counter, tick, mark, turns, flags, samples = cast(tuple[int, int, int, int, int, bytes], f)
    return SampleFrame(counter, tick, mark, turns, flags & SAMPLE_FLAGS, samples)


def _write_samples(m: SampleFrame) -> Fields:
    if len(m.samples) != 48:
        raise ValueError(f"samples hold {len(m.samples)} bytes, not 3 x 8 x 2 = 48")
    if m.flags & ~SAMPLE_FLAGS:
        raise ValueError(f"flags {m.flags:#x} hold bits beyond {SAMPLE_FLAGS:#x}")
    return m.counter, m.tick_us, m.mark_tick_us, m.turn_count, m.flags, m.samples


def _read_status(f: Fields) -> RigStatus:
    counter, tick, power, oil, clearance, pressure = cast(tuple[int, ...], f)
    return RigStatus(
        counter,
        tick,
        power * POWER_W,
        oil * TEMPERATURE_C,
        clearance * CLEARANCE_UM,
        pressure * PRESSURE_BAR,
    )


def _write_status(m: RigStatus) -> Fields:
    return (
        m.counter,
        m.tick_us,
        _counts(m.shaft_power_W, POWER_W, -(2**31), 2**31 - 1),
        _counts(m.oil_outlet_C, TEMPERATURE_C, -(2**15), 2**15 - 1),
        _counts(m.clearance_actual_um, CLEARANCE_UM),
        _counts(m.pressure_actual_bar, PRESSURE_BAR),
    )


def _read_state(f: Fields) -> NodeState | None:
    counter, tick, session, command, mode, arrived, clearance, pressure, *refused = cast(
        tuple[int, ...], f
    )
    if mode > max(NodeMode) or arrived > 1:
        return None
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


def _write_state(m: NodeState) -> Fields:
    return (
        m.counter,
        m.tick_us,
        m.session,
        m.command_counter,
        NodeMode(m.mode),
        bool(m.at_target),
        _counts(m.target_clearance_um, CLEARANCE_UM),
        _counts(m.target_pressure_bar, PRESSURE_BAR),
        m.refused_stale,
        m.refused_check,
        m.refused_session,
        m.refused_range,
    )


def _read_info(f: Fields) -> NodeInfo | None:
    counter, tick, schema, period, clearance, pressure, time_to_live, rate = cast(
        tuple[int, ...], f
    )
    if not (period and time_to_live):
        return None
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


def _write_info(m: NodeInfo) -> Fields:
    if not (m.sample_period_us and m.time_to_live_ms):
        raise ValueError("sample_period_us and time_to_live_ms are at least 1")
    return (
        m.counter,
        m.tick_us,
        m.schema,
        m.sample_period_us,
        _counts(m.boot_clearance_um, CLEARANCE_UM),
        _counts(m.boot_pressure_bar, PRESSURE_BAR),
        m.time_to_live_ms,
        _counts(m.rate_um_s, RATE_UM_S),
    )


def _read_command(f: Fields) -> Command:
    counter, session, echo, clearance, pressure = cast(tuple[int, ...], f)
    return Command(counter, session, echo, clearance * CLEARANCE_UM, pressure * PRESSURE_BAR)


def _write_command(m: Command) -> Fields:
    return (
        m.counter,
        m.session,
        m.echo_tick_us,
        _counts(m.clearance_um, CLEARANCE_UM),
        _counts(m.pressure_bar, PRESSURE_BAR),
    )


def _read_heartbeat(f: Fields) -> DeviceHeartbeat | None:
    counter, session, mode, arm_state, flags = cast(tuple[int, ...], f)
    if mode > max(Mode) or arm_state > max(ArmState):
        return None
    return DeviceHeartbeat(
        counter, session, mode, arm_state, bool(flags & RUN_PERMIT), bool(flags & TRIP_REQUEST)
    )


def _write_heartbeat(m: DeviceHeartbeat) -> Fields:
    flags = RUN_PERMIT * bool(m.run_permit) | TRIP_REQUEST * bool(m.trip_request)
    return m.counter, m.session, Mode(m.mode), ArmState(m.arm_state), flags


@dataclass(frozen=True, slots=True)
class Conversion:
    """Between one record type and its fields; ``layout`` is their :mod:`struct` format, counter
    first."""

    layout: str
    read: Callable[[Fields], WireMessage | None]
    write: Callable[..., Fields]


CONVERSIONS: Final[dict[type, Conversion]] = {
    DeviceHeartbeat: Conversion("HIBBB", _read_heartbeat, _write_heartbeat),
    Command: Conversion("HIIHH", _read_command, _write_command),
    NodeState: Conversion("HIIHBBHHHHHH", _read_state, _write_state),
    RigStatus: Conversion("HIihHH", _read_status, _write_status),
    SampleFrame: Conversion("HIIHH48s", _read_samples, _write_samples),
    NodeInfo: Conversion("HIHHHHHH", _read_info, _write_info),
}
