"""ASAM MDF 3 and 4 by asammdf: channels of all groups, rates from their masters."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from models.readers.channel_map import FileRules
from models.readers.signal_file import Channel, SignalFile, SignalFileError, guarded, library
from models.readers.timing import rate_of_stamps


def read(path: Path, rules: FileRules) -> SignalFile:
    """Every channel of numbers; a name that stands in several groups gets the group's number."""
    asammdf = library("asammdf", path)

    def load() -> list[Any]:
        with asammdf.MDF(path) as stored:
            return [s for s in stored.iter_channels() if np.ndim(s.samples) == 1]

    found = guarded(path, "MDF file", load)
    names = [signal.name for signal in found]
    channels, notes = [], []
    for number, signal in enumerate(found):
        name = signal.name if names.count(signal.name) == 1 else f"{signal.name} ({number + 1})"
        if not np.issubdtype(signal.samples.dtype, np.number) or len(signal.samples) < 2:
            notes.append(f"{name}: no row of numbers, left out")
            continue
        rate, fault = None, ""
        try:
            rate = rate_of_stamps(
                np.asarray(signal.timestamps, np.float64), f"{path.name}: {name}", None
            )
        except SignalFileError as error:
            fault = str(error)
        values = np.asarray(signal.samples, np.float64)
        channels.append(Channel(name, values, str(signal.unit or ""), rate, fault=fault))
    return SignalFile(path, tuple(channels), notes=tuple(notes))
