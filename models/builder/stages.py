"""The stages of a build, in their order; each gives figures and files."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from firmware_py.brain.errors import ModelError
from firmware_py.brain.store import SHIPPED, model_of
from firmware_py.brain.verdict import WINDOWS
from models.builder.rig_build import Report, RigBuild, StageResult
from models.builder.sensors import SENSORS, columns_of, costs
from models.control import actor
from models.diagnosis import classifier, recordings
from models.diagnosis.dataset import split_groups
from models.diagnosis.judge import judged_views
from models.diagnosis.recordings import RecordingPlan, record_build
from models.diagnosis.windowed import WindowSampling, per_decision, usable_windows, views_of
from models.film import surrogate
from models.prediction import predictor
from models.qualify import load_bars, qualify
from models.runs import progress_bar
from sim_hil.film.table import FilmTable
from sim_hil.rigs import RigData

SURROGATE: Final = "surrogate.onnx"
REUSED: Final = "reused"
"""Where a copy of what ships with the package lies."""
PROBED: Final = 4
"""Windows in which it is tried which features a sensor takes part in."""


def film(build: RigBuild, rig: RigData) -> StageResult:
    """The table of the film that the simulator runs on, for the bearing's shape."""
    shape = _shape(rig)
    FilmTable.load(shape)
    return StageResult({"length_over_diameter": shape})


def film_surrogate(build: RigBuild, rig: RigData) -> StageResult:
    """The film surrogate: the shipped one where its dimensionless domain covers the bearing."""
    shipped = SHIPPED / SURROGATE
    try:
        model = model_of("surrogate", shipped.read_bytes(), build.config)
    except (ModelError, OSError) as error:
        reason = str(error)
    else:
        kept = build.work / REUSED
        kept.mkdir(parents=True, exist_ok=True)
        for name in (SURROGATE, "surrogate.md", "surrogate.json"):
            shutil.copyfile(SHIPPED / name, kept / name)
        told = {"reused": model.described, "domain": model.card.domain}
        names = (SURROGATE, "surrogate.md", "surrogate.json")
        return StageResult(told, {name: f"{REUSED}/{name}" for name in names})
    report = build.train("surrogate", surrogate, _surrogate(build, rig))
    return StageResult({"trained_because": reason, **report}, _files(build, "surrogate", SURROGATE))


def forecasts(build: RigBuild, rig: RigData) -> StageResult:
    """The predictor's factors, on episodes of the machine."""
    settings = msgspec.structs.replace(
        build.sizes.predictor,
        rig=str(build.folder),
        surrogate=str(film_file(build)),
        workers=build.workers,
    )
    report = build.train("predictor", predictor, settings)
    files = {
        name: build.path("predictor", name)
        for name in ("predictor.json", "predictor.md", "predictor-report.json")
    }
    return StageResult(report, files)


def diagnosis(build: RigBuild, rig: RigData) -> StageResult:
    """The fault classifier, on recordings of builds of the machine."""
    report = build.train("classifier", classifier, _classifier(build))
    return StageResult(report, _files(build, "classifier", "classifier.onnx"))


def sensors(build: RigBuild, rig: RigData) -> StageResult:
    """What each missing sensor costs the diagnosis, and what cannot be told apart."""
    settings, out = _classifier(build), build.work
    plan = RecordingPlan(
        settings.rig, build.seed, settings.rate_hz, settings.seconds, recordings.training_cases
    )
    look = WindowSampling(WINDOWS, settings.raw_builds, settings.keep_samples)
    data = views_of(out, plan, settings.builds, settings.workers, look).orders
    rng = np.random.default_rng(build.seed)
    outer, inner = split_groups(data, settings.inner_share, rng)
    judged = per_decision(judged_views(settings.judge, build.seed, out)).orders
    (raw, *_), machine = record_build(plan, 0), build.config.machine
    windows = list(islice(usable_windows(raw, settings.rig), PROBED))
    lost = {sensor: columns_of(sensor, windows, machine) for sensor in SENSORS}
    with progress_bar("missing sensors", len(lost)) as bar:
        report = costs(outer, inner, judged, lost, build.sizes.sensors, build.seed, bar)
    return StageResult(report)


def policies(build: RigBuild, rig: RigData) -> StageResult:
    """The clearance policy: DDPG and a lookup table behind the guard's shield, the better ships."""
    settings = msgspec.structs.replace(
        build.sizes.policies, rig=str(build.folder), workers=build.workers
    )
    try:
        report = build.train("actor", actor, settings)
    except ValueError as error:
        return StageResult({"left_out": str(error)})
    return StageResult(report, _files(build, "actor", "actor.onnx"))


def sealed(build: RigBuild, rig: RigData, results: dict[str, StageResult]) -> StageResult:
    """The frozen evaluation on builds, duties and noise that no training has seen; the copies that
    it marks are those that go into the set."""
    if not build.sizes.sealed:
        return StageResult({"left_out": "a trial has no sealed test: its models are provisional"})
    out = build.work / "sealed"
    out.mkdir(exist_ok=True)
    report: Report = {}
    files = {}
    evaluations = {
        SURROGATE: ("surrogate", partial(_judge_surrogate, build, rig)),
        "predictor.json": ("predictor", partial(_judge_predictor, build)),
        "classifier.onnx": ("classifier", partial(_judge_classifier, build)),
        "actor.onnx": ("actor", partial(_judge_actor, build)),
    }
    for name, (kind, evaluate) in evaluations.items():
        given = next((r.files for r in results.values() if name in r.files), None)
        if given is None or given[name].startswith(REUSED):
            continue
        for each, path in given.items():
            shutil.copyfile(build.work / path, out / each)
            files[each] = f"sealed/{each}"
        bars = load_bars()[kind]
        try:
            judged: Report = qualify(
                kind, out / name, evaluate, ship=False, artifacts=out / "none", bars=bars
            )
        except ValueError as error:
            judged = {"qualified": False, "seed": bars.seed, "size": bars.size, "bars": []}
            judged["left_out"] = str(error)
        report[kind] = judged
    return StageResult(report, files)


def _judge_surrogate(
    build: RigBuild, rig: RigData, path: Path, seed: int, size: int
) -> dict[str, object]:
    return surrogate.evaluate(path, seed, size, build.work, _surrogate(build, rig))


def _judge_predictor(build: RigBuild, path: Path, seed: int, size: int) -> dict[str, object]:
    surrogate_bytes = film_file(build).read_bytes()
    return predictor.evaluate(path, seed, size, build.work, str(build.folder), surrogate_bytes)


def _judge_classifier(build: RigBuild, path: Path, seed: int, size: int) -> dict[str, object]:
    from models.export import milliseconds_per_call

    settings = msgspec.structs.replace(_classifier(build).judge, other_rate_builds=size // 2)
    report = classifier.evaluate(path, seed, size, build.work, settings.rate_hz, settings)
    return {**report, "milliseconds_per_call": milliseconds_per_call(path)}


def _judge_actor(build: RigBuild, path: Path, seed: int, size: int) -> dict[str, object]:
    from models.export import milliseconds_per_call

    settings = msgspec.structs.replace(
        build.sizes.policies, rig=str(build.folder), workers=build.workers
    )
    report = actor.evaluate(path, seed, size, build.work, settings)
    return {**report, "milliseconds_per_call": milliseconds_per_call(path)}


STAGES: Final[dict[str, Callable[[RigBuild, RigData], StageResult]]] = {
    "film": film,
    "surrogate": film_surrogate,
    "predictor": forecasts,
    "classifier": diagnosis,
    "sensors": sensors,
    "policies": policies,
}
"""What comes before the sealed test."""


def film_file(build: RigBuild) -> Path:
    """The file of the film surrogate of this build."""
    trained = build.work / build.path("surrogate", SURROGATE)
    return trained if trained.is_file() else build.work / REUSED / SURROGATE


def _classifier(build: RigBuild) -> classifier.ClassifierSettings:
    rate, rig = build.config.sampling.rate_hz, str(build.folder)
    settings = build.sizes.classifier
    judge = msgspec.structs.replace(settings.judge, rig=rig, rate_hz=rate, workers=build.workers)
    return msgspec.structs.replace(
        settings, rig=rig, rate_hz=rate, workers=build.workers, judge=judge
    )


def _surrogate(build: RigBuild, rig: RigData) -> surrogate.SurrogateSettings:
    return msgspec.structs.replace(
        build.sizes.surrogate, rig=str(build.folder), length_over_diameter=_shape(rig)
    )


def _files(build: RigBuild, kind: str, model: str) -> dict[str, str]:
    """Model, report and card of a training."""
    names = (model, f"{kind}.json", f"{kind}.md")
    return {name: build.path(kind, name) for name in names}


def _shape(rig: RigData) -> float:
    return rig.bearing.length_m / (2.0 * rig.bearing.radius_m)
