"""What the network may do: read with or without a certificate, command only as operator, nothing
else."""

from __future__ import annotations

import datetime
import json
import socket
import threading
from pathlib import Path

import msgspec
import pytest
import zenoh
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from firmware_py.gate import session
from firmware_py.gate.telemetry import Telemetry
from firmware_py.records import CommandReply

START = datetime.datetime(2020, 1, 1)
END = datetime.datetime(2120, 1, 1)


class Authority:
    """A certificate authority that lives in one folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._key = ec.generate_private_key(ec.SECP256R1())
        self._name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "test authority")])
        certificate = (
            self._build(self._name, self._key.public_key())
            .add_extension(x509.BasicConstraints(ca=True, path_length=None), critical=True)
            .sign(self._key, hashes.SHA256())
        )
        self.root = folder / "root.pem"
        self.root.write_bytes(certificate.public_bytes(serialization.Encoding.PEM))

    def issue(self, common_name: str) -> tuple[str, str]:
        key = ec.generate_private_key(ec.SECP256R1())
        name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])
        certificate = (
            self._build(name, key.public_key())
            .add_extension(x509.SubjectAlternativeName([x509.DNSName("localhost")]), critical=False)
            .sign(self._key, hashes.SHA256())
        )
        paths = self._folder / f"{common_name}.pem", self._folder / f"{common_name}.key"
        paths[0].write_bytes(certificate.public_bytes(serialization.Encoding.PEM))
        paths[1].write_bytes(
            key.private_bytes(
                serialization.Encoding.PEM,
                serialization.PrivateFormat.PKCS8,
                serialization.NoEncryption(),
            )
        )
        return str(paths[0]), str(paths[1])

    def _build(self, name: x509.Name, public: ec.EllipticCurvePublicKey) -> x509.CertificateBuilder:
        return (
            x509.CertificateBuilder()
            .subject_name(name)
            .issuer_name(self._name)
            .public_key(public)
            .serial_number(x509.random_serial_number())
            .not_valid_before(START)
            .not_valid_after(END)
        )


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def visit(values: dict[str, object]) -> zenoh.Session:
    conf = zenoh.Config()
    values = {
        "mode": "client",
        "scouting/multicast/enabled": False,
        "connect/timeout_ms": 2000,
        **values,
    }
    for key, value in values.items():
        conf.insert_json5(key, json.dumps(value))
    return zenoh.open(conf)


class Device:
    """A device that answers every query."""

    def __init__(self, settings, folder: Path, prefix: str) -> None:
        self.telemetry = Telemetry(session.open_device(settings, folder, prefix), prefix)
        self.verbs: list[str] = []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        while not self._stop.wait(0.005):
            for asked in self.telemetry.queries.commands():
                self.verbs.append(asked.verb)
                reply = CommandReply(seq=1, accepted=True, reasons=[])
                self.telemetry.queries.answer_command(asked.verb, asked.question, reply)
            self.telemetry.queries.questions(lambda name, question: b"{}")

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self.telemetry.close()


def answered(visitor: zenoh.Session, key: str) -> bool:
    return any(reply.ok is not None for reply in visitor.get(key, timeout=0.5))


@pytest.fixture
def certificates(tmp_path):
    made = Authority(tmp_path)
    return {
        "root": str(made.root),
        "device": made.issue("device"),
        "operator": made.issue(session.OPERATOR),
        "reader": made.issue("reader"),
    }


def identity(certificates, name: str) -> dict[str, object]:
    return {
        "transport/link/tls": {
            "root_ca_certificate": certificates["root"],
            "connect_certificate": certificates[name][0],
            "connect_private_key": certificates[name][1],
            "enable_mtls": True,
        }
    }


def test_plain_tcp_may_read_but_not_command_or_speak(bench, tmp_path, prefix):
    port = free_port()
    settings = msgspec.structs.replace(bench.zenoh, listen=[f"tcp/127.0.0.1:{port}"])
    device = Device(settings, tmp_path, prefix)
    visitor = visit({"connect/endpoints": [f"tcp/127.0.0.1:{port}"]})
    local = visit({"connect/endpoints": [session.endpoint(tmp_path)]})
    try:
        assert answered(visitor, f"{prefix}/state")
        assert not answered(visitor, f"{prefix}/cmd/arm")
        assert not answered(visitor, "orbitd/**")
        assert device.verbs == []
        heard = local.declare_subscriber(f"{prefix}/**", zenoh.handlers.RingChannel(8))
        assert answered(local, f"{prefix}/cmd/arm")
        visitor.put(f"{prefix}/ha/diagnosis", b"forged")
        assert answered(local, f"{prefix}/state")
        assert heard.try_recv() is None
    finally:
        visitor.close()
        local.close()
        device.close()


def test_mtls_reads_with_any_certificate_and_commands_only_as_operator(
    bench, tmp_path, prefix, certificates
):
    port = free_port()
    settings = msgspec.structs.replace(
        bench.zenoh,
        listen=[f"tls/localhost:{port}"],
        tls_root_ca=certificates["root"],
        tls_certificate=certificates["device"][0],
        tls_private_key=certificates["device"][1],
    )
    device = Device(settings, tmp_path, prefix)
    endpoint = {"connect/endpoints": [f"tls/localhost:{port}"]}
    reader = visit({**endpoint, **identity(certificates, "reader")})
    operator = visit({**endpoint, **identity(certificates, "operator")})
    try:
        assert answered(reader, f"{prefix}/state")
        assert not answered(reader, f"{prefix}/cmd/disarm")
        assert answered(operator, f"{prefix}/cmd/disarm")
        assert answered(operator, f"{prefix}/state")
        with pytest.raises(zenoh.ZError):
            visit({**endpoint, "transport/link/tls": {"root_ca_certificate": certificates["root"]}})
    finally:
        reader.close()
        operator.close()
        device.close()


def test_an_endpoint_that_cannot_be_bound_is_named(bench, tmp_path, prefix):
    settings = msgspec.structs.replace(bench.zenoh, listen=["tcp/192.0.2.1:7447"])
    with pytest.raises(session.SessionError, match=r"192\.0\.2\.1"):
        session.open_device(settings, tmp_path, prefix)


@pytest.mark.parametrize(
    "junk",
    [b"", b"\xff\x00" * 50, b"-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n"],
)
@pytest.mark.parametrize("file", ["root", "certificate", "key"])
def test_a_damaged_certificate_is_a_named_refusal(
    bench, tmp_path, prefix, certificates, junk, file
):
    paths = {
        "root": certificates["root"],
        "certificate": certificates["device"][0],
        "key": certificates["device"][1],
    }
    Path(paths[file]).write_bytes(junk)
    settings = msgspec.structs.replace(
        bench.zenoh,
        listen=[f"tls/localhost:{free_port()}"],
        tls_root_ca=paths["root"],
        tls_certificate=paths["certificate"],
        tls_private_key=paths["key"],
    )
    with pytest.raises(session.SessionError, match="cannot listen"):
        session.open_device(settings, tmp_path, prefix).close()


def test_without_configured_endpoints_the_device_opens_no_network_socket(bench, tmp_path, prefix):
    opened = session.open_device(bench.zenoh, tmp_path, prefix)
    try:
        for table in ("tcp", "tcp6", "udp", "udp6"):
            inodes = {
                line.split()[9]
                for line in Path(f"/proc/self/net/{table}").read_text().splitlines()[1:]
            }
            links = {
                link.readlink().name
                for link in Path("/proc/self/fd").iterdir()
                if link.is_symlink() and link.exists()
            }
            assert not {f"socket:[{inode}]" for inode in inodes} & links
    finally:
        opened.close()
