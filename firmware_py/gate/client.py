"""The other end of the gate, for the command line and other local programs: ask, and read the
state."""

from __future__ import annotations

import uuid
from pathlib import Path
from types import TracebackType
from typing import Final, Self, TypeVar

import msgspec
import zenoh

from firmware_py.decoding import UNDECODABLE
from firmware_py.errors import OrbitdError
from firmware_py.gate import keys, session
from firmware_py.gate.view import DeviceState
from firmware_py.records import CommandReply, PlannedRamp

TIMEOUT_S: Final = 2.0
"""Longer than the gate's own patience with the guard, so that the gate's answer arrives."""


T = TypeVar("T")


class NoAnswerError(OrbitdError):
    """The gate stays silent."""

    exit_code = 3


class Client:
    """A connection to the gate of one device.

    Parameters
    ----------
    runtime
        Runtime directory of the instance.
    prefix
        :func:`firmware_py.gate.keys.prefix` of the device.

    Raises
    ------
    SessionError
        No gate serves ``runtime``.
    """

    def __init__(self, runtime: Path, prefix: str) -> None:
        self._prefix = prefix
        self._session = session.open_client(runtime)

    def ask(
        self, verb: str, value: float | str | PlannedRamp | dict[str, object] | None = None
    ) -> CommandReply:
        """Ask for ``verb``; the answer is the guard's, or the gate's when the guard is silent.

        Raises
        ------
        NoAnswerError
            The gate itself did not answer: whether the command was carried out is not known.
        """
        request = {"id": uuid.uuid4().hex} | ({} if value is None else {"value": value})
        payload = msgspec.json.encode(request)
        return self.query(keys.command(verb), CommandReply, payload)

    def status(self) -> DeviceState:
        """The whole device at this instant."""
        return self.query(keys.STATE, DeviceState)

    def query(self, name: str, answer_type: type[T], payload: bytes = b"") -> T:
        """The gate's answer on ``name`` (parameters after ``?``), decoded as ``answer_type``."""
        selector = f"{self._prefix}/{name}{';' if '?' in name else '?'}as=msgpack"
        for reply in self._session.get(selector, payload=payload, timeout=TIMEOUT_S):
            if reply.ok is None:
                continue
            try:
                return msgspec.msgpack.decode(reply.ok.payload.to_bytes(), type=answer_type)
            except UNDECODABLE as error:
                raise NoAnswerError(
                    f"the answer on {self._prefix}/{name} cannot be understood ({error}); use the "
                    "orbitd that the gate runs"
                ) from error
        raise NoAnswerError(
            f"no answer on {self._prefix}/{name}, waited for at most {TIMEOUT_S:g} s; check that "
            "the gate runs for this site and rig: name the rig that it was started with (--rig)"
        )

    def subscribe(
        self, name: str, capacity: int = 256
    ) -> zenoh.Subscriber[zenoh.Handler[zenoh.Sample]]:
        """A subscriber on ``name`` that keeps the newest ``capacity`` samples."""
        return self._session.declare_subscriber(
            f"{self._prefix}/{name}", zenoh.handlers.RingChannel(capacity)
        )

    def close(self) -> None:
        """End the connection."""
        self._session.close()  # type: ignore[no-untyped-call]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
