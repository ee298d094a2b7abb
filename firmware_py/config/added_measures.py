"""The rows that ``[[measure]]`` adds to the table: what is measured of which source, in which
unit."""

from __future__ import annotations

from math import inf
from typing import Final

from firmware_py import signals
from firmware_py.config.instances import slow_signals
from firmware_py.config.measure_schema import MeasureConfig
from firmware_py.config.measure_types import Effect, JudgedWhile, Measure, SetPoint, written
from firmware_py.config.schema import Config
from firmware_py.machine import FastChannel
from firmware_py.records import Severity


def added(config: Config) -> tuple[Measure, ...]:
    """The rows that ``[[measure]]`` adds: those with a quantity."""
    return tuple(
        _added(config, i, each)
        for i, each in enumerate(config.measure)
        if each.quantity is not None
    )


SMAX_SHARE: Final = 0.5
"""Smax is a radius: its cap by the clearance is half of that of a peak-to-peak."""

UNITS: Final = {
    "peak_to_peak": "um", "amplitude_1x": "um", "amplitude_not_1x": "um", "smax": "um",
    "position": "share", "velocity_rms": "mm/s", "speed": "rpm",
}  # fmt: skip
"""Unit of each quantity; of the others, that of the kind of channel."""

ORBITS: Final = ("smax", "position")
"""Quantities of a bearing."""

SOURCES: Final = {
    "peak_to_peak": ("displacement",),
    "amplitude_1x": ("displacement",),
    "amplitude_not_1x": ("displacement",),
    "velocity_rms": ("acceleration",),
    "rms": ("acceleration", "velocity"),
    "mean": (),
}
"""Kinds of channels that have a quantity; empty: all."""

QUANTITIES: Final = {
    "peak_to_peak": "displacement, peak-to-peak",
    "amplitude_1x": "displacement 1X, peak-to-peak",
    "amplitude_not_1x": "displacement without 1X, peak-to-peak",
    "smax": "maximum of the orbit from its mean",
    "position": "mean position over the clearance",
    "rms": "rms",
    "velocity_rms": "velocity, rms, integrated",
    "mean": "mean",
    "reading": "reading",
    "speed": "shaft speed",
}
"""Each quantity for people."""


def unit_of_measure(config: Config, quantity: str, source: str) -> str:
    """Unit of a quantity of ``source``; empty where ``source`` has no such quantity."""
    if quantity == "reading":
        return next((s.kind.unit for s in slow_signals(config) if s.name == source), "")
    if quantity in ("mean", "rms"):
        return next((_si(config, c) for c in config.machine.channel if c.name == source), "")
    return UNITS[quantity]


def _si(config: Config, channel: FastChannel) -> str:
    """Unit in which people read a channel: a velocity in mm/s, a displacement in um."""
    kind = signals.fast_kind(channel.name, channel.kind)
    return kind.wire_unit if kind else ""


def _added(config: Config, i: int, by: MeasureConfig) -> Measure:
    """An added measure; its hysteresis counts from zero."""
    lim, word = config.limits, by.quantity or ""
    judged, points = JudgedWhile[by.judged.upper()], []
    for level, severity, delay_s in (
        ("alert", Severity.ALERT, lim.alert_delay_s),
        ("danger", Severity.DANGER, lim.danger_delay_s),
    ):  # fmt: skip
        own, danger = written(by, severity), severity is Severity.DANGER
        if own.limit is None:
            continue
        points.append(
            SetPoint(
                f"{by.name}_{level}", severity, own.limit,
                round((delay_s if own.delay_s is None else own.delay_s) * 1e9),
                danger and own.latching is not False,
                Effect[own.effect.upper()] if own.effect
                else Effect.TRIP if danger else Effect.ALARM,
                f"measure[{i}].{level}", judged, own.low if by.sense == "window" else None,
            )
        )  # fmt: skip
    share = lim.hysteresis_share if by.hysteresis_share is None else by.hysteresis_share
    return Measure(
        by.name, by.source or ("mark" if word == "speed" else config.machine.bearing.name),
        QUANTITIES[word], by.unit, tuple(points), share,
        -1.0 if by.sense == "falling" else 1.0,
        _falls_from(by) if by.sense == "falling" else 0.0,
        word in ("peak_to_peak", "smax"), word,
        (by.from_rpm or 0.0, inf if by.to_rpm is None else by.to_rpm), by.band_low_hz,
    )  # fmt: skip


def _falls_from(by: MeasureConfig) -> float:
    """Value from which the hysteresis of a falling measure counts: twice its highest set point,
    so that it ends the share of a set point above it."""
    return 2.0 * max(abs(each) for each in (by.alert, by.danger, 0.0) if each is not None)
