"""``orbitd check``: what the machine lacks is a fault as well, and what it calls good has been
built."""

from __future__ import annotations

import datetime
import json
import os
import re
import shutil
import socket
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from firmware_py.commands import building, check, set_points
from firmware_py.config import SHIPPED, ConfigError, load
from tests.first_schema import BENCH


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder in which everything of the device lies."""
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path))
    return tmp_path


def said(place: Path, extra: str, *options: str) -> dict[str, str]:
    """What is wrong by key with the shipped configuration and ``extra``."""
    path = place / "rotor.toml"
    path.write_text(f"{BENCH}\n{extra}\n")
    try:
        assert check.main([str(path), *options]) == 0
    except ConfigError as error:
        return {fault.key: fault.cause for fault in error.faults}
    return {}


def test_good_is_told_with_what_holds_and_what_is_default(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert said(place, "[metrics]\nport = 0") == {}
    assert "keys at their default: --all shows them" in capsys.readouterr().out
    assert said(place, "[metrics]\nport = 0", "--all") == {}
    out = capsys.readouterr().out
    assert "rotor.toml: good\n" in out
    assert "default device.instance = 'default'" in out
    assert "default metrics.port" not in out
    assert not (place / "state").exists()


def test_programs_read_the_same(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = place / "rotor.toml"
    path.write_text(BENCH)
    assert check.main([str(path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["good"], found["config"]["device"]["rig"], len(found["models"])) == (
        True,
        "bench",
        3,
    )
    path.write_text(BENCH.replace("film_max_C = 60.0", "film_max_C = inf"))
    assert check.main([str(path), "--json"]) == 2
    found = json.loads(capsys.readouterr().out)
    assert (found["good"], [fault["key"] for fault in found["faults"]]) == (
        False,
        ["oil.film_max_C"],
    )


def test_any_file_name_can_be_told(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in (b"gr\xc3\xb6\xc3\x9fe.toml", b"\xff\xfe.toml", b"a\x1b[31m\n.toml"):
        path = place / os.fsdecode(name)
        path.write_text(BENCH)
        assert check.main([str(path)]) == 0
        path.write_text("x = 1")
        assert check.main([str(path), "--json"]) == 2
        assert "\x1b" not in capsys.readouterr().out
        with pytest.raises(ConfigError) as refusal:
            check.main([str(path)])
        assert all(line.isprintable() for line in str(refusal.value).encode().decode().splitlines())


def test_a_model_that_is_not_used_is_exit_code_1(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = place / "water"
    shutil.copytree(SHIPPED / "seed", rig)
    machine = rig / "machine.toml"
    machine.write_text(re.sub(r"\[\[feed_port\]\]\n(?:\w.*\n)*", "", machine.read_text()))
    assert check.main([str(rig)]) == 1
    assert "REFUSED classifier: " in capsys.readouterr().out


def test_a_machine_with_orifices_is_monitor_only_and_says_why(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert check.main(["seed"]) == 0
    out = capsys.readouterr().out
    assert "monitor only: feed_port: 4 orifices: the guard's laws know no feed but one" in out
    assert "admissible over" not in out


def test_each_figure_for_which_a_model_is_not_used(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = place / "turned_up"
    shutil.copytree(SHIPPED / "bench", rig)
    machine = rig / "machine.toml"
    text = machine.read_text()
    for key, before, after in (
        ("journal_radius_m", "0.02", "0.021"),
        ("mass_kg", "6.0", "7.0"),
    ):
        assert f"{key} = {before}" in text
        text = text.replace(f"{key} = {before}", f"{key} = {after}")
    machine.write_text(text)
    assert check.main([str(rig)]) == 1
    assert (
        "REFUSED actor: actor.onnx: made for 'bench': bearing.journal_radius_m 0.02, here 0.021 "
        "(within 2 %), rotor.mass_at_bearing_kg 1.74, here 1.99 (within 10 %)"
    ) in capsys.readouterr().out


def test_faults_of_all_three_files_are_named_at_once(place: Path) -> None:
    rig = place / "wrong"
    shutil.copytree(SHIPPED / "bench", rig)
    for name, old, new in (
        ("machine.toml", "journal_radius_m = 0.02", "journal_radius_m = 0.9"),
        ("device.toml", "rate_hz = 5000", "rate_hz = 5001"),
        ("simulation.toml", "teeth = 24", "teeth = 0"),
    ):
        text = (rig / name).read_text()
        assert old in text
        (rig / name).write_text(text.replace(old, new))
    with pytest.raises(ConfigError) as caught:
        check.main([str(rig)])
    assert {fault.key for fault in caught.value.faults} >= {
        "bearing.journal_radius_m", "sampling.rate_hz", "forces.teeth",
    }  # fmt: skip


def test_what_nobody_has_is_named_with_the_arithmetic(place: Path) -> None:
    rig = place / "elsewhere"
    shutil.copytree(SHIPPED / "bench", rig)
    machine = rig / "machine.toml"
    text = machine.read_text()
    for old, new, key, words in (
        ("journal_radius_m = 0.02", "journal_radius_m = 20", "bearing.journal_radius_m",
         "if these are millimetres, write 0.02"),
        ("coupling_to_cg_m = 0.25", "coupling_to_cg_m = 25.0", "rotor.coupling_to_cg_m",
         "25.25 m between coupling and bearing are 1262.5 journal radii, at most 200 (4 m); "
         "if these are millimetres, write 0.025"),
        ("radial_clearance_max_um = 160.0", "radial_clearance_max_um = 160e-6",
         "bearing.radial_clearance_max_um", "if these are metres, write 160"),
        ("radial_clearance_offset_um = 0.0", "radial_clearance_offset_um = -39.0",
         "bearing.radial_clearance_min_um",
         "the film at rest may be -1 um: radial_clearance_min_um 40 + offset -39 - error 2"),
        ("bearing_to_cg_m = 0.25", "bearing_to_cg_m = 0.25\nshaft_end_to_cg_m = 0.2",
         "rotor.bearing_to_cg_m",
         "it ends 0.26 m from the centre of gravity (0.25 and half of bearing.length_m), the shaft "
         "at 0.2"),
        ("polar_inertia_kg_m2 = 0.004", "polar_inertia_kg_m2 = 0.4", "rotor.polar_inertia_kg_m2",
         "above twice rotor.diametral_inertia_kg_m2 = 0.06"),
        ("diametral_inertia_kg_m2 = 0.06", "diametral_inertia_kg_m2 = 60000.0",
         "rotor.diametral_inertia_kg_m2", "6 kg x (0.5 m)^2 = 1.5"),
        ("load_max_N = 300.0", "load_max_N = 600.0", "operating.load_max_N",
         "at most 351.1 N with limits.min_film_um = 10 um left, in 40 um"),
        ("load_min_N = 30.0", "load_min_N = 1.0", "operating.load_min_N",
         "a rotor of 1.74 kg at the bearing is stable up to"),
    ):  # fmt: skip
        assert old in text, old
        machine.write_text(text.replace(old, new))
        with pytest.raises(ConfigError) as caught:
            check.main([str(rig)])
        said = {f.key: f"{f.cause}; {f.next_step}" for f in caught.value.faults}
        assert words in said.get(key, ""), (key, said)


def test_a_machine_outside_the_guards_laws_is_monitor_only(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = place / "long"
    shutil.copytree(SHIPPED / "bench", rig)
    machine = rig / "machine.toml"
    text = machine.read_text().replace("\nlength_m = 0.02", "\nlength_m = 0.045")
    text = re.sub(r"\npump_\w+ = .*|, \"pump_\w+\"", "", text)  # no pump feeds a bearing as long
    machine.write_text(text)
    assert check.main([str(rig)]) == 0
    out = capsys.readouterr().out
    assert "monitor only: L/D = 1.12: the guard's bounds are verified up to 1" in out
    assert "admissible over" not in out
    device = rig / "device.toml"
    device.write_text(device.read_text().replace('"monitor"', '"auto"'))
    with pytest.raises(ConfigError, match=r"monitor only: L/D = 1\.12"):
        check.main([str(rig)])


def test_up_to_which_speed_the_samples_suffice_is_told(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert said(place, "") == {}
    assert (
        "25 samples a turn at 12000 rpm; protection has its 20 up to 15000 rpm, analysis of the "
        "orbit its 64 up to 4688 rpm"
    ) in capsys.readouterr().out


def test_what_is_hardly_meant_is_told_as_a_caution(place: Path) -> None:
    rig = place / "narrow"
    shutil.copytree(SHIPPED / "bench", rig)
    machine, device = rig / "machine.toml", rig / "device.toml"
    group = '[[group]]\nname = "both"\nmeasures = ["disp_x", "oil_outlet_high"]\nvote = "2oo2"\n'
    device.write_text(device.read_text() + group)
    text = machine.read_text()
    machine.write_text(text.replace("runout_m = 6e-6", "runout_m = 9e-6"))
    found = list(set_points.remarks(load(rig)[0]))
    assert any("disp_x_alert: in force above 12.9 um at 40 um" in line for line in found)
    assert any("group both: disp_x, oil_outlet_high do not see the same" in line for line in found)
    assert list(set_points.remarks(load(SHIPPED / "bench")[0])) == []


def test_widths_beyond_the_laws_of_the_film_are_offered_with_a_caution() -> None:
    bench = load(SHIPPED / "bench")[0]
    assert "CAUTION" not in check._rights(bench, (40.0, 129.0))[0]
    assert "the laws of the film hold up to 130" in check._rights(bench, (40.0, 140.0))[0]


def test_folders_that_cannot_be_written_are_named(place: Path) -> None:
    (place / "file").write_text("")
    assert (
        "no folder"
        in said(place, f'[recorder]\ndirectory = "{place}/file/x"')["recorder.directory"]
    )
    assert "recorder.directory" in said(place, '[recorder]\ndirectory = "/proc/orbitd"')
    assert said(place, '[recorder]\ndirectory = "/proc/orbitd"\nenabled = false') == {}
    (place / "kept").mkdir(mode=0o500)
    if os.geteuid():
        assert (
            "by this user"
            in said(place, f'[recorder]\ndirectory = "{place}/kept/x"')["recorder.directory"]
        )
    key = "MCowBQYDK2VwAyEA" + "A" * 43 + "="
    assert list(said(place, f'[models]\ndirectory = "{place}/no"\npublic_keys = ["{key}"]')) == [
        "models.directory"
    ]
    assert list(said(place, f'[zenoh]\nlisten = ["unixsock-stream/{place}/file/s"]')) == [
        "zenoh.listen[0]"
    ]
    assert said(place, f'[zenoh]\nlisten = ["unixsock-stream/{place}/s"]') == {}


def test_an_address_that_is_taken_or_not_ours_is_named(place: Path) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        assert "in use" in said(place, f"[metrics]\nport = {port}")["metrics.port"]
        assert (
            "in use"
            in said(place, f'[zenoh]\nlisten = ["tcp/127.0.0.1:{port}"]')["zenoh.listen[0]"]
        )
        assert said(place, f'[zenoh]\nlisten = ["udp/127.0.0.1:{port}"]') == {}
    listen = 'listen = ["tcp/192.0.2.1:7447", "tcp/[2001:db8::1]:7447"]'
    far = f"[zenoh]\ninsecure_network = true\n{listen}"
    assert list(said(place, far)) == ["zenoh.listen[0]", "zenoh.listen[1]"]


@pytest.mark.parametrize("service", [False, True])
def test_what_this_device_itself_serves_is_not_taken(
    place: Path, monkeypatch: pytest.MonkeyPatch, service: bool
) -> None:
    (place / "default").mkdir()
    if service:
        monkeypatch.setattr(building, "SERVICE_RUNTIME", place / "default")
        monkeypatch.setenv("RUNTIME_DIRECTORY", str(place / "other"))
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as gate, socket.socket() as page:
        gate.bind(str(place / "default" / "gate.sock"))
        gate.listen()
        page.bind(("127.0.0.1", 0))
        page.listen()
        port = page.getsockname()[1]
        assert (
            said(place, f'[metrics]\nport = {port}\n[zenoh]\nlisten = ["tcp/127.0.0.2:{port}"]')
            == {}
        )


def test_zenoh_itself_opens_what_is_called_good(place: Path) -> None:
    assert (
        said(
            place,
            '[zenoh]\nlisten = ["tcp/127.0.0.1:47447", "udp/127.0.0.1:47447", '
            '"ws/127.0.0.1:47448"]',
        )
        == {}
    )
    (place / "taken").write_text("")
    assert (
        "no socket"
        in said(place, f'[zenoh]\nlisten = ["unixsock-stream/{place}/taken"]')["zenoh.listen[0]"]
    )


def test_good_certificates_are_good_and_locked_or_exchanged_ones_are_named(place: Path) -> None:
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "orbitd")])
    begin = datetime.datetime(2020, 1, 1, tzinfo=datetime.UTC)
    made = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(1)
        .not_valid_before(begin)
        .not_valid_after(begin.replace(year=2100))
        .add_extension(x509.BasicConstraints(ca=True, path_length=None), critical=True)
        .sign(key, hashes.SHA256())
    )
    (place / "root_ca.pem").write_bytes(made.public_bytes(serialization.Encoding.PEM))
    (place / "certificate.pem").write_bytes(made.public_bytes(serialization.Encoding.PEM))
    files = "".join(
        f'tls_{file} = "{place}/{file}.pem"\n' for file in ("root_ca", "certificate", "private_key")
    )
    text = f'[zenoh]\nlisten = ["tls/127.0.0.1:47449"]\n{files}'
    for secret, owner, wrong in (
        (serialization.NoEncryption(), key, []),
        (serialization.BestAvailableEncryption(b"secret"), key, ["zenoh.tls_certificate"]),
        (
            serialization.NoEncryption(),
            ec.generate_private_key(ec.SECP256R1()),
            ["zenoh.tls_certificate"],
        ),
    ):
        pem = owner.private_bytes(
            serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, secret
        )
        (place / "private_key.pem").write_bytes(pem)
        assert list(said(place, text)) == wrong


def test_certificates_are_opened(place: Path) -> None:
    (place / "junk.pem").write_text("no certificate")
    names = "".join(
        f'tls_{name} = "{place}/{file}"\n'
        for name, file in (
            ("root_ca", "absent.pem"),
            ("certificate", "junk.pem"),
            ("private_key", "junk.pem"),
        )
    )
    found = said(place, f'[zenoh]\nlisten = ["tls/127.0.0.1:7447"]\n{names}')
    assert list(found) == ["zenoh.tls_certificate", "zenoh.tls_root_ca"]


def test_the_regime_of_the_film_is_told_over_the_whole_range(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert check.main([str(SHIPPED / "bench")]) == 0
    text = capsys.readouterr().out
    assert "film over the declared range: Re 9.19 .. 623, Ta 0.411 .. 55.7, laminar up to" in text
    assert "film wider than 130 um at 12000 rpm in oil of 60 degC: not laminar" in text
