"""NI TDMS by nptdms: channels of all groups, rate from ``wf_increment``, unit from
``unit_string``."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from models.readers.channel_map import FileRules
from models.readers.signal_file import Channel, SignalFile, guarded, library


def read(path: Path, rules: FileRules) -> SignalFile:
    """Every channel that holds numbers; others are noted."""
    nptdms = library("nptdms", path)
    stored = guarded(path, "TDMS file", lambda: nptdms.TdmsFile.read(path))
    groups = stored.groups()
    channels, notes = [], []
    for group in groups:
        for each in group.channels():
            name = each.name if len(groups) == 1 else f"{group.name}/{each.name}"
            values = guarded(
                path,
                "TDMS file",
                lambda c=each: np.asarray(c[:]),  # type: ignore[misc]
            )
            if not np.issubdtype(values.dtype, np.number) or not len(values):
                notes.append(f"{name}: no numbers, left out")
                continue
            step = each.properties.get("wf_increment")
            channels.append(
                Channel(
                    name,
                    np.asarray(values, np.float64),
                    str(each.properties.get("unit_string", "") or ""),
                    1.0 / float(step) if step else None,
                )
            )
    return SignalFile(path, tuple(channels), notes=tuple(notes))
