"""Trainer of the fault classifier: the ladder on inner builds, calibration, novelty, judged on unseen builds."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from firmware_py.acquire.features import FEATURE_NAMES
from firmware_py.acquire.windows import WINDOW_LAYOUT
from models import card, export, figures, ladder, recordings, scores
from models.data_cache import recorded
from models.dataset import Dataset, split_groups
from models.diagnosis_network import Diagnosis
from models.ladder import HeadNetwork, Scaler
from models.recordings import JUDGED_SECONDS, Plan, Views
from models.runs import Run, Settings, SettingsError, progress_bar
from models.scores import Decisions

Floats = NDArray[np.float64]
Verdicts = Callable[[NDArray[np.float32]], tuple[Floats, Floats]]
"""Features ``(n, F)`` to probabilities of the heads ``(n, 4)`` and novelty scores ``(n,)``."""

JUDGE_SEED = 1_000_000
"""Added to the seed of builds that judge, so that they are never those of a training seed."""


class ClassifierSettings(Settings, frozen=True):
    """What ``orbitd train classifier`` does; every key may stand in the ``--config`` file."""

    rig: str = "bench"
    rate_hz: int = 5000
    builds: int = 1400
    seconds: float = 1.8
    judged_builds: int = 80
    inner_share: float = 0.2
    hidden: tuple[tuple[int, ...], ...] = ((), (24,), (48,))
    l2: tuple[float, ...] = (1e-5, 1e-4)
    iterations: int = 600
    paper_hidden: int = 20
    paper_recordings: int = 2000
    paper_iterations: int = 60
    novelty_quantile: float = 0.995
    workers: int = 2

    def smoked(self) -> ClassifierSettings:
        """The same training in some seconds."""
        return ClassifierSettings(
            workers=1, builds=10, judged_builds=2, hidden=((), (8,)), l2=(1e-3,), iterations=60, paper_hidden=4,
            paper_recordings=60, paper_iterations=5,
        )  # fmt: skip


SETTINGS = ClassifierSettings


@dataclass(frozen=True)
class Taught:
    """The parts of a trained classifier that its graph is made of."""

    scaler: Scaler
    network: HeadNetwork
    temperature: float
    whitening: Floats
    novelty_threshold: float

    def module(self) -> Diagnosis:
        """The graph."""
        layers = self.network.net.layers(self.network.theta)
        return Diagnosis(self.scaler.mean, self.scaler.deviation, layers, self.temperature, self.whitening)


def train(run: Run, settings: ClassifierSettings) -> dict[str, object]:
    """Train, judge and export; returns the report that is written beside the model."""
    started = time.monotonic()
    rng, out = np.random.default_rng(run.seed), run.folder.parent
    plan = Plan(settings.rig, run.seed, settings.rate_hz, settings.seconds, recordings.training_cases)
    views = recorded(out, plan, settings.builds, settings.workers)
    views.orders.check()
    outer, inner = split_groups(views.orders, settings.inner_share, rng)
    scaler = Scaler.of(outer)
    network, rungs = _climb(outer, inner, scaler, settings, run, rng)
    taught = _finish(network, scaler, outer, inner, settings)
    verdicts, judged = of_module(taught.module()), judged_views(settings, run.seed, out)
    report: dict[str, object] = {
        "chosen": network.name,
        "inner_ladder": rungs,
        "unseen_builds": judge(verdicts, judged.orders),
        "unknown_faults": judge_unknown(verdicts, taught.novelty_threshold, settings, run.seed, out),
        "baselines_on_unseen_builds": _baselines(views, outer, inner, judged, settings, run, rng),
        "training": {"builds": settings.builds, "windows": len(views.orders),
                     "seconds": round(time.monotonic() - started, 1)},
        "reproduce": run.command,
    }  # fmt: skip
    _export(taught, run, views.orders, settings, report)
    figures.classifier(run.folder, decisions_of(verdicts, judged.orders))
    return report


def judged_views(settings: ClassifierSettings, seed: int, out: Path) -> Views:
    """Builds that no training has seen, over the whole severity grid."""
    plan = Plan(settings.rig, JUDGE_SEED + seed, settings.rate_hz, JUDGED_SECONDS, recordings.judged_cases)
    return recorded(out, plan, settings.judged_builds, settings.workers)


def judge(verdicts: Verdicts, data: Dataset) -> dict[str, object]:
    """All figures of a classifier on judged builds."""
    probability, _ = verdicts(data.features.astype(np.float32))
    logits = scores.log_odds(probability)
    ten = scores.by_ten_windows(logits, data)
    return {
        "required_severities_per_10_windows": scores.summary(scores.required(ten)),
        "required_severities_per_window": scores.summary(scores.required(scores.by_window(logits, data))),
        "right_class_by_severity": scores.severity_grid(ten),
        "false_alarms": scores.false_alarms(ten),
    }


def decisions_of(verdicts: Verdicts, data: Dataset) -> Decisions:
    """Decisions over ten windows."""
    probability, _ = verdicts(data.features.astype(np.float32))
    return scores.by_ten_windows(scores.log_odds(probability), data)


def judge_unknown(
    verdicts: Verdicts, threshold: float, settings: ClassifierSettings, seed: int, out: Path
) -> dict[str, object]:
    """How well the novelty score tells faults that were never taught from healthy builds, per ten windows."""
    from sklearn.metrics import roc_auc_score

    plan = Plan(settings.rig, JUDGE_SEED + seed, settings.rate_hz, JUDGED_SECONDS, recordings.unknown_cases)
    data = recorded(out, plan, max(2, settings.judged_builds // 5), settings.workers).orders
    _, novelty = verdicts(data.features.astype(np.float32))
    ids = np.unique(data.recording)
    medians = np.array([np.median(novelty[data.recording == r]) for r in ids])
    first = np.array([np.flatnonzero(data.recording == r)[0] for r in ids])
    healthy = data.kind[first] == 0
    report: dict[str, object] = {"healthy_called_unknown": round(float(np.mean(medians[healthy] > threshold)), 4)}
    for k, name in enumerate(recordings.UNKNOWNS):
        of_fault = ~healthy & (data.severity[first] == k)
        both = healthy | of_fault
        report[name] = {
            "auroc": round(float(roc_auc_score(of_fault[both], medians[both])), 4),
            "called_unknown": round(float(np.mean(medians[of_fault] > threshold)), 4),
        }
    return report


def novelty_threshold(path: Path) -> float:
    """The threshold in an exported file's metadata."""
    settings = json.loads(export.session(path).get_modelmeta().custom_metadata_map["settings"])
    return float(settings["novelty_threshold"])


def of_module(module: Diagnosis) -> Verdicts:
    """A torch module as :data:`Verdicts`."""

    def verdicts(features: NDArray[np.float32]) -> tuple[Floats, Floats]:
        with torch.no_grad():
            heads, score = module(torch.from_numpy(features))
        return heads.double().numpy(), score.double().numpy()[:, 0]

    return verdicts


def of_file(path: Path) -> Verdicts:
    """An exported file as :data:`Verdicts`."""
    session = export.session(path)

    def verdicts(features: NDArray[np.float32]) -> tuple[Floats, Floats]:
        heads, score = session.run(["heads", "score"], {"features": features})
        return heads.astype(np.float64), score[:, 0].astype(np.float64)

    return verdicts


def _climb(
    outer: Dataset,
    inner: Dataset,
    scaler: Scaler,
    settings: ClassifierSettings,
    run: Run,
    rng: np.random.Generator,
) -> tuple[HeadNetwork, list[dict[str, object]]]:
    """Every rung on the inner builds; a later one is chosen only if it beats the one chosen so far."""
    train_on, inner_on = (scaler(outer), outer.heads), (scaler(inner), inner.heads)
    chosen: tuple[HeadNetwork, Decisions] | None = None
    rungs: list[dict[str, object]] = []
    for hidden in settings.hidden:
        name = "-".join(["logistic regression"] if not hidden else ["network", *map(str, hidden)])
        tried = []
        for l2 in settings.l2:
            with progress_bar(f"{name}, l2 {l2:g}", settings.iterations) as bar:
                tried.append(ladder.fit_heads(name, hidden, train_on, inner_on, l2, settings.iterations, rng, bar))
        best = min(tried, key=lambda n: scores.nll(n.logits(inner_on[0]), inner_on[1]))
        decisions = scores.required(scores.by_ten_windows(best.logits(inner_on[0]), inner))
        row = {"rung": name, "l2": best.l2, **scores.summary(decisions)}
        run.log(row)
        rungs.append(row)
        if chosen is None or scores.beats(decisions, chosen[1]):
            chosen = best, decisions
    if chosen is None:
        raise SettingsError("hidden: names no network; list at least one, [] for logistic regression")
    return chosen[0], rungs


def _finish(
    network: HeadNetwork, scaler: Scaler, outer: Dataset, inner: Dataset, settings: ClassifierSettings
) -> Taught:
    """Calibration and novelty threshold, both on the inner builds."""
    pooled, at = scores.pool(network.logits(scaler(inner)), inner)
    temperature = scores.temperature(pooled, inner.heads[at])
    whitening = _whitening((outer.features - scaler.mean) / scaler.deviation)
    distance = ((inner.features - scaler.mean) / scaler.deviation) @ whitening
    windows = np.sqrt(np.mean(distance**2, axis=1))
    medians = [np.median(windows[inner.recording == r]) for r in np.unique(inner.recording)]
    return Taught(scaler, network, temperature, whitening, float(np.quantile(medians, settings.novelty_quantile)))


def _whitening(z: Floats) -> Floats:
    """``(F, F)`` with unit covariance of ``z @ W``, from the shrunk covariance of Ledoit and Wolf (2004)."""
    from sklearn.covariance import ledoit_wolf

    covariance, _ = ledoit_wolf(z)
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors / np.sqrt(values))


def _baselines(
    views: Views, outer: Dataset, inner: Dataset, judged: Views, settings: ClassifierSettings, run: Run,
    rng: np.random.Generator,
) -> dict[str, object]:  # fmt: skip
    by_threshold = scores.by_ten_windows(ladder.thresholds(outer, judged.orders), judged.orders)
    raw_train = views.raw.subset(np.isin(views.raw.group, outer.group))
    few = np.zeros(len(raw_train), dtype=bool)
    few[rng.permutation(len(raw_train))[: settings.paper_recordings]] = True
    raw_inner = views.raw.subset(np.isin(views.raw.group, inner.group))
    with progress_bar("the paper's network on raw windows", settings.paper_iterations) as bar:
        paper = ladder.paper_network(
            raw_train.subset(few), raw_inner, judged.raw, settings.paper_hidden, settings.paper_iterations, rng, bar
        )
    return {
        "thresholds_per_10_windows": scores.summary(scores.required(by_threshold)),
        "paper_raw_800_points_per_window": scores.summary(scores.required(paper)),
    }


def _export(taught: Taught, run: Run, data: Dataset, settings: ClassifierSettings, report: dict[str, object]) -> None:
    metadata = export.Metadata(
        kind="classifier", version="0.1.0", inputs=FEATURE_NAMES, outputs=("heads", "score"), units=(),
        rate_hz=(settings.rate_hz,), window=WINDOW_LAYOUT, rigs=(settings.rig,), domain={},
        data_hash=export.data_hash(data.features, data.kind, data.group), metrics=report,
        settings={"novelty_threshold": taught.novelty_threshold, "temperature": taught.temperature},
    )  # fmt: skip
    module = taught.module()
    sample = data.features[:: max(1, len(data) // 5000)].astype(np.float32)
    example = torch.from_numpy(sample[:2])
    export.export(module, example, run.model, input_name="features", output_names=metadata.outputs, metadata=metadata)
    corners = np.concatenate([sample, 100.0 * sample, np.zeros_like(sample[:1])])
    report["export_parity"] = export.parity(module, run.model, corners)
    run.write_json("classifier.json", report)
    card.write(run, report, card.CLASSIFIER)
