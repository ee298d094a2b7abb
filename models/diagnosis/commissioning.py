"""What commissioning changes: the same unseen builds judged by the fleet, and by what is normal for
each of them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.features import FEATURE_NAMES
from firmware_py.brain import normal as own
from firmware_py.brain.diagnosis import DOUBT_BELOW
from firmware_py.records import Belonging, Normal
from models import export
from models.diagnosis import recordings
from models.diagnosis.dataset import WINDOWS_PER_DECISION, Dataset, pooled, severe
from models.diagnosis.judge import rule_of
from models.diagnosis.recordings import JUDGED_SECONDS, RecordingCase, RecordingPlan
from models.diagnosis.scores import class_probabilities, log_odds
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
    path: Path, rig: str, rate_hz: int, builds: int, workers: int, seed: int, out: Path
) -> dict[str, object]:
    """Figures after so many operating points of commissioning; builds follow from ``seed``.

    A decision rests on ten windows, 3 s at least; each point is one decision.

    Raises
    ------
    NormalError
        The file in ``path`` carries no statistics of healthy machines.
    """
    plan = RecordingPlan(rig, SEED + seed, rate_hz, JUDGED_SECONDS, commissioned_cases)
    rows = pooled(
        views_of(out, plan, builds, workers, WindowSampling(WINDOWS_PER_DECISION)).orders, 1
    )
    session, settings = export.session(path), _settings(path)
    if "normal" not in settings:
        raise own.NormalError(
            f"{path.name}: carries no statistics of healthy machines; train it again"
        )
    prior = msgspec.convert(settings["normal"], own.Prior)
    heads, score, white = (
        a.astype(np.float64)
        for a in session.run(
            ["heads", "score", "normal"], {"features": rows.features.astype(np.float32)}
        )
    )
    odds, strange = log_odds(heads), score[:, 0] > settings["novelty_threshold"]
    named_above = rule_of(path).named_above
    report: dict[str, object] = {}
    for points in POINTS:
        away, quiet = np.empty(len(rows)), np.zeros_like(odds)
        for build in np.unique(rows.group):
            mine = np.flatnonzero(rows.group == build)
            normal = learn(rows, odds, white, first_points(rows, mine, points), prior)
            away[mine] = own.Detector(prior, normal).novelty(white[mine])
            quiet[mine] = normal.quiet if normal else 0.0
        judged = rows.recording % _MOST_RECORDINGS >= LEARNED
        probability = class_probabilities(odds - quiet)
        report[f"{points} operating points"] = _figures(
            rows.subset(judged),
            away[judged],
            probability[judged],
            strange[judged],
            named_above,
            commissioned=points > 0,
        )
    return report


def first_points(rows: Dataset, mine: NDArray[np.intp], count: int) -> NDArray[np.intp]:
    """Those of the rows ``mine`` in the first ``count`` recordings, and in more where these lie too
    close together."""
    number = rows.recording[mine] % _MOST_RECORDINGS
    enough = count
    while (
        0 < enough < LEARNED
        and own.count_points(points_of(rows.features[mine[number < enough]])) < own.POINTS_LEAST
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
        points_of(rows.features[learned]),
        no_orbit,
        prior,
        _BELONGS,
        0.0,
    )


def points_of(features: NDArray[np.floating]) -> Floats:
    """Operating points as :data:`firmware_py.brain.normal.POINT`, from features."""
    names = (
        "log_speed_rad_s",
        "clearance_100um",
        "mean_x_over_clearance",
        "mean_y_over_clearance",
        "oil_outlet_50C",
    )
    speed, clearance, x, y, oil = (
        features[:, FEATURE_NAMES.index(name)].astype(np.float64) for name in names
    )
    return np.column_stack([10.0**speed, clearance * 1e-4, np.hypot(x, y), 50.0 * oil])


def _figures(
    rows: Dataset,
    away: Floats,
    probability: Floats,
    strange: NDArray[np.bool_],
    named_above: Floats,
    *,
    commissioned: bool,
) -> dict[str, object]:
    """AUROC of the distance from normal, and the words as the device says them."""
    from sklearn.metrics import roc_auc_score

    named, sure = probability.argmax(axis=1), probability.max(axis=1) >= DOUBT_BELOW
    taught = (named > 0) & sure & ~strange
    unknown = (away > 1.0) & ~taught if commissioned else strange
    told = taught & (probability.max(axis=1) >= np.r_[0.0, named_above][named] * probability[:, 0])
    healthy, must = rows.kind == 0, (rows.kind > 0) & severe(rows.kind, rows.severity)
    report: dict[str, object] = {
        "healthy_called_unknown": round(float(np.mean(unknown[healthy])), 4),
        "healthy_named_a_fault": round(float(np.mean(told[healthy])), 4),
        "taught_named_right": round(float(np.mean((named == rows.kind)[must] & told[must])), 4),
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
