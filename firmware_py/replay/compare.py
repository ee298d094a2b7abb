"""Whether a replayed record is the recorded one: to the bit, or as closely as other vector
extensions allow."""

from __future__ import annotations

import re
from typing import Any, Final

import msgspec

from firmware_py.recording import TOPICS, RecordingError, Stored, serialise
from firmware_py.records import Advice, Diagnosis, Forecast, Record, WindowRecord

PROBABILITY_TOLERANCE: Final = 0.02
"""Between machines of different vector extensions: the same verdict, and probabilities this
close."""
NUMBER_TOLERANCE: Final = 0.02
"""The same for a forecast's and an advice's numbers, as a share of the largest of one quantity."""

CLOSE: Final[tuple[type[Record], ...]] = (Diagnosis, WindowRecord, Forecast, Advice)
"""Kinds that are compared where it is not to the bit."""

_NUMBER: Final = re.compile(r"\d+(\.\d+)?")


def plain(record: Record) -> dict[str, Any]:
    """``record`` as the fields that a recording holds: numbers as they are written, nan as null."""
    return fields(Stored(TOPICS[type(record)].name, 0, serialise(record)))


def fields(message: Stored) -> dict[str, Any]:
    """The fields of a stored JSON record.

    Raises
    ------
    RecordingError
        It is none.
    """
    try:
        return msgspec.json.decode(message.data, type=dict[str, Any])
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise RecordingError(
            f"a record on {message.topic} is no JSON of this version ({error})"
        ) from error


def close(topic: str, recorded: dict[str, Any], replayed: dict[str, Any]) -> bool:
    """Whether two records agree within the tolerances above."""
    if topic == TOPICS[Diagnosis].name:
        return same_diagnosis(recorded, replayed)
    if topic == TOPICS[WindowRecord].name:
        return recorded | {"cpu_features": ""} == replayed | {"cpu_features": ""}
    return _near(recorded, replayed)


def same_diagnosis(recorded: dict[str, Any], replayed: dict[str, Any]) -> bool:
    """The same verdict, and probabilities within :data:`PROBABILITY_TOLERANCE`."""
    apart = abs(recorded["probability"] - replayed["probability"])
    return bool(recorded["verdict"] == replayed["verdict"] and apart <= PROBABILITY_TOLERANCE)


def _near(a: Any, b: Any) -> bool:
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(_near(a[key], b[key]) for key in a)
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and _lists_near(a, b)
    if isinstance(a, str) and isinstance(b, str):
        return _NUMBER.sub("#", a) == _NUMBER.sub("#", b)
    if isinstance(a, float) and isinstance(b, float):
        return _lists_near([a], [b])
    return bool(a == b)


def _lists_near(a: list[Any], b: list[Any]) -> bool:
    if not all(isinstance(value, float) for value in [*a, *b]):
        return all(_near(x, y) for x, y in zip(a, b, strict=True))
    most = max(map(abs, [*a, *b]), default=0.0)
    return all(abs(x - y) <= NUMBER_TOLERANCE * most for x, y in zip(a, b, strict=True))


def where(a: Any, b: Any, path: str = "") -> str:
    """The first place at which two decoded states differ."""
    if isinstance(a, dict) and isinstance(b, dict):
        for key in [*a, *(key for key in b if key not in a)]:
            if a.get(key) != b.get(key):
                return where(a.get(key), b.get(key), f"{path}.{key}".lstrip("."))
    return f"{path}: recorded {a!r:.80}, replayed {b!r:.80}"
