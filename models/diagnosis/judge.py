"""A fault classifier judged on builds that no training has seen: named, unknown, false alarms,
delays."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import torch
from numpy.typing import NDArray

from firmware_py.brain.verdict import DOUBT, UNKNOWN, WHIRL, WINDOWS, VerdictLimits
from models import export
from models.diagnosis import alarms, recordings, scores
from models.diagnosis.alarms import Answers, FoundRows
from models.diagnosis.dataset import CLASSES, Dataset, severe
from models.diagnosis.graph import DiagnosisGraph
from models.diagnosis.recordings import JUDGED_SECONDS, WATCH_SECONDS, RecordingPlan
from models.diagnosis.scores import Decisions, decide
from models.diagnosis.windowed import Views, WindowSampling, views_of
from models.runs import TrainerSettings

Floats = NDArray[np.float64]
Draw = Callable[[np.random.Generator], list[recordings.RecordingCase]]
RATES_HZ = (5000, 10000)
"""Sampling rates that a classifier is made for."""

JUDGE_SEED = 1_000_000
"""Added to the seed of builds that judge, so that they are never those of a training seed."""


class JudgeSettings(TrainerSettings, frozen=True):
    """How much a classifier is judged with.

    ``unknown_builds``: of 240 the AUROC of a rub, which half of them touch, moves by 0.012 from
    seed to seed. ``watched_builds``: the upper limit of false alarms a month needs 2156 runs
    without any, 3412 with one.
    """

    rig: str = "bench"
    rate_hz: int = 5000
    builds: int = 80
    unknown_builds: int = 720
    watched_builds: int = 3600
    held_builds: int = 80
    onset_builds: int = 30
    commissioned_builds: int = 40
    other_rate_builds: int = 40
    workers: int = 2
    keep_samples: bool = True


def of_module(module: DiagnosisGraph) -> Answers:
    """A torch module as :data:`Answers`."""

    def answers(features: NDArray[np.floating]) -> tuple[Floats, Floats]:
        with torch.no_grad():
            heads, score, *_ = module(torch.from_numpy(features.astype(np.float32)))
        return heads.double().numpy(), score.double().numpy()[:, 0]

    return answers


def of_file(path: Path) -> Answers:
    """An exported file as :data:`Answers`."""
    session = export.session(path)

    def answers(features: NDArray[np.floating]) -> tuple[Floats, Floats]:
        heads, score = session.run(["heads", "score"], {"features": features.astype(np.float32)})
        return heads.astype(np.float64), score[:, 0].astype(np.float64)

    return answers


def limits_of(path: Path) -> VerdictLimits:
    """The limits in an exported file's metadata."""
    metadata = export.session(path).get_modelmeta().custom_metadata_map
    return VerdictLimits.of(json.loads(metadata["settings"]))


def judge(
    answers: Answers, limits: VerdictLimits, settings: JudgeSettings, seed: int, out: Path
) -> dict[str, object]:
    """All figures; builds, duties and noise follow from ``seed``, recordings are kept in
    ``out``."""

    def data(draw: Draw, seconds: float, builds: int) -> Dataset:
        return _views(draw, seconds, builds, settings, seed, out).orders

    judged = judged_views(settings, seed, out).orders
    unknown = data(recordings.unknown_cases, JUDGED_SECONDS, settings.unknown_builds)
    watched = alarms.find(
        answers, data(recordings.watch_cases, WATCH_SECONDS, settings.watched_builds)
    )
    long = alarms.find(answers, data(alarms.held_cases, alarms.HELD_SECONDS, settings.held_builds))
    faulty = alarms.onsets(answers, data(alarms.faulty_cases, WATCH_SECONDS, settings.onset_builds))
    ten = decisions_of(answers, judged)
    return {
        "required_severities_per_10_windows": scores.summary(scores.required(ten)),
        "required_severities_per_window": scores.summary(
            scores.required(decisions_of(answers, judged, 1))
        ),
        "right_class_by_severity": scores.severity_grid(ten),
        "words_on_required_severities": said(alarms.find(answers, judged, None), limits),
        "unknown_faults": unknown_faults(alarms.find(answers, unknown, None), limits),
        "false_alarms": alarms.false_alarms(watched, limits),
        "long_healthy_runs": alarms.held(long, limits),
        "detection": alarms.detection(faulty, limits),
        "limits_traded": alarms.traded(watched, faulty, limits),
    }


def at_other_rate(
    answers: Answers, settings: JudgeSettings, seed: int, out: Path
) -> dict[str, object]:
    """The classes again, on builds sampled at the other rate that the model's metadata names."""
    rate_hz = next(rate for rate in RATES_HZ if rate != settings.rate_hz)
    other = msgspec.structs.replace(settings, rate_hz=rate_hz, builds=settings.other_rate_builds)
    judged = judged_views(other, seed, out).orders
    return {
        "rate_hz": other.rate_hz,
        "required_severities_per_10_windows": scores.summary(
            scores.required(decisions_of(answers, judged))
        ),
    }


def judged_views(settings: JudgeSettings, seed: int, out: Path) -> Views:
    """Builds that no training has seen, over the whole severity grid."""
    return _views(
        recordings.judged_cases,
        JUDGED_SECONDS,
        settings.builds,
        settings,
        seed,
        out,
        settings.builds,
    )


def _views(
    draw: Draw,
    seconds: float,
    builds: int,
    settings: JudgeSettings,
    seed: int,
    out: Path,
    raw_builds: int = 0,
) -> Views:
    look = WindowSampling(raw_builds=raw_builds, keep_samples=settings.keep_samples)
    plan = RecordingPlan(settings.rig, JUDGE_SEED + seed, settings.rate_hz, seconds, draw)
    return views_of(out, plan, builds, settings.workers, look)


def decisions_of(answers: Answers, data: Dataset, windows: int = WINDOWS) -> Decisions:
    """Decisions, each from the mean features of ``windows`` windows; where the device says whirl it
    names no class."""
    found = alarms.find(answers, data, None, windows)
    found = found.subset(~found.found.whirl)
    return decide(found.probability, found.rows)


def said(found: FoundRows, limits: VerdictLimits) -> dict[str, dict[str, float]]:
    """The device's words on every class at the severities that must be found, as shares; ``other``:
    a wrong class."""
    needed = found.subset(severe(found.rows.kind, found.rows.severity))
    words = needed.words(limits)
    report = {}
    for kind, name in enumerate(CLASSES):
        of_kind = words[needed.rows.kind == kind]
        if not len(of_kind):
            continue
        shares = {
            "right": of_kind == kind,
            "doubt": of_kind == DOUBT,
            "unknown": of_kind == UNKNOWN,
            "whirl": of_kind == WHIRL,
            "other": (of_kind != kind) & (of_kind < UNKNOWN),
        }
        report[name] = {word: round(float(np.mean(rows)), 4) for word, rows in shares.items()}
    return report


def unknown_faults(found: FoundRows, limits: VerdictLimits) -> dict[str, object]:
    """How well the novelty score tells faults that were never taught from healthy builds, per ten
    windows.

    Decisions in which the device says whirl are left out: there it asks for no novelty.
    """
    from sklearn.metrics import roc_auc_score

    found = found.subset(~found.found.whirl)
    words, rows = found.words(limits), found.rows
    healthy = rows.kind == 0
    report: dict[str, object] = {
        "healthy_called_unknown": round(float(np.mean(words[healthy] == UNKNOWN)), 4)
    }
    for k, name in enumerate(recordings.UNKNOWN_LABELS):
        fault = (rows.kind == recordings.UNKNOWN_KIND) & (rows.severity == k)
        if not fault.any():
            continue
        both = healthy | fault
        report[name] = {
            "auroc": round(float(roc_auc_score(fault[both], found.found.novelty[both])), 4),
            "called_unknown": round(float(np.mean(words[fault] == UNKNOWN)), 4),
            "called_a_taught_fault": round(
                float(np.mean((words[fault] > 0) & (words[fault] < UNKNOWN))), 4
            ),
            "decisions": int(fault.sum()),
        }
    return report
