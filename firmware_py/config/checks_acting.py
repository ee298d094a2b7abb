"""Set points that never act, or always: above what the shaft can do, below what the sensor can
tell, at speeds that the machine never has, or doing less than the set point below them."""

from __future__ import annotations

from collections.abc import Iterator
from math import pi, sqrt
from typing import Final

from firmware_py import signals
from firmware_py.config.added_measures import added
from firmware_py.config.convert import Found
from firmware_py.config.measure_types import Measure
from firmware_py.config.measures import (
    OUTLET_HIGH,
    OUTLET_LOW,
    PRESSURE_LOW,
    oil,
    probes_at,
    vibration,
)
from firmware_py.config.schema import Config
from firmware_py.records import Severity

WRITTEN: Final = "measure["
"""Keys of limits that a row writes begin so."""

DIAMETRAL_SHARE_MAX: Final = 0.7
"""Of the diametral clearance: a danger limit above is hardly reached before the shaft touches."""

OTHERWISE: Final = {"mm/s": "m/s", "um": "m or mm"}
"""Units in which people write such a value by mistake."""


def _displacement(config: Config) -> Iterator[Found]:
    """A danger limit that the shaft reaches before it touches."""
    key, bearing = "limits.displacement_danger_um", "machine.bearing"
    nominal_um = config.machine.bearing.radial_clearance_nominal_um
    yield from _touches(key, config.limits.displacement_danger_um, nominal_um, bearing)


def _displacement_at(config: Config) -> Iterator[Found]:
    """As it, of the further bearings."""
    names = [each.name for each in config.machine.other_bearing]
    for i, limits in enumerate(config.limits_at):
        if limits.bearing in names:
            place = names.index(limits.bearing)
            nominal_um = config.machine.other_bearing[place].radial_clearance_nominal_um
            key, bearing = f"limits_at[{i}].displacement_danger_um", f"other_bearing[{place}]"
            danger_um = limits.displacement_danger_um
            yield from _touches(key, danger_um, nominal_um, f"machine.{bearing}")


def _displacement_row(config: Config) -> Iterator[Found]:
    """As it, of rows that are written; smax is a radius."""
    if not config.measure:
        return
    machine = config.machine
    seated = {channel.name: channel.bearing for channel in machine.channel}
    names = [each.name for each in machine.other_bearing]
    for row in (*vibration(config), *added(config)):
        point = row.points[-1] if row.points else None
        shaft = row.capped or row.kind in ("amplitude_1x", "amplitude_not_1x")
        if point is None or not shaft or row.sign < 0.0 or not point.key.startswith(WRITTEN):
            continue
        at = seated.get(row.source, row.source)
        if at in names:
            place = names.index(at)
            bearing, key = machine.other_bearing[place], f"machine.other_bearing[{place}]"
            nominal_um = bearing.radial_clearance_nominal_um
        else:
            nominal_um, key = machine.bearing.radial_clearance_nominal_um, "machine.bearing"
        times = 0.5 if row.kind == "smax" else 1.0
        yield from _touches(point.key, point.limit, nominal_um, key, times)


def _touches(
    key: str, limit_um: float, nominal_um: float, bearing: str, times: float = 1.0
) -> Iterator[Found]:
    diametral_um, share = 2.0 * nominal_um, DIAMETRAL_SHARE_MAX * times
    if limit_um > share * diametral_um:
        yield (
            key,
            limit_um,
            (
                f"above {share:g} x diametral clearance ({diametral_um:g} um); lower it or set "
                f"{bearing}.radial_clearance_nominal_um"
            ),
        )


def _told_apart(config: Config) -> Iterator[Found]:
    """A rising set point above what its sensor shows of nothing."""
    if not config.measure:
        return
    for row in (*vibration(config), *added(config)):
        if row.sign < 0.0 or row.kind in ("position", "mean", "reading", "speed"):
            continue
        least = _floor(config, row)
        for point in row.points:
            if point.key.startswith(WRITTEN) and point.limit <= least:
                no = OTHERWISE.get(row.unit)
                yield (
                    point.key,
                    point.limit,
                    (
                        f"not above {least:.3g} {row.unit}, what one count or the noise of its "
                        f"sensor makes: it would stand always; write it in {row.unit}"
                        f"{f', not in {no}' if no else ''}"
                    ),
                )


def _floor(config: Config, row: Measure) -> float:
    """What one count or the noise of the sensor is in a measure, in its unit; 0: no such channel.

    Of a velocity: a sine of one count, or white noise of density ``n^2 / (fs / 2)``, integrated
    from the low end ``f`` of the band on: ``a / (sqrt(2) 2 pi f)`` and ``n / (2 pi) sqrt(2 / (fs
    f))``.
    """
    channels = {channel.name: channel for channel in config.machine.channel}
    if row.kind == "smax":
        channel = config.machine.channel[probes_at(config, row.source)[0]]
    elif row.source in channels:
        channel = channels[row.source]
    else:
        return 0.0
    kind = signals.fast_kind(channel.name, channel.kind)
    count, noise = abs(channel.scale), channel.noise_rms or 0.0
    if row.kind == "velocity_rms":
        low_hz = row.band_low_hz
        count /= sqrt(2.0) * 2.0 * pi * low_hz
        noise *= sqrt(2.0 / (config.sampling.rate_hz * low_hz)) / (2.0 * pi)
        return 1e3 * max(count, noise)
    return max(count, noise) * (kind.wire_per_si if kind else 1.0)


def _never_judged(config: Config) -> Iterator[Found]:
    """Speeds from which on something holds are speeds that the machine has."""
    rows = [(f"measure[{i}]", each.from_rpm) for i, each in enumerate(config.measure)]
    rows += [(f"multiply[{i}]", each.from_rpm) for i, each in enumerate(config.multiply)]
    for key, from_rpm in rows:
        if from_rpm is not None and from_rpm > config.machine.operating.speed_max_rpm:
            cause = (
                f"above machine.operating.speed_max_rpm "
                f"({config.machine.operating.speed_max_rpm:g}): it would never hold; lower it"
            )
            yield f"{key}.from_rpm", from_rpm, cause


def _weaker(config: Config) -> Iterator[Found]:
    if config.measure:
        yield from _danger_weaker(config, (*vibration(config), *added(config)))


def _oil_weaker(config: Config) -> Iterator[Found]:
    if {each.name for each in config.measure} & {PRESSURE_LOW, OUTLET_HIGH, OUTLET_LOW}:
        yield from _danger_weaker(config, oil(config))


def _danger_weaker(config: Config, rows: tuple[Measure, ...]) -> Iterator[Found]:
    """Danger does at least what alert does."""
    written = {each.name: (i, each) for i, each in enumerate(config.measure)}
    for row in rows:
        alert, danger = row.point(Severity.ALERT), row.point(Severity.DANGER)
        if row.name not in written or not alert or not danger or danger.effect >= alert.effect:
            continue
        i, each = written[row.name]
        low, high = alert.effect.name.lower(), danger.effect.name.lower()
        key = "alert_effect" if each.danger_effect is None else "danger_effect"
        cause = f"danger does less ({high}) than alert ({low}) of {row.name}; write {low} or more"
        yield f"measure[{i}].{key}", high, cause


ACTING_CHECKS: Final = (
    _displacement, _displacement_at, _displacement_row, _told_apart, _never_judged, _weaker,
    _oil_weaker,
)  # fmt: skip
