"""What a link and a codec are, and which ones a configuration asks for."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, Protocol

from firmware_py.config import Config
from firmware_py.records import RawFrame, Rejected, WireMessage
from firmware_py.wire.can_link import CanLink, bus_opener
from firmware_py.wire.codec import CanCodec
from firmware_py.wire.layout import WireLayout


class Codec(Protocol):
    """Wire bytes <-> records; stateless and total (any bytes give a record or
    :class:`Rejected`)."""

    @property
    def layout(self) -> WireLayout:
        """Of the rig's frames."""

    def decode(self, frame: RawFrame) -> WireMessage | Rejected:
        """The record in ``frame``."""

    def encode(self, message: WireMessage, now_ns: int = 0) -> RawFrame:
        """The frame that carries ``message``; ValueError when a value does not fit."""


class Link(Protocol):
    """A bus or port that may come and go; nothing of that raises out of :meth:`receive` or
    :meth:`send`."""

    @property
    def counters(self) -> dict[str, int]:
        """What came in, went out, and was lost or refused, by name."""

    @property
    def up(self) -> bool:
        """False while the adapter, hub or port is away."""

    @property
    def fault(self) -> str:
        """What is wrong with the link and what to do, up or not; empty while it is well."""

    def receive(self, now_ns: int) -> list[RawFrame]:
        """Everything waiting, at most 32 frames; never blocks."""

    def send(self, frame: RawFrame) -> bool:
        """True when the frame was taken; never blocks."""

    def fileno(self) -> int:
        """Descriptor that polls readable with a frame, -1 while the link is away."""

    def close(self) -> None:
        """Give the bus or port back."""


def codec_for(config: Config) -> Codec:
    """The codec of the configured link."""
    if config.bus.link == "serial":
        from firmware_py.wire.mav_codec import MavCodec  # only serial devices pay for it

        return MavCodec(WireLayout.of(config))
    return CanCodec(WireLayout.of(config))


def open_device_link(config: Config, folder: Path) -> Link:
    """The device's link; ``folder`` holds the DBC of a foreign bus."""
    link = open_link(config, "device")
    if config.machine.foreign is None:
        return link
    from firmware_py.config.foreign import mapped  # only who listens to a foreign bus pays for it
    from firmware_py.wire.foreign_link import ForeignLink, ForeignTranslator

    return ForeignLink(link, ForeignTranslator(config, mapped(config, folder)))


def open_link(config: Config, role: Literal["device", "rig"]) -> Link:
    """The configured link; when the bus or port is absent it says so in ``fault`` and keeps trying.

    On CAN both roles attach to the same channel.  A serial line has two ends: the rig's port is
    named by its own configuration.
    """
    if config.bus.link == "serial":
        from firmware_py.wire.serial_link import SerialLink

        return SerialLink(config.bus.serial_port, config.bus.serial_baud)
    return CanLink(bus_opener(config.bus.interface, config.bus.channel))
