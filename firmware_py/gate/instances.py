"""The rig's signals as people see them: each channel and reading with its words, value and unit.

Metrics and page take their rows from here, and so show whatever the rig declares.
"""

from __future__ import annotations

import msgspec

from firmware_py import signals
from firmware_py.acquire.slow_pages import doubt_of
from firmware_py.config import Config
from firmware_py.config.instances import fast_signals, slow_signals
from firmware_py.gate.features import SignalFeatures
from firmware_py.records import ReadingQuality, RigReading, SlowValue


class ShownSignal(msgspec.Struct, frozen=True):
    """One signal now: ``value`` is None while there is none, ``note`` says why it is not OK.

    Of a fast channel the value is its rms about the mean.
    """

    name: str
    words: str
    kind: str
    unit: str
    suffix: str
    value: float | None
    ok: bool
    note: str = ""


class Instances:
    """The signals of one rig.

    Parameters
    ----------
    config
        Its channels and readings.
    """

    def __init__(self, config: Config) -> None:
        self._fast = fast_signals(config.machine.channel)
        self._slow = slow_signals(config)

    def channels(self, features: SignalFeatures | None) -> list[ShownSignal]:
        """Every fast channel in wire order."""
        found = features.channel if features else {}
        shown = []
        for row in self._fast:
            now = found.get(row.name)
            per_si = row.kind.wire_per_si
            shown.append(
                ShownSignal(
                    row.name,
                    row.words,
                    row.kind.name,
                    row.kind.wire_unit,
                    "",
                    None if now is None else now.rms * per_si,
                    now is not None and now.ok,
                )
            )
        return shown

    def readings(self, reading: RigReading | None) -> list[ShownSignal]:
        """Every slow reading in wire order."""
        shown = []
        for row in self._slow:
            value = _value(row.name, reading)
            doubt = doubt_of(row, value)
            known = value is not None and value.quality == ReadingQuality.OK
            shown.append(
                ShownSignal(
                    row.name,
                    row.words,
                    row.kind.name,
                    row.kind.unit,
                    row.kind.suffix,
                    value.value if value is not None and known else None,
                    not doubt,
                    doubt,
                )
            )
        return shown


def _value(name: str, reading: RigReading | None) -> SlowValue | None:
    """A reading by its name: of a rig of wire schema 1, out of its status."""
    if reading is None or reading.values:
        return reading.values.get(name) if reading else None
    standard = signals.STANDARD_READING.get(name)
    if standard is None:
        return None
    field = f"{name}_{signals.SLOW[standard.kind].suffix}"
    return SlowValue(getattr(reading.status, field), 0, int(ReadingQuality.OK))
