"""Labelled windows of recordings, and splits that never share a group."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.features import FEATURE_NAMES
from firmware_py.brain import verdict
from firmware_py.brain.verdict import HEADS_OF_CLASS

Floats = NDArray[np.float64]
Rows = NDArray[np.bool_] | NDArray[np.intp] | slice

CLASSES = tuple(verdict.CLASSES)
"""Names of the classes, in the order of their labels."""


SLIGHT_WEIGHT = 0.1


def severe(kind: NDArray[np.intp], severity: Floats) -> NDArray[np.bool_]:
    """Healthy, or a fault at a severity that must be found: grade G16 and more, at most 25 % of the
    preload."""
    needed = np.where(kind == CLASSES.index("unbalance"), severity >= 16.0, severity <= 25.0)
    return np.asarray((kind <= 0) | needed)


class DatasetError(ValueError):
    """The data cannot be trained on or judged with; the text names cause, place and next step."""


@dataclass(frozen=True)
class Dataset:
    """Windows in the order of their recordings.

    ``features`` ``(n, F)``, or raw samples in their place; ``kind`` the class of each window;
    ``severity`` what is left of the preload in percent, or the balance grade; ``group`` the build,
    ``recording`` the recording that it comes from; ``loop`` and ``duty`` who moved the clearance
    and what speed and load did; ``bad`` where a channel was not OK.
    """

    features: NDArray[np.floating]
    kind: NDArray[np.intp]
    severity: Floats
    group: NDArray[np.intp]
    recording: NDArray[np.intp]
    loop: NDArray[np.intp]
    duty: NDArray[np.intp]
    bad: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.features)

    @property
    def heads(self) -> Floats:
        """Which of the four heads each window's class has, ``(n, 4)``."""
        return HEADS_OF_CLASS[self.kind]

    @property
    def weight(self) -> Floats:
        """Weight of each row in training, ``(n,)``: 1, and :data:`SLIGHT_WEIGHT` for faults that
        need not be found."""
        return np.where(severe(self.kind, self.severity), 1.0, SLIGHT_WEIGHT)

    def subset(self, rows: Rows) -> Dataset:
        """The windows at ``rows``."""
        return Dataset(*(getattr(self, f.name)[rows] for f in fields(self)))

    def check(self) -> None:
        """Refuse what cannot be trained on.

        Raises
        ------
        DatasetError
            Empty, mismatched or non-finite data, unknown classes, a class with fewer than two
            recordings.
        """
        if len(self) == 0:
            raise DatasetError(
                "dataset is empty: no usable window; check speed, marks and recording length"
            )
        lengths = {f.name: len(getattr(self, f.name)) for f in fields(self)}
        if len(set(lengths.values())) != 1:
            raise DatasetError(
                f"columns differ in length: {lengths}; every window needs every label"
            )
        bad = np.argwhere(~np.isfinite(self.features))
        if len(bad):
            row, column = bad[0]
            name = (
                FEATURE_NAMES[column]
                if self.features.shape[1] == len(FEATURE_NAMES)
                else f"column {column}"
            )
            raise DatasetError(
                f"{len(bad)} features are not finite, the first: {name} in recording "
                f"{self.recording[row]}; "
                "drop the recording or supply the missing reading"
            )
        if self.kind.min() < 0 or self.kind.max() >= len(CLASSES):
            raise DatasetError(
                f"class label outside 0 .. {len(CLASSES) - 1}: {sorted(set(self.kind.tolist()))}"
            )
        for kind in np.unique(self.kind):
            count = len(np.unique(self.recording[self.kind == kind]))
            if count < 2:
                raise DatasetError(
                    f"class {CLASSES[kind]} has {count} recording: at least 2 are needed so that "
                    f"one can be "
                    "held out; record more or leave the class out"
                )


def spans(data: Dataset, windows: int, step: int | None = None) -> list[tuple[int, int]]:
    """First row of each decision and the row after its last: ``windows`` windows every ``step``
    (default: no overlap).

    A recording that is shorter than ``windows`` but has half of them gives one decision.
    """
    borders = np.flatnonzero(np.r_[True, np.diff(data.recording) != 0, True])
    all_spans = (
        (at, min(end, at + windows))
        for start, end in pairwise(borders.tolist())
        for at in range(start, max(start + 1, end - windows + 1), step or windows)
    )
    return [(first, end) for first, end in all_spans if end - first >= windows / 2]


def pooled(data: Dataset, windows: int, step: int | None = None) -> Dataset:
    """Mean features of the :func:`spans` of a recording."""
    decisions = spans(data, windows, step)
    means = [data.features[first:end].mean(axis=0, dtype=np.float64) for first, end in decisions]
    features = np.array(means, data.features.dtype).reshape(-1, data.features.shape[1])
    rows = data.subset(np.array([first for first, _ in decisions], dtype=np.intp))
    return replace(rows, features=features)


def split_groups(data: Dataset, share: float, rng: np.random.Generator) -> tuple[Dataset, Dataset]:
    """Two parts that share no group; the second holds about ``share`` of the groups."""
    groups = rng.permutation(np.unique(data.group))
    held = np.isin(data.group, groups[: max(1, round(share * len(groups)))])
    parts = data.subset(~held), data.subset(held)
    check_disjoint(*parts)
    return parts


def check_disjoint(first: Dataset, second: Dataset) -> None:
    """Refuse a split with a group on both sides.

    Raises
    ------
    DatasetError
        Names the groups.
    """
    both = np.intersect1d(first.group, second.group)
    if len(both):
        raise DatasetError(
            f"{len(both)} groups stand on both sides of the split (e.g. {both[:5].tolist()}): the "
            f"score would "
            "be of memory, not of unseen builds; split by group"
        )


def join(parts: list[Dataset]) -> Dataset:
    """All windows of ``parts``."""
    return Dataset(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Dataset)))
