"""Arrays of NumPy and MATLAB (to version 7.2): vectors and columns as channels, scalars as
facts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from models.readers.channel_map import FileRules
from models.readers.signal_file import Channel, SignalFile, SignalFileError, guarded, library

SAMPLES: Final = "samples"
"""Of an .npz in this project's own layout: ``(instants, channels)``."""
HDF5: Final = b"MATLAB 7.3"


def read_npz(path: Path, rules: FileRules) -> SignalFile:
    """Every array of an .npz."""

    def load() -> dict[str, Any]:
        with np.load(path, allow_pickle=False) as stored:
            return {name: stored[name] for name in stored.files}

    return _file(path, guarded(path, "NumPy archive", load))


def read_npy(path: Path, rules: FileRules) -> SignalFile:
    """One array, ``(instants,)`` or ``(instants, channels)``."""
    return _file(
        path, {"": guarded(path, "NumPy array", lambda: np.load(path, allow_pickle=False))}
    )


def read_mat(path: Path, rules: FileRules) -> SignalFile:
    """Every variable; fields of structures as ``structure.field``."""
    if path.read_bytes()[: len(HDF5)] == HDF5:
        raise SignalFileError(
            f"{path.name}: MATLAB 7.3 (HDF5) is not read; save it with save('{path.name}', '-v7')"
        )
    io = library("scipy.io", path)
    found = guarded(
        path,
        "MATLAB file",
        lambda: io.loadmat(path, squeeze_me=True, struct_as_record=False),
    )
    return _file(path, {k: v for k, v in found.items() if not k.startswith("__")})


def _file(path: Path, arrays: Mapping[str, Any]) -> SignalFile:
    """Channels are the arrays of the greatest length and those of others, in their order."""
    channels: list[Channel] = []
    facts: dict[str, float] = {}
    notes: list[str] = []
    for name, value in _flat("", arrays):
        array = np.asarray(value)
        if not (np.issubdtype(array.dtype, np.number) or array.dtype == np.bool_):
            notes.append(f"{name}: no numbers, left out")
        elif np.iscomplexobj(array):
            notes.append(f"{name}: complex numbers, left out")
        elif array.size == 1:
            facts[name.rpartition(".")[2]] = float(array.reshape(-1)[0])
        elif array.ndim in (1, 2):
            channels += _columns(name, array)
        else:
            notes.append(f"{name}: {array.ndim} dimensions, left out")
    return SignalFile(path, tuple(channels), facts, notes=tuple(notes))


def _columns(name: str, array: Any) -> Iterator[Channel]:
    """A vector as one channel, a table as one a column; a table that lies is set upright."""
    if array.ndim == 2 and min(array.shape) == 1:
        array = array.reshape(-1)
    if array.ndim == 1:
        yield Channel(name or "column 1", np.asarray(array, np.float64))
        return
    upright = array if name == SAMPLES or array.shape[0] >= array.shape[1] else array.T
    for i in range(upright.shape[1]):
        named = f"column {i + 1}" if name in ("", SAMPLES) else f"{name} {i + 1}"
        yield Channel(named, np.asarray(upright[:, i], np.float64))


def _flat(prefix: str, tree: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Variables, and the fields of MATLAB structures, by dotted name."""
    for name, value in tree.items():
        inner = value.item() if isinstance(value, np.ndarray) and value.shape == () else value
        fields = getattr(inner, "_fieldnames", None)
        if fields is not None:
            yield from _flat(f"{prefix}{name}.", {f: getattr(inner, f) for f in fields})
        else:
            yield f"{prefix}{name}", value
