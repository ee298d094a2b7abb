"""Channels that the wire does not carry, cannot be read, or cannot show what protection
watches."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from firmware_py import signals
from firmware_py.config.convert import Found
from firmware_py.config.instances import PROBES, places
from firmware_py.config.schema import Config
from firmware_py.machine import FastChannel
from firmware_py.machine.parts import monitor_only
from firmware_py.machine.probes import ZEROED, error_of
from firmware_py.records import CHANNELS

SCALE_FACTOR_MAX: Final = 10.0
"""A calibrated scale differs from the wire's by some per cent; by more than this it is in another
unit."""

RAIL_COUNTS: Final = 32_500
"""The counts of a channel end at 32767: an OK range beyond this never tells a sensor at its
rail."""

OK_COUNTS_MIN: Final = 1000
"""An OK range of fewer counts resolves nothing."""

PROBES_APART_DEG: Final = 30.0
"""Nearer probes double the error of one direction in the other; at one angle there is no second
direction."""

READABLE_SHARE: Final = 0.8
"""Of what a channel can show: a danger limit above is reached only where the signal clips."""

CREST_FACTOR: Final = 2.0
"""Peak over rms of a housing that shakes; of a sine 1.4."""

DISPLACEMENTS: Final = (0, 1)

ERRORS_OF_PROBES: Final = ("zero_error", "gain_error_share", "runout_m")
"""Each has another value after the zero and slow-roll procedure, under ``zeroed_``."""


def _names(config: Config) -> Iterator[Found]:
    """Schema 1 has the eight standard channels; schema 2 needs the two probes in front."""
    names = [channel.name for channel in config.machine.channel]
    if config.bus.schema == 1:
        if names != list(CHANNELS):
            yield (
                "machine.channel",
                ", ".join(names),
                f"must be exactly {', '.join(CHANNELS)}, in this order (bus.schema = 1); correct "
                f"the names, or set bus.schema = 2",
            )
        return
    if tuple(names[:2]) != PROBES:
        yield (
            "machine.channel",
            ", ".join(names),
            f"must begin with {PROBES[0]}, {PROBES[1]}: protection rests on them; put them first",
        )
    for i, name in enumerate(names):
        if name in names[:i]:
            yield f"machine.channel[{i}].name", name, "named twice; give each channel its own name"


def _kinds(config: Config) -> Iterator[Found]:
    for i, channel in enumerate(config.machine.channel):
        kind = signals.fast_kind(channel.name, channel.kind)
        standard = signals.STANDARD_CHANNEL.get(channel.name)
        if kind is None:
            cause = f"no kind of fast channel; write one of {', '.join(signals.FAST)}"
            yield f"machine.channel[{i}].kind", channel.kind or '""', cause
        elif standard and kind.name != standard.kind:
            cause = f"the channel {channel.name} is of kind {standard.kind}; leave it out"
            yield f"machine.channel[{i}].kind", channel.kind, cause


def _units(config: Config) -> Iterator[Found]:
    for i, channel in enumerate(config.machine.channel):
        kind = signals.fast_kind(channel.name, channel.kind)
        if kind is not None and channel.unit != kind.unit:
            yield (
                f"machine.channel[{i}].unit",
                channel.unit,
                f"the wire carries {kind.unit}; write {kind.unit}, and scale in {kind.unit}",
            )


def _scales(config: Config) -> Iterator[Found]:
    for i, channel in enumerate(config.machine.channel):
        kind = signals.fast_kind(channel.name, channel.kind)
        if kind is None:
            continue
        scale = channel.wire_scale or kind.wire_scale
        low, high = scale / SCALE_FACTOR_MAX, scale * SCALE_FACTOR_MAX
        if not low <= abs(channel.scale) <= high:
            yield (
                f"machine.channel[{i}].scale",
                channel.scale,
                (
                    f"outside {low:g} .. {high:g} {kind.unit} a count, the wire has {scale:g}; "
                    f"correct its unit"
                ),
            )
        if channel.wire_scale and config.bus.schema == 1:
            cause = "schema 1 has the scales of orbitd.dbc; leave it out, or set bus.schema = 2"
            yield f"machine.channel[{i}].wire_scale", channel.wire_scale, cause


def _ok_range(i: int, channel: FastChannel) -> Iterator[Found]:
    if channel.ok_low >= channel.ok_high:
        yield (
            f"machine.channel[{i}].ok_low",
            channel.ok_low,
            f"not below ok_high ({channel.ok_high:g}); lower it",
        )
        return
    if not channel.scale:
        return
    for key, value in (("ok_low", channel.ok_low), ("ok_high", channel.ok_high)):
        counts = (value - channel.offset) / channel.scale
        if abs(counts) > RAIL_COUNTS:
            end = RAIL_COUNTS * abs(channel.scale)
            yield (
                f"machine.channel[{i}].{key}",
                value,
                (
                    f"{counts:.6g} counts, the channel reads up to {RAIL_COUNTS} "
                    f"({channel.offset - end:g} .. "
                    f"{channel.offset + end:g}); narrow the range"
                ),
            )
    if channel.ok_high - channel.ok_low < OK_COUNTS_MIN * abs(channel.scale):
        yield (
            f"machine.channel[{i}].ok_high",
            channel.ok_high,
            (
                f"less than {OK_COUNTS_MIN} counts above ok_low ({channel.ok_low:g}); widen the "
                f"range"
            ),
        )


def _ok_ranges(config: Config) -> Iterator[Found]:
    for i, channel in enumerate(config.machine.channel):
        yield from _ok_range(i, channel)


def _probes(config: Config) -> Iterator[Found]:
    if len(config.machine.channel) > DISPLACEMENTS[1]:
        yield from too_near(config, *DISPLACEMENTS)


def too_near(config: Config, i: int, k: int) -> Iterator[Found]:
    """The axes of channels ``i`` and ``k``, the probes of one bearing, are hardly two."""
    first, second = (config.machine.channel[n].angle_deg for n in (i, k))
    between = abs((second - first + 90.0) % 180.0 - 90.0)
    if between < PROBES_APART_DEG - 1e-9:
        yield (
            f"machine.channel[{k}].angle_deg",
            second,
            f"its axis lies {between:g} degrees from that of machine.channel[{i}].angle_deg = "
            f"{first:g} (180 degrees more is the same axis), least {PROBES_APART_DEG:g}; mount the "
            "probes 90 degrees apart",
        )


def _probe_errors(config: Config) -> Iterator[Found]:
    """The zero and slow-roll procedure leaves less than there was, and only probes have it."""
    for i, channel in enumerate(config.machine.channel):
        kind = signals.fast_kind(channel.name, channel.kind)
        for key in ERRORS_OF_PROBES:
            zeroed = ZEROED + key
            if kind is not None and kind.name == "displacement":
                left, built = error_of(channel, zeroed), error_of(channel, key)
                if left > built:
                    cause = f"above {key} ({built:g}), which the zero procedure lessens; lower it"
                    yield f"machine.channel[{i}].{zeroed}", left, cause
                continue
            for own in (zeroed, key) if key == "runout_m" else (zeroed,):
                value = getattr(channel, own)
                if kind is not None and value is not None:
                    cause = f"a figure of displacement probes, this shows {kind.name}; remove it"
                    yield f"machine.channel[{i}].{own}", value, cause


def _shaft_seen(config: Config) -> Iterator[Found]:
    """The probes see the shaft wherever it may be."""
    b = config.machine.bearing
    widest_m = (b.radial_clearance_max_um + max(0.0, b.radial_clearance_offset_um)) * 1e-6
    for i, channel in enumerate(config.machine.channel[: DISPLACEMENTS[1] + 1]):
        if min(channel.ok_high, -channel.ok_low) < widest_m:
            yield (
                f"machine.channel[{i}].ok_high",
                channel.ok_high,
                f"the shaft may stand {widest_m * 1e6:g} um off "
                f"(machine.bearing.radial_clearance_max_um), OK are {channel.ok_low * 1e6:g} .. "
                f"{channel.ok_high * 1e6:g} um; widen ok_low .. ok_high",
            )


def _displacement_seen(config: Config) -> Iterator[Found]:
    """The probes show the danger limit before they clip."""
    danger_um = config.limits.displacement_danger_um
    for i, channel in enumerate(config.machine.channel[: DISPLACEMENTS[1] + 1]):
        span_um = READABLE_SHARE * (channel.ok_high - channel.ok_low) * 1e6
        if danger_um > span_um:
            yield (
                "limits.displacement_danger_um",
                danger_um,
                f"above {span_um:g} um peak-to-peak, {READABLE_SHARE:g} of what {channel.name} can "
                f"read; lower it or widen machine.channel[{i}].ok_low .. ok_high",
            )


def _acceleration_seen(config: Config) -> Iterator[Found]:
    danger = config.limits.acceleration_danger_m_s2
    for i in places(config.machine.channel).accelerations:
        for channel in config.machine.channel[i : i + 1]:
            most = min(channel.ok_high, -channel.ok_low) / CREST_FACTOR
            if danger > most:
                yield (
                    "limits.acceleration_danger_m_s2",
                    danger,
                    (
                        f"above {most:g} m/s2 rms: its peaks (crest factor {CREST_FACTOR:g}) go "
                        f"beyond what {channel.name} "
                        f"can read; lower it or widen machine.channel[{i}].ok_low .. ok_high"
                    ),
                )


def _slow_channels_seen(config: Config) -> Iterator[Found]:
    """What the feed, one that has failed, and an open contact give is a good signal."""
    feed, contact = config.machine.feed, config.machine.contact
    wanted = [("supply_pressure", 0.0, feed.pressure_max_bar, "the feed's pressures and of none")]
    if contact is not None:
        volts = "the voltages of contact.circuit_V"
        wanted.append(("contact_resistance", 0.0, contact.circuit_V, volts))
    names = [channel.name for channel in config.machine.channel]
    for name, low, high, words in wanted:
        for i in [names.index(name)] if name in names else []:
            channel = config.machine.channel[i]
            if not channel.ok_low <= low <= high <= channel.ok_high:
                yield (
                    f"machine.channel[{i}].ok_high",
                    channel.ok_high,
                    (
                        f"OK are {channel.ok_low:g} .. {channel.ok_high:g} {channel.unit}, not all "
                        f"of {words}, {low:g} .. "
                        f"{high:g}; widen the range"
                    ),
                )


def _readings(config: Config) -> Iterator[Found]:
    """Slow readings: known kinds, names once, the four that the guard rests on."""
    names = [row.name for row in config.machine.reading]
    needed = [] if monitor_only(config.machine) else [row.name for row in signals.READINGS]
    if not names:
        return
    if config.bus.schema == 1:
        cause = "schema 1 carries the four of RIG_STATUS; remove them, or set bus.schema = 2"
        yield "machine.reading", ", ".join(names), cause
        return
    for missing in [name for name in needed if name not in names]:
        cause = f"{missing} is missing, which the guard rests on; add it"
        yield "machine.reading", ", ".join(names), cause
    for i, row in enumerate(config.machine.reading):
        kind = signals.slow_kind(row.name, row.kind)
        known = signals.STANDARD_READING.get(row.name)
        if kind is None:
            cause = f"no kind of slow reading; write one of {', '.join(signals.SLOW)}"
            yield f"machine.reading[{i}].kind", row.kind or '""', cause
        elif known and kind.name != known.kind:
            cause = f"the reading {row.name} is of kind {known.kind}; leave it out"
            yield f"machine.reading[{i}].kind", row.kind, cause
        if row.name in names[:i]:
            yield (
                f"machine.reading[{i}].name",
                row.name,
                "named twice; give each reading its own name",
            )
        if row.ok_low >= row.ok_high:
            cause = f"not below ok_high ({row.ok_high:g}); lower it"
            yield f"machine.reading[{i}].ok_low", row.ok_low, cause


CHANNEL_CHECKS: Final = (
    _names, _kinds, _units, _scales, _readings, _ok_ranges, _probes, _probe_errors,
    _shaft_seen, _displacement_seen, _acceleration_seen, _slow_channels_seen,
)  # fmt: skip
