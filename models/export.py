"""From a torch module to one self-contained ONNX file with metadata."""

from __future__ import annotations

import hashlib
import io
import json
import re
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Final

import numpy as np
import onnx
import onnxruntime
import torch
from numpy.typing import NDArray

from firmware_py import records
from firmware_py.brain.made_for import figures_of
from firmware_py.config import read_machine
from models import PHYSICS_VERSION
from models.manifest import commit, write_whole

OPSET = 17
_TIMED: Final = re.compile(r"seconds(_until_judged)?$|(milli|micro)seconds")


class ExportError(ValueError):
    """The exported graph is not what it should be; the text names what differs."""


@dataclass(frozen=True)
class Metadata:
    """What a model file says about itself (DESIGN rule 7); lists and maps travel as JSON.

    ``rigs``: the machines that it was made for, shipped names or rig folders; the file carries
    their names and figures.  Of ``metrics`` what was timed stays out: the same training gives the
    same bytes.
    """

    kind: str
    version: str
    inputs: Sequence[str]
    outputs: Sequence[str]
    domain: Mapping[str, tuple[float, float]]
    rigs: Sequence[str]
    data_hash: str
    metrics: Mapping[str, object]
    units: Sequence[str]
    channels: Sequence[str] = records.CHANNELS
    rate_hz: Sequence[int] = (5000, 10000)
    window: Mapping[str, float] | None = None
    settings: Mapping[str, object] | None = None
    status: str = "provisional"
    physics_version: str = PHYSICS_VERSION

    def properties(self) -> dict[str, str]:
        """All fields as strings, with the figures of the machines that ``rigs`` names, and the
        commit that made the file."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        machines = [read_machine(rig) for rig in self.rigs]
        values["rigs"] = [machine.name for machine in machines]
        values["machines"] = {machine.name: figures_of(machine) for machine in machines}
        values["metrics"] = untimed(self.metrics)
        texts = {
            k: v if isinstance(v, str) else json.dumps(v, sort_keys=True) for k, v in values.items()
        }
        return {**texts, "commit": commit()}


def untimed(report: object) -> object:
    """``report`` without what a clock gave, by the names of its keys."""
    if not isinstance(report, Mapping):
        return report
    return {key: untimed(item) for key, item in report.items() if not _TIMED.match(str(key))}


def export(
    module: torch.nn.Module,
    example: torch.Tensor,
    path: Path,
    *,
    input_name: str,
    output_names: Sequence[str],
    metadata: Metadata,
) -> None:
    """Write ``module`` to ``path`` as one file (no external data), batch dimension free.

    Parameters
    ----------
    example
        One input, ``(m, inputs)``; its dtype is the graph's.

    Raises
    ------
    ExportError
        When the metadata names another number of inputs than the graph takes.
    """
    if len(metadata.inputs) != example.shape[1]:
        raise ExportError(
            f"{metadata.kind}: metadata names {len(metadata.inputs)} inputs, the graph takes "
            f"{example.shape[1]}"
        )
    write(graph_of(module, example, input_name, output_names), path, metadata)


def graph_of(
    module: torch.nn.Module, example: torch.Tensor, input_name: str, output_names: Sequence[str]
) -> onnx.ModelProto:
    """``module`` as an ONNX graph, batch dimension free."""
    buffer: Any = io.BytesIO()  # the stubs know only paths, the exporter also takes a stream
    with warnings.catch_warnings():
        # The older exporter is announced to go; the newer one writes a second .onnx.data file.
        warnings.simplefilter("ignore")
        torch.onnx.export(
            module.eval(),
            (example,),
            buffer,
            dynamo=False,
            opset_version=OPSET,
            input_names=[input_name],
            output_names=list(output_names),
            dynamic_axes={name: {0: "batch"} for name in (input_name, *output_names)},
        )
    model = onnx.load_from_string(buffer.getvalue())
    for node in model.graph.node:
        node.doc_string = ""
    return model


def write(model: onnx.ModelProto, path: Path, metadata: Metadata) -> None:
    """Write ``model`` with its metadata, checked, to ``path``."""
    onnx.helper.set_model_props(model, metadata.properties())
    onnx.checker.check_model(model, full_check=True)
    write_whole(path, model.SerializeToString())


def session(path: Path) -> onnxruntime.InferenceSession:
    """One-thread session on the bytes of ``path``."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    return onnxruntime.InferenceSession(
        path.read_bytes(), options, providers=["CPUExecutionProvider"]
    )


def milliseconds_per_call(path: Path, calls: int = 300) -> float:
    """Median time of one answer for one row, one thread."""
    run = session(path)
    given = run.get_inputs()[0]
    row = {
        given.name: np.zeros(
            (1, given.shape[1]), np.float64 if "double" in given.type else np.float32
        )
    }
    times = []
    for _ in range(calls):
        started = time.perf_counter()
        run.run(None, row)
        times.append(time.perf_counter() - started)
    return round(1e3 * float(np.median(times)), 4)


def parity(module: torch.nn.Module, path: Path, x: NDArray[np.generic]) -> float:
    """Largest difference between ``module`` and the file over inputs ``x``, relative to ``|y| +
    mean |y|``."""
    with torch.no_grad():
        expected = module.eval()(torch.from_numpy(x))
    expected = expected if isinstance(expected, tuple) else (expected,)
    run = session(path)
    answers = run.run(None, {run.get_inputs()[0].name: x})
    worst = 0.0
    for want, got in zip(expected, answers, strict=True):
        w = want.numpy()
        worst = max(worst, float(np.max(np.abs(w - got) / (np.abs(w) + np.mean(np.abs(w))))))
    return worst


def data_hash(*arrays: NDArray[np.generic]) -> str:
    """SHA-256 over the bytes of ``arrays`` in order."""
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
