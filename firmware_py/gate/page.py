"""The live page and the Prometheus text, over HTTP on the loopback, read-only.

The gate's loop renders (:meth:`Page.step`); the server's threads only hand out what was rendered last.
"""

from __future__ import annotations

import threading
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, Final

import msgspec

from firmware_py.errors import OrbitdError
from firmware_py.gate.core import Gate
from firmware_py.gate.features import Features, Orbit
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
    features: Features | None
    orbit: Orbit
    events: list[Event]


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
        self._content: dict[str, tuple[str, bytes]] = {"/": ("text/html; charset=utf-8", HTML.read_bytes())}
        try:
            self._server = ThreadingHTTPServer(("127.0.0.1", port), _handler(self._content))
        except OSError as error:
            raise PageError(f"metrics.port = {port}: {error.strerror}; choose another port, or 0 for none") from error
        self._server.daemon_threads = True
        self.port: int = self._server.server_address[1]
        self._thread = threading.Thread(target=self._server.serve_forever, name="page", daemon=True)
        self._thread.start()
        self._next_ns = 0

    def step(self, gate: Gate, now_ns: int) -> None:
        """Render five times a second."""
        if now_ns < self._next_ns:
            return
        self._next_ns = now_ns + PERIOD_NS
        state, view = gate.state(now_ns), gate.view
        live = Live(state, view.features, view.decimator.orbit(), view.events()[-EVENTS_SHOWN:])
        self._content["/live.json"] = ("application/json", msgspec.json.encode(live))
        self._content["/metrics"] = ("text/plain; version=0.0.4; charset=utf-8", render(state, view.features))

    def close(self) -> None:
        """Stop serving."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


def _handler(content: dict[str, tuple[str, bytes]]) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        """GET of what was rendered; everything else is refused."""

        timeout = 5.0

        def do_GET(self) -> None:
            found = content.get(self.path.partition("?")[0])
            if found is None:
                self.send_error(HTTPStatus.NOT_FOUND)
                return
            kind, body = found
            self.send_response(HTTPStatus.OK)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            self.send_header("Cache-Control", "no-store")
            self.send_header("Content-Security-Policy", "default-src 'self' 'unsafe-inline'")
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, format: str, *args: Any) -> None:
            """Requests are nobody's business."""

    return Handler
