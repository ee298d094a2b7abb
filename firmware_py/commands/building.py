"""Builds what the processes build from a configuration, and looks at what they need around them.

A configuration without faults that does not get through here is a mistake of this program; what is
found around it (a folder that cannot be written, a port that is taken) is a fault of the machine on
which it shall run.
"""

from __future__ import annotations

import os
import socket
import ssl
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import msgspec

from firmware_py.brain.core import BrainCore
from firmware_py.brain.library import prewarm
from firmware_py.brain.store import Models, load_models
from firmware_py.config import Config
from firmware_py.config.checks_network import DATAGRAM, Address, parse_endpoint
from firmware_py.gate import keys, session
from firmware_py.gate.loop import recordings_dir
from firmware_py.guard.core import GuardCore
from firmware_py.guard.envelope.shield import Shield
from firmware_py.launch import SERVICE_RUNTIME
from firmware_py.machine.parts import monitor_only
from firmware_py.wire.link import codec_for

Found = tuple[str, object, str]


@dataclass(frozen=True)
class Built:
    """What came of it: the clearances admissible everywhere (um; None: monitor only), and the
    models."""

    admissible_um: tuple[float, float] | None
    models: Models


def build(config: Config, models: Models | None = None) -> Built:
    """Guard and brain as the processes make them, with the models of the files where none are
    given."""
    GuardCore(config, codec_for(config), 1)
    if models is None:
        models = load_models(config)
        prewarm(models)
    BrainCore(config, models)
    session.access_rules(keys.prefix(config.device.site, config.device.rig))
    if monitor_only(config.machine):
        return Built(None, models)
    low_m, high_m = Shield(config).fixed_range() or (0.0, 0.0)
    return Built((low_m * 1e6, high_m * 1e6), models)


def surroundings(config: Config, runtime: Path, environment: Mapping[str, str]) -> list[Found]:
    """What the machine lacks; ``runtime`` is the folder of the sockets of this device, which may be
    running."""
    return list(_around(config, runtime, environment)) or list(_session(config))


def _around(config: Config, runtime: Path, environment: Mapping[str, str]) -> Iterator[Found]:
    """Folders, files, addresses."""
    running = any(_serves(folder / "gate.sock") for folder in (runtime, SERVICE_RUNTIME))
    if config.recorder.enabled and (cause := _unwritable(recordings_dir(config, environment))):
        yield "recorder.directory", config.recorder.directory or '""', cause
    if config.models.directory and not Path(config.models.directory).is_dir():
        yield (
            "models.directory",
            config.models.directory,
            "no such folder; make it or correct the name",
        )
    if config.models.shadow and not Path(config.models.shadow).is_file():
        yield "models.shadow", config.models.shadow, "no such file; correct the name"
    if (
        config.metrics.port
        and not running
        and (cause := _unbindable(Address("tcp", "127.0.0.1", config.metrics.port)))
    ):
        yield "metrics.port", config.metrics.port, f"{cause}; choose another port, or 0 for none"
    for i, text in enumerate(config.zenoh.listen):
        parsed = parse_endpoint(text)
        if isinstance(parsed, str) or running:
            continue
        cause = _unbindable(parsed) if parsed.port else _no_socket(Path(parsed.host))
        if cause:
            yield f"zenoh.listen[{i}]", text, f"{cause}; correct it"
    yield from _certificates(config)


def _certificates(config: Config) -> Iterator[Found]:
    """Certificate files that cannot be read or do not belong together."""
    zenoh = config.zenoh
    if not zenoh.tls_certificate:
        return
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    try:
        context.load_cert_chain(
            zenoh.tls_certificate, zenoh.tls_private_key, password=str
        )  # asks nobody for one
    except (OSError, ValueError) as error:
        yield (
            "zenoh.tls_certificate",
            zenoh.tls_certificate,
            (
                f"cannot be used with tls_private_key ({error}); name a certificate and its key "
                f"as PEM"
            ),
        )
    try:
        context.load_verify_locations(zenoh.tls_root_ca)
    except (OSError, ValueError) as error:
        yield (
            "zenoh.tls_root_ca",
            zenoh.tls_root_ca,
            f"cannot be used ({error}); name a certificate as PEM",
        )


def _session(config: Config) -> Iterator[Found]:
    """What Zenoh itself has against the settings: its session is opened as the gate opens it, at
    free ports."""
    network = [
        e for e in map(parse_endpoint, config.zenoh.listen) if not isinstance(e, str) and e.port
    ]
    if not network:
        return
    free = [f"{e.protocol}/{f'[{e.host}]' if ':' in e.host else e.host}:0" for e in network]
    settings = msgspec.structs.replace(config.zenoh, listen=free, connect=[])
    prefix = keys.prefix(config.device.site, config.device.rig)
    with tempfile.TemporaryDirectory() as folder:
        try:
            opened = session.open_device(settings, Path(folder), prefix)
        except session.SessionError as error:
            yield "zenoh", None, str(error)
            return
        opened.close()  # type: ignore[no-untyped-call]


def _serves(path: Path) -> bool:
    """Whether somebody listens at the socket ``path``."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as probe:
        try:
            probe.connect(str(path))
        except PermissionError:
            return True  # of the service, which this user may not speak to
        except OSError:
            return False
    return True


def _unbindable(address: Address) -> str:
    """Why nobody can listen at ``address``; empty when one can."""
    family = socket.AF_INET6 if ":" in address.host else socket.AF_INET
    kind = socket.SOCK_DGRAM if address.protocol in DATAGRAM else socket.SOCK_STREAM
    try:
        with socket.socket(family, kind) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((address.host, address.port))
    except OSError as error:
        return error.strerror or str(error)
    return ""


def _no_socket(path: Path) -> str:
    """Why no socket can be made at ``path``; empty when one can."""
    if path.exists() and not path.is_socket():
        return f"{path} is there and no socket"
    return _unwritable(path.parent)


def _unwritable(folder: Path) -> str:
    """Why no file can be made in ``folder``, which a process makes when it is not there; empty when
    one can."""
    there = folder
    while not there.exists() and there != there.parent:
        there = there.parent
    if not there.is_dir():
        return f"{there} is no folder; name one that can be written"
    if not os.access(there, os.W_OK | os.X_OK):
        return f"{there} cannot be written by this user; change its owner or name another"
    try:
        with tempfile.TemporaryFile(dir=there):
            return ""
    except OSError as error:
        return f"{there}: {error.strerror}; name a folder that can be written"
