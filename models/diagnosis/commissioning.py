"""What commissioning changes: the same unseen builds judged by the fleet, and by what is normal for
each of them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.feature_rows import operating_points_of
from firmware_py.brain import normal as own
from firmware_py.brain.verdict import NOT_LEARNED, UNKNOWN, WINDOWS, VerdictLimits
from firmware_py.records import Belonging, Normal
from models import export
from models.diagnosis import alarms, recordings
from models.diagnosis.alarms import FoundRows
from models.diagnosis.dataset import Dataset, severe
from models.diagnosis.judge import of_file
from models.diagnosis.recordings import JUDGED_SECONDS, RecordingCase, RecordingPlan
from models.diagnosis.windowed import WindowSampling, views_of

Floats = NDArray[np.float64]

SEED: Final = 2_000_000
"""Added to the seed, so that the builds are none that train or judge a classifier."""
LEARNED: Final = 24
"""Healthy recordings of a build that may be learned from, each at an operating point of its own."""
POINTS: Final = (0, 4, 8, 16, LEARNED)
HEALTHY: Final = 8
UNKNOWN_EACH: Final = 2
_MOST_RECORDINGS: Final = 100
"""Recordings of one build are numbered below it (:mod:`models.diagnosis.windowed`)."""
_BELONGS: Final = Belonging("judged", "judged", "judged", "judged")


def commissioned_cases(rng: np.random.Generator) -> list[RecordingCase]:
    """Healthy ones to learn from and to judge, every unknown twice, every taught fault where it
    must be found."""
    unknown = [case for _ in range(UNKNOWN_EACH) for case in recordings.unknown_cases(rng)[1:]]
    taught = [
        RecordingCase(kind, severity, {name: severity})
        for kind, name in enumerate(recordings.FAULT_OF_CLASS)
        if name
        for severity in [16.0 if name == "unbalance" else 25.0]
    ]
    return [RecordingCase(0, 100.0, {})] * (LEARNED + HEALTHY) + unknown + taught


def judge(
    path: Path,
    rig: str,
    rate_hz: int,
    builds: int,
    workers: int,
    seed: int,
    out: Path,
    keep_samples: bool = True,
) -> dict[str, object]:
    """Figures after so many operating points of commissioning; builds follow from ``seed``.

    A decision rests on ten windows, 3 s at least; each point is one decision.

    Raises
    ------
    NormalError
        The file in ``path`` carries no statistics of healthy machines.
    """
    plan = RecordingPlan(rig, SEED + seed, rate_hz, JUDGED_SECONDS, commissioned_cases)
    settings, look = _settings(path), WindowSampling(keep_samples=keep_samples)
    if "normal" not in settings:
        raise own.NormalError(
            f"{path.name}: carries no statistics of healthy machines; train it again"
        )
    prior, limits = msgspec.convert(settings["normal"], own.Prior), VerdictLimits.of(settings)
    every = views_of(out, plan, builds, workers, look).orders
    fleet = alarms.find(of_file(path), every, None)
    (white,) = export.session(path).run(
        ["normal"], {"features": fleet.rows.features.astype(np.float32)}
    )
    white, judged = white.astype(np.float64), fleet.rows.recording % _MOST_RECORDINGS >= LEARNED
    report: dict[str, object] = {}
    for points in POINTS:
        away, known = after(fleet, white, points, prior, limits)
        report[f"{points} operating points"] = _figures(known.subset(judged), away[judged], limits)
    return report


def after(
    fleet: FoundRows, white: Floats, points: int, prior: own.Prior, limits: VerdictLimits
) -> tuple[Floats, FoundRows]:
    """Distance of every decision from what is normal for its build after so many operating points,
    and what the device then finds.

    The distance is that of the features: of the orbit's first order, which the device also watches,
    recordings of features know nothing.
    """
    rows, odds = fleet.rows, fleet.found.log_odds
    away, own_normal = np.empty(len(rows)), np.full(len(rows), np.nan)
    quiet = np.zeros_like(odds)
    learned = ~np.isin(fleet.words(limits), NOT_LEARNED) & (fleet.found.windows >= WINDOWS)
    for build in np.unique(rows.group):
        mine = np.flatnonzero(rows.group == build)
        taken = first_points(rows, mine[learned[mine]], points)
        normal = learn(rows, odds, white, taken, prior)
        away[mine] = own.Detector(prior, normal).novelty(white[mine])
        if normal is not None:
            own_normal[mine], quiet[mine] = away[mine], normal.quiet
    return away, FoundRows(replace(fleet.found, log_odds=odds - quiet, own=own_normal), rows)


def first_points(rows: Dataset, mine: NDArray[np.intp], count: int) -> NDArray[np.intp]:
    """Those of the rows ``mine`` in the first ``count`` recordings, and in more where these lie too
    close together."""
    number = rows.recording[mine] % _MOST_RECORDINGS
    enough = count
    while (
        0 < enough < LEARNED
        and own.count_points(operating_points_of(rows.features[mine[number < enough]]))
        < own.POINTS_LEAST
    ):
        enough += 1
    return mine[number < enough]


def learn(
    rows: Dataset, odds: Floats, white: Floats, learned: NDArray[np.intp], prior: own.Prior
) -> Normal | None:
    """The state of one build after its rows ``learned``; None without any."""
    if not len(learned):
        return None
    no_orbit = np.zeros(len(learned), np.complex128)
    return own.fit(
        white[learned],
        odds[learned],
        operating_points_of(rows.features[learned]),
        no_orbit,
        prior,
        _BELONGS,
        0.0,
    )


def _figures(known: FoundRows, away: Floats, limits: VerdictLimits) -> dict[str, object]:
    """AUROC of the distance from normal, and the words as the device says them."""
    from sklearn.metrics import roc_auc_score

    rows, said = known.rows, known.words(limits)
    unknown, told = said == UNKNOWN, (said > 0) & (said < UNKNOWN)
    healthy, must = rows.kind == 0, (rows.kind > 0) & severe(rows.kind, rows.severity)
    report: dict[str, object] = {
        "healthy_called_unknown": round(float(np.mean(unknown[healthy])), 4),
        "healthy_named_a_fault": round(float(np.mean(told[healthy])), 4),
        "taught_named_right": round(float(np.mean((said == rows.kind)[must])), 4),
        "taught_called_unknown": round(float(np.mean(unknown[must])), 4),
    }
    for k, name in enumerate(recordings.UNKNOWN_LABELS):
        fault = (rows.kind == recordings.UNKNOWN_KIND) & (rows.severity == k)
        if fault.any():
            both = healthy | fault
            report[name] = {
                "auroc": round(float(roc_auc_score(fault[both], away[both])), 4),
                "called_unknown": round(float(np.mean(unknown[fault])), 4),
                "decisions": int(fault.sum()),
            }
    return report


def _settings(path: Path) -> dict[str, object]:
    settings: dict[str, object] = json.loads(
        export.session(path).get_modelmeta().custom_metadata_map["settings"]
    )
    return settings
