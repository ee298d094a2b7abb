"""The brain's state as bytes and back, every bit of it: arrays and complex numbers included.

Each stage of the brain keeps what changes in one ``msgspec`` structure, which holds the structures
of the stages below it.  :func:`encode` writes such a tree as msgpack, :func:`decode` reads it.  An
array keeps its type, shape and memory order; one whose values all fit in ``float32`` takes half of
the space.
"""

from __future__ import annotations

from typing import Any, Literal, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

T = TypeVar("T", bound=msgspec.Struct)


class _Array(msgspec.Struct, frozen=True, array_like=True):
    """An array as it is stored: ``dtype`` is its own, ``stored`` that of ``data``."""

    dtype: str
    stored: str
    shape: list[int]
    order: str
    data: bytes


def encode(tree: msgspec.Struct) -> bytes:
    """The bytes of ``tree``."""
    return msgspec.msgpack.encode(tree, enc_hook=_plain)


def decode(data: bytes, kind: type[T]) -> T:
    """The tree in ``data``.

    Raises
    ------
    msgspec.DecodeError
        Another version wrote it.
    """
    return msgspec.msgpack.decode(data, type=kind, dec_hook=_typed)


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return _stored(value)
    if isinstance(value, complex):
        return (value.real, value.imag)
    raise TypeError(f"{type(value).__name__} cannot be part of a stage's state")


def _stored(array: NDArray[Any]) -> _Array:
    order: Literal["C", "F"] = (
        "F" if array.flags.f_contiguous and not array.flags.c_contiguous else "C"
    )
    data, stored = array.tobytes(order), array.dtype
    if array.dtype == np.float64:
        with np.errstate(over="ignore", invalid="ignore"):
            half = array.astype(np.float32)
        if half.astype(np.float64).tobytes(order) == data:
            data, stored = half.tobytes(order), half.dtype
    return _Array(array.dtype.str, stored.str, list(array.shape), order, data)


def _typed(kind: type, value: Any) -> Any:
    if kind is complex:
        real, imag = msgspec.convert(value, tuple[float, float])
        return complex(real, imag)
    try:
        found = msgspec.convert(value, _Array)
        flat = np.frombuffer(found.data, found.stored).astype(found.dtype)
        return flat.reshape(found.shape, order="F" if found.order == "F" else "C")
    except (TypeError, ValueError) as error:
        raise msgspec.ValidationError(f"no array in a stored state: {error}") from error
