"""From the channels of a file to even samples in SI and the shaft's angle, by the channel map."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from models.readers import units
from models.readers.channel_map import ChannelRow, FileMap, find
from models.readers.shaft_angle import STUCK, turns_at
from models.readers.signal_file import Channel, Floats, SignalFile, SignalFileError
from models.readers.timing import rate_of_stamps, resampled, rounded_rate

TIME_NAMES: Final = frozenset(
    (
        *("time", "t", "zeit", "timestamp", "timestamps", "time_s", "time_ms", "time_us", "sec"),
        *("datetime", "date_time", "seconds", "second", "x_value", "temps", "tiempo"),
        *("datum", "date", "uhrzeit", "zeitstempel"),
    )
)
RATE_FACTS: Final = ("rate_hz", "fs", "sample_rate", "samplerate", "sampling_rate", "f_s", "sr")
MARK_NAMES: Final = frozenset(("mark", "tacho", "tachometer", "keyphasor", "keyphase"))
SPEED_NAMES: Final = frozenset(("rpm", "speed_rpm", "n_rpm", "drehzahl"))
SPEED_FACTS: Final = ("rpm", "speed_rpm", "n_rpm", "speed", "drehzahl")
EPOCHS: Final = (("ns", 1e17), ("us", 1e14), ("ms", 1e11))
"""Stamps since 1970 above these are in that unit: in seconds they would lie in the year 5138."""
RATE_LEAST_HZ: Final = 1.0
"""Below, a time column is most likely in another unit."""


@dataclass(frozen=True)
class EvenSamples:
    """Even samples of one recording.

    Attributes
    ----------
    values
        Shape (n, channels), SI.
    units
        SI unit of each channel; empty where the file and the map tell none.
    turns
        Shaft angle in turns of each instant, shape (n,); None where no speed and no mark is known.
    """

    values: Floats
    rate_hz: float
    names: tuple[str, ...]
    units: tuple[str, ...]
    turns: Floats | None
    notes: tuple[str, ...] = ()


def assemble(
    file: SignalFile,
    plan: FileMap,
    *,
    rate_hz: float | None = None,
    rpm: float | None = None,
    span_s: tuple[float, float] = (0.0, math.inf),
    names: Sequence[str] = (),
) -> EvenSamples:
    """The chosen channels of ``file`` at one rate, in SI.

    Parameters
    ----------
    rate_hz, rpm
        What a table of recordings says of this file; comes before what the map says.
    span_s
        First and last second that are used.
    names
        Of the channels, in their order, where the map names none.

    Raises
    ------
    SignalFileError
        Everything that is wrong with this file, one a line.
    """
    who, problems = file.path.name, list[str]()
    if not file.channels:
        raise SignalFileError(f"{who}: no channel of numbers in it; {'; '.join(file.notes)}")
    stamps, speed, mark = roles(file, plan)
    timed, notes = list(file.channels), list[str]()
    try:
        timed, notes = _timed(file, plan, rate_hz, stamps)
    except SignalFileError as error:
        problems += str(error).splitlines()
    rest = [i for i in range(len(timed)) if i not in (stamps, speed, mark)]
    if not plan.channel:
        counting = [i for i in rest if _counts(timed[i].values)]
        rest = [i for i in rest if i not in counting]
        notes += [f"{timed[i].name!r} only counts the rows, left out" for i in counting]
    if not rest:
        raise SignalFileError(f"{who}: no column of signals in it; name them in channels.toml")
    notes += [
        f"{timed[i].name!r} is the {what}"
        for what, i, said in (("speed", speed, plan.speed), ("mark", mark, plan.mark))
        if i is not None and said.column == ""
    ]
    rows = _rows(timed, plan, rest, names, who)
    made: list[tuple[str, Floats, float, str]] = []
    for index, row in rows:
        try:
            made.append(_channel(who, timed[index], row, span_s))
        except SignalFileError as error:
            problems += [line for line in str(error).splitlines() if line not in problems]
    if problems:
        raise SignalFileError("\n".join(problems))
    rate = _one_rate(who, made, plan.file.resample_hz)
    values = _joined(file, made, rate)
    constant = rpm or plan.speed.rpm or _fact(file.facts, SPEED_FACTS)
    time_s = span_s[0] + np.arange(len(values)) / rate
    turns = turns_at(
        time_s,
        file,
        plan,
        speed=None if speed is None else timed[speed],
        mark=None if mark is None else timed[mark],
        rpm=constant,
    )
    return EvenSamples(
        values,
        rate,
        tuple(each[0] for each in made),
        tuple(each[3] for each in made),
        turns,
        (*file.notes, *notes),
    )


def _timed(
    file: SignalFile, plan: FileMap, rate_hz: float | None, stamps: int | None
) -> tuple[list[Channel], list[str]]:
    """Channels with their rates, and notes."""
    channels, who = list(file.channels), file.path.name
    given = rate_hz or plan.file.rate_hz or _fact(file.facts, RATE_FACTS)
    notes: list[str] = []
    if given is None and stamps is not None:
        given = _rate_of(who, channels[stamps], plan)
        notes.append(f"{given:g} Hz by the stamps of {channels[stamps].name!r}")
    found = []
    for channel in channels:
        rate = rate_hz or channel.rate_hz or given
        found.append(channel if rate is None else replace(channel, rate_hz=rounded_rate(rate)))
    if all(each.rate_hz is None for each in found):
        raise SignalFileError(
            f"{who}: no sampling rate: neither the file tells it nor a column of time; give "
            "rate_hz in recordings.csv, or under [file] in channels.toml"
        )
    return found, notes


def _time_channel(who: str, channels: Sequence[Channel], plan: FileMap) -> int | None:
    if plan.time.column != "":
        return find(channels, plan.time.column, f"{who}: [time] in {plan.source}")
    for i, channel in enumerate(channels):
        if channel.name.casefold().strip() in TIME_NAMES:
            return i
        known = units.unit(channel.unit) if channel.unit else None
        if known and known.quantity == "time" and i == 0:
            return i
    first = channels[0]
    if first.lines is not None and first.name == "column 1" and len(channels) > 1:
        step = np.diff(first.values[:1000])
        if len(step) > 2 and np.all(step > 0.0) and np.ptp(step) < 1e-3 * step.mean():
            return 0
    return None


def _counts(values: Floats) -> bool:
    """Whether a column grows by the same step from row to row: a number of the row, no signal."""
    step = np.diff(values)
    return bool(len(step) > 2 and step[0] != 0.0 and np.all(step == step[0]))


def _rate_of(who: str, channel: Channel, plan: FileMap) -> float:
    text = plan.time.unit or channel.unit
    if not text:
        suffix = channel.name.casefold().rpartition("_")[2]
        text = suffix if suffix in ("ms", "us") else _unit_of_epoch(float(channel.values[0]))
    known = units.unit(text)
    if known is None or known.quantity != "time":
        raise SignalFileError(
            f"{who}: {channel.name}: unit {text!r} is no time; give s, ms, us or ns under [time] "
            f"in {plan.source}"
        )
    where = f"{who}: {channel.name}"
    rate = rate_of_stamps(channel.values * known.factor, where, channel.lines)
    if rate < RATE_LEAST_HZ:
        raise SignalFileError(
            f"{where}: {rate:.4g} Hz if its unit is {text!r}: is it ms? say unit under [time] in "
            f"{plan.source}, or rate_hz where the column only counts"
        )
    return rate


def _unit_of_epoch(stamp: float) -> str:
    """Unit of stamps without one: counted since 1970 they tell it by their size."""
    return next((name for name, least in EPOCHS if stamp > least), "s")


def _fact(facts: Mapping[str, float], names: Sequence[str]) -> float | None:
    plain = {name.casefold(): value for name, value in facts.items()}
    found = next((plain[name] for name in names if name in plain), None)
    return found if found is not None and 0.0 < found < math.inf else None


def roles(file: SignalFile, plan: FileMap) -> tuple[int | None, int | None, int | None]:
    """Which channel holds time, speed and mark: as the map says, else by unit and name; None: no
    such channel."""
    who = file.path.name
    stamps = _time_channel(who, file.channels, plan)
    speed = mark = None
    if plan.speed.column != "":
        speed = find(file.channels, plan.speed.column, f"{who}: [speed] in {plan.source}")
    if plan.mark.column != "":
        mark = find(file.channels, plan.mark.column, f"{who}: [mark] in {plan.source}")
    for i, channel in enumerate(file.channels):
        known, name = units.unit(channel.unit), channel.name.casefold().strip()
        if i == stamps or plan.channel:
            continue
        is_speed = (known and known.quantity == "speed") or (not known and name in SPEED_NAMES)
        if speed is None and plan.speed.rpm is None and is_speed:
            speed = i
        elif mark is None and name in MARK_NAMES:
            mark = i
    return stamps, speed, mark


def _rows(
    channels: Sequence[Channel],
    plan: FileMap,
    rest: Sequence[int],
    names: Sequence[str],
    who: str,
) -> list[tuple[int, ChannelRow]]:
    """Which channel is used how: as the map says, else all of those that are left."""
    if plan.channel:
        return [
            (find(channels, row.column, f"{who}: [[channel]] {n} in {plan.source}"), row)
            for n, row in enumerate(plan.channel, 1)
        ]
    if not names:
        return [(i, ChannelRow(i + 1, channels[i].name)) for i in rest]
    if len(names) != len(rest):
        raise SignalFileError(
            f"{who}: {len(rest)} columns of signals ("
            f"{', '.join(channels[i].name for i in rest)}), the table names {len(names)} channels; "
            "name each, or choose them in channels.toml"
        )
    return [(i, ChannelRow(i + 1, name)) for i, name in zip(rest, names, strict=True)]


def _channel(
    who: str, channel: Channel, row: ChannelRow, span_s: tuple[float, float]
) -> tuple[str, Floats, float, str]:
    """Name, values in SI, rate and SI unit of one channel; every reason to refuse it at once."""
    if channel.fault:
        raise SignalFileError(f"{channel.fault}; or choose other channels in channels.toml")
    name = row.name or channel.name
    named = replace(channel, name=name if name == channel.name else f"{channel.name} ({name})")
    first, last = 0, len(channel.values)
    problems: list[str] = []
    if channel.rate_hz is not None:
        first = round(span_s[0] * channel.rate_hz)
        last = last if span_s[1] == math.inf else round(span_s[1] * channel.rate_hz)
        if not 0 <= first < last <= len(channel.values):
            problems.append(
                f"{who}: from {span_s[0]:g} s to {span_s[1]:g} s of "
                f"{len(channel.values) / channel.rate_hz:.3f} s; correct start_s and end_s"
            )
            first, last = 0, len(channel.values)
    raw = channel.values[first:last]
    values, si, more = _in_si(who, named, row, raw, first)
    problems += more
    if problems:
        raise SignalFileError("\n".join(problems))
    if channel.rate_hz is None:
        raise SignalFileError(f"{who}: no sampling rate of {channel.name}; give rate_hz")
    return name, values, channel.rate_hz, si


def _in_si(
    who: str, channel: Channel, row: ChannelRow, raw: Floats, first: int
) -> tuple[Floats, str, list[str]]:
    """Values in SI, their unit, and all that is wrong with them; ``raw`` begins at sample
    ``first``."""
    here, problems = f"{who}: {channel.name}", list[str]()
    good = np.isfinite(raw)
    if not good.all():
        bad = np.flatnonzero(~good)
        what = "missing or no number" if np.isnan(raw[bad[0]]) else "infinite"
        problems.append(
            f"{who}: {channel.where(first + int(bad[0]))}: {what} ({len(bad)} such values, the "
            "first of them); cut them out (start_s, end_s), or leave the file out"
        )
    text = row.unit or channel.unit
    known = units.unit(text) if text else None
    if text and known is None:
        problems.append(
            f"{here}: unit {text!r} is not known; give one of {units.known()} as unit of this "
            "channel in channels.toml"
        )
    values = (raw * row.scale + row.offset) * row.polarity
    if known is not None:
        values = values * known.factor + known.offset
    whole = values[good]
    if len(whole) and np.ptp(whole) == 0.0:
        problems.append(f"{here}: {STUCK}; leave it out in channels.toml")
    elif len(whole) and known and (odd := units.implausible(float(whole.std()), known)):
        problems.append(f"{here}: {odd} Say unit and scale of this channel in channels.toml")
    return values, known.si if known else "", problems


def _one_rate(
    who: str, made: Sequence[tuple[str, Floats, float, str]], to_hz: float | None
) -> float:
    """The rate of all channels."""
    rates = sorted({rate for _, _, rate, _ in made})
    if to_hz is not None:
        return to_hz
    if rates[-1] - rates[0] > 1e-6 * rates[-1]:
        of = ", ".join(f"{name} {rate:g} Hz" for name, _, rate, _ in made)
        raise SignalFileError(
            f"{who}: channels of several rates ({of}); choose those of one rate in channels.toml, "
            f"or bring all to one: resample_hz = {rates[0]:g} under [file]"
        )
    return rates[0]


def _joined(
    file: SignalFile, made: Sequence[tuple[str, Floats, float, str]], rate: float
) -> Floats:
    columns = [resampled(values, own, rate, file.path) for _, values, own, _ in made]
    lengths = [len(column) for column in columns]
    if max(lengths) - min(lengths) > max(2, round(0.01 * max(lengths))):
        of = ", ".join(
            f"{name} {n / rate:.4g} s" for (name, *_), n in zip(made, lengths, strict=True)
        )
        raise SignalFileError(
            f"{file.path.name}: channels of several lengths ({of}); choose those that belong "
            "together in channels.toml"
        )
    return np.column_stack([column[: min(lengths)] for column in columns])
