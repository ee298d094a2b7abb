"""What all records share: the eight channels, and the frozen, tagged base class."""

from __future__ import annotations

from typing import Final

import msgspec

CHANNELS: Final = (
    "disp_x",
    "disp_y",
    "acc_bearing_vertical",
    "acc_bearing_horizontal",
    "acc_motor",
    "microphone",
    "supply_pressure",
    "contact_resistance",
)
"""The eight sensor channels in wire order."""

N_CHANNELS: Final = len(CHANNELS)
INSTANTS_PER_FRAME: Final = 3
"""Sampling instants in one sample frame."""


class Record(msgspec.Struct, frozen=True, gc=False, tag_field="type"):
    """Base of every record: frozen, compared by value, tagged with its class name."""
