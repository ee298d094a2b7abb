"""Machines of several bearings: which channel sits where, and what each bearing needs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from firmware_py.config.bearings import probes_of
from firmware_py.config.checks_channel import DISPLACEMENTS, too_near
from firmware_py.config.convert import Found
from firmware_py.config.schema import Config

PROBES_EACH: Final = 2
"""Displacement probes of a bearing: fewer show no orbit."""


def _names(config: Config) -> Iterator[Found]:
    """Every further bearing has a name of its own, and every channel sits at one there is."""
    machine = config.machine
    names = [machine.bearing.name]
    for i, other in enumerate(machine.other_bearing):
        place = f"machine.other_bearing[{i}].name"
        if not other.name:
            yield place, '""', "missing: channels say by it where they sit; name the bearing"
        elif other.name in names:
            yield place, other.name, "named twice; give each bearing its own name"
        names.append(other.name)
    known = ", ".join(name for name in names if name) or "none"
    for i, channel in enumerate(machine.channel):
        if channel.bearing and channel.bearing not in names:
            cause = f"no bearing of that name, there are: {known}; correct it"
            yield f"machine.channel[{i}].bearing", channel.bearing, cause
        elif i in DISPLACEMENTS and channel.bearing not in ("", machine.bearing.name):
            cause = "the first two channels are the probes of the first bearing; put them first"
            yield f"machine.channel[{i}].bearing", channel.bearing, cause
    for i, limits in enumerate(config.limits_at):
        if limits.bearing not in names[1:]:
            cause = f"no further bearing of that name, there are: {known}; correct it"
            yield f"limits_at[{i}].bearing", limits.bearing, cause
        if limits.displacement_alert_um >= limits.displacement_danger_um:
            cause = (
                f"not below displacement_danger_um ({limits.displacement_danger_um:g}); lower it"
            )
            yield f"limits_at[{i}].displacement_alert_um", limits.displacement_alert_um, cause


def _probes(config: Config) -> Iterator[Found]:
    """Two probes at each further bearing, far enough apart."""
    machine = config.machine
    for i, other in enumerate(machine.other_bearing):
        found = probes_of(machine, other) if other.name else ()
        if other.name and len(found) != PROBES_EACH:
            cause = f'{len(found)} displacement probes with bearing = "{other.name}", two make an '
            yield (
                f"machine.other_bearing[{i}].name",
                other.name,
                f"{cause}orbit; correct the channels",
            )
        elif found:
            yield from too_near(config, *found)


def _loads(config: Config) -> Iterator[Found]:
    """Both ends of a load, or none, in order."""
    for i, other in enumerate(config.machine.other_bearing):
        low, high = other.load_min_N, other.load_max_N
        if (low is None) != (high is None):
            key = "load_min_N" if low is None else "load_max_N"
            cause = "missing beside the other end; set it"
            yield f"machine.other_bearing[{i}].{key}", None, cause
        elif low is not None and high is not None and low > high:
            cause = f"above load_max_N ({high:g}); lower it"
            yield f"machine.other_bearing[{i}].load_min_N", low, cause


BEARING_CHECKS: Final = (_names, _probes, _loads)
