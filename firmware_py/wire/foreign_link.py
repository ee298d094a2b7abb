"""A link to a foreign bus: its frames are translated into those of a node that only measures.

The guard sees, and the recorder keeps, sample frames, readings and NODE_INFO of wire schema 2 as a
node of the rig's own would send them; a replay needs no DBC.  Nothing is ever sent: a heartbeat or
a command has no place on a bus that was made for others.

Samples are numbered as they come, one period apart; where a message counter is mapped, what it
leaves out is left out of the numbering too, so that a loss is a gap.  A sample is whole when all
messages that make it have come since the one before.
"""

from __future__ import annotations

from struct import pack
from typing import Final

from firmware_py.config import Config
from firmware_py.config.foreign import COUNTER, MARK, MARK_AGE, TURNS, ForeignMap, MappedMessage
from firmware_py.records import NodeInfo, RawFrame, ReadingQuality, ReadingsFrame, SampleFrame
from firmware_py.wire.codec import CanCodec
from firmware_py.wire.counts import INT32_MIN
from firmware_py.wire.layout import WireLayout
from firmware_py.wire.layout_fields import SampleFlag
from firmware_py.wire.link import Link

READINGS_US: Final = 50_000
INFO_US: Final = 1_000_000
FIRST_US: Final = 5_000_000
"""Until then a reading that has not come yet is waited for."""
AGE_MOST_MS: Final = 2550
_TICK: Final = 0xFFFFFFFF
_COUNTS: Final = (-32768, 32767)


class ForeignTranslator:
    """Foreign frames to frames of wire schema 2.

    Parameters
    ----------
    config
        Channels, readings and sampling of the rig.
    foreign
        Which signal is which.
    """

    def __init__(self, config: Config, foreign: ForeignMap) -> None:
        self._layout = WireLayout.of(config)
        self._codec, self._messages = CanCodec(self._layout), foreign.messages
        self._columns = {channel.name: i for i, channel in enumerate(self._layout.channels)}
        rows = [m.instant for each in foreign.messages.values() for m in each.fast]
        self._batch = max(rows, default=0) + 1
        self._needed = sum(len(each.fast) > 0 for each in foreign.messages.values())
        self._rows = [[0] * len(self._columns) for _ in range(self._batch)]
        self._seen: set[int] = set()
        self._waiting: list[list[int]] = []
        self._sample = 0
        self._first = 0
        self._lost_before = False
        self._counts: dict[int, int] = {}
        self._sent: dict[type, int] = {}
        self._values: dict[str, tuple[float, int]] = {}
        self._mark_us, self._turns, self._told = 0, 0, -1
        self._high = False
        self._readings_due_us = self._info_due_us = 0
        self.counters = {"foreign_unknown": 0, "foreign_refused": 0, "foreign_incomplete": 0}

    def step(self, frame: RawFrame) -> list[RawFrame]:
        """The frames that ``frame`` completes."""
        found = self._messages.get(frame.frame_id)
        if found is None:
            self.counters["foreign_unknown"] += 1
            return []
        values = found.decode(frame.data)
        if values is None:
            self.counters["foreign_refused"] += 1
            return []
        self._count(frame.frame_id, found, values)
        for m in found.slow:
            if m.signal in values:
                self._values[m.to] = (values[m.signal] * m.factor, self._now_us + m.every_us)
        self._take_mark(found, values)
        return self._take_samples(frame, found, values) if found.fast else []

    @property
    def _now_us(self) -> int:
        return self._sample * self._layout.period_us

    def _count(self, frame_id: int, found: MappedMessage, values: dict[str, float]) -> None:
        """What a message counter says was lost moves the numbering of the samples on."""
        for m in found.marks:
            if m.to != COUNTER or m.signal not in values:
                continue
            bits = found.message.get_signal_by_name(m.signal).length
            now = int(values[m.signal])
            lost = (now - self._counts.get(frame_id, now - 1) - 1) % (1 << bits)
            self._counts[frame_id] = now
            if 0 < lost < 1 << (bits - 1) and found.fast:
                self._waiting, self._seen = [], set()
                self._sample += lost * self._batch
                self._first = self._sample

    def _take_mark(self, found: MappedMessage, values: dict[str, float]) -> None:
        """The newest mark, on the clock of the samples."""
        by_name = {m.to: m for m in found.marks if m.signal in values}
        age_us = 0
        if MARK_AGE in by_name:
            m = by_name[MARK_AGE]
            age_us = round(values[m.signal] * m.factor * 1e6)
        if MARK in by_name:
            high = values[by_name[MARK].signal] != 0
            if high and not self._high:
                self._mark_us, self._turns = self._now_us - age_us, self._turns + 1
            self._high = high
        if TURNS in by_name:
            bits = found.message.get_signal_by_name(by_name[TURNS].signal).length
            told = int(values[by_name[TURNS].signal])
            passed = (told - self._told) % (1 << bits) if self._told >= 0 else 0
            if passed or (self._told < 0 and told):
                self._mark_us, self._turns = self._now_us - age_us, self._turns + max(passed, 1)
            self._told = told

    def _take_samples(
        self, frame: RawFrame, found: MappedMessage, values: dict[str, float]
    ) -> list[RawFrame]:
        if frame.frame_id in self._seen:
            self._seen = set()
            self.counters["foreign_incomplete"] += 1
        self._seen.add(frame.frame_id)
        for m in found.fast:
            column = self._columns[m.to]
            if m.signal in values:
                counts = round(
                    values[m.signal] * m.factor / self._layout.channels[column].wire_scale
                )
                self._rows[m.instant][column] = min(max(counts, _COUNTS[0]), _COUNTS[1])
        if len(self._seen) < self._needed:
            return []
        self._seen = set()
        self._waiting += [list(row) for row in self._rows]
        self._sample += self._batch
        return self._sends(frame.arrival_ns)

    def _sends(self, arrival_ns: int) -> list[RawFrame]:
        out, n, period_us = list[RawFrame](), self._layout.instants, self._layout.period_us
        while len(self._waiting) >= n:
            rows, self._waiting = self._waiting[:n], self._waiting[n:]
            counts = [value for row in rows for value in row]
            last_us = (self._first + n - 1) * period_us
            mark_us = min(self._mark_us, last_us)
            message = SampleFrame(
                self._next(SampleFrame), self._first * period_us & _TICK, mark_us & _TICK,
                self._turns & 0xFFFF, int(SampleFlag.MARK_VALID) if self._turns else 0,
                pack(f"<{len(counts)}h", *counts),
            )  # fmt: skip
            self._first += n
            out.append(self._codec.encode(message, arrival_ns))
        if self._now_us >= self._info_due_us:
            self._info_due_us = self._now_us + INFO_US
            info = NodeInfo(
                self._next(NodeInfo), self._now_us & _TICK, 2, period_us, 0.0, 0.0, 100, 0.0,
                self._layout.hash,
            )  # fmt: skip
            out.append(self._codec.encode(info, arrival_ns))
        heard = len(self._values) == len(self._layout.readings) or self._now_us > FIRST_US
        if self._layout.pages and heard and self._now_us >= self._readings_due_us:
            self._readings_due_us = self._now_us + READINGS_US
            out += [
                self._codec.encode(self._page(k), arrival_ns) for k in range(self._layout.pages)
            ]
        return out

    def _page(self, number: int) -> ReadingsFrame:
        values, ages, qualities = list[float](), list[int](), list[int]()
        for row in self._layout.page(number):
            value, since_us = self._values.get(row.name, (0.0, -1))
            fits = abs(value) < -INT32_MIN * row.kind.resolution
            values.append(value if fits else 0.0)
            age_ms = max(0, self._now_us - since_us) // 1000 if since_us >= 0 else AGE_MOST_MS
            ages.append(min(age_ms, AGE_MOST_MS))
            absent = since_us < 0 or not fits
            qualities.append(int(ReadingQuality.ABSENT if absent else ReadingQuality.OK))
        return ReadingsFrame(
            self._next(ReadingsFrame), self._now_us & _TICK, number, tuple(values), tuple(ages),
            tuple(qualities),
        )  # fmt: skip

    def _next(self, kind: type) -> int:
        self._sent[kind] = number = (self._sent.get(kind, -1) + 1) & 0xFFFF
        return number


class ForeignLink:
    """The ``Link`` of :mod:`firmware_py.wire.link` on a foreign bus: it listens, and never speaks.

    Parameters
    ----------
    link
        The bus.
    translator
        To frames of the rig's own.
    """

    def __init__(self, link: Link, translator: ForeignTranslator) -> None:
        self._link, self._translator = link, translator

    @property
    def counters(self) -> dict[str, int]:
        """Those of the bus, and frames that were not mapped, not decoded, or made no sample."""
        return self._link.counters | self._translator.counters

    @property
    def up(self) -> bool:
        """False while the bus is away."""
        return self._link.up

    @property
    def fault(self) -> str:
        """What is wrong with the bus; empty while it is well."""
        return self._link.fault

    def fileno(self) -> int:
        """Descriptor that polls readable with a frame, -1 while the bus is away."""
        return self._link.fileno()

    def receive(self, now_ns: int) -> list[RawFrame]:
        """The translation of everything that waits."""
        return [
            made for frame in self._link.receive(now_ns) for made in self._translator.step(frame)
        ]

    def send(self, frame: RawFrame) -> bool:
        """False: nothing is sent here."""
        return False

    def close(self) -> None:
        """Leave the bus."""
        self._link.close()
