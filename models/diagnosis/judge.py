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

from models import export
from models.diagnosis import alarms, recordings, scores
from models.diagnosis.alarms import DOUBT, UNKNOWN, WHIRL, Heard, Rule, Verdicts
from models.diagnosis.dataset import CLASSES, WINDOWS_PER_DECISION, Dataset, severe
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


def of_module(module: DiagnosisGraph) -> Verdicts:
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


def rule_of(path: Path) -> Rule:
    """The limits in an exported file's metadata."""
    settings = json.loads(export.session(path).get_modelmeta().custom_metadata_map["settings"])
    odds = settings.get("named_above", {})
    return Rule(
        float(settings["novelty_threshold"]),
        np.array([odds.get(name, 0.0) for name in CLASSES[1:]]),
    )


def judge(
    verdicts: Verdicts, rule: Rule, settings: JudgeSettings, seed: int, out: Path
) -> dict[str, object]:
    """All figures; builds, duties and noise follow from ``seed``, recordings are kept in
    ``out``."""

    def data(draw: Draw, seconds: float, builds: int) -> Dataset:
        return _views(draw, seconds, builds, settings, seed, out).orders

    judged = judged_views(settings, seed, out).orders
    unknown = data(recordings.unknown_cases, JUDGED_SECONDS, settings.unknown_builds)
    watched = alarms.hear(
        verdicts, data(recordings.watch_cases, WATCH_SECONDS, settings.watched_builds)
    )
    long = alarms.hear(verdicts, data(alarms.held_cases, alarms.HELD_SECONDS, settings.held_builds))
    faulty = alarms.onsets(
        verdicts, data(alarms.faulty_cases, WATCH_SECONDS, settings.onset_builds)
    )
    ten = decisions_of(verdicts, judged)
    return {
        "required_severities_per_10_windows": scores.summary(scores.required(ten)),
        "required_severities_per_window": scores.summary(
            scores.required(decisions_of(verdicts, judged, 1))
        ),
        "right_class_by_severity": scores.severity_grid(ten),
        "words_on_required_severities": said(alarms.hear(verdicts, judged, None), rule),
        "unknown_faults": unknown_faults(alarms.hear(verdicts, unknown, None), rule),
        "false_alarms": alarms.false_alarms(watched, rule),
        "long_healthy_runs": alarms.held(long, rule),
        "detection": alarms.detection(faulty, rule),
        "limits_traded": alarms.traded(watched, faulty, rule),
    }


def at_other_rate(
    verdicts: Verdicts, settings: JudgeSettings, seed: int, out: Path
) -> dict[str, object]:
    """The classes again, on builds sampled at the other rate that the model's metadata names."""
    other = msgspec.structs.replace(
        settings, rate_hz=sum(RATES_HZ) - settings.rate_hz, builds=settings.other_rate_builds
    )
    judged = judged_views(other, seed, out).orders
    return {
        "rate_hz": other.rate_hz,
        "required_severities_per_10_windows": scores.summary(
            scores.required(decisions_of(verdicts, judged))
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
    plan = RecordingPlan(settings.rig, JUDGE_SEED + seed, settings.rate_hz, seconds, draw)
    return views_of(out, plan, builds, settings.workers, WindowSampling(raw_builds=raw_builds))


def decisions_of(
    verdicts: Verdicts, data: Dataset, windows: int = WINDOWS_PER_DECISION
) -> Decisions:
    """Decisions, each from the mean features of ``windows`` windows; where the device says whirl it
    names no class."""
    heard = alarms.hear(verdicts, data, None, windows)
    heard = heard.subset(~heard.whirl)
    return decide(heard.probability, heard.rows)


def said(heard: Heard, rule: Rule) -> dict[str, dict[str, float]]:
    """The device's words on every class at the severities that must be found, as shares; ``other``:
    a wrong class."""
    needed = heard.subset(severe(heard.rows.kind, heard.rows.severity))
    words = needed.words(rule)
    report = {}
    for kind, name in enumerate(CLASSES):
        of_kind = words[needed.rows.kind == kind]
        shares = {
            "right": of_kind == kind,
            "doubt": of_kind == DOUBT,
            "unknown": of_kind == UNKNOWN,
            "whirl": of_kind == WHIRL,
            "other": (of_kind != kind) & (of_kind < UNKNOWN),
        }
        report[name] = {word: round(float(np.mean(rows)), 4) for word, rows in shares.items()}
    return report


def unknown_faults(heard: Heard, rule: Rule) -> dict[str, object]:
    """How well the novelty score tells faults that were never taught from healthy builds, per ten
    windows.

    Decisions in which the device says whirl are left out: there it asks for no novelty.
    """
    from sklearn.metrics import roc_auc_score

    heard = heard.subset(~heard.whirl)
    words, rows = heard.words(rule), heard.rows
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
            "auroc": round(float(roc_auc_score(fault[both], heard.novelty[both])), 4),
            "called_unknown": round(float(np.mean(words[fault] == UNKNOWN)), 4),
            "called_a_taught_fault": round(
                float(np.mean((words[fault] > 0) & (words[fault] < UNKNOWN))), 4
            ),
            "decisions": int(fault.sum()),
        }
    return report
