"""Records <-> the integer fields that both wires carry: one conversion, whatever the transport.

A field tuple holds counts in the order of ``orbitd.dbc`` (and of ``orbitd.xml``), counter first.
Reading is total: fields that name no state give the reason of their rejection.  Writing a value
that does not fit is a programming error and raises ``ValueError``.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable
from dataclasses import dataclass
from operator import mul
from struct import Struct
from typing import Final, cast

import msgspec

from firmware_py.records import (
    ArmState,
    Command,
    DeviceHeartbeat,
    DriveCommand,
    DriveMode,
    DriveState,
    Mode,
    NodeFigures,
    NodeInfo,
    NodeMode,
    NodeState,
    ReadingQuality,
    ReadingsFrame,
    RigStatus,
    SampleFrame,
    WireMessage,
)
from firmware_py.wire.layout import PAGES_MAX, WireLayout


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
SPEED_RPM: Final = 0.01
LOAD_N: Final = 0.01
AGE_MS: Final = 10

RANGE: Final = "range"
"""Reject reason of fields that name no state."""
LAYOUT: Final = "layout"
"""Reject reason of a frame of another layout."""

COASTS_ON_SILENCE: Final = 1
DRIVE_COMMANDABLE: Final = 2
INT32_MIN: Final = -(2**31)


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


def _read_state(f: Fields) -> NodeState | str:
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


def _read_info(f: Fields) -> NodeInfo | str:
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


def _read_heartbeat(f: Fields) -> DeviceHeartbeat | str:
    counter, session, mode, arm_state, flags = cast(tuple[int, ...], f)
    if mode > max(Mode) or arm_state > max(ArmState):
        return RANGE
    return DeviceHeartbeat(
        counter, session, mode, arm_state, bool(flags & RUN_PERMIT), bool(flags & TRIP_REQUEST)
    )


def _write_heartbeat(m: DeviceHeartbeat) -> Fields:
    flags = RUN_PERMIT * bool(m.run_permit) | TRIP_REQUEST * bool(m.trip_request)
    return m.counter, m.session, Mode(m.mode), ArmState(m.arm_state), flags


def _read_info_2(f: Fields) -> NodeInfo | str:
    info, layout_hash = _read_info(f[:-1]), cast(int, f[-1])
    return info if isinstance(info, str) else msgspec.structs.replace(info, layout_hash=layout_hash)


def _write_info_2(m: NodeInfo) -> Fields:
    return *_write_info(m), m.layout_hash


def _read_figures(f: Fields) -> NodeFigures | str:
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


def _write_figures(m: NodeFigures) -> Fields:
    return (
        m.counter,
        m.tick_us,
        m.heartbeat_limit_ms,
        COASTS_ON_SILENCE * bool(m.coasts_on_silence)
        | DRIVE_COMMANDABLE * bool(m.drive_commandable),
        _counts(m.clearance_min_um, CLEARANCE_UM),
        _counts(m.clearance_max_um, CLEARANCE_UM),
        _counts(m.pressure_min_bar, PRESSURE_BAR),
        _counts(m.pressure_max_bar, PRESSURE_BAR),
        m.clearance_lag_ms,
        m.pressure_lag_ms,
        m.drive_time_to_live_ms,
        *(_counts(rpm, SPEED_RPM, 0, 2**32 - 1) for rpm in (m.speed_min_rpm, m.speed_max_rpm)),
        *(_counts(load_N, LOAD_N, 0, 2**32 - 1) for load_N in (m.load_min_N, m.load_max_N)),
    )


def _read_drive_command(f: Fields) -> DriveCommand:
    counter, session, echo, speed, load, speed_ramp, load_ramp = cast(tuple[int, ...], f)
    return DriveCommand(
        counter, session, echo, speed * SPEED_RPM, load * LOAD_N, speed_ramp, load_ramp
    )


def _write_drive_command(m: DriveCommand) -> Fields:
    return (
        m.counter,
        m.session,
        m.echo_tick_us,
        _counts(m.speed_rpm, SPEED_RPM, 0, 2**32 - 1),
        _counts(m.load_N, LOAD_N, 0, 2**32 - 1),
        m.speed_ramp_rpm_s,
        m.load_ramp_N_s,
    )


def _read_drive_state(f: Fields) -> DriveState | str:
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


def _write_drive_state(m: DriveState) -> Fields:
    return (
        m.counter,
        m.tick_us,
        m.session,
        m.command_counter,
        DriveMode(m.mode),
        _counts(m.speed_setpoint_rpm, SPEED_RPM, 0, 2**32 - 1),
        _counts(m.load_setpoint_N, LOAD_N, 0, 2**32 - 1),
        _counts(m.speed_rpm, SPEED_RPM, -(2**31), 2**31 - 1),
        _counts(m.load_N, LOAD_N, -(2**31), 2**31 - 1),
        m.refused_stale,
        m.refused_check,
        m.refused_session,
        m.refused_range,
    )


class _Samples:
    """Sample frames of one layout."""

    def __init__(self, layout: WireLayout) -> None:
        self._size, self._tag = layout.samples_bytes, layout.tag

    def read(self, f: Fields) -> SampleFrame | str:
        counter, tick, mark, turns, flags, tag, samples = cast(
            tuple[int, int, int, int, int, int, bytes], f
        )
        if tag != self._tag:
            return LAYOUT
        return SampleFrame(counter, tick, mark, turns, flags & SAMPLE_FLAGS, samples[: self._size])

    def write(self, m: SampleFrame) -> Fields:
        if len(m.samples) != self._size:
            raise ValueError(f"samples hold {len(m.samples)} bytes, this layout has {self._size}")
        if m.flags & ~SAMPLE_FLAGS:
            raise ValueError(f"flags {m.flags:#x} hold bits beyond {SAMPLE_FLAGS:#x}")
        return m.counter, m.tick_us, m.mark_tick_us, m.turn_count, m.flags, self._tag, m.samples


class _Readings:
    """Pages of readings of one layout."""

    def __init__(self, layout: WireLayout) -> None:
        self._tag = layout.tag
        self._pages = [
            (Struct(f"<{len(page)}i"), tuple(row.kind.resolution for row in page))
            for page in map(layout.page, range(min(layout.pages, PAGES_MAX)))
        ]

    def read(self, f: Fields) -> ReadingsFrame | str:
        counter, tick, page, tag, counts, ages, qualities = cast(
            tuple[int, int, int, int, bytes, bytes, bytes], f
        )
        if tag != self._tag:
            return LAYOUT
        if page >= len(self._pages):
            return RANGE
        form, resolutions = self._pages[page]
        n = len(resolutions)
        if max(qualities[:n]) > max(ReadingQuality):
            return RANGE
        values = form.unpack_from(counts)
        return ReadingsFrame(
            counter,
            tick,
            page,
            tuple(map(mul, values, resolutions)),
            tuple(AGE_MS * age for age in ages[:n]),
            tuple(qualities[:n]),
        )

    def write(self, m: ReadingsFrame) -> Fields:
        if not 0 <= m.page < len(self._pages):
            raise ValueError(f"page {m.page}: this layout has {len(self._pages)}")
        form, resolutions = self._pages[m.page]
        if not len(m.values) == len(m.ages_ms) == len(m.qualities) == len(resolutions):
            raise ValueError(f"page {m.page} has {len(resolutions)} readings")
        counts = form.pack(
            *(
                _counts(value, resolution, INT32_MIN, 2**31 - 1)
                for value, resolution in zip(m.values, resolutions, strict=True)
            )
        )
        ages = bytes(min(age // AGE_MS, 255) for age in m.ages_ms)
        qualities = bytes(ReadingQuality(quality) for quality in m.qualities)
        return m.counter, m.tick_us, m.page, self._tag, counts, ages, qualities


@dataclass(frozen=True, slots=True)
class Conversion:
    """Between one record type and its fields; ``layout`` is their :mod:`struct` format, counter
    first."""

    layout: str
    read: Callable[[Fields], WireMessage | str]
    write: Callable[..., Fields]
    elements: tuple[int, ...] = ()
    """Bytes per element of each array in ``layout``."""


_COMMON: Final[dict[type, Conversion]] = {
    DeviceHeartbeat: Conversion("HIBBB", _read_heartbeat, _write_heartbeat),
    Command: Conversion("HIIHH", _read_command, _write_command),
    NodeState: Conversion("HIIHBBHHHHHH", _read_state, _write_state),
}
"""Messages that both schemas have in common."""

NODE_INFO_1: Final = Conversion("HIHHHHHH", _read_info, _write_info)
NODE_INFO_2: Final = Conversion("HIHHHHHHI", _read_info_2, _write_info_2)


def conversions(
    layout: WireLayout, slots: int | None = None, samples_bytes: int | None = None
) -> dict[type, Conversion]:
    """Every message of ``layout``'s schema.

    Parameters
    ----------
    slots, samples_bytes
        Of the arrays on a wire whose messages have one size for all rigs; as the layout has them
        when None.
    """
    if layout.schema == 1:
        return _COMMON | {
            RigStatus: Conversion("HIihHH", _read_status, _write_status),
            SampleFrame: Conversion("HIIHH48s", _read_samples, _write_samples, (2,)),
            NodeInfo: NODE_INFO_1,
        }
    samples, readings = _Samples(layout), _Readings(layout)
    n = layout.slots if slots is None else slots
    size = layout.samples_bytes if samples_bytes is None else samples_bytes
    return _COMMON | {
        DriveCommand: Conversion("HIIIIHH", _read_drive_command, _write_drive_command),
        DriveState: Conversion("HIIHBxIIiiHHHH", _read_drive_state, _write_drive_state),
        ReadingsFrame: Conversion(
            f"HIBB2x{4 * n}s{n}s{n}s", readings.read, readings.write, (4, 1, 1)
        ),
        SampleFrame: Conversion(f"HIIHBB{size}s", samples.read, samples.write, (2,)),
        NodeInfo: NODE_INFO_2,
        NodeFigures: Conversion("HIHBxHHHHHHH2xIIII", _read_figures, _write_figures),
    }
