"""Set points as they are in force, for people: capped by the clearance, beside the runout of the
probes, and in votes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from firmware_py.config import Config
from firmware_py.config.bearings import views
from firmware_py.config.measure_types import VOTES, Measure, SetPoint
from firmware_py.config.measures import PROBES, groups, measures
from firmware_py.guard.protection.set_points import cap_um, in_force
from firmware_py.machine import FastChannel
from firmware_py.machine.parts import CLEARANCE
from firmware_py.machine.probes import error_of

SMALL_UM: Final = 1e-6
"""A clearance in which every cap holds."""


def said(config: Config, measure: Measure, point: SetPoint) -> str:
    """A set point with its side, and what the clearance leaves of it."""
    if point.low is not None:
        return f"outside {point.low:.5g} .. {point.limit:.5g} {measure.unit}"
    side = "above" if measure.sign > 0.0 else "below"
    return f"{side} {point.limit:.5g} {measure.unit}{_capped(config, measure, point)}"


def remarks(config: Config) -> Iterator[str]:
    """What is allowed and hardly meant: set points within runout, and votes of unlike measures."""
    for measure in measures(config):
        if measure.capped:
            yield from _within_runout(config, measure)
    yield from _unlike(config)


def _at(config: Config, measure: Measure, point: SetPoint, clearance_um: float) -> float:
    """``point`` in force in a radial clearance, um."""
    cap = cap_um(measure, config.limits.clearance_share, clearance_um)
    return in_force(measure, cap=cap)[measure.points.index(point)]


def _bearing(config: Config, measure: Measure) -> Config:
    """The configuration of the bearing at which a displacement is measured."""
    first, *others = views(config)
    for view in others:
        names = [view.name, *(channel.name for channel in view.config.machine.channel)]
        if measure.source in names:
            return view.config
    return first.config


def _least_um(config: Config, measure: Measure) -> float | None:
    """Least radial clearance of its bearing; None where that is not known."""
    machine = _bearing(config, measure).machine
    return None if CLEARANCE in machine.absent else machine.bearing.radial_clearance_min_um


def _capped(config: Config, measure: Measure, point: SetPoint) -> str:
    if not measure.capped:
        return ""
    share = _at(config, measure, point, SMALL_UM) / SMALL_UM
    text, least_um = f", at most {share:.3g} of the radial clearance", _least_um(config, measure)
    if least_um is None:
        return text
    at_um = _at(config, measure, point, least_um)
    return f"{text}: {at_um:.4g} um at its least, {least_um:g} um"


def _within_runout(config: Config, measure: Measure) -> Iterator[str]:
    """Protection takes no runout off: a set point within it stands on a sound machine."""
    least_um = _least_um(config, measure)
    if least_um is None:
        return
    probes = _bearing(config, measure).machine.channel[:PROBES]
    own = [probe for probe in probes if probe.name == measure.source] or probes
    shown_um = (1.0 if measure.kind == "smax" else 2.0) * max(map(_runout_um, own))
    for point in measure.points:
        at_um = _at(config, measure, point, least_um)
        if at_um < shown_um:
            yield (
                f"CAUTION {point.alarm}: in force above {at_um:.3g} um at {least_um:g} um of "
                f"clearance, the runout of the probes alone may show {shown_um:.3g} um; measure "
                f"runout_m or raise {point.key}, limits.clearance_share or the least clearance"
            )


def _runout_um(probe: FastChannel) -> float:
    """Amplitude of one order that a probe may show of a shaft that stands in its place, um."""
    if probe.zeroed:
        return probe.slow_roll_um + 1e6 * error_of(probe, "zeroed_runout_m")
    return 1e6 * error_of(probe, "runout_m")


def _unlike(config: Config) -> Iterator[str]:
    """Votes that need several dangers, of measures that do not see the same."""
    rows = {row.name: row for row in measures(config)}
    seated = {channel.name: channel.bearing for channel in config.machine.channel}
    first = config.machine.bearing.name
    for group in groups(config):
        needed = VOTES[group.vote].needed
        seen = {
            (rows[name].quantity, seated.get(rows[name].source) or first) for name in group.measures
        }
        if needed > 1 and len(seen) > 1:
            yield (
                f"CAUTION group {group.name}: {', '.join(group.measures)} do not see the same "
                f"(quantity or bearing), and {group.vote} trips on {needed} of them alone: a "
                "danger that one of them sees trips no longer; vote over like measures"
            )
