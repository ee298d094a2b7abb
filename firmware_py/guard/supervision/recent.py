"""The range of a value over the last while, with few entries whatever its rate of change."""

from __future__ import annotations

from typing import Final

import msgspec

ENTRIES: Final = 8
"""Entries that one window is divided into; the range may look back one entry too far, never too
little."""


class Span(msgspec.Struct, array_like=True, gc=False):
    """Lowest and highest value from ``since_ns`` until the next entry begins; ``value`` is the last
    one."""

    since_ns: int
    low: float
    high: float
    value: float


def note(spans: list[Span], now_ns: int, value: float, window_ns: int) -> None:
    """The value is ``value`` from ``now_ns`` on; what ended before the window is forgotten.

    To be called again and again, also when the value stays: a change within one entry is forgotten
    that way too.
    """
    while len(spans) > 1 and spans[1].since_ns <= now_ns - window_ns:
        del spans[0]
    if spans and spans[-1].low == spans[-1].high == value:
        return
    if spans and now_ns - spans[-1].since_ns < window_ns // ENTRIES:
        last = spans[-1]
        last.low, last.high, last.value = min(last.low, value), max(last.high, value), value
        return
    spans.append(Span(now_ns, value, value, value))


def extremes(spans: list[Span]) -> tuple[float, float]:
    """Lowest and highest value of the window that :func:`note` kept (it holds one entry at
    least)."""
    return min(span.low for span in spans), max(span.high for span in spans)
