"""The Zenoh session: a Unix socket in the runtime directory always, anything else only as
configured.

No scouting, no gossip: the device opens no connection that the configuration does not name.  Over
configured network endpoints everything is denied but reading; commands come over the Unix socket,
or over mTLS with a client certificate whose common name is :data:`OPERATOR`.
"""

from __future__ import annotations

import json
import socket
from pathlib import Path
from typing import Any, Final

import zenoh

from firmware_py.config import Zenoh
from firmware_py.errors import OrbitdError
from firmware_py.wire.folders import foreign_server

SOCKET: Final = "zenoh.sock"
SOCKET_MODE: Final = 0o660
OPERATOR: Final = "orbitd-operator"
"""Common name of the client certificates that may command over the network."""

UNIX: Final = "unixsock-stream"
NETWORK_LINKS: Final = ("tcp", "udp", "tls", "quic", "ws")
TX_BATCHES: Final = 16
"""Of 64 kB for each client: room for the longest answer, so that a slow network is no reason to
wait."""

TX_WAIT_US: Final = 100_000
"""Who does not read for so long while that room is full loses his connection; nobody waits longer
behind him."""

REOPENINGS_MAX: Final = 100
"""Each costs a session of some threads; a folder that is cleaned so often is the wrong folder."""

_READING_IN: Final = (
    "query",
    "declare_subscriber",
    "liveliness_query",
    "declare_liveliness_subscriber",
)
_READING_OUT: Final = ("put", "reply", "declare_queryable", "liveliness_token")
_READABLE: Final = (
    "da",
    "dm",
    "sd",
    "ha",
    "pa",
    "ag",
    "event",
    "state",
    "config",
    "models",
    "live",
)


class SessionError(OrbitdError):
    """The Zenoh session cannot be opened; the text says why and what to do."""

    exit_code = 3


def endpoint(runtime: Path) -> str:
    """The local endpoint of the device whose runtime directory is ``runtime``."""
    return f"{UNIX}/{runtime / SOCKET}"


def open_device(settings: Zenoh, runtime: Path, prefix: str) -> zenoh.Session:
    """The device's session, listening on :func:`endpoint` and on what ``settings`` adds.

    Raises
    ------
    SessionError
        An endpoint cannot be bound, or a certificate cannot be used.
    """
    values: dict[str, Any] = {
        "mode": "peer",
        "listen/endpoints": [endpoint(runtime), *settings.listen],
        "connect/endpoints": settings.connect,
        "connect/timeout_ms": 0,
        "connect/exit_on_failure": False,
        "transport/link/tx/queue/size/data": TX_BATCHES,
        "transport/link/tx/queue/congestion_control/block/wait_before_close": TX_WAIT_US,
    }
    if settings.tls_certificate:
        values["transport/link/tls"] = {
            "root_ca_certificate": settings.tls_root_ca,
            "listen_certificate": settings.tls_certificate,
            "listen_private_key": settings.tls_private_key,
            "connect_certificate": settings.tls_certificate,
            "connect_private_key": settings.tls_private_key,
            "enable_mtls": True,
        }
    if settings.listen or settings.connect:
        values["access_control"] = access_rules(prefix)
    try:
        (runtime / SOCKET).unlink(missing_ok=True)
        opened = _open(values)
        (runtime / SOCKET).chmod(SOCKET_MODE)
    except (zenoh.ZError, OSError) as error:
        where = ", ".join([endpoint(runtime), *settings.listen])
        cause = str(error).partition(" at /")[0]  # what follows is a place in Zenoh's source
        raise SessionError(
            f"zenoh: cannot listen on {where}: {cause}; check [zenoh] in the configuration"
        ) from error
    return opened


class SocketWatch:
    """The local socket of an open device session: notices when it is gone, and opens another behind
    a new one.

    Parameters
    ----------
    runtime
        Folder of the socket.
    prefix
        As for :func:`open_device`.
    """

    def __init__(self, runtime: Path, prefix: str) -> None:
        self._runtime = runtime
        self._prefix = prefix
        self._left = REOPENINGS_MAX
        self._inode = self._now()

    def lost(self) -> bool:
        """Whether clients no longer find what :func:`open_device` bound."""
        return self._left > 0 and self._now() != self._inode

    def open_again(self) -> zenoh.Session:
        """A second session behind a new local socket; endpoints on the network stay with the first.

        Raises
        ------
        SessionError
            The socket cannot be bound.
        """
        # The lock of the removed socket is this process's own: the lock of gate.sock keeps other
        # gates away.
        (self._runtime / f"{SOCKET}.lock").unlink(missing_ok=True)
        opened = open_device(Zenoh(), self._runtime, self._prefix)
        self._left -= 1
        self._inode = self._now()
        return opened

    def _now(self) -> tuple[int, int] | None:
        try:
            found = (self._runtime / SOCKET).lstat()
        except OSError:
            return None
        return found.st_dev, found.st_ino


def open_client(runtime: Path) -> zenoh.Session:
    """A session that knows only the device at ``runtime``.

    Raises
    ------
    SessionError
        No gate serves this runtime directory, or another user does.
    """
    path = runtime / SOCKET
    try:
        with socket.socket(socket.AF_UNIX) as probe:
            probe.connect(str(path))
            foreign = foreign_server(probe, path)
    except (OSError, ValueError) as error:
        raise SessionError(
            f"no gate at {path} ({error}); start it with 'orbitd gate' or 'orbitd run'"
        ) from error
    if foreign:
        raise SessionError(foreign)
    try:
        return _open(
            {"mode": "client", "connect/endpoints": [endpoint(runtime)], "connect/timeout_ms": 1000}
        )
    except zenoh.ZError as error:
        raise SessionError(
            f"no gate at {runtime / SOCKET}; start it with 'orbitd gate' or 'orbitd run'"
        ) from error


_OFF: Final = (
    "scouting/multicast/enabled",
    "scouting/gossip/enabled",
    "transport/shared_memory/enabled",
)
"""Shared memory: segments in /dev/shm that the service's sandbox forbids, for messages of a few
hundred bytes."""


def _open(values: dict[str, Any]) -> zenoh.Session:
    config = zenoh.Config()
    for key, value in {**values, **dict.fromkeys(_OFF, False)}.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def access_rules(prefix: str) -> dict[str, Any]:
    """Zenoh's ``access_control``: the Unix socket may everything, the network may read, nobody else
    anything."""
    readable = [f"{prefix}/{part}{rest}" for part in _READABLE for rest in ("", "/**")]
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [
            _rule(
                "all",
                ("ingress", "egress"),
                (*_READING_IN, *_READING_OUT, "delete", "liveliness_token"),
                ["**"],
            ),
            _rule("read-in", ("ingress",), _READING_IN, readable),
            _rule("read-out", ("egress",), _READING_OUT, readable),
            _rule("command-in", ("ingress",), ("query",), [f"{prefix}/cmd/**"]),
            _rule("command-out", ("egress",), ("reply", "declare_queryable"), [f"{prefix}/cmd/**"]),
        ],
        "subjects": [
            {"id": "local", "link_protocols": [UNIX]},
            {"id": "network", "link_protocols": list(NETWORK_LINKS)},
            {"id": "operator", "link_protocols": ["tls"], "cert_common_names": [OPERATOR]},
        ],
        "policies": [
            {"rules": ["all"], "subjects": ["local"]},
            {"rules": ["read-in", "read-out"], "subjects": ["network"]},
            {"rules": ["command-in", "command-out"], "subjects": ["operator"]},
        ],
    }


def _rule(
    name: str, flows: tuple[str, ...], messages: tuple[str, ...], keys: list[str]
) -> dict[str, Any]:
    return {
        "id": name,
        "permission": "allow",
        "flows": list(flows),
        "messages": sorted(set(messages)),
        "key_exprs": keys,
    }
