"""Endpoints, keys, folders and ports: text that a process would stumble over at its start."""

from __future__ import annotations

import base64
import binascii
import ipaddress
import re
from collections.abc import Iterator
from typing import Final, NamedTuple

from firmware_py.config.convert import Found
from firmware_py.config.schema import Config

SECURE: Final = ("tls", "quic")
PLAIN: Final = ("tcp", "udp", "ws")
DATAGRAM: Final = ("udp", "quic")
LOCAL: Final = "unixsock-stream"
SOCKET_PATH_MAX: Final = 107
"""Bytes of a Unix socket's path in Linux."""

ED25519_PREFIX: Final = bytes.fromhex("302a300506032b6570032100")
"""What `openssl pkey -pubout` puts before the 32 bytes of the key."""

FREE_PORT_MIN: Final = 1024
"""Ports below it belong to root."""

_LABEL: Final = "[A-Za-z0-9]([A-Za-z0-9-]{0,61}[A-Za-z0-9])?"
_HOST: Final = re.compile(rf"^{_LABEL}(\.{_LABEL})*\Z")


class Address(NamedTuple):
    """An endpoint in its parts; ``port`` is 0 for a path."""

    protocol: str
    host: str
    port: int

    @property
    def ip(self) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
        """The address; None for a name, which may come to mean anything."""
        try:
            return ipaddress.ip_address("127.0.0.1" if self.host == "localhost" else self.host)
        except ValueError:
            return None

    @property
    def loopback(self) -> bool:
        """Whether only this machine reaches it."""
        return self.protocol == LOCAL or (self.ip is not None and self.ip.is_loopback)

    def collides(self, other: Address) -> bool:
        """Whether one process cannot listen at both."""
        if self.port != other.port or (self.protocol in DATAGRAM) != (other.protocol in DATAGRAM):
            return False
        return self.ip == other.ip or any(
            each.ip is not None and each.ip.is_unspecified for each in (self, other)
        )


def parse_endpoint(text: str) -> Address | str:
    """``PROTOCOL/HOST:PORT`` or ``unixsock-stream/PATH`` in its parts, or why it is none."""
    protocol, slash, rest = text.partition("/")
    if not slash or protocol not in (*SECURE, *PLAIN, LOCAL):
        return f"no endpoint; write tls/HOST:PORT, or one of {', '.join((*PLAIN, *SECURE, LOCAL))}"
    if "?" in rest or "#" in rest:
        return "carries options (? or #) that the device sets itself; remove them"
    if protocol == LOCAL:
        good = rest.startswith("/") and len(rest) <= SOCKET_PATH_MAX
        return (
            Address(protocol, rest, 0)
            if good
            else f"no absolute path of at most {SOCKET_PATH_MAX}; correct it"
        )
    host, colon, port = rest.rpartition(":")
    if not colon or not re.match(r"^[0-9]{1,5}\Z", port) or not 0 < int(port) <= 65535:
        return "no port of 1 .. 65535; write HOST:PORT"
    if host.startswith("[") and host.endswith("]"):
        try:
            return Address(protocol, str(ipaddress.IPv6Address(host[1:-1])), int(port))
        except ValueError:
            return f"{host} is no IPv6 address; correct it"
    if re.match(r"^[0-9.]+\Z", host):
        try:
            return Address(protocol, str(ipaddress.IPv4Address(host)), int(port))
        except ValueError:
            return f"{host} is no IPv4 address; correct it"
    if not _HOST.match(host) or len(host) > 253:
        return "no host name or address; write HOST:PORT, an IPv6 address in brackets"
    return Address(protocol, host, int(port))


def _endpoints(config: Config) -> Iterator[Found]:
    """Endpoints that are none, or open to everybody on the network."""
    zenoh = config.zenoh
    for name, endpoints in (("listen", zenoh.listen), ("connect", zenoh.connect)):
        for i, text in enumerate(endpoints):
            key, parsed = f"zenoh.{name}[{i}]", parse_endpoint(text)
            if isinstance(parsed, str):
                yield key, text, parsed
            elif parsed.protocol in PLAIN and not parsed.loopback and not zenoh.insecure_network:
                yield (
                    key,
                    text,
                    (
                        "without TLS beyond this machine, whoever is on the network reads along; "
                        "use tls/, or set "
                        "zenoh.insecure_network = true"
                    ),
                )
            elif name == "listen" and parsed.protocol != LOCAL and parsed.ip is None:
                yield (
                    key,
                    text,
                    "a name; write the address of this machine at which to listen, 0.0.0.0 for all",
                )


def _ports(config: Config) -> Iterator[Found]:
    """Ports of this machine that are wanted twice."""
    taken = {"metrics.port": Address("tcp", "127.0.0.1", config.metrics.port)}
    for i, text in enumerate(config.zenoh.listen):
        parsed = parse_endpoint(text)
        if isinstance(parsed, str) or not parsed.port:
            continue
        for key, other in taken.items():
            if parsed.collides(other):
                yield f"zenoh.listen[{i}]", text, f"at the port of {key}; choose another port"
        taken[f"zenoh.listen[{i}]"] = parsed


def _certificates(config: Config) -> Iterator[Found]:
    zenoh = config.zenoh
    files = {
        "tls_root_ca": zenoh.tls_root_ca,
        "tls_certificate": zenoh.tls_certificate,
        "tls_private_key": zenoh.tls_private_key,
    }
    secure = [e for e in (*zenoh.listen, *zenoh.connect) if e.partition("/")[0] in SECURE]
    if not secure and not any(files.values()):
        return
    for name, path in files.items():
        if not path:
            yield (
                f"zenoh.{name}",
                '""',
                "TLS needs tls_root_ca, tls_certificate and tls_private_key; name the file",
            )


def _keys(config: Config) -> Iterator[Found]:
    models = config.models
    if models.require_signature and not models.public_keys:
        yield (
            "models.public_keys",
            "[]",
            (
                "models.require_signature wants each set signed by one of these; add a key with "
                "`orbitd keys trust`"
            ),
        )
    for i, text in enumerate(models.public_keys):
        try:
            data = base64.b64decode(text, validate=True)
        except binascii.Error:
            data = b""
        if not data.startswith(ED25519_PREFIX) or len(data) != len(ED25519_PREFIX) + 32:
            yield (
                f"models.public_keys[{i}]",
                text,
                (
                    "not the base64 of an Ed25519 public key; take the middle line of `openssl "
                    "pkey -pubout`"
                ),
            )


def _port(config: Config) -> Iterator[Found]:
    port = config.metrics.port
    if 0 < port < FREE_PORT_MIN:
        yield (
            "metrics.port",
            port,
            f"below {FREE_PORT_MIN}, where only root may serve; raise it, or 0 for none",
        )


NETWORK_CHECKS: Final = (_endpoints, _ports, _certificates, _keys, _port)
