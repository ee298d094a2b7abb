"""What all records share: the eight standard channels, and the frozen, tagged base class."""

from __future__ import annotations

from typing import Final

import msgspec

from firmware_py import signals

CHANNELS: Final = tuple(row.name for row in signals.CHANNELS)
"""The eight standard channels, in the order of wire schema 1."""

N_CHANNELS: Final = len(CHANNELS)


class Record(msgspec.Struct, frozen=True, gc=False, tag_field="type"):
    """Base of every record: frozen, compared by value, tagged with its class name."""
