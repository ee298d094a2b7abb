"""End-to-end protection of the CAN messages: CRC-16/CCITT over a data id that is never transmitted.

The data id differs per message, so a payload that arrives under another identifier fails its CRC.
Polynomial 0x1021, start 0xFFFF, not reflected, no final xor (``binascii.crc_hqx``); coverage is the
data id (two bytes, little endian), then payload bytes 2 to the last.  Bytes 0 and 1 hold the CRC.
"""

from __future__ import annotations

from binascii import crc_hqx

CRC_START = 0xFFFF
CRC_BYTES = 2


def seed(data_id: int) -> int:
    """CRC register after the data id: the start value for a payload of that message."""
    return crc_hqx(data_id.to_bytes(2, "little"), CRC_START)


def protect(body: bytes, data_id_seed: int) -> bytes:
    """``body`` (counter and signals, without its CRC) with the CRC in front."""
    return crc_hqx(body, data_id_seed).to_bytes(CRC_BYTES, "little") + body


def is_intact(data: bytes, data_id_seed: int) -> bool:
    """True when the CRC in ``data[0:2]`` fits the rest; ``data`` holds at least two bytes."""
    return crc_hqx(data[CRC_BYTES:], data_id_seed) == data[0] | data[1] << 8
