"""Pages of slow readings (wire schema 2) to values by name, and to the status that the guard rests
on."""

from __future__ import annotations

from typing import Final

from firmware_py import signals
from firmware_py.config import Config
from firmware_py.config.instances import SlowSignal
from firmware_py.records import ReadingQuality, ReadingsFrame, RigStatus, SlowValue
from firmware_py.wire.counts import INT32_MIN
from firmware_py.wire.layout import WireLayout

AGE_MAX_MS: Final = 250
"""An older value of a standard reading is none: what the node cannot measure any more."""

ABSENT: Final = SlowValue(0.0, 2550, int(ReadingQuality.ABSENT))


def doubt_of(row: SlowSignal, value: SlowValue | None) -> str:
    """Why a reading is not OK, in words; empty when it is."""
    if value is None:
        return "has not come yet"
    if value.quality != ReadingQuality.OK:
        return f"is {ReadingQuality(value.quality).name.lower()}, says the node"
    if value.age_ms > AGE_MAX_MS:
        return f"was {value.age_ms} ms old when it was sent (limit {AGE_MAX_MS})"
    if not row.ok_low <= value.value <= row.ok_high:
        return f"= {value.value:.6g} {row.kind.unit} is outside {row.ok_low:g} .. {row.ok_high:g}"
    return ""


class SlowPages:
    """Takes pages apart by the rig's layout; holds no state.

    Parameters
    ----------
    config
        Which readings there are.
    """

    def __init__(self, config: Config) -> None:
        self._layout = WireLayout.of(config)
        self._last = self._layout.pages - 1

    def values(self, page: ReadingsFrame) -> dict[str, SlowValue]:
        """The readings of one page by name; a page that this layout has not gives none."""
        rows = self._layout.page(page.page)
        told = zip(page.values, page.ages_ms, page.qualities, strict=True)
        return {
            row.name: SlowValue(value, age_ms, quality)
            for row, (value, age_ms, quality) in zip(rows, told, strict=False)
        }

    def status(self, page: ReadingsFrame, values: dict[str, SlowValue]) -> RigStatus | None:
        """The status after the last page of a round; None after another page."""
        if page.page != self._last:
            return None
        numbers = (_number(row, values.get(row.name, ABSENT)) for row in signals.READINGS)
        return RigStatus(page.counter, page.tick_us, *numbers)


def _number(row: signals.Standard, value: SlowValue) -> float:
    """A standard reading, or a number outside every range where the node has none."""
    if value.quality == ReadingQuality.OK and value.age_ms <= AGE_MAX_MS:
        return value.value
    return INT32_MIN * signals.SLOW[row.kind].resolution
