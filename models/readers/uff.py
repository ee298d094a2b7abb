"""Universal file format, dataset 58 (time responses), by pyuff."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from models.readers.channel_map import FileRules
from models.readers.signal_file import Channel, SignalFile, SignalFileError, guarded, library

TIME_RESPONSE: Final = 1
"""``func_type`` of a time response; others (spectra, frequency responses) are no recordings."""


def read(path: Path, rules: FileRules) -> SignalFile:
    """Every time response; what else stands in the file is noted."""
    pyuff = library("pyuff", path)
    sets: list[dict[str, Any]] = guarded(path, "universal file", lambda: _sets(pyuff, path))
    channels, notes = [], []
    for number, each in enumerate(sets, 1):
        if each.get("type") != 58 or each.get("func_type") != TIME_RESPONSE:
            notes.append(f"data set {number}: no time response, left out")
            continue
        name = str(each.get("id1") or "").strip()
        name = name if name and name.upper() != "NONE" else f"node {each.get('rsp_node', number)}"
        step = float(each.get("abscissa_inc") or 0.0)
        channels.append(
            Channel(
                name,
                np.real(np.asarray(each["data"])).astype(np.float64),
                _unit(each),
                1.0 / step if step > 0.0 else None,
            )
        )
    if not channels:
        raise SignalFileError(
            f"{path.name}: {len(sets)} data sets, none of them a time response (58, function type "
            "1); export the waveforms"
        )
    return SignalFile(path, tuple(channels), notes=tuple(notes))


def _sets(pyuff: Any, path: Path) -> list[dict[str, Any]]:
    found = pyuff.UFF(str(path)).read_sets()
    return found if isinstance(found, list) else [found]


def _unit(each: dict[str, Any]) -> str:
    text = str(each.get("ordinate_axis_units_lab") or "").strip()
    return "" if text.upper() == "NONE" else text
