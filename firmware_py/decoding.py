"""The one place where bytes from outside become values: they decode, or are refused by name.

Any bytes at all give a value of the wanted type or an :class:`OutsideError`; nothing else is
raised, and the work is bounded by ``limit_bytes``.  Zenoh payloads, packets between processes and
the JSON files that a process reads all pass here.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final, TypeVar

import msgspec

from firmware_py.errors import OrbitdError

T = TypeVar("T")

UNDECODABLE: Final = (msgspec.DecodeError, ValueError, OverflowError, RecursionError)
"""All that msgspec raises on bytes that it does not take.

``UnicodeDecodeError`` (a ``ValueError``) and ``RecursionError`` are none of its own kind.
"""

FILE_LIMIT_BYTES: Final = 16 << 20
"""No JSON file of the device (manifest, normal state) comes near this."""

SAID_LETTERS: Final = 200
"""Of the decoder's own words in a refusal: they can repeat what somebody sent, whatever that is."""


class OutsideError(OrbitdError, ValueError):
    """Bytes from outside that are not what they should be; ``kind`` is the name under which they
    are counted."""

    exit_code = 2

    def __init__(self, kind: str, text: str) -> None:
        super().__init__(text)
        self.kind = kind


def from_json(data: bytes, kind: type[T], limit_bytes: int) -> T:
    """The ``kind`` that the JSON ``data`` holds.

    Raises
    ------
    OutsideError
        ``too_large``, ``not_utf8``, ``too_deep``, ``wrong_shape`` (JSON, but not of this type) or
        ``no_json``.
    """
    if len(data) > limit_bytes:
        raise OutsideError("too_large", f"{len(data)} bytes; at most {limit_bytes} are taken")
    try:
        return msgspec.json.decode(data, type=kind)
    except UNDECODABLE as error:
        raise _named(error, "no_json", "JSON") from error


def read_file(path: Path, limit_bytes: int = FILE_LIMIT_BYTES) -> bytes:
    """The bytes of ``path``, one more than ``limit_bytes`` at most (:func:`from_json` then
    refuses).

    Raises
    ------
    OSError
        It cannot be read, or is no regular file: a pipe or a device would be waited for.
    """
    if path.exists() and not path.is_file():
        raise IsADirectoryError(21, "not a regular file", str(path))
    with path.open("rb") as file:
        return file.read(limit_bytes + 1)


def _named(error: BaseException, otherwise: str, language: str) -> OutsideError:
    if isinstance(error, RecursionError):
        return OutsideError("too_deep", "nested too deeply")
    if isinstance(error, UnicodeDecodeError):
        return OutsideError("not_utf8", f"not UTF-8 text (byte {error.start})")
    said = "".join(letter if letter.isprintable() else "?" for letter in str(error)[:SAID_LETTERS])
    if isinstance(error, msgspec.ValidationError):
        return OutsideError("wrong_shape", said)
    return OutsideError(otherwise, f"no {language} ({said})")
