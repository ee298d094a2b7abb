"""Small ONNX models with the interfaces of the shipped ones, whose answers are known.

The film surrogate is the short (Ocvirk) half film in closed form.
"""

from __future__ import annotations

import json

import numpy as np
from onnx import TensorProto, helper, numpy_helper

from firmware_py.acquire.features import FEATURE_NAMES
from firmware_py.acquire.windows import WINDOW_LAYOUT
from firmware_py.brain.store import FILM_STATE, OBSERVATION
from firmware_py.records import CHANNELS


class Graph:
    """Collects nodes; every method returns the name of a new tensor."""

    def __init__(self) -> None:
        self.nodes: list[object] = []
        self.constants: list[object] = []

    def constant(self, value: object) -> str:
        name = f"c{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(np.asarray(value, np.float64), name))
        return name

    def op(self, kind: str, *inputs: str | float, **attributes: object) -> str:
        names = [i if isinstance(i, str) else self.constant(i) for i in inputs]
        out = f"t{len(self.nodes)}"
        self.nodes.append(helper.make_node(kind, names, [out], **attributes))
        return out

    def column(self, tensor: str, index: int) -> str:
        axis = numpy_helper.from_array(np.array([index]), f"i{len(self.constants)}")
        self.constants.append(axis)
        return self.op("Gather", tensor, axis.name, axis=1)

    def rename(self, tensor: str, name: str) -> None:
        self.nodes.append(helper.make_node("Identity", [tensor], [name]))

    def total(self, tensor: str) -> str:
        axis = numpy_helper.from_array(np.array([1]), f"i{len(self.constants)}")
        self.constants.append(axis)
        return self.op("ReduceSum", tensor, axis.name, keepdims=1)


def short_film(nodes: int = 60, **changed: str) -> bytes:
    """``surrogate.onnx`` of the short bearing: ``p = max(0, 6 mu (dh/dt + w/2 dh/dtheta)(z^2 -
    L^2/4)/h^3)``."""
    g = Graph()
    x, y, vx, vy, omega, c, mu, radius, length = (g.column("state", k) for k in range(9))
    angle = np.linspace(0, 2 * np.pi, nodes, endpoint=False)[None, :]
    cos, sin = np.cos(angle), np.sin(angle)
    film = g.op("Sub", g.op("Sub", c, g.op("Mul", x, cos)), g.op("Mul", y, sin))
    film = g.op("Max", film, g.op("Mul", c, 0.02))
    # Squeeze of the film: dh/dt + (omega / 2) dh/dtheta, negative where it closes.
    half = g.op("Mul", omega, 0.5)
    closing_x = g.op("Add", vx, g.op("Mul", half, y))
    closing_y = g.op("Sub", vy, g.op("Mul", half, x))
    squeeze = g.op("Add", g.op("Mul", closing_x, cos), g.op("Mul", closing_y, sin))
    pressure = g.op("Div", g.op("Max", squeeze, 0.0), g.op("Mul", g.op("Mul", film, film), film))
    gain = g.op("Mul", g.op("Mul", mu, radius), g.op("Mul", g.op("Mul", length, length), length))
    gain = g.op("Mul", gain, -2 * np.pi / nodes)
    fx = g.op("Mul", gain, g.total(g.op("Mul", pressure, cos)))
    fy = g.op("Mul", gain, g.total(g.op("Mul", pressure, sin)))
    shear = g.op("Mul", g.total(g.op("Reciprocal", film)), 2 * np.pi / nodes)
    size = g.op(
        "Mul",
        g.op("Mul", mu, omega),
        g.op("Mul", g.op("Mul", radius, radius), g.op("Mul", radius, length)),
    )
    torque = g.op(
        "Add",
        g.op("Mul", size, shear),
        g.op("Mul", g.op("Sub", g.op("Mul", x, fy), g.op("Mul", y, fx)), 0.5),
    )
    force = g.op("Concat", fx, fy, axis=1)
    g.rename(force, "force")
    g.rename(torque, "friction_torque")
    g.rename(size, "side_flow")
    return finish(
        g,
        "state",
        9,
        {"force": 2, "friction_torque": 1, "side_flow": 1},
        TensorProto.DOUBLE,
        card("surrogate", **changed),
    )


def classifier(
    bias: tuple[float, ...] = (-4.0, -4.0, -4.0, -4.0),
    *,
    unbalance_above: float = 99.0,
    novelty_threshold: float = 1.0,
    score: float = 0.0,
    named_above: dict[str, float] | None = None,
    fleet: bool = False,
    **changed: str,
) -> bytes:
    """Heads ``sigmoid(bias)``; the unbalance head rises where ``log_shaft_fwd_1x_m`` exceeds
    ``unbalance_above``.

    With ``fleet``: ``normal`` is the decades of the motor's and the microphone's level from a
    fleet's, by hundredths.
    """
    g = Graph()
    amplitude = g.column(
        g.op("Cast", "features", to=TensorProto.DOUBLE), FEATURE_NAMES.index("log_shaft_fwd_1x_m")
    )
    above = g.op("Mul", g.op("Sub", amplitude, unbalance_above), 100.0)
    heads = g.op(
        "Concat",
        *(g.op("Add", g.op("Mul", above, 0.0), value) for value in bias[:3]),
        g.op("Max", above, bias[3]),
        axis=1,
    )
    g.rename(g.op("Sigmoid", heads), "heads")
    g.rename(g.op("Add", g.op("Mul", above, 0.0), score), "score")
    outputs = {"heads": 4, "score": 1}
    settings: dict[str, object] = {
        "novelty_threshold": novelty_threshold,
        "named_above": named_above or {},
    }
    if fleet:
        levels = [
            g.column(g.op("Cast", "features", to=TensorProto.DOUBLE), FEATURE_NAMES.index(name))
            for name in ("acc_motor_log_rms", "microphone_log_rms")
        ]
        away = [
            g.op("Mul", g.op("Sub", level, usual), 100.0)
            for level, usual in zip(levels, (0.1, -1.2), strict=True)
        ]
        g.rename(g.op("Concat", *away, axis=1), "normal")
        outputs["normal"] = 2
        settings["normal"] = {
            "parts": ["floating", "ringing"],
            "columns": [1, 1],
            "between": [400.0, 400.0],
            "limits": [3.0, 3.0],
            "typical": [0.7, 0.7],
        }
    lists = {
        "channels": list(CHANNELS),
        "rate_hz": [5000, 10000],
        "inputs": list(FEATURE_NAMES),
        "outputs": ["heads", "score"],
        "domain": {},
        "window": WINDOW_LAYOUT,
        "settings": settings,
    }
    return finish(
        g,
        "features",
        len(FEATURE_NAMES),
        outputs,
        TensorProto.FLOAT,
        card("classifier", **{k: json.dumps(v) for k, v in lists.items()} | changed),
    )


def actor(clearance_m: float, **changed: str) -> bytes:
    """Always the same clearance (NaN is a way to a broken model)."""
    g = Graph()
    first = g.op("Cast", g.column("observation", 0), to=TensorProto.DOUBLE)
    g.rename(g.op("Add", g.op("Mul", first, 0.0), clearance_m), "clearance")
    lists = {
        "inputs": list(OBSERVATION),
        "outputs": ["clearance"],
        "domain": {"speed_rad_s": [100.0, 1300.0]},
    }
    return finish(
        g,
        "observation",
        len(OBSERVATION),
        {"clearance": 1},
        TensorProto.FLOAT,
        card("actor", **{k: json.dumps(v) for k, v in lists.items()} | changed),
    )


def finish(
    g: Graph,
    source: str,
    columns: int,
    outputs: dict[str, int],
    dtype: int,
    metadata: dict[str, str],
) -> bytes:
    """The graph as the bytes of an ONNX file; answers are double."""
    graph = helper.make_graph(
        g.nodes,
        "test",
        [helper.make_tensor_value_info(source, dtype, ["batch", columns])],
        [
            helper.make_tensor_value_info(name, TensorProto.DOUBLE, ["batch", n])
            for name, n in outputs.items()
        ],
        g.constants,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, metadata)
    return bytes(model.SerializeToString())


def card(kind: str, /, **changed: str) -> dict[str, str]:
    """Metadata as the shipped models carry it; ``changed`` replaces values, an empty one
    removes."""
    lists = {
        "channels": [],
        "rate_hz": [],
        "inputs": list(FILM_STATE),
        "outputs": ["force", "friction_torque", "side_flow"],
        "domain": {"eccentricity_ratio": [0.0, 0.97], "length_over_diameter": [0.5, 0.5]},
        "rigs": ["bench"],
        "units": [],
        "metrics": {},
        "window": None,
        "settings": None,
    }
    plain = {
        "kind": kind,
        "version": "0",
        "status": "provisional",
        "physics_version": "1",
        "data_hash": "0",
        "commit": "0",
    }
    properties = plain | {k: json.dumps(v) for k, v in lists.items()} | changed
    return {key: value for key, value in properties.items() if value}


OWN_CHANNELS = ("disp_x", "acc_motor")
OWN_SIZE = {"2 bands": 10, "orders": 26}


def own(made: str = "2 bands", column: int = 4, at: float = 5e-6, **changed: object) -> bytes:
    """A model that says ``loud`` where feature ``column`` is above ``at`` and nothing strange."""
    size = OWN_SIZE[made]
    pick = np.zeros((size, 2), np.float32)
    pick[column] = (-1e8, 1e8)
    shift = np.array([1e8 * at, -1e8 * at], np.float32)
    nodes = [
        helper.make_node("Gemm", ["features", "w", "b"], ["z"]),
        helper.make_node("Softmax", ["z"], ["classes"], axis=1),
        helper.make_node("Gemm", ["features", "zero", "half"], ["score"]),
    ]
    weights = {"w": pick, "b": shift, "zero": np.zeros((size, 1), np.float32),
               "half": np.array([0.5], np.float32)}  # fmt: skip
    graph = helper.make_graph(
        nodes,
        "own",
        [helper.make_tensor_value_info("features", TensorProto.FLOAT, [None, size])],
        [helper.make_tensor_value_info("classes", TensorProto.FLOAT, [None, 2]),
         helper.make_tensor_value_info("score", TensorProto.FLOAT, [None, 1])],
        [numpy_helper.from_array(value, name) for name, value in weights.items()],
    )  # fmt: skip
    settings = {"labels": ["quiet", "loud"], "view": made, "rate_hz": 5000.0, "window_s": 1.0}
    card: dict[str, object] = {
        "kind": "measured classifier", "version": "1", "status": "provisional",
        "channels": list(OWN_CHANNELS), "units": ["m", "m/s2"], "rate_hz": [5000],
        "inputs": [f"{made} {i}" for i in range(size)], "outputs": ["classes", "score"],
        "domain": {}, "rigs": [], "physics_version": "2", "data_hash": "", "commit": "",
        "settings": {k: changed.get(k, v) for k, v in settings.items()},
    }  # fmt: skip
    card = {k: v if k == "rate_hz" else changed.get(k, v) for k, v in card.items()}
    proto = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    texts = {k: v if isinstance(v, str) else json.dumps(v) for k, v in card.items()}
    helper.set_model_props(proto, texts)
    return proto.SerializeToString()
