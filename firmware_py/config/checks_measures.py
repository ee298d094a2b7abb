"""Rows of ``[[measure]]`` and ``[[group]]`` that change nothing, cross over, or cannot vote."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Any, Final

from firmware_py.config.checks_acting import ACTING_CHECKS
from firmware_py.config.checks_added import ADDED_CHECKS
from firmware_py.config.checks_channel import CREST_FACTOR, READABLE_SHARE
from firmware_py.config.convert import Found
from firmware_py.config.measure_schema import GroupConfig, MeasureConfig
from firmware_py.config.measure_types import VOTES, Measure
from firmware_py.config.measures import (
    OUTLET_HIGH,
    OUTLET_LOW,
    PRESSURE_LOW,
    SPEED_HIGH,
    oil,
    vibration,
    voted,
)
from firmware_py.config.schema import Config
from firmware_py.machine.parts import FEED, LUBRICANT, has
from firmware_py.records import Severity

WRITTEN: Final = "measure["
"""Keys of limits that a row writes begin so."""


def oil_dangers(config: Config) -> dict[str, bool]:
    """Measures of the oil that the machine has, and whether each has a danger; none of their
    limits is read."""
    lim, feed, lubricant = config.limits, has(config.machine, FEED), has(config.machine, LUBRICANT)
    low, high = lim.oil_pressure_low_danger_bar, lim.oil_outlet_high_danger_C
    found = {}
    if feed or low or lim.oil_pressure_low_alert_bar:
        found[PRESSURE_LOW] = bool(feed or low)
    if lubricant or high or lim.oil_outlet_high_alert_C:
        found[OUTLET_HIGH] = bool(lubricant or high)
    if lubricant:
        found[OUTLET_LOW] = False
    return found


def _derived(config: Config) -> dict[str, bool]:
    """Every measure that may be changed, and whether it has a danger."""
    return dict.fromkeys((row.name for row in vibration(config)), True) | oil_dangers(config)


def _dangers(config: Config) -> dict[str, bool]:
    """Every measure that may vote, and whether it has a danger."""
    own = {each.name: each.danger is not None for each in config.measure if each.quantity}
    return _derived(config) | own


def _known(config: Config) -> Iterator[Found]:
    """Every row is of a measure there is, once."""
    if not config.measure:
        return
    there = _derived(config)
    names = [each.name for each in config.measure]
    for i, (name, each) in enumerate(zip(names, config.measure, strict=True)):
        key = f"measure[{i}].name"
        if name == SPEED_HIGH:
            yield key, name, "its delay is counted in turns; set limits.speed_high_rpm"
        elif each.quantity and name in there:
            yield key, name, "is there already; name the added measure otherwise"
        elif not each.quantity and name not in there:
            cause = f"no measure of that name, there are: {', '.join(there)}; correct it"
            yield key, name, f"{cause}, or add it with quantity"
        if name in names[:i]:
            yield key, name, "written twice; keep one"


def _whole(config: Config) -> Iterator[Found]:
    """What a row says can be done."""
    if not config.measure:
        return
    there, groups = _dangers(config), voted(config.group)
    for i, each in enumerate(config.measure):
        if not each.quantity:
            yield from _of_added(i, each)
        danger = there.get(each.name, True)
        for key in ("danger", "danger_delay_s", "danger_effect", "latching"):
            value = getattr(each, key)
            if value is not None and not danger:
                yield f"measure[{i}].{key}", value, f"{each.name} has no danger; remove it"
        trips = each.danger_effect in (None, "trip")
        if danger and each.latching is False and trips and each.name not in groups:
            cause = f"{each.name} trips alone, and a trip is latched; let it vote in a [[group]]"
            yield f"measure[{i}].latching", False, f"{cause}, or write danger_effect = alarm"


def _rows_crossed(rows: tuple[Measure, ...]) -> Iterator[Found]:
    for row in rows:
        alert, danger = row.point(Severity.ALERT), row.point(Severity.DANGER)
        if alert is None or danger is None:
            continue
        at = next((p for p in (danger, alert) if p.key.startswith(WRITTEN)), None)
        if at is not None and row.sign * (danger.limit - alert.limit) <= 0.0:
            side = "above" if row.sign > 0.0 else "below"
            cause = (
                f"danger {danger.limit:g} {row.unit} of {row.name} is not {side} its alert "
                f"{alert.limit:g}; part them"
            )
            yield at.key, at.limit, cause


def _vibration_crossed(config: Config) -> Iterator[Found]:
    if config.measure:
        yield from _rows_crossed(vibration(config))


def _oil_crossed(config: Config) -> Iterator[Found]:
    if {each.name for each in config.measure} & set(oil_dangers(config)):
        yield from _rows_crossed(oil(config))


def _readable(config: Config) -> Iterator[Found]:
    """A danger that is written can be shown by its channel."""
    written = {each.name: i for i, each in enumerate(config.measure)}
    if not written:
        return
    channels = {channel.name: channel for channel in config.machine.channel}
    for row in vibration(config):
        danger = row.points[-1]
        if row.name not in written or not danger.key.startswith(WRITTEN):
            continue
        channel = channels[row.source]
        if row.capped:
            most = READABLE_SHARE * (channel.ok_high - channel.ok_low) * 1e6
        else:
            most = min(channel.ok_high, -channel.ok_low) / CREST_FACTOR
        if not 0.0 < danger.limit <= most:
            cause = f"outside 0 .. {most:g} {row.unit}, what {row.source} can show; correct it"
            yield danger.key, danger.limit, cause


def _votes(config: Config) -> Iterator[Found]:
    """Every group has as many measures as its vote counts, each with a danger that trips."""
    if not config.group:
        return
    there = _dangers(config)
    own: dict[str, Any] = {each.name: each.danger_effect for each in config.measure}
    for i, group in enumerate(config.group):
        wanted = VOTES[group.vote].of
        if not group.measures:
            yield f"group[{i}].measures", "[]", f"a vote over an empty group; name {wanted}"
        elif len(group.measures) != wanted:
            cause = f"{len(group.measures)} measures, {group.vote} counts {wanted}; correct one"
            yield f"group[{i}].measures", ", ".join(group.measures), cause
        for k, name in enumerate(group.measures):
            if cause := _cannot_vote(name, there, own):
                yield f"group[{i}].measures[{k}]", name, cause


def _cannot_vote(name: str, there: dict[str, bool], own: dict[str, Any]) -> str:
    if name == SPEED_HIGH:
        return "trips alone, always; remove it"
    if name not in there:
        return f"no measure of that name, there are: {', '.join(there)}; correct it"
    if not there[name]:
        return "has no danger that could vote; remove it"
    if own.get(name) not in (None, "trip"):
        return f"its danger_effect is {own[name]}, which does not trip; write trip, or remove it"
    return ""


def _one_vote(config: Config) -> Iterator[Found]:
    """A measure votes once, and a name means one group."""
    found: Counter[str] = Counter()
    names = [group.name for group in config.group]
    taken = {each.name for each in config.machine.channel}
    taken |= {each.name for each in config.machine.reading}
    for i, group in enumerate(config.group):
        if group.name in names[:i]:
            yield f"group[{i}].name", group.name, "named twice; give each group its own name"
        if group.name in taken:
            cause = "a channel or reading has alarms of that name; name the group otherwise"
            yield f"group[{i}].name", group.name, cause
        yield from _twice(i, group, found)


def _twice(i: int, group: GroupConfig, found: Counter[str]) -> Iterator[Found]:
    for k, name in enumerate(group.measures):
        if found[name]:
            yield f"group[{i}].measures[{k}]", name, "votes already; a measure has one vote"
        found[name] += 1


def _of_added(i: int, each: MeasureConfig) -> Iterator[Found]:
    """Keys that only an added measure has."""
    for key, value, default in (
        ("source", each.source, ""), ("unit", each.unit, ""), ("sense", each.sense, "rising"),
        ("judged", each.judged, "always"), ("alert_low", each.alert_low, None),
        ("danger_low", each.danger_low, None), ("from_rpm", each.from_rpm, None),
        ("to_rpm", each.to_rpm, None), ("band_low_hz", each.band_low_hz, 10.0),
    ):  # fmt: skip
        if value != default:
            yield f"measure[{i}].{key}", value, "belongs to an added measure; write quantity"


def _bypassed(config: Config) -> Iterator[Found]:
    """No bypass takes the last vote of a group, and only dangers are bypassed."""
    there = _dangers(config)
    allowed = {each.name: i for i, each in enumerate(config.measure) if each.may_bypass}
    for name, i in allowed.items():
        if not there.get(name, True):
            cause = f"{name} has no danger that could be bypassed; remove it"
            yield f"measure[{i}].may_bypass", True, cause
    for group in config.group:
        if len(group.measures) == 1 and group.measures[0] in allowed:
            cause = (
                f"{group.measures[0]} is the last channel of {group.name}; remove it, or let the "
                f"whole group be bypassed"
            )
            yield f"measure[{allowed[group.measures[0]]}].may_bypass", True, cause


def _multiplied(config: Config) -> Iterator[Found]:
    """A window has an end, a way to begin anew, and set points that can be multiplied."""
    if not config.multiply:
        return
    rising = {row.name for row in vibration(config)}
    rising |= {m.name for m in config.measure if m.quantity and m.sense == "rising"}
    names = [each.name for each in config.multiply]
    for i, each in enumerate(config.multiply):
        key = f"multiply[{i}]"
        if each.name in names[:i]:
            yield f"{key}.name", each.name, "named twice; give each window its own name"
        if not each.measures:
            yield f"{key}.measures", "[]", "names no measure; name one"
        for k, name in enumerate(each.measures):
            if name not in rising:
                cause = f"no rising measure of that name, there are: {', '.join(sorted(rising))}"
                yield f"{key}.measures[{k}]", name, f"{cause}; correct it"
        if each.from_rpm >= each.to_rpm:
            yield f"{key}.from_rpm", each.from_rpm, f"not below to_rpm ({each.to_rpm:g}); lower it"
        if each.max_s is None:
            yield f"{key}.max_s", None, "a multiply without end; say for how long at most"
        if each.reset_rpm is None:
            cause = "a window without reset; say below which speed its time counts anew"
            yield f"{key}.reset_rpm", None, cause
        elif each.reset_rpm >= each.from_rpm:
            cause = f"not below from_rpm ({each.from_rpm:g}); lower it"
            yield f"{key}.reset_rpm", each.reset_rpm, cause


MEASURE_CHECKS: Final = (
    _known, *ACTING_CHECKS, _whole, _vibration_crossed, _oil_crossed, _readable, _votes, _one_vote,
    _bypassed, _multiplied, *ADDED_CHECKS,
)  # fmt: skip
