"""``orbitd train classifier --data DIR``: a classifier of a user's own recordings as one ONNX file
that the device runs in shadow."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from firmware_py.acquire.channel_features import WINDOW_S, window_samples
from firmware_py.brain.own_card import KIND, OUTPUTS
from firmware_py.options import WINDOW_S as WINDOW_LIMITS_S
from models import export
from models.diagnosis import measured, measured_graph, measured_normal
from models.diagnosis.dataset import DatasetError
from models.diagnosis.dataset_folder import MeasuredRecording, read_folder
from models.diagnosis.measured import Forest, Network
from models.diagnosis.measured_features import FeatureRows, windows_of
from models.diagnosis.measured_score import QUANTILE, fit_score
from models.runs import TrainerSettings, TrainingRun


class MeasuredSettings(TrainerSettings, frozen=True):
    """What ``orbitd train classifier --data`` does."""

    data: str = ""
    group: str = "group"
    channels: str = ""
    window_s: Annotated[float, Meta(ge=WINDOW_LIMITS_S[0], le=WINDOW_LIMITS_S[1])] = WINDOW_S
    rungs: tuple[str, ...] = tuple(measured.CANDIDATES)

    def smoked(self) -> MeasuredSettings:
        """The simplest rung alone."""
        return msgspec.structs.replace(self, rungs=self.rungs[:1])


SETTINGS = MeasuredSettings


def train(run: TrainingRun, settings: MeasuredSettings) -> dict[str, object]:
    """Judge by leaving groups out, then train the rung that all groups choose on everything and
    export it."""
    found = read_folder(
        Path(settings.data),
        settings.group,
        Path(settings.channels) if settings.channels else None,
    )
    data = windows_of(found, settings.window_s)
    report, chosen, view, predict = _fitted(data, run.seed, settings)
    x = data.views[view]
    score = fit_score(x, data.label, data.group)
    graph = measured_graph.graph_of(predict, score, x)
    export.write(graph, run.model, _metadata(found, data, view, report, settings))
    report |= {
        "export_parity": measured_graph.worst_difference(graph, predict, score, x),
        "trained": chosen,
        "file": str(run.model),
    }
    run.write_json("measured_model.json", report)
    return report


def _fitted(
    data: FeatureRows, seed: int, settings: MeasuredSettings
) -> tuple[dict[str, object], str, str, Network | Forest | None]:
    """The report, what was chosen, its features, and the model; None where all is normal."""
    if len(data.labels) == 1:
        name = f"distance from normal, {measured_normal.NORMAL_VIEW}"
        return measured_normal.normal_only(data), name, measured_normal.NORMAL_VIEW, None
    unknown = [name for name in settings.rungs if name not in measured.RUNGS]
    if unknown:
        raise DatasetError(f"rungs: no {unknown[0]!r}; there are {', '.join(measured.RUNGS)}")
    rungs = {name: measured.RUNGS[name] for name in settings.rungs}
    report = measured.evaluate(data, seed, rungs) | {
        "fit_normal_then_detect": measured_normal.detect(data)
    }
    chosen = measured.choose(data, np.arange(len(data)), seed, rungs)
    view, fit = rungs[chosen]
    return report, chosen, view, fit(data.views[view], data.label, len(data.labels), seed)


def _metadata(
    found: list[MeasuredRecording],
    data: FeatureRows,
    view: str,
    report: dict[str, object],
    settings: MeasuredSettings,
) -> export.Metadata:
    x, rate_hz = data.views[view], found[0].rate_hz
    return export.Metadata(
        kind=KIND,
        version="0.2.0",
        inputs=[f"{view} {i}" for i in range(x.shape[1])],
        outputs=OUTPUTS,
        units=found[0].units,
        channels=found[0].channels,
        rigs=(),
        domain={},
        rate_hz=(round(rate_hz),),
        window={"samples": float(window_samples(rate_hz, settings.window_s))},
        data_hash=export.data_hash(x, data.label, data.group),
        metrics=report,
        settings={
            "labels": list(data.labels),
            "view": view,
            "rate_hz": rate_hz,
            "window_s": settings.window_s,
            "recordings": sorted({each.fingerprint for each in found}),
            "score_quantile": QUANTILE,
        },
    )
