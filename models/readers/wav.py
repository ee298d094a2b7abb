"""WAV: channels between -1 and 1 of full scale."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from models.readers.channel_map import FileRules
from models.readers.signal_file import Channel, SignalFile, SignalFileError, guarded, library


def read(path: Path, rules: FileRules) -> SignalFile:
    """PCM of 8 to 32 bit and floating point; a file that is cut short is refused."""
    wavfile = library("scipy.io.wavfile", path)

    def load() -> Any:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            rate, values = wavfile.read(path)
        cut = [str(w.message) for w in caught if "EOF" in str(w.message)]
        if cut:
            raise SignalFileError(
                f"{path.name}: ends before the samples that its head announces ({cut[0]}); copy "
                "it again, or cut it to its whole part with an audio editor"
            )
        return rate, values

    rate, values = guarded(path, "WAV", load)
    columns = np.atleast_2d(np.asarray(values).T)
    if columns.dtype == np.uint8:
        scaled = (columns.astype(np.float64) - 128.0) / 128.0
    elif np.issubdtype(columns.dtype, np.integer):
        scaled = columns / -float(np.iinfo(columns.dtype).min)
    else:
        scaled = columns.astype(np.float64)
    names = [f"channel {i}" for i in range(1, len(scaled) + 1)]
    return SignalFile(
        path,
        tuple(
            Channel(name, row, "fs", float(rate)) for name, row in zip(names, scaled, strict=True)
        ),
    )
