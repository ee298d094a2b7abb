"""Bytes from a seed: valid examples, damaged in the ways that wires, disks and people damage
them."""

from __future__ import annotations

import random
from collections.abc import Sequence

SPECIAL = (
    b"\xff",
    b"\x00",
    b"\xfd",
    b"\xc1",
    b"\xdd\xff\xff\xff\xff",
    b"\xef\xbb\xbf",
    b'"',
    b"{",
    b"[" * 2000,
    b"nan",
    b"1e999",
    b"-1",
    b"9" * 400,
    b"\\ud800",
    b"*",
    b";",
    b"\r\n\r\n",
    b"%00",
    "\u0000\u202e\U0001f600".encode(),
)


def mutated(corpus: Sequence[bytes], seed: int) -> bytes:
    """The payload of ``seed``: the same for ever."""
    noise = random.Random(seed)
    if not corpus or noise.random() < 0.05:
        return noise.randbytes(noise.choice((0, 1, 2, 7, 8, 64, 300, 5000)))
    data = bytearray(noise.choice(corpus))
    for _ in range(noise.choice((0, 1, 1, 2, 5))):
        place = noise.randrange(len(data) + 1)
        match noise.randrange(7):
            case 0 if data:
                data[place % len(data)] = noise.randrange(256)
            case 1 if data:
                data[place % len(data)] ^= 1 << noise.randrange(8)
            case 2:
                del data[place:]
            case 3:
                del data[place : place + noise.randrange(1, 9)]
            case 4:
                data[place:place] = noise.choice(SPECIAL)
            case 5:
                data[place:place] = noise.randbytes(noise.randrange(1, 9))
            case _:
                other = noise.choice(corpus)
                data[place:] = other[noise.randrange(len(other) + 1) :]
    return bytes(data)
