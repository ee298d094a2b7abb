"""The records that move through the device, in the order in which a sample meets them.

Every record is a frozen ``msgspec.Struct``.  Those that cross a process border are tagged, so one
byte string tells its own type; :func:`encode` and :func:`decode` are the only two ways across.

Times are monotonic nanoseconds of the host (``*_ns``) or microsecond ticks of the node
(``*_tick_us``, 32 bit, wrapping).  Units stand in the names; values inside the stages are SI
floats.
"""

from __future__ import annotations

import msgspec

from firmware_py.records.acquired import (
    Block,
    ChannelCause,
    Quality,
    RigReading,
    SlowValue,
    cause_bits,
    cause_of,
)
from firmware_py.records.base import CHANNELS, N_CHANNELS, Record
from firmware_py.records.brain import Advice, BrainState, Diagnosis, Forecast, ShadowDiagnosis
from firmware_py.records.command import (
    BRAIN_VERBS,
    REQUEST_ID,
    VERBS,
    CommandReply,
    CommandRequest,
    EventAck,
    Hello,
    PlannedRamp,
)
from firmware_py.records.guard import Alarm, Event, GuardState, Severity
from firmware_py.records.models import LOST, MODELS_ACTIONS, ModelsInUse
from firmware_py.records.normal import (
    COMMISSION_ACTIONS,
    Baseline,
    Belonging,
    CommissionState,
    Normal,
)
from firmware_py.records.replay import (
    BrainSnapshot,
    BrainStep,
    Cycle,
    CycleRecord,
    Decision,
    Snapshot,
    WindowRecord,
)
from firmware_py.records.wire import (
    ArmState,
    Command,
    DeviceHeartbeat,
    DriveCommand,
    DriveMode,
    DriveState,
    Mode,
    NodeFigures,
    NodeInfo,
    NodeMode,
    NodeState,
    RawFrame,
    ReadingQuality,
    ReadingsFrame,
    Rejected,
    RigStatus,
    SampleFrame,
    WireMessage,
)

__all__ = [
    "BRAIN_VERBS",
    "CHANNELS",
    "COMMISSION_ACTIONS",
    "LOST",
    "MODELS_ACTIONS",
    "N_CHANNELS",
    "REQUEST_ID",
    "VERBS",
    "Advice",
    "Alarm",
    "ArmState",
    "Baseline",
    "Belonging",
    "Block",
    "BrainSnapshot",
    "BrainState",
    "BrainStep",
    "ChannelCause",
    "Command",
    "CommandReply",
    "CommandRequest",
    "CommissionState",
    "Cycle",
    "CycleRecord",
    "Decision",
    "DeviceHeartbeat",
    "Diagnosis",
    "DriveCommand",
    "DriveMode",
    "DriveState",
    "Event",
    "EventAck",
    "Forecast",
    "GuardState",
    "Hello",
    "Mode",
    "ModelsInUse",
    "NodeFigures",
    "NodeInfo",
    "NodeMode",
    "NodeState",
    "Normal",
    "PeerRecord",
    "PlannedRamp",
    "Quality",
    "RawFrame",
    "ReadingQuality",
    "ReadingsFrame",
    "Record",
    "Rejected",
    "RigReading",
    "RigStatus",
    "SampleFrame",
    "Severity",
    "ShadowDiagnosis",
    "SlowValue",
    "Snapshot",
    "WindowRecord",
    "WireMessage",
    "cause_bits",
    "cause_of",
    "decode",
    "encode",
]

PeerRecord = (
    Block
    | RigReading
    | Event
    | GuardState
    | Diagnosis
    | ShadowDiagnosis
    | Forecast
    | Advice
    | BrainState
    | CommandRequest
    | CommandReply
    | EventAck
    | Hello
    | CycleRecord
    | Snapshot
    | WindowRecord
    | CommissionState
    | Normal
    | BrainStep
    | BrainSnapshot
    | ModelsInUse
)

_encoder = msgspec.msgpack.Encoder()
_decoder = msgspec.msgpack.Decoder(PeerRecord)


def encode(record: PeerRecord) -> bytes:
    """Byte string (msgpack) of one record."""
    return _encoder.encode(record)


def decode(data: bytes) -> PeerRecord:
    """The record in ``data``.

    Raises
    ------
    msgspec.ValidationError, msgspec.DecodeError
        When ``data`` is not one whole record of a known type.
    """
    record: PeerRecord = _decoder.decode(data)
    return record
