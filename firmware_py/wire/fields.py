"""Records <-> the integer fields that both wires carry: one conversion, whatever the transport.

A field tuple holds counts in the order of ``orbitd.dbc`` (and of ``orbitd.xml``), counter first.
Reading is total: fields that name no state give the reason of their rejection.  Writing a value
that does not fit is a programming error and raises ``ValueError``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from firmware_py.records import (
    Command,
    DeviceHeartbeat,
    DriveCommand,
    DriveState,
    NodeFigures,
    NodeInfo,
    NodeState,
    ReadingsFrame,
    RigStatus,
    SampleFrame,
    WireMessage,
)
from firmware_py.wire.counts import Fields
from firmware_py.wire.drive_fields import (
    read_drive_command,
    read_drive_state,
    read_figures,
    write_drive_command,
    write_drive_state,
    write_figures,
)
from firmware_py.wire.layout import WireLayout
from firmware_py.wire.layout_fields import ReadingFields, SampleFields, read_samples, write_samples
from firmware_py.wire.node_fields import (
    read_command,
    read_heartbeat,
    read_info,
    read_info_2,
    read_state,
    read_status,
    write_command,
    write_heartbeat,
    write_info,
    write_info_2,
    write_state,
    write_status,
)


@dataclass(frozen=True, slots=True)
class Conversion:
    """Between one record type and its fields; ``layout`` is their :mod:`struct` format, counter
    first."""

    layout: str
    read: Callable[[Fields], WireMessage | str]
    write: Callable[..., Fields]
    elements: tuple[int, ...] = ()
    """Bytes per element of each array in ``layout``."""


_COMMON: Final[dict[type, Conversion]] = {
    DeviceHeartbeat: Conversion("HIBBB", read_heartbeat, write_heartbeat),
    Command: Conversion("HIIHH", read_command, write_command),
    NodeState: Conversion("HIIHBBHHHHHH", read_state, write_state),
}
"""Messages that both schemas have in common."""

NODE_INFO_1: Final = Conversion("HIHHHHHH", read_info, write_info)
NODE_INFO_2: Final = Conversion("HIHHHHHHI", read_info_2, write_info_2)


def conversions(
    layout: WireLayout, slots: int | None = None, samples_bytes: int | None = None
) -> dict[type, Conversion]:
    """Every message of ``layout``'s schema.

    Parameters
    ----------
    slots, samples_bytes
        Of the arrays on a wire whose messages have one size for all rigs; as the layout has them
        when None.
    """
    if layout.schema == 1:
        return _COMMON | {
            RigStatus: Conversion("HIihHH", read_status, write_status),
            SampleFrame: Conversion("HIIHH48s", read_samples, write_samples, (2,)),
            NodeInfo: NODE_INFO_1,
        }
    samples, readings = SampleFields(layout), ReadingFields(layout)
    n = layout.slots if slots is None else slots
    size = layout.samples_bytes if samples_bytes is None else samples_bytes
    return _COMMON | {
        DriveCommand: Conversion("HIIIIHH", read_drive_command, write_drive_command),
        DriveState: Conversion("HIIHBxIIiiHHHH", read_drive_state, write_drive_state),
        ReadingsFrame: Conversion(
            f"HIBB2x{4 * n}s{n}s{n}s", readings.read, readings.write, (4, 1, 1)
        ),
        SampleFrame: Conversion(f"HIIHBB{size}s", samples.read, samples.write, (2,)),
        NodeInfo: NODE_INFO_2,
        NodeFigures: Conversion("HIHBxHHHHHHH2xIIII", read_figures, write_figures),
    }
