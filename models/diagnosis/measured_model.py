"""``orbitd train classifier --data DIR``: a classifier of a user's own recordings as one ONNX
file."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from models import export
from models.diagnosis import measured, measured_normal
from models.diagnosis.dataset_folder import read_folder
from models.diagnosis.measured import Network
from models.diagnosis.measured_features import window_samples, windows_of
from models.film.reduced_network import TorchPerceptron
from models.runs import TrainerSettings, TrainingRun

Floats = NDArray[np.float64]


class MeasuredSettings(TrainerSettings, frozen=True):
    """What ``orbitd train classifier --data`` does."""

    data: str = ""
    group: str = "group"
    channels: str = ""
    rungs: tuple[str, ...] = tuple(measured.RUNGS)

    def smoked(self) -> MeasuredSettings:
        """The simplest rung alone."""
        return msgspec.structs.replace(self, rungs=self.rungs[:1])


SETTINGS = MeasuredSettings


class MeasuredGraph(nn.Module):
    """``features (m, F)`` float32 -> ``classes (m, K)`` probabilities."""

    def __init__(self, network: Network) -> None:
        super().__init__()
        self.net = TorchPerceptron(network.net.layers(network.theta))
        self.mean: Tensor
        self.deviation: Tensor
        self.register_buffer("mean", torch.from_numpy(network.mean))
        self.register_buffer("deviation", torch.from_numpy(network.deviation))

    def forward(self, features: Tensor) -> Tensor:
        """Softmax (7), summed over the outputs only."""
        return torch.softmax(
            self.net((features.double() - self.mean) / self.deviation), dim=1
        ).float()


def train(run: TrainingRun, settings: MeasuredSettings) -> dict[str, object]:
    """Judge by leaving groups out, then train the rung that all groups choose on everything and
    export it."""
    found = read_folder(
        Path(settings.data),
        settings.group,
        Path(settings.channels) if settings.channels else None,
    )
    data = windows_of(found)
    rungs = {name: measured.RUNGS[name] for name in settings.rungs}
    report = measured.evaluate(data, run.seed, rungs) | {
        "fit_normal_then_detect": measured_normal.detect(data)
    }
    chosen = measured.choose(data, np.arange(len(data)), run.seed, rungs)
    view, fit = rungs[chosen]
    network = fit(data.views[view], data.label, len(data.labels), run.seed)
    module, x = MeasuredGraph(network), data.views[view].astype(np.float32)
    metadata = export.Metadata(
        kind="measured classifier",
        version="0.1.0",
        inputs=[f"{view} {i}" for i in range(x.shape[1])],
        outputs=("classes",),
        units=(),
        channels=found[0].channels,
        rigs=(),
        domain={},
        rate_hz=(round(found[0].rate_hz),),
        window={"samples": float(window_samples(found[0].rate_hz))},
        data_hash=export.data_hash(x, data.label, data.group),
        metrics=report,
        settings={"labels": list(data.labels), "view": view},
    )
    export.export(
        module,
        torch.from_numpy(x[:2]),
        run.model,
        input_name="features",
        output_names=("classes",),
        metadata=metadata,
    )
    report |= {"export_parity": export.parity(module, run.model, x), "trained": chosen}
    run.write_json("measured_model.json", report)
    return report
