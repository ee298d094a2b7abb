"""The table of measures of a machine: every value that is held against alert and danger, and how
danger votes.

Derived from ``[limits]`` and the channels; ``[[measure]]`` changes rows, ``[[group]]`` makes them
vote.  Protection judges by these rows and has no other limits, and ``orbitd protection matrix``
prints them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

import msgspec

from firmware_py import signals
from firmware_py.config.added_measures import added
from firmware_py.config.bearings import probes_of
from firmware_py.config.measure_schema import GroupConfig, MeasureConfig
from firmware_py.config.measure_types import Effect, Group, JudgedWhile, Measure, SetPoint, written
from firmware_py.config.schema import Config, Limits
from firmware_py.machine import FastChannel
from firmware_py.machine.lubricant import coldest_outlet_C
from firmware_py.machine.parts import FEED, LUBRICANT, has
from firmware_py.records import Severity

SPEED_HIGH: Final = "speed_high"
PRESSURE_LOW, OUTLET_HIGH, OUTLET_LOW = "oil_pressure_low", "oil_outlet_high", "oil_outlet_low"

SPEED_HIGH_SHARE: Final = 1.1
"""Of operating.speed_max_rpm, where limits.speed_high_rpm is 0: usual for trips of
turbomachinery."""

PROBES: Final = 2
"""Displacement probes of a bearing, first among its channels."""


# ---------------------------------------------------------------------- the rows


def measures(config: Config) -> tuple[Measure, ...]:
    """Every measure of the machine, in the order in which they are judged."""
    return (*vibration(config), *oil(config), speed_high(config), *added(config))


def groups(config: Config) -> tuple[Group, ...]:
    """Every group: those that are declared, then each measure that trips alone."""
    declared = tuple(
        Group(g.name, tuple(g.measures), g.vote, Effect[g.all_not_ok.upper()], True)
        for g in config.group
    )
    taken = voted(config.group)
    alone = tuple(
        Group(point.alarm, (each.name,), "1oo1", Effect.ALARM, False)
        for each in measures(config)
        if each.name not in taken
        and (point := each.point(Severity.DANGER)) is not None
        and point.effect is Effect.TRIP
    )
    return declared + alone


def probes_at(config: Config, bearing: str) -> tuple[int, int]:
    """Places of the two displacement probes of a bearing, by its name."""
    others = {each.name: probes_of(config.machine, each) for each in config.machine.other_bearing}
    if bearing in others:
        first, second = others[bearing]
        return first, second
    taken = {i for places in others.values() for i in places}
    first, second, *_ = (i for i in range(len(config.machine.channel)) if i not in taken)
    return first, second


def may_bypass(config: Config) -> tuple[str, ...]:
    """Measures and groups that a person may bypass."""
    return (
        *(each.name for each in config.measure if each.may_bypass),
        *(each.name for each in config.group if each.may_bypass),
    )


def voted(found: Iterable[GroupConfig]) -> frozenset[str]:
    """Names of the measures whose danger votes."""
    return frozenset(name for group in found for name in group.measures)


def vibration(config: Config) -> tuple[Measure, ...]:
    """Peak-to-peak of each displacement probe and rms of each acceleration, bearing by bearing."""
    machine, limits = config.machine, config.limits
    own = {each.bearing: each for each in config.limits_at}
    others = [(each.name, probes_of(machine, each)) for each in machine.other_bearing]
    taken = {i for _, places in others for i in places}
    first = [channel for i, channel in enumerate(machine.channel) if i not in taken]
    shared = (limits.displacement_alert_um, limits.displacement_danger_um)
    rows = [_displacement(limits, channel, shared, "limits") for channel in first[:PROBES]]
    rows += [_acceleration(limits, each) for each in first if _kind(each) == "acceleration"]
    for name, places in others:
        at, place = shared, "limits"
        if name in own:
            at = (own[name].displacement_alert_um, own[name].displacement_danger_um)
            place = "limits_at"
        rows += [_displacement(limits, machine.channel[i], at, place) for i in places]
    return _changed(rows, config.measure)


def oil(config: Config) -> tuple[Measure, ...]:
    """Supply pressure and outlet, as far as there are limits for them.

    Where feed or lubricant are not described, the limits that are written; hysteresis then counts
    from twice the pressure, and from 0 degC.
    """
    machine, lim = config.machine, config.limits
    feed, lubricant = has(machine, FEED), has(machine, LUBRICANT)
    low_bar, hot_C = config.oil_pressure_limits_bar, config.oil_outlet_limits_C
    most_bar = machine.feed.pressure_max_bar if feed else 2.0 * max(low_bar)
    pressure = _points(
        PRESSURE_LOW, lim, low_bar, "limits.oil_pressure_low_{}_bar", JudgedWhile.TURNING,
        (bool(feed or lim.oil_pressure_low_alert_bar),
         bool(feed or lim.oil_pressure_low_danger_bar)),
    )  # fmt: skip
    outlet = _points(
        OUTLET_HIGH, lim, hot_C, "limits.oil_outlet_high_{}_C", JudgedWhile.ALWAYS,
        (bool(lubricant or lim.oil_outlet_high_alert_C),
         bool(lubricant or lim.oil_outlet_high_danger_C)),
    )  # fmt: skip
    share, film_C = lim.hysteresis_share, machine.lubricant.film_max_C
    cold_C = machine.lubricant.inlet_min_C if lubricant else 0.0
    cold = _points(
        OUTLET_LOW, lim, (coldest_outlet_C(machine), 0.0), "oil.inlet_min_C", JudgedWhile.ALWAYS,
        (lubricant, False),
    )  # fmt: skip
    rows = [
        Measure(
            PRESSURE_LOW, "supply_pressure", "supply pressure", "bar", pressure, share, -1.0,
            most_bar,
        ),
        Measure(OUTLET_HIGH, "oil_outlet", "oil outlet", "degC", outlet, share, 1.0, cold_C),
        Measure(OUTLET_LOW, "oil_outlet", "oil outlet", "degC", cold, share, -1.0, film_C),
    ]  # fmt: skip
    return _changed([row for row in rows if row.points], config.measure)


def speed_high(config: Config) -> Measure:
    """The speed-high trip, whose delay is counted in turns; it trips alone, whatever is
    declared."""
    limit_rpm = config.limits.speed_high_rpm or (
        SPEED_HIGH_SHARE * config.machine.operating.speed_max_rpm
    )
    danger = SetPoint(
        SPEED_HIGH, Severity.DANGER, limit_rpm, 0, True, Effect.TRIP, "limits.speed_high_rpm"
    )
    return Measure(SPEED_HIGH, "mark", "shaft speed", "rpm", (danger,), 0.0)


# ---------------------------------------------------------------------- one row


def _kind(channel: FastChannel) -> str:
    kind = signals.fast_kind(channel.name, channel.kind)
    return kind.name if kind else ""


def _displacement(
    limits: Limits, channel: FastChannel, at: tuple[float, float], place: str
) -> Measure:
    key = f"{place}.displacement_{{}}_um"
    points = _points(channel.name, limits, at, key, JudgedWhile.ALWAYS)
    return Measure(
        channel.name, channel.name, "displacement, peak-to-peak", "um", points,
        limits.hysteresis_share, capped=True,
    )  # fmt: skip


def _acceleration(limits: Limits, channel: FastChannel) -> Measure:
    at = (limits.acceleration_alert_m_s2, limits.acceleration_danger_m_s2)
    key = "limits.acceleration_{}_m_s2"
    points = _points(channel.name, limits, at, key, JudgedWhile.ALWAYS)
    return Measure(
        channel.name, channel.name, "acceleration, rms", "m/s2", points, limits.hysteresis_share
    )


def _points(
    name: str,
    limits: Limits,
    at: tuple[float, float],
    key: str,
    judged: JudgedWhile,
    there: tuple[bool, bool] = (True, True),
) -> tuple[SetPoint, ...]:
    """Alert and danger of a measure; the oil's alerts take authority, and its pressure is needed
    while the shaft turns."""
    oily = name in (PRESSURE_LOW, OUTLET_HIGH, OUTLET_LOW)
    alert = SetPoint(
        f"{name}_alert", Severity.ALERT, at[0], round(limits.alert_delay_s * 1e9), False,
        Effect.AUTHORITY if oily else Effect.ALARM, key.format("alert"),
    )  # fmt: skip
    danger = SetPoint(
        f"{name}_danger", Severity.DANGER, at[1], round(limits.danger_delay_s * 1e9), True,
        Effect.TRIP, key.format("danger"), judged,
    )  # fmt: skip
    return tuple(point for point, here in zip((alert, danger), there, strict=True) if here)


def _changed(rows: Sequence[Measure], by: Sequence[MeasureConfig]) -> tuple[Measure, ...]:
    """``rows`` with what ``[[measure]]`` writes."""
    written = {each.name: (i, each) for i, each in enumerate(by)}
    return tuple(
        _row_changed(row, *written[row.name]) if row.name in written else row for row in rows
    )


def _row_changed(row: Measure, place: int, by: MeasureConfig) -> Measure:
    points = tuple(_point_changed(point, place, by) for point in row.points)
    share = row.hysteresis if by.hysteresis_share is None else by.hysteresis_share
    return msgspec.structs.replace(row, points=points, hysteresis=share)


def _point_changed(point: SetPoint, place: int, by: MeasureConfig) -> SetPoint:
    own = written(by, point.severity)
    key = f"measure[{place}].{point.severity.name.lower()}"
    return msgspec.structs.replace(
        point,
        limit=point.limit if own.limit is None else own.limit,
        key=point.key if own.limit is None else key,
        delay_ns=point.delay_ns if own.delay_s is None else round(own.delay_s * 1e9),
        effect=point.effect if own.effect is None else Effect[own.effect.upper()],
        latching=point.latching if own.latching is None else own.latching,
    )
