"""A classifier of measured recordings as one graph: ``features (m, F)`` float32 -> ``classes (m,
K)``, ``score (m, 1)``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from models import export
from models.diagnosis.measured import Forest, Network
from models.diagnosis.measured_score import TaughtDistance
from models.film.reduced_network import TorchPerceptron

Floats = NDArray[np.float64]

INPUT: Final = "features"
ML_OPSET: Final = 3
"""Of the operators for trees."""


class ScoreGraph(nn.Module):
    """:class:`~models.diagnosis.measured_score.TaughtDistance`, ``(m, F)`` -> ``(m, 1)``."""

    def __init__(self, score: TaughtDistance) -> None:
        super().__init__()
        self.limit = score.limit
        self.whitening: Tensor
        self.centres: Tensor
        self.register_buffer("whitening", torch.from_numpy(score.whitening))
        self.register_buffer("centres", torch.from_numpy(score.centres @ score.whitening))

    def forward(self, features: Tensor) -> Tensor:
        """Distance to the nearest class over the limit."""
        away = (features.double() @ self.whitening)[:, None, :] - self.centres
        squares = (away * away).mean(dim=2).amin(dim=1, keepdim=True)
        return (torch.sqrt(squares) / self.limit).float()


class NetworkGraph(nn.Module):
    """A network and its score; without a network every row is of the one class."""

    def __init__(self, network: Network | None, score: TaughtDistance) -> None:
        super().__init__()
        self.score = ScoreGraph(score)
        self.net = TorchPerceptron(network.net.layers(network.theta)) if network else None
        self.mean: Tensor
        self.deviation: Tensor
        if network:
            self.register_buffer("mean", torch.from_numpy(network.mean))
            self.register_buffer("deviation", torch.from_numpy(network.deviation))

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Softmax (7), summed over the outputs only, and the score."""
        score = self.score(features)
        if self.net is None:
            return torch.ones_like(score), score
        z = (features.double() - self.mean) / self.deviation
        return torch.softmax(self.net(z), dim=1).float(), score


def graph_of(predict: Network | Forest | None, score: TaughtDistance, x: Floats) -> onnx.ModelProto:
    """The graph of a fitted model; ``x`` ``(m, F)`` are some rows of features."""
    example = torch.from_numpy(x[:2].astype(np.float32))
    if not isinstance(predict, Forest):
        return export.graph_of(NetworkGraph(predict, score), example, INPUT, ("classes", "score"))
    beside = export.graph_of(ScoreGraph(score), example, INPUT, ("score",))
    return _joined(_trees(predict, x.shape[1]), beside)


def worst_difference(
    model: onnx.ModelProto, predict: Network | Forest | None, score: TaughtDistance, x: Floats
) -> float:
    """Largest difference of classes and score between graph and fitted model over ``x``, relative
    to ``1 + |y|``."""
    import onnxruntime

    run = onnxruntime.InferenceSession(
        model.SerializeToString(), providers=["CPUExecutionProvider"]
    )
    rows = x.astype(np.float32)
    classes, distance = run.run(["classes", "score"], {INPUT: rows})
    wide = rows.astype(np.float64)
    wanted = np.ones((len(x), 1)) if predict is None else predict(wide)
    away = np.abs(score(wide) - distance[:, 0]) / (1.0 + np.abs(distance[:, 0]))
    return float(max(np.abs(wanted - classes).max(), away.max()))


def _trees(forest: Forest, columns: int) -> onnx.ModelProto:
    """The forest by skl2onnx, probabilities as one tensor."""
    import skl2onnx
    from skl2onnx.common.data_types import FloatTensorType

    model: onnx.ModelProto = skl2onnx.convert_sklearn(
        forest.trees,
        initial_types=[(INPUT, FloatTensorType([None, columns]))],
        options={id(forest.trees): {"zipmap": False}},
        target_opset={"": export.OPSET, "ai.onnx.ml": ML_OPSET},
    )
    return model


def _joined(trees: onnx.ModelProto, beside: onnx.ModelProto) -> onnx.ModelProto:
    """One graph on the same input; the forest's ``probabilities`` are called ``classes``."""
    other = onnx.compose.add_prefix(beside, "score_", rename_inputs=False, rename_outputs=False)
    rename = onnx.helper.make_node("Identity", ["probabilities"], ["classes"])
    free = [None, _columns(trees, "probabilities")]
    classes = onnx.helper.make_tensor_value_info("classes", onnx.TensorProto.FLOAT, free)
    graph = onnx.helper.make_graph(
        [*trees.graph.node, rename, *other.graph.node],
        "measured",
        [trees.graph.input[0]],
        [classes, other.graph.output[0]],
        [*trees.graph.initializer, *other.graph.initializer],
    )
    opsets = {each.domain: each.version for model in (beside, trees) for each in model.opset_import}
    return onnx.helper.make_model(
        graph,
        opset_imports=[onnx.helper.make_opsetid(*each) for each in opsets.items()],
        ir_version=min(trees.ir_version, beside.ir_version),
    )


def _columns(model: onnx.ModelProto, output: str) -> int:
    found: Sequence[Any] = [each for each in model.graph.output if each.name == output]
    return int(found[0].type.tensor_type.shape.dim[1].dim_value)
