"""Fields of sample frames and of pages of readings, whose size and order the rig's layout tells."""

from __future__ import annotations

import enum
from operator import mul
from struct import Struct
from typing import Final, cast

from firmware_py.records import ReadingQuality, ReadingsFrame, SampleFrame
from firmware_py.wire.counts import AGE_MS, INT32_MIN, LAYOUT, RANGE, Fields, counts
from firmware_py.wire.layout import PAGES_MAX, WireLayout


class SampleFlag(enum.IntFlag):
    """Bits of ``SampleFrame.flags``."""

    BEHIND = 1
    MARK_VALID = 2
    COASTING = 4


SAMPLE_FLAGS: Final = 0x7


def read_samples(f: Fields) -> SampleFrame:
    """Record of a sample frame of schema 1."""
    counter, tick, mark, turns, flags, samples = cast(tuple[int, int, int, int, int, bytes], f)
    return SampleFrame(counter, tick, mark, turns, flags & SAMPLE_FLAGS, samples)


def write_samples(m: SampleFrame) -> Fields:
    """Fields of a sample frame of schema 1; ValueError when it does not fit."""
    if len(m.samples) != 48:
        raise ValueError(f"samples hold {len(m.samples)} bytes, not 3 x 8 x 2 = 48")
    if m.flags & ~SAMPLE_FLAGS:
        raise ValueError(f"flags {m.flags:#x} hold bits beyond {SAMPLE_FLAGS:#x}")
    return m.counter, m.tick_us, m.mark_tick_us, m.turn_count, m.flags, m.samples


class SampleFields:
    """Sample frames of one layout."""

    def __init__(self, layout: WireLayout) -> None:
        self._size, self._tag = layout.samples_bytes, layout.tag

    def read(self, f: Fields) -> SampleFrame | str:
        """Record of one frame; a reason where it has another layout."""
        counter, tick, mark, turns, flags, tag, samples = cast(
            tuple[int, int, int, int, int, int, bytes], f
        )
        if tag != self._tag:
            return LAYOUT
        return SampleFrame(counter, tick, mark, turns, flags & SAMPLE_FLAGS, samples[: self._size])

    def write(self, m: SampleFrame) -> Fields:
        """Fields of one frame; ValueError when it does not fit the layout."""
        if len(m.samples) != self._size:
            raise ValueError(f"samples hold {len(m.samples)} bytes, this layout has {self._size}")
        if m.flags & ~SAMPLE_FLAGS:
            raise ValueError(f"flags {m.flags:#x} hold bits beyond {SAMPLE_FLAGS:#x}")
        return m.counter, m.tick_us, m.mark_tick_us, m.turn_count, m.flags, self._tag, m.samples


class ReadingFields:
    """Pages of readings of one layout."""

    def __init__(self, layout: WireLayout) -> None:
        self._tag = layout.tag
        self._pages = [
            (Struct(f"<{len(page)}i"), tuple(row.kind.resolution for row in page))
            for page in map(layout.page, range(min(layout.pages, PAGES_MAX)))
        ]

    def read(self, f: Fields) -> ReadingsFrame | str:
        """Record of one page; a reason where there is none."""
        counter, tick, page, tag, packed, ages, qualities = cast(
            tuple[int, int, int, int, bytes, bytes, bytes], f
        )
        if tag != self._tag:
            return LAYOUT
        if page >= len(self._pages):
            return RANGE
        form, resolutions = self._pages[page]
        n = len(resolutions)
        if max(qualities[:n]) > max(ReadingQuality):
            return RANGE
        values = form.unpack_from(packed)
        return ReadingsFrame(
            counter,
            tick,
            page,
            tuple(map(mul, values, resolutions)),
            tuple(AGE_MS * age for age in ages[:n]),
            tuple(qualities[:n]),
        )

    def write(self, m: ReadingsFrame) -> Fields:
        """Fields of one page; ValueError when it does not fit the layout."""
        if not 0 <= m.page < len(self._pages):
            raise ValueError(f"page {m.page}: this layout has {len(self._pages)}")
        form, resolutions = self._pages[m.page]
        if not len(m.values) == len(m.ages_ms) == len(m.qualities) == len(resolutions):
            raise ValueError(f"page {m.page} has {len(resolutions)} readings")
        packed = form.pack(
            *(
                counts(value, resolution, INT32_MIN, 2**31 - 1)
                for value, resolution in zip(m.values, resolutions, strict=True)
            )
        )
        ages = bytes(min(age // AGE_MS, 255) for age in m.ages_ms)
        qualities = bytes(ReadingQuality(quality) for quality in m.qualities)
        return m.counter, m.tick_us, m.page, self._tag, packed, ages, qualities
