"""The key expressions of the device: ``orbitd/<site>/<rig>/<block>/<signal>``, blocks after ISO
13374.

================ ============================== ===================== ====================
key              payload                        when                  encoding
================ ============================== ===================== ====================
da/block         ``Block`` (raw samples)        each block            application/msgpack
da/reading       ``RigReading``                 20 Hz                 application/json
dm/features      ``SignalFeatures``             10 Hz                 application/json
sd/state         ``GuardState``                 10 Hz                 application/json
sd/alarms        list of ``Alarm``, all active  1 Hz, and on query    application/json
ha/diagnosis     ``Diagnosis``                  each decision         application/json
ha/shadow        ``ShadowDiagnosis``            each window           application/json
pa/forecast      ``Forecast``                   each forecast         application/json
ag/advice        ``Advice``                     10 Hz                 application/json
ha/state         ``BrainState``                 1 Hz                  application/json
ha/commission    ``CommissionState``            1 Hz                  application/json
ha/models        ``ModelsInUse``                1 Hz, at a change     application/json
event/<severity> ``Event``                      once                  application/json
event            list of ``Event``              query, ``?since=N``   application/json
state            ``DeviceState``                query                 application/json
config           effective configuration        query                 application/json
models           manifest and file metadata     query                 application/json
cmd/<verb>       ``CommandReply``               query, payload: see   application/json
                                                below
live/<process>   liveliness token               while it lives
================ ============================== ===================== ====================

Queries answer in JSON, where a number that is not finite is null; with the parameter ``as=msgpack``
in msgpack, exact.  ``since`` counts the guard's events from its last start.

Reading is harmless: a query with any wildcard in it executes nothing.  A command names its exact
key and carries a JSON object, ``{"id": "7f3a", "value": 60.0}``: ``id`` is any text of 1 to 64
printable characters that was not used before (a UUID, say), ``value`` is left away where the verb
takes none.  The id comes back in the reply; a repeated id is not executed twice but answered the
same.

The payload structures are those of :mod:`firmware_py.records` and of :mod:`firmware_py.gate.view`;
units stand in the names.  Verbs: ``mode`` ("monitor", "manual", "auto"), ``arm``, ``disarm``,
``reset``, ``set_clearance`` (radial, um), ``set_pressure`` (bar), ``announce`` (a ``PlannedRamp``);
answered by the brain: ``commission`` ("start", "stop", "cancel", "forget"), ``models``
(``{"action": "add", "set": ID}``, also "shadow", "promote" and "rollback").
"""

from __future__ import annotations

from typing import Final

from firmware_py import signals
from firmware_py.recording import TOPICS
from firmware_py.records import Record, Severity

PUBLISHED: Final[dict[type[Record], str]] = {
    kind: topic.name
    for kind, topic in TOPICS.items()
    if kind.__name__ in {row.record for row in signals.STREAMS if row.published}
}
"""Records that go out as they come in."""

FEATURES: Final = "dm/features"
ALARMS: Final = "sd/alarms"
EVENTS: Final = "event"
STATE: Final = "state"
CONFIG: Final = "config"
MODELS: Final = "models"


def prefix(site: str, rig: str) -> str:
    """What every key of one device starts with."""
    return f"orbitd/{site}/{rig}"


def event(severity: int) -> str:
    """Key of one event."""
    return f"{EVENTS}/{Severity(severity).name.lower()}"


def command(verb: str) -> str:
    """Key under which ``verb`` is asked for."""
    return f"cmd/{verb}"


def live(process: str) -> str:
    """Key of a process's liveliness token."""
    return f"live/{process}"
