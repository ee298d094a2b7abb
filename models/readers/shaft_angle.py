"""The shaft's angle over a recording: from the pulses of a mark, else from its speed."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from firmware_py.acquire.channel_features import MARKS_LEAST, angle_at
from models.readers import units
from models.readers.channel_map import FileMap
from models.readers.signal_file import Channel, Floats, SignalFile, SignalFileError

HYSTERESIS: Final = 0.2
"""A pulse must pass its level by this share of its height on both sides to count."""
AROUND_S: Final = 2.0
"""Marks so far outside the span in use still tell the turn at its ends."""
STUCK: Final = "never moves: the sensor is not connected, or the column holds something else"


def turns_at(
    time_s: Floats,
    file: SignalFile,
    plan: FileMap,
    *,
    speed: Channel | None,
    mark: Channel | None,
    rpm: float | None,
) -> Floats | None:
    """Shaft angle in turns, shape (n,); None where neither marks nor a speed are known.

    Parameters
    ----------
    time_s
        Instants from the start of the file, shape (n,).
    speed, mark
        Channels that the map sets apart.
    rpm
        Constant speed, where no channel tells more.

    Raises
    ------
    SignalFileError
        The channel of marks holds too few, or the speed has no unit of a speed.
    """
    if mark is not None or file.marks_s is not None:
        marks_s = file.marks_s if mark is None else _mark_times(file, plan, mark)
        assert marks_s is not None
        inside = marks_s[(marks_s >= time_s[0] - AROUND_S) & (marks_s <= time_s[-1] + AROUND_S)]
        if len(inside) >= MARKS_LEAST:
            return angle_at(inside, time_s)
        if mark is not None:
            raise SignalFileError(
                f"{file.path.name}: {mark.name}: {len(inside)} marks in "
                f"{time_s[-1] - time_s[0]:.3g} s, at least {MARKS_LEAST} are needed; give level, "
                f"edge and per_turn under [mark] in {plan.source}, or [speed]"
            )
    if speed is not None:
        known = units.unit(plan.speed.unit or speed.unit or "rpm")
        if known is None or known.quantity != "speed" or speed.rate_hz is None:
            raise SignalFileError(
                f"{file.path.name}: {speed.name}: unit {plan.speed.unit or speed.unit!r} is no "
                f"speed; give rpm, Hz or rad/s under [speed] in {plan.source}"
            )
        own = np.arange(len(speed.values)) / speed.rate_hz
        rad_s = np.interp(time_s, own, speed.values * known.factor)
        step_s = (time_s[-1] - time_s[0]) / (len(time_s) - 1)
        return np.asarray(np.cumsum(rad_s) * step_s / (2.0 * math.pi))
    return None if rpm is None else time_s * (rpm / 60.0)


def _mark_times(file: SignalFile, plan: FileMap, mark: Channel) -> Floats:
    """Times (s) at which the pulses of a mark pass their level, one a turn."""
    values = mark.values if plan.mark.edge == "rising" else -mark.values
    low, high = (float(q) for q in (values.min(), values.max()))
    if not (math.isfinite(low) and high > low) or mark.rate_hz is None:
        raise SignalFileError(f"{file.path.name}: {mark.name}: {STUCK}; or give [speed] instead")
    sign = 1.0 if plan.mark.edge == "rising" else -1.0
    level = 0.5 * (low + high) if plan.mark.level is None else sign * plan.mark.level
    reach = HYSTERESIS * (high - low)
    armed = np.where(values < level - reach, -1, np.where(values > level + reach, 1, 0))
    known = np.flatnonzero(armed)
    rises = known[1:][(armed[known[1:]] > 0) & (armed[known[:-1]] < 0)]
    times = np.empty(len(rises))
    for k, end in enumerate(rises):
        i = int(end)
        while i > 0 and values[i - 1] >= level:
            i -= 1
        step = values[i] - values[i - 1]
        times[k] = (i - 1 + (level - values[i - 1]) / step if step > 0.0 else i) / mark.rate_hz
    return times[:: plan.mark.per_turn]
