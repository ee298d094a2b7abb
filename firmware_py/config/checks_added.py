"""Measures that ``[[measure]]`` adds: a source that has the quantity, a unit that fits, set points
in order and within what the sensor can show."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from math import pi, sqrt
from typing import Final

from firmware_py import signals
from firmware_py.config.added_measures import ORBITS, SOURCES, unit_of_measure
from firmware_py.config.checks_channel import READABLE_SHARE
from firmware_py.config.convert import Found
from firmware_py.config.measure_schema import MeasureConfig
from firmware_py.config.schema import Config
from firmware_py.machine import FastChannel
from firmware_py.machine.parts import CLEARANCE, READINGS, has, part_of

RANGE_TIMES: Final = 5.0
"""The range of a vibration sensor is at least so many times the danger set point (peak)."""

BAND_HIGH_SHARE: Final = 0.1
"""Of the sampling rate: the low end of a band lies below, or nothing is left of the band."""


def _rows(config: Config) -> Iterator[tuple[int, MeasureConfig]]:
    return ((i, each) for i, each in enumerate(config.measure) if each.quantity is not None)


def _channel(config: Config, name: str) -> FastChannel | None:
    return next((each for each in config.machine.channel if each.name == name), None)


def _kind(channel: FastChannel | None) -> signals.FastKind | None:
    return signals.fast_kind(channel.name, channel.kind) if channel else None


def _sources(config: Config) -> Iterator[Found]:
    """Every source is there and has the quantity, and the unit is that of the quantity."""
    for i, each in _rows(config):
        quantity, fault = each.quantity or "", _source_fault(config, each)
        if fault:
            yield f"measure[{i}].source", each.source or '""', fault
            continue
        unit = unit_of_measure(config, quantity, each.source)
        if each.unit != unit:
            cause = f"{quantity} of {each.source or 'this machine'} is in {unit}; write {unit}"
            yield f"measure[{i}].unit", each.unit or '""', f"{cause}, and the set points in it"


def _source_fault(config: Config, each: MeasureConfig) -> str:
    """Why ``source`` has no such quantity; empty when it has."""
    machine, quantity = config.machine, each.quantity or ""
    if quantity == "speed":
        return "the speed is that of the mark; leave it out" if each.source else ""
    if quantity == "reading":
        if not has(machine, READINGS) or not unit_of_measure(config, quantity, each.source):
            return "no slow reading of that name; correct it, or add a [[reading]]"
        return ""
    if quantity in ORBITS:
        names = [machine.bearing.name, *(other.name for other in machine.other_bearing)]
        if each.source and each.source not in names:
            known = ", ".join(name for name in names if name) or "only one, without a name"
            return f"no bearing of that name, there are: {known}; correct it"
        others = names[1:]
        part = part_of(CLEARANCE, each.source) if each.source in others else CLEARANCE
        if quantity == "position" and part in machine.absent:
            return "the clearance of the bearing is not known; describe it, or remove the measure"
        return ""
    kind = _kind(_channel(config, each.source))
    if kind is None:
        return "no channel of that name; correct it"
    kinds = SOURCES[quantity]
    if kinds and kind.name not in kinds:
        return f"a channel of {kind.name} has no {quantity}, only {' and '.join(kinds)}; correct it"
    return ""


def _levels(config: Config) -> Iterator[Found]:
    """Set points are there and in order."""
    for i, each in _rows(config):
        if each.alert is None and each.danger is None:
            yield f"measure[{i}].danger", None, "neither alert nor danger; set one"
        yield from _window(i, each) if each.sense == "window" else _one_side(i, each)
        if each.from_rpm is not None and each.to_rpm is not None and each.from_rpm >= each.to_rpm:
            cause = f"not below to_rpm ({each.to_rpm:g}); lower it"
            yield f"measure[{i}].from_rpm", each.from_rpm, cause


def _one_side(i: int, each: MeasureConfig) -> Iterator[Found]:
    for key, low in (("alert_low", each.alert_low), ("danger_low", each.danger_low)):
        if low is not None:
            yield f"measure[{i}].{key}", low, "the lower end of a window; write sense = window"
    alert, danger = each.alert, each.danger
    if alert is None or danger is None:
        return
    sign, side = (-1.0, "below") if each.sense == "falling" else (1.0, "above")
    if sign * (danger - alert) <= 0.0:
        yield f"measure[{i}].danger", danger, f"not {side} alert ({alert:g}); part them"


def _window(i: int, each: MeasureConfig) -> Iterator[Found]:
    ends = [("danger_low", each.danger_low), ("alert_low", each.alert_low),
            ("alert", each.alert), ("danger", each.danger)]  # fmt: skip
    for low, high in (("alert_low", "alert"), ("danger_low", "danger")):
        there = dict(ends)
        if (there[low] is None) != (there[high] is None):
            missing = low if there[low] is None else high
            yield f"measure[{i}].{missing}", None, "a window has two ends; set it"
    written = [(key, value) for key, value in ends if value is not None]
    for (lower, low_value), (upper, value) in pairwise(written):
        if low_value >= value:
            cause = f"not above {lower} ({low_value:g}); part them"
            yield f"measure[{i}].{upper}", value, cause


def _seen(config: Config) -> Iterator[Found]:
    """The sensor shows the danger set point, a velocity five times of it."""
    for i, each in _rows(config):
        channel = _channel(config, each.source)
        kind = _kind(channel)
        if channel is None or kind is None or each.danger is None:
            continue
        ends = (channel.ok_low * kind.wire_per_si, channel.ok_high * kind.wire_per_si)
        peak = min(abs(ends[0]), abs(ends[1]))
        if each.quantity == "velocity_rms" or kind.name == "velocity":
            yield from _range(config, i, each, kind.name, peak)
        elif each.quantity == "mean":
            if not ends[0] < each.danger < ends[1]:
                cause = f"outside {ends[0]:g} .. {ends[1]:g} {each.unit}, what {channel.name} shows"
                yield f"measure[{i}].danger", each.danger, f"{cause}; correct it"
        else:
            most = READABLE_SHARE * ((ends[1] - ends[0]) if each.unit == "um" else peak)
            if not 0.0 < each.danger <= most:
                cause = f"outside 0 .. {most:g} {each.unit}, what {channel.name} can show"
                yield f"measure[{i}].danger", each.danger, f"{cause}; correct it"


def _range(config: Config, i: int, each: MeasureConfig, kind: str, peak: float) -> Iterator[Found]:
    """Range of the sensor over the peak of the danger set point; of an acceleration at the greatest
    declared speed."""
    danger = each.danger or 0.0
    needed, unit = RANGE_TIMES * sqrt(2.0) * danger, "mm/s"
    if kind == "acceleration":
        needed *= 1e-3 * config.machine.operating.speed_max_rpm * pi / 30.0
        unit = "m/s2"
    if peak < needed:
        cause = (
            f"its peak times {RANGE_TIMES:g} is {needed:.4g} {unit}, {each.source} shows up to "
            f"{peak:.4g}; fit a sensor of a wider range, or lower it"
        )
        yield f"measure[{i}].danger", danger, cause


def _band(config: Config) -> Iterator[Found]:
    for i, each in _rows(config):
        most = BAND_HIGH_SHARE * config.sampling.rate_hz
        if each.quantity == "velocity_rms" and each.band_low_hz > most:
            cause = f"above {most:g} Hz, {BAND_HIGH_SHARE:g} of sampling.rate_hz; lower it"
            yield f"measure[{i}].band_low_hz", each.band_low_hz, cause
        elif each.quantity == "velocity_rms" and each.band_low_hz > (
            first := config.machine.operating.speed_max_rpm / 60.0
        ):
            cause = (
                f"above {first:g} Hz, the first order at machine.operating.speed_max_rpm: "
                "unbalance is never in the band; lower it"
            )
            yield f"measure[{i}].band_low_hz", each.band_low_hz, cause


ADDED_CHECKS: Final = (_sources, _levels, _seen, _band)
