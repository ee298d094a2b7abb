"""What passes on the bus, message by message: counts, rates, losses, newest values, bus load."""

from __future__ import annotations

import json
import time
from collections import Counter
from dataclasses import dataclass, field
from struct import Struct
from typing import Any, Final

import msgspec
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table

from firmware_py.config import Bus, Config
from firmware_py.errors import OrbitdError
from firmware_py.records import (
    RawFrame,
    ReadingQuality,
    ReadingsFrame,
    Rejected,
    SampleFrame,
    WireMessage,
)
from firmware_py.wire.layout import WireLayout
from firmware_py.wire.link import Codec, Link, codec_for, open_link

POLL_S: Final = 0.005
REFRESH_S: Final = 0.25


class NoBusError(OrbitdError):
    """The bus or port cannot be opened."""


@dataclass
class MessageCount:
    """One message: how often it came, what its counter says is missing or came twice, its newest
    record."""

    frame_id: int
    last: WireMessage
    frames: int = 0
    lost: int = 0
    not_newer: int = 0

    def take(self, message: WireMessage) -> None:
        """Count ``message`` by the distance of its counter to the newest one."""
        step = (message.counter - self.last.counter) & 0xFFFF
        self.frames += 1
        if self.frames > 1 and (step == 0 or step >= 0x8000):
            self.not_newer += 1
            return
        self.lost += max(0, step - 1) if self.frames > 1 else 0
        self.last = message


@dataclass
class Monitor:
    """Tallies of everything that a bus carries; pure, so it can read a recording as well."""

    config: Config
    codec: Codec
    tallies: dict[int, MessageCount] = field(default_factory=dict)
    rejected: Counter[str] = field(default_factory=Counter)
    busy_s: float = 0.0

    def take(self, frames: list[RawFrame]) -> None:
        """Count ``frames``."""
        for frame in frames:
            self.busy_s += wire_seconds(self.config.bus, len(frame.data))
            message = self.codec.decode(frame)
            if isinstance(message, Rejected):
                self.rejected[message.reason] += 1
            else:
                self.tallies.setdefault(frame.frame_id, MessageCount(frame.frame_id, message)).take(
                    message
                )

    def report(self, seconds: float) -> dict[str, Any]:
        """Everything seen in ``seconds``, ready for JSON."""
        return {
            "seconds": round(seconds, 3),
            "bus_load": round(self.busy_s / seconds, 4),
            "messages": [
                {
                    "id": t.frame_id,
                    "name": type(t.last).__name__,
                    "frames": t.frames,
                    "per_s": round(t.frames / seconds, 1),
                    "lost": t.lost,
                    "not_newer": t.not_newer,
                    "last": values(t.last, self.config),
                }
                for _, t in sorted(self.tallies.items())
            ],
            "rejected": dict(self.rejected),
        }


def values(message: WireMessage, config: Config) -> dict[str, Any]:
    """The fields of ``message`` by name; of samples, the first instant of each channel in its SI
    unit."""
    fields = msgspec.structs.asdict(message)
    if isinstance(message, SampleFrame):
        counts = Struct(f"<{len(config.machine.channel)}h").unpack_from(fields.pop("samples"))
        for channel, count in zip(config.machine.channel, counts, strict=True):
            fields[channel.name] = float(f"{count * channel.scale + channel.offset:.6g}")
    if isinstance(message, ReadingsFrame):
        rows = WireLayout.of(config).page(message.page)
        names = ("values", "ages_ms", "qualities")
        told = zip(*(fields.pop(name) for name in names), strict=True)
        for row, (value, _age_ms, quality) in zip(rows, told, strict=False):
            fields[f"{row.name} ({row.kind.unit})"] = (
                float(f"{value:.6g}")
                if quality == ReadingQuality.OK
                else ReadingQuality(quality).name
            )
    return fields


def wire_seconds(bus: Bus, size: int) -> float:
    """Time that a frame of ``size`` data bytes holds the wire, without dynamic stuff bits.

    CAN FD after ISO 11898-1: 30 bits at the nominal rate; at the data rate 5 bits of flag and
    length, the data, the stuff count and the CRC of 17 or 21 bits, with a fixed stuff bit before
    every fourth of both. A serial byte takes ten bits.
    """
    if bus.link == "serial":
        return size * 10 / bus.serial_baud
    check_bits = 4 + 17 + 6 if size <= 16 else 4 + 21 + 7
    return 30 / bus.nominal_bitrate + (5 + 8 * size + check_bits) / bus.data_bitrate


def monitor(config: Config, seconds: float, as_json: bool) -> int:
    """Watch the configured bus for ``seconds`` and show it: a live table, or one JSON object at the
    end.

    Returns
    -------
    Exit code: 0, or 3 when nothing intact was heard.

    Raises
    ------
    NoBusError
        The bus or port cannot be opened.
    """
    seen = Monitor(config, codec_for(config))
    link = open_link(config, "device")
    started = time.monotonic()
    try:
        if not link.up:
            raise NoBusError(f"{link.fault}; check the [bus] table, or start the other side first")
        if as_json:
            _watch(seen, link, started, seconds, live=None)
            report = seen.report(time.monotonic() - started) | {"link": link.counters}
            print(json.dumps(report))
        else:
            with Live(console=Console(), auto_refresh=False) as live:
                _watch(seen, link, started, seconds, live)
                live.update(_table(seen.report(time.monotonic() - started)), refresh=True)
    finally:
        link.close()
    return 0 if seen.tallies else 3


def dump(config: Config, seconds: float, as_json: bool) -> int:
    """Print every frame of the configured bus for ``seconds``, one line each; exit codes as
    :func:`monitor`."""
    codec, link = codec_for(config), open_link(config, "device")
    started, heard = time.monotonic(), 0
    try:
        if not link.up:
            raise NoBusError(f"{link.fault}; check the [bus] table, or start the other side first")
        while (now := time.monotonic()) < started + seconds:
            for frame in link.receive(time.monotonic_ns()):
                heard += 1
                print(_line(frame, codec.decode(frame), now - started, config, as_json), flush=True)
            time.sleep(POLL_S)
    finally:
        link.close()
    return 0 if heard else 3


def _line(
    frame: RawFrame, message: WireMessage | Rejected, at_s: float, config: Config, as_json: bool
) -> str:
    fields = (
        {"reason": message.reason} if isinstance(message, Rejected) else values(message, config)
    )
    name = type(message).__name__
    if as_json:
        return json.dumps({"t_s": round(at_s, 6), "id": frame.frame_id, "name": name, **fields})
    return f"{at_s:10.3f}  {frame.frame_id:#05x}  {name:<16} {_shown(fields)}"


def _watch(seen: Monitor, link: Link, started: float, seconds: float, live: Live | None) -> None:
    refresh_due = started
    while (now := time.monotonic()) < started + seconds:
        seen.take(link.receive(time.monotonic_ns()))
        if live is not None and now >= refresh_due:
            live.update(_table(seen.report(max(now - started, POLL_S))), refresh=True)
            refresh_due = now + REFRESH_S
        time.sleep(POLL_S)


def _table(report: dict[str, Any]) -> Group:
    rejected = (
        ", ".join(f"{count} {reason}" for reason, count in report["rejected"].items()) or "none"
    )
    table = Table(
        title=f"{report['seconds']:.1f} s, bus load {100 * report['bus_load']:.1f} %, rejected: "
        f"{rejected}",
        box=None,
        title_justify="left",
    )
    for title in ("id", "message", "frames", "per s", "lost", "not newer"):
        table.add_column(title, justify="left" if title in ("id", "message") else "right")
    newest = []
    for m in report["messages"]:
        table.add_row(
            f"{m['id']:#05x}",
            m["name"],
            str(m["frames"]),
            f"{m['per_s']:.1f}",
            str(m["lost"]),
            str(m["not_newer"]),
        )
        newest.append(f"\n{m['name']}  " + _shown(m["last"]))
    return Group(table, *newest)


def _shown(fields: dict[str, Any]) -> str:
    return "  ".join(
        f"{name}={value:.5g}" if isinstance(value, float) else f"{name}={value}"
        for name, value in fields.items()
    )
