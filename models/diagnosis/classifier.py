"""Trainer of the fault classifier: the ladder on inner builds, calibration, novelty, judged on
unseen builds."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path

import msgspec
import numpy as np
import torch
from numpy.typing import NDArray

from firmware_py.acquire.features import FEATURE_NAMES
from firmware_py.acquire.windows import WINDOW_LAYOUT
from firmware_py.brain.verdict import WINDOWS, VerdictLimits, class_probabilities
from models import card, export, figures
from models.diagnosis import commissioning, recordings, scores
from models.diagnosis.dataset import CLASSES, Dataset, split_groups
from models.diagnosis.graph import DiagnosisGraph
from models.diagnosis.judge import (
    RATES_HZ,
    JudgeSettings,
    at_other_rate,
    decisions_of,
    judge,
    judged_views,
    limits_of,
    of_file,
    of_module,
)
from models.diagnosis.ladder import HeadNetwork, cross_fitted
from models.diagnosis.novelty import fit_novelty, fleet
from models.diagnosis.real_figures import REAL_RECORDINGS
from models.diagnosis.recordings import RecordingPlan
from models.diagnosis.rungs import LadderSettings, choose, climb
from models.diagnosis.windowed import Views, WindowSampling, per_decision, views_of
from models.runs import TrainerSettings, TrainingRun


class ClassifierSettings(TrainerSettings, frozen=True):
    """What ``orbitd train classifier`` does; every key may stand in the ``--config`` file.

    ``false_alarm_rate``: healthy decisions that may name a fault, a tenth of what is allowed
    (1e-4): the rate that 6000 healthy recordings foretell was met by 2200 others, but not its upper
    limit.
    """

    rig: str = "bench"
    rate_hz: int = 5000
    builds: int = 2000
    seconds: float = 3.1
    raw_builds: int = 200
    judge: JudgeSettings = JudgeSettings(unknown_builds=80, watched_builds=400, held_builds=30)
    inner_share: float = 0.2
    ladder: LadderSettings = LadderSettings()
    novelty_quantile: float = 0.999
    false_alarm_rate: float = 1e-5
    folds: int = 5
    workers: int = 2
    keep_samples: bool = True

    def smoked(self) -> ClassifierSettings:
        """The same training in some seconds."""
        return ClassifierSettings(
            workers=1,
            builds=8,
            judge=JudgeSettings(
                builds=2,
                unknown_builds=2,
                watched_builds=2,
                held_builds=2,
                onset_builds=2,
                workers=1,
            ),
            ladder=LadderSettings(
                hidden=8,
                own_hidden=2,
                members=2,
                l2=(1e-3,),
                iterations=60,
                paper_hidden=4,
                paper_iterations=5,
                epochs=2,
            ),
        )


SETTINGS = ClassifierSettings


NOVELTY_THRESHOLD = 1.0
"""Novelty is scaled to it."""


def train(run: TrainingRun, settings: ClassifierSettings) -> dict[str, object]:
    """Train, judge and export; returns the report that is written beside the model."""
    started = time.monotonic()
    rng, out = np.random.default_rng(run.seed), run.folder.parent
    plan = RecordingPlan(
        settings.rig, run.seed, settings.rate_hz, settings.seconds, recordings.training_cases
    )
    look = WindowSampling(WINDOWS, settings.raw_builds, settings.keep_samples)
    views = views_of(out, plan, settings.builds, settings.workers, look)
    views.orders.check()
    outer, inner = _split(views, settings.inner_share, rng)
    recorded_s = time.monotonic() - started
    judged = judged_views(settings.judge, run.seed, out)
    started = time.monotonic()
    chosen, rows, unseen = run.kept(
        "ladder", partial(_climbed, outer, inner, per_decision(judged), settings, run.seed)
    )
    for row in rows:
        run.log(row)
    module = _finish(chosen, outer.orders, inner.orders, settings)
    trained_s = round(recorded_s + time.monotonic() - started, 1)
    odds = run.kept("limits", partial(_named_above, chosen, views.orders, settings, run.seed))
    limits, answers = VerdictLimits(NOVELTY_THRESHOLD, odds), of_module(module)
    report: dict[str, object] = {
        "chosen": chosen.name,
        "inner_ladder": rows,
        "ladder_on_unseen_builds": unseen,
        "named_above": _by_fault(limits),
        "cannot_be_told_apart": scores.confused(
            scores.required(decisions_of(answers, judged.orders))
        ),
        "real_recordings": REAL_RECORDINGS,
        "unseen_builds": judge(answers, limits, settings.judge, run.seed, out),
        "training": {
            "builds": settings.builds,
            "decisions": len(views.orders),
            "seconds_until_judged": trained_s,
        },
        "reproduce": run.command,
    }
    _export(module, limits, run, views.orders, settings, report)
    figures.classifier(run.folder, decisions_of(answers, judged.orders))
    return report


Rows = list[dict[str, object]]


def _climbed(
    outer: Views, inner: Views, unseen: Views, settings: ClassifierSettings, seed: int
) -> tuple[HeadNetwork, Rows, dict[str, object]]:
    """The chosen network, a row for each rung on the inner builds, and the rungs on ``unseen``."""
    rungs = climb(outer, inner, settings.ladder, settings.rate_hz, seed)
    chosen, rows = choose(rungs, inner)
    return chosen, rows, {r.name: scores.summary(r.decisions(unseen)) for r in rungs}


def _split(views: Views, share: float, rng: np.random.Generator) -> tuple[Views, Views]:
    """Outer and inner builds, the same in every view."""
    outer, inner = split_groups(views.orders, share, rng)

    def part(data: Dataset, of: Dataset) -> Dataset:
        return data.subset(np.isin(data.group, of.group))

    return (
        Views(outer, part(views.raw, outer), part(views.waves, outer)),
        Views(inner, part(views.raw, inner), part(views.waves, inner)),
    )


def _finish(
    network: HeadNetwork, outer: Dataset, inner: Dataset, settings: ClassifierSettings
) -> DiagnosisGraph:
    """The graph, with novelty by the inner builds."""
    residual, parts = fit_novelty(outer, inner, settings.novelty_quantile)
    layers, scaler = network.net.layers(network.theta), network.scaler
    known = fleet(parts, residual(inner.features[inner.kind == 0]), settings.novelty_quantile)
    return DiagnosisGraph(
        scaler.mean, scaler.deviation, layers, network.temperature, residual, parts, known
    )


def _named_above(
    chosen: HeadNetwork, data: Dataset, settings: ClassifierSettings, seed: int
) -> NDArray[np.float64]:
    """Odds of the faults against normal that healthy decisions exceed at the rate that is allowed.

    Cross-fitted: the rare ones among the healthy decide, and the inner builds alone hold too few.
    """
    odds = cross_fitted(chosen, data, settings.folds, settings.ladder.iterations, seed)
    return scores.alarm_limits(class_probabilities(odds[data.kind == 0]), settings.false_alarm_rate)


def _by_fault(limits: VerdictLimits) -> dict[str, float]:
    return {
        name: float(f"{odds:.4g}")
        for name, odds in zip(CLASSES[1:], limits.named_above, strict=True)
    }


def _export(
    module: DiagnosisGraph,
    limits: VerdictLimits,
    run: TrainingRun,
    data: Dataset,
    settings: ClassifierSettings,
    report: dict[str, object],
) -> None:
    metadata = export.Metadata(
        kind="classifier",
        version="0.3.0",
        inputs=FEATURE_NAMES,
        units=(),
        outputs=("heads", "score", "drivers", "normal", "departures"),
        rate_hz=sorted({*RATES_HZ, settings.rate_hz}),
        window=WINDOW_LAYOUT,
        rigs=(settings.rig,),
        domain={},
        data_hash=export.data_hash(data.features, data.kind, data.group),
        metrics=report,
        settings={
            "novelty_threshold": limits.novelty,
            "named_above": _by_fault(limits),
            "temperature": module.temperature.tolist(),
            "normal": module.fleet,
        },
    )
    sample = data.features[:: max(1, len(data) // 5000)].astype(np.float32)
    example = torch.from_numpy(sample[:2])
    export.export(
        module,
        example,
        run.model,
        input_name="features",
        output_names=metadata.outputs,
        metadata=metadata,
    )
    corners = np.concatenate([sample, 100.0 * sample, np.zeros_like(sample[:1])])
    report["export_parity"] = export.parity(module, run.model, corners)
    run.write_json("classifier.json", report)
    card.write(run, report, card.CLASSIFIER)


def evaluate(
    path: Path,
    seed: int,
    size: int | None,
    out: Path,
    rate_hz: int = 5000,
    settings: JudgeSettings | None = None,
) -> dict[str, object]:
    """Judge the model in ``path`` on builds, duties and noise that follow from ``seed``; ``size``
    builds."""
    settings = settings or JudgeSettings(rate_hz=rate_hz)
    if size is not None:
        settings = msgspec.structs.replace(
            settings,
            builds=size,
            unknown_builds=max(4, 9 * size),
            watched_builds=45 * size,
            held_builds=max(2, size),
            commissioned_builds=max(4, size // 2),
        )
    answers = of_file(path)
    known = commissioning.judge(
        path,
        settings.rig,
        settings.rate_hz,
        settings.commissioned_builds,
        settings.workers,
        seed,
        out,
        settings.keep_samples,
    )
    return {
        "unseen_builds": judge(answers, limits_of(path), settings, seed, out),
        "unseen_builds_at_the_other_rate": at_other_rate(answers, settings, seed, out),
        "after_commissioning": known,
        "real_recordings": REAL_RECORDINGS,
    }
