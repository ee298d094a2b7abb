"""Trainer of the fault classifier: the ladder on inner builds, calibration, novelty, judged on unseen builds."""

from __future__ import annotations

import time
from pathlib import Path

import msgspec
import numpy as np
import torch

from firmware_py.acquire.features import FEATURE_NAMES
from firmware_py.acquire.windows import WINDOW_LAYOUT
from models import card, export, figures
from models.diagnosis import recordings, scores
from models.diagnosis.dataset import Dataset, split_groups
from models.diagnosis.graph import Diagnosis
from models.diagnosis.judge import (
    JudgeSettings,
    decisions_of,
    judge,
    judged_views,
    milliseconds,
    novelty_threshold,
    of_file,
    of_module,
)
from models.diagnosis.ladder import HeadNetwork
from models.diagnosis.novelty import fit_novelty, fleet
from models.diagnosis.recordings import Plan
from models.diagnosis.rungs import LadderSettings, choose, climb
from models.diagnosis.windowed import Views, per_decision, views_of
from models.runs import Run, Settings


class ClassifierSettings(Settings, frozen=True):
    """What ``orbitd train classifier`` does; every key may stand in the ``--config`` file."""

    rig: str = "bench"
    rate_hz: int = 5000
    builds: int = 333
    seconds: float = 2.6
    judge: JudgeSettings = JudgeSettings()
    inner_share: float = 0.2
    ladder: LadderSettings = LadderSettings()
    novelty_quantile: float = 0.995
    workers: int = 2

    def smoked(self) -> ClassifierSettings:
        """The same training in some seconds."""
        return ClassifierSettings(
            workers=1, builds=8,
            judge=JudgeSettings(builds=2, unknown_builds=2, watched_builds=2, workers=1),
            ladder=LadderSettings(hidden=(8,), l2=(1e-3,), iterations=60, paper_hidden=4, paper_iterations=5, epochs=2),
        )  # fmt: skip


SETTINGS = ClassifierSettings


NOVELTY_THRESHOLD = 1.0
"""Novelty is scaled to it."""


def train(run: Run, settings: ClassifierSettings) -> dict[str, object]:
    """Train, judge and export; returns the report that is written beside the model."""
    started = time.monotonic()
    rng, out = np.random.default_rng(run.seed), run.folder.parent
    plan = Plan(settings.rig, run.seed, settings.rate_hz, settings.seconds, recordings.training_cases)
    views = views_of(out, plan, settings.builds, settings.workers)
    views.orders.check()
    decided = per_decision(views)
    decided.orders.check()
    outer, inner = _split(decided, settings.inner_share, rng)
    rungs = climb(outer, inner, settings.ladder, settings.rate_hz, run.seed, rng)
    chosen, rows = choose(rungs, inner)
    for row in rows:
        run.log(row)
    module = _finish(chosen, outer.orders, inner.orders, settings)
    judged, verdicts = judged_views(settings.judge, run.seed, out), of_module(module)
    decided = per_decision(judged)
    report: dict[str, object] = {
        "chosen": chosen.name,
        "inner_ladder": rows,
        "ladder_on_unseen_builds": {rung.name: scores.summary(rung.decisions(decided)) for rung in rungs},
        "unseen_builds": judge(verdicts, NOVELTY_THRESHOLD, settings.judge, run.seed, out),
        "training": {"builds": settings.builds, "windows": len(views.orders),
                     "seconds": round(time.monotonic() - started, 1)},
        "reproduce": run.command,
    }  # fmt: skip
    _export(module, run, views.orders, settings, report)
    figures.classifier(run.folder, decisions_of(verdicts, judged.orders))
    return report


def _split(views: Views, share: float, rng: np.random.Generator) -> tuple[Views, Views]:
    """Outer and inner builds, the same in every view."""
    outer, inner = split_groups(views.orders, share, rng)

    def part(data: Dataset, of: Dataset) -> Dataset:
        return data.subset(np.isin(data.group, of.group))

    return (Views(outer, part(views.raw, outer), part(views.waves, outer)),
            Views(inner, part(views.raw, inner), part(views.waves, inner)))  # fmt: skip


def _finish(network: HeadNetwork, outer: Dataset, inner: Dataset, settings: ClassifierSettings) -> Diagnosis:
    """The graph: calibration and novelty by the inner builds."""
    temperature = scores.temperature(network.logits(inner.features), inner.heads)
    residual, parts = fit_novelty(outer, inner, settings.novelty_quantile)
    layers, scaler = network.net.layers(network.theta), network.scaler
    known = fleet(parts, residual(inner.features[inner.kind == 0]), settings.novelty_quantile)
    return Diagnosis(scaler.mean, scaler.deviation, layers, temperature, residual, parts, known)


def _export(
    module: Diagnosis, run: Run, data: Dataset, settings: ClassifierSettings, report: dict[str, object]
) -> None:
    metadata = export.Metadata(
        kind="classifier", version="0.2.0", inputs=FEATURE_NAMES, units=(),
        outputs=("heads", "score", "drivers", "normal", "departures"),
        rate_hz=(5000, 10000), window=WINDOW_LAYOUT, rigs=(settings.rig,), domain={},
        data_hash=export.data_hash(data.features, data.kind, data.group), metrics=report,
        settings={"novelty_threshold": NOVELTY_THRESHOLD, "temperature": module.temperature, "normal": module.fleet},
    )  # fmt: skip
    sample = data.features[:: max(1, len(data) // 5000)].astype(np.float32)
    example = torch.from_numpy(sample[:2])
    export.export(module, example, run.model, input_name="features", output_names=metadata.outputs, metadata=metadata)
    corners = np.concatenate([sample, 100.0 * sample, np.zeros_like(sample[:1])])
    report["export_parity"] = export.parity(module, run.model, corners)
    run.write_json("classifier.json", report)
    card.write(run, report, card.CLASSIFIER)


def evaluate(path: Path, seed: int, size: int | None, out: Path, rate_hz: int = 5000) -> dict[str, object]:
    """Judge the model in ``path`` on builds, duties and noise that follow from ``seed``; ``size`` builds."""
    settings = JudgeSettings(rate_hz=rate_hz)
    if size is not None:
        settings = msgspec.structs.replace(settings, builds=size, unknown_builds=max(2, size // 4))
    verdicts, threshold = of_file(path), novelty_threshold(path)
    return {
        "unseen_builds": judge(verdicts, threshold, settings, seed, out),
        "milliseconds_per_call": round(milliseconds(verdicts), 4),
    }
