"""Reading and writing protected messages with nothing but the DBC, python-can, cantools and
binascii."""

from __future__ import annotations

import binascii
from collections import Counter
from pathlib import Path
from typing import Any

import can
import cantools

DBC = Path(__file__).resolve().parents[2] / "firmware_py" / "wire" / "orbitd.dbc"


class Wire:
    """The messages of one DBC on one bus, with counter and CRC as its attributes describe them.

    ``counts`` tells frames taken, lost (gaps in the counters), of unknown identifier, not sent, and
    per message (``bad COMMAND``) those of wrong length or CRC.
    """

    def __init__(self, bus: can.BusABC, dbc: Path = DBC) -> None:
        self.bus = bus
        self.database: Any = cantools.database.load_file(dbc)
        self.counts: Counter[str] = Counter()
        self._by_id = {message.frame_id: message for message in self.database.messages}
        self._start = self.database.dbc.attributes["CrcStart"].value
        self._sent: Counter[str] = Counter()
        self._seen: dict[str, int] = {}

    def crc(self, message: Any, data: bytes) -> int:
        data_id = message.dbc.attributes["DataId"].value.to_bytes(2, "little")
        return binascii.crc_hqx(data_id + data[2:], self._start)

    def send(self, name: str, **values: float) -> None:
        message = self.database.get_message_by_name(name)
        counter = self._sent[name] & 0xFFFF
        data = message.encode({"crc": 0, "counter": counter, **values}, strict=False)
        data = self.crc(message, data).to_bytes(2, "little") + data[2:]
        self._sent[name] += 1
        try:
            self.bus.send(
                can.Message(
                    arbitration_id=message.frame_id,
                    is_extended_id=False,
                    is_fd=True,
                    bitrate_switch=True,
                    data=data,
                ),
                timeout=0,
            )
        except can.CanOperationError:
            self.counts["not_sent"] += 1

    def receive(self, wait_s: float) -> list[tuple[str, dict[str, float]]]:
        """All intact messages that wait; at least ``wait_s`` passes when there is none."""
        messages = []
        frame = self.bus.recv(wait_s)
        while frame is not None:
            intact = self._read(frame)
            if intact:
                messages.append(intact)
            frame = self.bus.recv(0)
        return messages

    def _read(self, frame: can.Message) -> tuple[str, dict[str, float]] | None:
        message = None if frame.is_extended_id else self._by_id.get(frame.arbitration_id)
        if message is None:
            self.counts["unknown"] += 1
            return None
        data = bytes(frame.data)
        if len(data) != message.length or int.from_bytes(data[:2], "little") != self.crc(
            message, data
        ):
            self.counts[f"bad {message.name}"] += 1
            return None
        values = message.decode(data, decode_choices=False)
        self._follow(message.name, values["counter"])
        return message.name, values

    def _follow(self, name: str, counter: int) -> None:
        self.counts["lost"] += (counter - self._seen.get(name, counter - 1) - 1) & 0xFFFF
        self._seen[name] = counter
        self.counts["frames"] += 1
