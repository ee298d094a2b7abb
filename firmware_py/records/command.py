"""Commands of people and programs, and how processes greet each other."""

from __future__ import annotations

from typing import Final

from firmware_py.records.base import Record


class PlannedRamp(Record, frozen=True):
    """A ramp of the machine told ahead: start and end in seconds from now, speed and static load at
    its end."""

    start_s: float
    end_s: float
    speed_rpm: float
    load_N: float


class CommandRequest(Record, frozen=True, tag=True):
    """A person's or program's request: ``verb`` is one of :data:`VERBS` or of
    :data:`BRAIN_VERBS`."""

    seq: int
    verb: str
    value: float | None = None
    mode: int | None = None
    origin: str = "local"
    ramp: PlannedRamp | None = None
    action: str = ""
    id: str = ""
    """The asker's own name for this request; a repeated one is not executed twice."""
    target: str = ""
    """Of ``bypass`` a measure or a group, of ``shelve`` an alarm; ``value`` is for how long, s, and
    0 ends it.  Of ``models`` a set."""
    owner: str = ""
    reason: str = ""
    """Who bypasses, and why."""


REQUEST_ID: Final = r"^[!-~]{1,64}\Z"
"""What the id of a request may be."""

VERBS: Final = (
    "mode", "arm", "disarm", "reset", "set_clearance", "set_pressure", "announce", "bypass",
    "shelve",
)  # fmt: skip
"""What the guard answers."""
BRAIN_VERBS: Final = ("commission", "models")
"""What the brain answers; ``commission`` takes one of
:data:`~firmware_py.records.COMMISSION_ACTIONS`, ``models`` one of
:data:`~firmware_py.records.MODELS_ACTIONS` and a set."""


class CommandReply(Record, frozen=True, tag=True):
    """Answer to :class:`CommandRequest` ``seq``: accepted, or *all* reasons why not."""

    seq: int
    accepted: bool
    reasons: list[str]
    id: str = ""
    """Of the request, filled in by the gate."""


class EventAck(Record, frozen=True, tag=True):
    """The gate has stored every event up to and including ``seq``."""

    seq: int


class Hello(Record, frozen=True, tag=True):
    """First record of a peer on a process's socket: which process it is (``brain``, ``gate``)."""

    role: str
    pid: int
