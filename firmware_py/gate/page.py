"""The live page and the Prometheus text, over HTTP on the loopback, read-only.

The gate's loop renders what was asked for of late and serves it (:meth:`Page.step`).
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import msgspec

from firmware_py.errors import OrbitdError
from firmware_py.gate.core import Gate
from firmware_py.gate.features import OrbitPath, SignalFeatures
from firmware_py.gate.http import HttpServer
from firmware_py.gate.instances import ShownSignal
from firmware_py.gate.metrics import render
from firmware_py.gate.view import DeviceState
from firmware_py.records import Event

PERIOD_NS: Final = 200_000_000
EVENTS_SHOWN: Final = 20
HTML: Final = Path(__file__).with_name("page.html")


class PageError(OrbitdError):
    """The page cannot be served; the text says why and what to do."""


class Live(msgspec.Struct, frozen=True):
    """What the page polls (``/live.json``)."""

    state: DeviceState
    features: SignalFeatures | None
    orbit: OrbitPath
    events: list[Event]
    channels: list[ShownSignal]
    readings: list[ShownSignal]


class Page:
    """Serves ``/`` (page), ``/live.json`` and ``/metrics`` on ``127.0.0.1``.

    Parameters
    ----------
    port
        TCP port; 0 takes a free one (see :attr:`port`).

    Raises
    ------
    PageError
        The port is taken.
    """

    def __init__(self, port: int) -> None:
        self._content: dict[str, tuple[str, bytes]] = {
            "/": ("text/html; charset=utf-8", HTML.read_bytes())
        }
        try:
            self._server = HttpServer(port, self._content)
        except OSError as error:
            raise PageError(
                f"metrics.port = {port}: {error.strerror}; choose another port, or 0 for none"
            ) from error
        self.port = self._server.port
        self.counters = self._server.counters
        self._next_ns = 0

    def step(self, gate: Gate, now_ns: int) -> None:
        """Serve who asks, and render five times a second."""
        self._server.step(now_ns)
        if now_ns < self._next_ns:
            return
        self._next_ns = now_ns + PERIOD_NS
        state, view = gate.state(now_ns), gate.view
        readings = view.instances.readings(view.reading)
        live = Live(
            state,
            view.features,
            view.decimator.orbit(),
            view.events()[-EVENTS_SHOWN:],
            view.instances.channels(view.features),
            readings,
        )
        self._content["/live.json"] = ("application/json", msgspec.json.encode(live))
        self._content["/metrics"] = (
            "text/plain; version=0.0.4; charset=utf-8",
            render(state, view.features, readings),
        )

    def close(self) -> None:
        """Stop serving."""
        self._server.close()
