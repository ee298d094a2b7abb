"""One ONNX model as a function from arrays to arrays: one thread, no spinning, no telemetry, finite
answers."""

from __future__ import annotations

import math
import time
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_py.brain.errors import ModelAnswerError, ModelUnfitError

_DTYPES = {"tensor(float)": np.float32, "tensor(double)": np.float64}


@cache
def _runtime() -> Any:
    """onnxruntime with its usage reporting off, before the first session."""
    import onnxruntime

    onnxruntime.disable_telemetry_events()
    return onnxruntime


@cache
def _load_errors() -> tuple[type[Exception], ...]:
    """What onnxruntime raises on bytes that it cannot run; its errors share no base of their
    own."""
    from onnxruntime.capi import onnxruntime_pybind11_state as state

    return (
        state.Fail,
        state.InvalidArgument,
        state.InvalidGraph,
        state.InvalidProtobuf,
        state.NotImplemented,
        state.RuntimeException,
    )


class Session:
    """An inference session on bytes that somebody has already vouched for.

    Parameters
    ----------
    name
        For messages.
    data
        The ONNX file.  External data is not looked up: the graph must hold its weights.

    Raises
    ------
    ModelUnfitError
        ``data`` is no model that onnxruntime can run, or it has not exactly one floating-point
        input of shape (batch, columns).
    """

    def __init__(self, name: str, data: bytes) -> None:
        runtime = _runtime()
        options = runtime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        options.use_deterministic_compute = True
        options.log_severity_level = 4
        try:
            self._session = runtime.InferenceSession(
                data, options, providers=["CPUExecutionProvider"]
            )
        except Exception as error:
            first = str(error).splitlines()[0][:200]
            raise ModelUnfitError(
                f"{name}: not a model that onnxruntime runs ({first}); export it again"
            ) from error
        inputs = self._session.get_inputs()
        if len(inputs) != 1 or inputs[0].type not in _DTYPES or len(inputs[0].shape) != 2:
            found = [(i.name, i.type, i.shape) for i in inputs]
            raise ModelUnfitError(
                f"{name}: inputs {found}, expected one float or double of shape [batch, columns]"
            )
        self.name = name
        self.columns = inputs[0].shape[1]
        self.outputs: tuple[str, ...] = tuple(output.name for output in self._session.get_outputs())
        self._input = inputs[0].name
        self._dtype = _DTYPES[inputs[0].type]
        self.deadline_s = math.inf
        self._late = 0

    @property
    def metadata(self) -> dict[str, str]:
        """The file's own metadata."""
        return dict(self._session.get_modelmeta().custom_metadata_map)

    def take_late(self) -> int:
        """Answers that took longer than ``deadline_s`` since the last call."""
        late, self._late = self._late, 0
        return late

    def run(self, rows: NDArray[np.floating[Any]]) -> dict[str, NDArray[np.float64]]:
        """Answers by output name for ``rows`` of shape (batch, columns).

        Raises
        ------
        ModelAnswerError
            An answer is not finite.
        """
        start_s = time.perf_counter()
        answers = self._session.run(None, {self._input: np.ascontiguousarray(rows, self._dtype)})
        self._late += time.perf_counter() - start_s > self.deadline_s
        named: dict[str, NDArray[np.float64]] = {}
        for name, answer in zip(self.outputs, answers, strict=True):
            if not np.isfinite(answer).all():
                raise ModelAnswerError(
                    f"{self.name}: output {name!r} is not finite; the model is not used for this"
                )
            named[name] = answer.astype(np.float64)
        return named
