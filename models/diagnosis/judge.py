"""A fault classifier judged on builds that no training has seen: named, unknown, false alarms, delays."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from firmware_py.acquire.features import FEATURE_NAMES
from firmware_py.acquire.windows import HOP_SECONDS
from firmware_py.brain.diagnosis import CONFIRM_NS, DOUBT_BELOW
from models import export
from models.diagnosis import recordings, scores
from models.diagnosis.dataset import CLASSES, WINDOWS_PER_DECISION, Dataset, join, pooled, severe
from models.diagnosis.graph import Diagnosis
from models.diagnosis.recordings import JUDGED_SECONDS, WATCH_SECONDS, Plan
from models.diagnosis.scores import Decisions, class_probabilities, decide, log_odds
from models.diagnosis.windowed import Views, views_of
from models.runs import Settings

Floats = NDArray[np.float64]
Verdicts = Callable[[NDArray[np.floating]], tuple[Floats, Floats]]
"""Features ``(n, F)`` to probabilities of the heads ``(n, 4)`` and novelty scores ``(n,)``."""

JUDGE_SEED = 1_000_000
"""Added to the seed of builds that judge, so that they are never those of a training seed."""
MONTH_S = 30 * 86400.0
UNKNOWN = len(CLASSES)
DOUBT = UNKNOWN + 1
"""Words beside the classes."""


class JudgeSettings(Settings, frozen=True):
    """How much a classifier is judged with."""

    rig: str = "bench"
    rate_hz: int = 5000
    builds: int = 80
    unknown_builds: int = 20
    watched_builds: int = 300
    workers: int = 2


def of_module(module: Diagnosis) -> Verdicts:
    """A torch module as :data:`Verdicts`."""

    def verdicts(features: NDArray[np.floating]) -> tuple[Floats, Floats]:
        with torch.no_grad():
            heads, score, *_ = module(torch.from_numpy(features.astype(np.float32)))
        return heads.double().numpy(), score.double().numpy()[:, 0]

    return verdicts


def of_file(path: Path) -> Verdicts:
    """An exported file as :data:`Verdicts`."""
    session = export.session(path)

    def verdicts(features: NDArray[np.floating]) -> tuple[Floats, Floats]:
        heads, score = session.run(["heads", "score"], {"features": features.astype(np.float32)})
        return heads.astype(np.float64), score[:, 0].astype(np.float64)

    return verdicts


def novelty_threshold(path: Path) -> float:
    """The threshold in an exported file's metadata."""
    settings = json.loads(export.session(path).get_modelmeta().custom_metadata_map["settings"])
    return float(settings["novelty_threshold"])


def milliseconds(verdicts: Verdicts, calls: int = 200) -> float:
    """Median duration of a call with one row."""
    row = np.zeros((1, len(FEATURE_NAMES)), np.float32)
    durations = []
    for _ in range(calls):
        started = time.perf_counter()
        verdicts(row)
        durations.append(time.perf_counter() - started)
    return 1e3 * float(np.median(durations))


def judge(
    verdicts: Verdicts, threshold: float, settings: JudgeSettings, seed: int, out: Path
) -> dict[str, object]:
    """All figures; builds, duties and noise follow from ``seed``, recordings are kept in ``out``."""
    judged = judged_views(settings, seed, out).orders
    unknown = _views(recordings.unknown_cases, JUDGED_SECONDS, settings.unknown_builds, settings, seed, out).orders
    watched = _views(recordings.watch_cases, WATCH_SECONDS, settings.watched_builds, settings, seed, out).orders
    ten = decisions_of(verdicts, judged)
    return {
        "required_severities_per_10_windows": scores.summary(scores.required(ten)),
        "required_severities_per_window": scores.summary(scores.required(decisions_of(verdicts, judged, 1))),
        "right_class_by_severity": scores.severity_grid(ten),
        "unknown_faults": unknown_faults(verdicts, unknown, threshold),
        "false_alarms": false_alarms(verdicts, watched, threshold),
        "detection": detection(verdicts, judged, threshold),
    }


def judged_views(settings: JudgeSettings, seed: int, out: Path) -> Views:
    """Builds that no training has seen, over the whole severity grid."""
    return _views(recordings.judged_cases, JUDGED_SECONDS, settings.builds, settings, seed, out)


def _views(draw: Callable[[np.random.Generator], list[recordings.Case]], seconds: float, builds: int,
           settings: JudgeSettings, seed: int, out: Path) -> Views:  # fmt: skip
    plan = Plan(settings.rig, JUDGE_SEED + seed, settings.rate_hz, seconds, draw)
    return views_of(out, plan, builds, settings.workers)


def decisions_of(verdicts: Verdicts, data: Dataset, windows: int = WINDOWS_PER_DECISION) -> Decisions:
    """Decisions, each from the mean features of ``windows`` windows."""
    rows = pooled(data, windows)
    return decide(class_probabilities(log_odds(verdicts(rows.features)[0])), rows)


def words(verdicts: Verdicts, rows: Dataset, threshold: float) -> NDArray[np.intp]:
    """The device's word on each row: a class, :data:`UNKNOWN` or :data:`DOUBT`."""
    heads, score = verdicts(rows.features)
    probability = class_probabilities(log_odds(heads))
    word = np.where(probability.max(axis=1) < DOUBT_BELOW, DOUBT, probability.argmax(axis=1))
    return np.asarray(np.where(score > threshold, UNKNOWN, word), dtype=np.intp)


def unknown_faults(verdicts: Verdicts, data: Dataset, threshold: float) -> dict[str, object]:
    """How well the novelty score tells faults that were never taught from healthy builds, per ten windows."""
    from sklearn.metrics import roc_auc_score

    rows = pooled(data, WINDOWS_PER_DECISION)
    _, novelty = verdicts(rows.features)
    said = words(verdicts, rows, threshold)
    healthy = rows.kind == 0
    report: dict[str, object] = {"healthy_called_unknown": round(float(np.mean(said[healthy] == UNKNOWN)), 4)}
    for k, name in enumerate(recordings.UNKNOWNS):
        fault = (rows.kind == recordings.UNKNOWN_KIND) & (rows.severity == k)
        both = healthy | fault
        report[name] = {
            "auroc": round(float(roc_auc_score(fault[both], novelty[both])), 4),
            "called_unknown": round(float(np.mean(said[fault] == UNKNOWN)), 4),
            "called_a_taught_fault": round(float(np.mean((said[fault] > 0) & (said[fault] < UNKNOWN))), 4),
        }
    return report


def false_alarms(verdicts: Verdicts, data: Dataset, threshold: float) -> dict[str, object]:
    """Words on healthy machines that name a fault: per decision every hop, and confirmed by persistence.

    The upper 95 % limit of the rate is a bootstrap over builds; without any alarm it is the rule of three over
    the builds, which a bootstrap cannot give.
    """
    rows = pooled(data, WINDOWS_PER_DECISION, 1)
    said = words(verdicts, rows, threshold)
    alarm = (said > 0) & (said < UNKNOWN)
    builds = np.unique(rows.group)
    share = np.array([np.mean(alarm[rows.group == build]) for build in builds])
    draws = np.random.default_rng(0).integers(0, len(builds), (2000, len(builds)))
    upper = float(np.quantile(share[draws].mean(axis=1), 0.95)) if alarm.any() else 3.0 / len(builds)
    confirmed = sum(_longest_run(said[rows.recording == r], alarm[rows.recording == r]) * HOP_SECONDS * 1e9
                    >= CONFIRM_NS for r in np.unique(rows.recording))  # fmt: skip
    hours = len(rows) * HOP_SECONDS / 3600.0
    return {
        "healthy_builds": len(builds), "decisions": len(rows), "watched_hours": round(hours, 3),
        "false_alarms": int(alarm.sum()), "builds_with_a_false_alarm": int(np.sum(share > 0)),
        "share_of_decisions": round(float(share.mean()), 6), "upper_95": round(upper, 6),
        "called_unknown": round(float(np.mean(said == UNKNOWN)), 5), "doubt": round(float(np.mean(said == DOUBT)), 5),
        "confirmed_alarms": int(confirmed),
        "confirmed_per_machine_month_if_builds_alarmed_anew": round(confirmed / hours * MONTH_S / 3600.0, 1),
    }  # fmt: skip


def _longest_run(said: NDArray[np.intp], alarm: NDArray[np.bool_]) -> int:
    """Decisions in the longest stretch that names one and the same fault."""
    longest = run = 0
    for i in range(len(said)):
        run = run + 1 if alarm[i] and run and said[i] == said[i - 1] else int(alarm[i])
        longest = max(longest, run)
    return longest


def detection(verdicts: Verdicts, data: Dataset, threshold: float) -> dict[str, object]:
    """Seconds from a fault's first window to its right name, after ten healthy windows of the same build.

    At the severities that must be found; the healthy windows are of another operating point, which is harder
    than a fault that comes while the machine runs on.
    """
    needed = severe(data.kind, data.severity)
    delays: dict[str, list[float]] = {}
    for recording in np.unique(data.recording[(data.kind > 0) & needed]):
        rows = np.flatnonzero(data.recording == recording)
        before = np.flatnonzero((data.group == data.group[rows[0]]) & (data.kind == 0))[-WINDOWS_PER_DECISION:]
        joined = join([data.subset(before), data.subset(rows)])
        joined = Dataset(joined.features, *(np.full(len(joined), getattr(data, name)[rows[0]]) for name in (
            "kind", "severity", "group", "recording", "loop", "duty")))  # fmt: skip
        said = words(verdicts, pooled(joined, WINDOWS_PER_DECISION, 1), threshold)[1:]
        right = np.flatnonzero(said == joined.kind[0])
        delays.setdefault(CLASSES[joined.kind[0]], []).append((right[0] + 1) * HOP_SECONDS if len(right) else np.inf)
    return {name: {"median_s": float(np.median(found)), "never_in_4_s": round(float(np.mean(np.isinf(found))), 4),
                   "recordings": len(found)} for name, found in delays.items()}  # fmt: skip
