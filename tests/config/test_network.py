"""Endpoints, certificates, keys and ports: refused before a process stumbles over them."""

from __future__ import annotations

import base64

import pytest

from firmware_py import config
from firmware_py.config.checks_network import ED25519_PREFIX, Address, parse_endpoint
from tests.first_schema import BENCH

KEY = base64.b64encode(ED25519_PREFIX + bytes(32)).decode()
TLS = "".join(
    f'tls_{name} = "/etc/orbitd/{name}.pem"\n' for name in ("root_ca", "certificate", "private_key")
)


def said(extra: str) -> dict[str, str]:
    """What is wrong by key with the shipped configuration and ``extra``."""
    try:
        config.parse(f"{BENCH}\n{extra}\n")
    except config.ConfigError as error:
        return {fault.key: f"{fault.cause}; {fault.next_step}" for fault in error.faults}
    return {}


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("tcp/127.0.0.1:7447", Address("tcp", "127.0.0.1", 7447)),
        ("udp/[::1]:1", Address("udp", "::1", 1)),
        ("ws/localhost:65535", Address("ws", "localhost", 65535)),
        ("tls/rig-7.lab.example:7447", Address("tls", "rig-7.lab.example", 7447)),
        ("unixsock-stream//run/orbitd/x.sock", Address("unixsock-stream", "/run/orbitd/x.sock", 0)),
    ],
)
def test_an_endpoint_has_parts(text: str, address: Address) -> None:
    assert parse_endpoint(text) == address


@pytest.mark.parametrize(
    "text",
    [
        "",
        "tcp",
        "tcp/",
        "tcp/127.0.0.1",
        "tcp/:7447",
        "tcp/127.0.0.1:",
        "tcp/127.0.0.1:0",
        "tcp/127.0.0.1:65536",
        "tcp/127.0.0.1:-1",
        "tcp/127.0.0.1:7447x",
        "tcp/127.0.0.1:1\n",
        "tcp/127.0.0.256:1",
        "tcp/127.1:1",
        "tcp/::1:7447",
        "tcp/[::1]",
        "tcp/[::g]:1",
        "tcp/[127.0.0.1]:1",
        "TCP/127.0.0.1:7447",
        "http/127.0.0.1:80",
        "serial//dev/ttyS0",
        "tcp/127.0.0.1:7447#iface=eth0",
        "tcp/127.0.0.1:7447?rel=0",
        "tcp/a_b:1",
        "tcp/-a:1",
        "tcp/a..b:1",
        "tcp/" + "a" * 64 + ":1",
        "tcp/" + ".".join(["a" * 50] * 6) + ":1",
        "tcp/u@h:1",
        "tcp/h:1:2",
        "unixsock-stream/x.sock",
        "unixsock-stream//" + "x" * 110,
    ],
)
def test_what_is_no_endpoint_is_refused_with_what_to_write(text: str) -> None:
    wrong = parse_endpoint(text)
    assert isinstance(wrong, str)
    assert "; " in wrong


@pytest.mark.parametrize("protocol", ["tcp", "udp", "ws"])
@pytest.mark.parametrize(
    "host", ["0.0.0.0", "[::]", "192.168.1.7", "[fe80::1]", "rig.lab", "[::ffff:10.0.0.1]"]
)
@pytest.mark.parametrize("way", ["listen", "connect"])
def test_without_tls_only_this_machine_is_reached(protocol: str, host: str, way: str) -> None:
    line = f'[zenoh]\n{way} = ["{protocol}/127.0.0.1:7446", "{protocol}/{host}:7447"]'
    found = said(line)
    assert list(found) == [f"zenoh.{way}[1]"]
    assert "use tls/, or set zenoh.insecure_network = true" in found[f"zenoh.{way}[1]"]
    allowed = said(line + "\ninsecure_network = true")
    assert not allowed or (way, host) == ("listen", "rig.lab")


def test_the_loopback_and_tls_need_no_leave() -> None:
    assert (
        said(
            '[zenoh]\nlisten = ["tcp/127.0.0.1:7447", "udp/[::1]:7447", '
            '"unixsock-stream//tmp/x.sock"]'
        )
        == {}
    )
    assert (
        said(f'[zenoh]\nlisten = ["tls/0.0.0.0:7447"]\nconnect = ["quic/rig.lab:7448"]\n{TLS}')
        == {}
    )


def test_a_name_is_nothing_to_listen_at() -> None:
    assert (
        "the address of this machine"
        in said(f'[zenoh]\nlisten = ["tls/rig.lab:7447"]\n{TLS}')["zenoh.listen[0]"]
    )


@pytest.mark.parametrize(
    ("first", "second"),
    [("tcp/127.0.0.1:7447", "tcp/127.0.0.1:7447"), ("tcp/127.0.0.1:7447", "ws/127.0.0.1:7447"),
     ("tcp/localhost:7447", "ws/127.0.0.1:7447"), ("tls/0.0.0.0:7447", "tcp/127.0.0.1:7447"),
     ("tcp/127.0.0.1:7447", "tls/[::]:7447"), ("udp/127.0.0.1:7447", "quic/127.0.0.1:7447")],
)  # fmt: skip
def test_a_port_is_wanted_once(first: str, second: str) -> None:
    found = said(f'[zenoh]\nlisten = ["{first}", "{second}"]\n{TLS}')
    assert found == {"zenoh.listen[1]": "at the port of zenoh.listen[0]; choose another port"}


def test_page_and_zenoh_want_different_ports() -> None:
    text = '[zenoh]\nlisten = ["{}/127.0.0.1:9100"]\n[metrics]\nport = 9100'
    assert said(text.format("tcp")) == {
        "zenoh.listen[0]": "at the port of metrics.port; choose another port"
    }
    assert said(text.format("udp")) == {}
    assert said('[zenoh]\nlisten = ["tcp/127.0.0.2:9100"]\n[metrics]\nport = 9100') == {}
    assert list(said('[zenoh]\nlisten = ["tcp/127.0.0.1"]\n[metrics]\nport = 9100')) == [
        "zenoh.listen[0]"
    ]


def test_tls_needs_all_three_files() -> None:
    for missing in TLS.splitlines(keepends=True):
        found = said(f'[zenoh]\nlisten = ["tls/0.0.0.0:7447"]\n{TLS.replace(missing, "")}')
        assert list(found) == [f"zenoh.{missing.split(' ')[0]}"]
    assert len(said('[zenoh]\nlisten = ["tls/0.0.0.0:7447"]')) == 3
    assert len(said('[zenoh]\ntls_root_ca = "/etc/ca.pem"')) == 2


@pytest.mark.parametrize(
    "path", ["certs/ca.pem", "~/ca.pem", "", "/" + "x" * 300, "/a\\u0000b", "/a\\nb"]
)
def test_a_file_is_named_from_the_root(path: str) -> None:
    found = said(f'[recorder]\ndirectory = "{path}"')
    assert list(found) == (["recorder.directory"] if path else [])


@pytest.mark.parametrize(
    "key",
    ["", "0" * 64, "AAAA", KEY[:-4], KEY + "AAAA", "A" * 59 + "=", "A", KEY.replace("MC", "MD", 1)],
)
def test_a_key_is_an_ed25519_key(key: str) -> None:
    found = said(f'[models]\ndirectory = "/srv/models"\npublic_keys = ["{KEY}", "{key}"]')
    assert list(found) == ["models.public_keys[1]"]


def test_required_signatures_need_a_key() -> None:
    required = '[models]\ndirectory = "/srv/models"\nrequire_signature = true'
    assert list(said(required)) == ["models.public_keys"]
    assert said('[models]\ndirectory = "/srv/models"') == {}
    assert said(f'{required}\npublic_keys = ["{KEY}"]') == {}
    assert said(f'[models]\ndirectory = "/srv/models"\npublic_keys = ["{KEY}"]') == {}


def test_a_port_of_root_is_refused() -> None:
    assert list(said("[metrics]\nport = 80")) == ["metrics.port"]
    assert said("[metrics]\nport = 0") == {}
    assert said("[metrics]\nport = 1024") == {}
