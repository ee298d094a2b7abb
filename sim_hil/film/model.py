"""A film model of someone else, such as an exported network, tabulated so that a rotor runs on
it."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from .records import FilmError, Floats
from .table import FilmTable

FilmModel = Callable[[Floats], Sequence[Floats]]
"""State (m, 9): x, y, m, vx, vy, m/s, speed, rad/s, clearance, m, viscosity, Pa s, radius, length,
m; gives force (m, 2), N, friction torque (m, 1), N m, side flow (m, 1), m3/s."""

_OUTPUTS = ("force", "friction_torque", "side_flow")


def tabulate(model: FilmModel, length_over_diameter: float) -> FilmTable:
    """Tabulate a model of the plain unfed film, once, through the two numbers that its force
    depends on.

    What a model of another film says beyond them is lost. How the film answers a moving clearance,
    which such a model does not know, is taken from the shipped table.

    Raises
    ------
    FilmError
        No table of that shape is shipped, or an answer is not finite.
    """
    shipped = FilmTable.load(length_over_diameter)
    eps, gamma = shipped.nodes()
    c, radius = 1e-4, 0.02
    around, along = np.meshgrid(gamma, eps)
    zero = np.zeros(along.size)
    state = np.column_stack(
        [
            c * along.ravel(),
            zero,
            np.cos(around).ravel(),
            np.sin(around).ravel(),
            zero,
            *(
                np.full(along.size, each)
                for each in (c, 0.01, radius, 2 * radius * length_over_diameter)
            ),
        ]
    )
    answers = [np.asarray(answer, dtype=np.float64) for answer in model(state)[:3]]
    if not all(np.isfinite(answer).all() for answer in answers):
        raise FilmError(
            f"film model: its answers are not finite for eccentricity ratios up to {eps[-1]:g}"
        )
    force = answers[0].reshape(*along.shape, 2) / (12 * 0.01 * (radius / c) ** 3 * radius)
    flow = answers[2].reshape(along.shape) / radius**2
    velocity = np.stack([np.cos(around), np.sin(around)], axis=-1)
    return shipped.with_film(force, flow, velocity)


def load_model(path: Path) -> tuple[FilmModel, float]:
    """A film model exported to ONNX, and the length over diameter that it holds for.

    Raises
    ------
    FilmError
        Not a readable model of a film.
    """
    import onnxruntime
    from onnxruntime.capi import onnxruntime_pybind11_state as state

    onnxruntime.disable_telemetry_events()
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    unreadable = (
        state.Fail,
        state.InvalidArgument,
        state.InvalidGraph,
        state.InvalidProtobuf,
        state.NotImplemented,
    )
    try:
        session = onnxruntime.InferenceSession(
            str(path), options, providers=["CPUExecutionProvider"]
        )
        domain = json.loads(session.get_modelmeta().custom_metadata_map["domain"])
        shape = float(domain["length_over_diameter"][0])
    except (*unreadable, KeyError, ValueError) as error:
        raise FilmError(
            f"{path}: not a film model that onnxruntime reads, with its domain: {error!r}"
        ) from error
    names = {output.name for output in session.get_outputs()}
    if not names.issuperset(_OUTPUTS):
        raise FilmError(f"{path}: gives {sorted(names)}; a film model gives {', '.join(_OUTPUTS)}")
    entry = session.get_inputs()[0].name

    def model(state: Floats) -> Sequence[Floats]:
        answers: Sequence[Floats] = session.run(list(_OUTPUTS), {entry: state})
        return answers

    return model, shape
