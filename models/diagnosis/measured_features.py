"""Windows of measured recordings as rows of features, on whatever channels a rig has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import floor

import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.channel_features import (
    ORDERS_VIEW,
    VIEWS,
    WINDOW_S,
    WINDOW_SAMPLES,
    no_orders,
    window_samples,
)
from models.diagnosis.dataset import DatasetError
from models.diagnosis.dataset_folder import MeasuredRecording, listed

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class FeatureRows:
    """Rows of one dataset: features by the name of their view, label, group, recording and machine
    of every window; ``left_out`` says why a view is not there."""

    views: dict[str, Floats]
    label: NDArray[np.intp]
    group: NDArray[np.intp]
    recording: NDArray[np.intp]
    machine: NDArray[np.intp]
    labels: tuple[str, ...]
    groups: tuple[str, ...]
    machines: tuple[str, ...]
    left_out: tuple[tuple[str, str], ...] = ()

    def __len__(self) -> int:
        return len(self.label)


def windows_of(
    found: Sequence[MeasuredRecording],
    window_s: float = WINDOW_S,
    views: Sequence[str] = tuple(VIEWS),
) -> FeatureRows:
    """Non-overlapping windows of every recording, in every view.

    Orders are left out, with the reason, where a single window has none.

    Raises
    ------
    DatasetError
        Recordings shorter than a window, by name.
    """
    _check_length(found, window_s)
    reason = _why_no_orders(found, window_s) if ORDERS_VIEW in views else ""
    kept = [name for name in views if not (name == ORDERS_VIEW and reason)]
    labels, groups, machines = (
        tuple(sorted({getattr(r, name) for r in found})) for name in ("label", "group", "machine")
    )
    rows: dict[str, list[Floats]] = {name: [] for name in kept}
    told: list[tuple[int, int, int, int]] = []
    for number, recording in enumerate(found):
        about = (
            labels.index(recording.label),
            groups.index(recording.group),
            number,
            machines.index(recording.machine),
        )
        for window, turns in windows(recording, window_s):
            for name in kept:
                rows[name].append(VIEWS[name](window, recording.rate_hz, turns))
            told.append(about)
    label, group, of, machine = np.array(told, np.intp).T
    left_out = ((ORDERS_VIEW, reason),) if reason else ()
    return FeatureRows(
        {name: np.array(each) for name, each in rows.items()},
        label,
        group,
        of,
        machine,
        labels,
        groups,
        machines,
        left_out,
    )


def windows(recording: MeasuredRecording, window_s: float) -> list[tuple[Floats, Floats | None]]:
    """Samples ``(channels, n)`` and shaft angle ``(n,)`` of every window."""
    n = window_samples(recording.rate_hz, window_s)
    turns = recording.turns
    return [
        (
            recording.samples[start : start + n].T,
            None if turns is None else turns[start : start + n],
        )
        for start in range(0, len(recording.samples) - n + 1, n)
    ]


def too_short(recording: MeasuredRecording, window_s: float = WINDOW_S) -> str:
    """Why no window of a recording can be taken, and what to do; empty where one can."""
    have, rate_hz = len(recording.samples), recording.rate_hz
    n, seconds = window_samples(rate_hz, window_s), have / rate_hz
    if have >= n:
        return ""
    shorter = f"give --window-s {floor(1e4 * seconds) / 1e4:g}, " if have >= WINDOW_SAMPLES else ""
    return (
        f"{have} samples ({seconds:.3g} s), a window has {n} ({n / rate_hz:.3g} s); {shorter}"
        "record longer, or leave it out"
    )


def _check_length(found: Sequence[MeasuredRecording], window_s: float) -> None:
    short = [f"{each.name}: {why}" for each in found if (why := too_short(each, window_s))]
    if short:
        raise DatasetError(listed(short))


def _why_no_orders(found: Sequence[MeasuredRecording], window_s: float) -> str:
    for each in found:
        for number, (_, turns) in enumerate(windows(each, window_s)):
            if reason := no_orders(each.rate_hz, turns):
                return f"{each.name}, window {number + 1}: {reason}"
    return ""
