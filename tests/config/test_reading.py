"""Files that an editor, a copy or a person made of a configuration: read, or refused with what to
do."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from firmware_py import config
from firmware_py.config.source import MAX_BYTES, MAX_LINE
from tests.first_schema import BENCH


def refusal(path: Path) -> str:
    """Why ``path`` is refused, which is told soon."""
    began = time.process_time()
    with pytest.raises(config.ConfigError) as caught:
        config.load(path)
    assert time.process_time() - began < 2.0
    assert caught.value.exit_code == 2
    assert all(fault.cause and fault.next_step for fault in caught.value.faults)
    return str(caught.value)


@pytest.mark.parametrize(
    "data",
    [
        b"\xef\xbb\xbf" + BENCH.encode(),
        BENCH.replace("\n", "\r\n").encode(),
        b"\xef\xbb\xbf" + BENCH.replace("\n", "\r\n").encode(),
        BENCH.replace("# orbitd", "# Größe orbitd").encode(),
        BENCH.replace("rate_hz =", "'rate_hz' =").replace("[limits]", '[ "limits" ]').encode(),
    ],
    ids=["mark", "crlf", "mark and crlf", "umlaut", "quoted keys"],
)
def test_what_editors_write_is_read(data: bytes, tmp_path: Path) -> None:
    path = tmp_path / "rotor.toml"
    path.write_bytes(data)
    assert config.load(path)[0] == config.parse(BENCH)[0]


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (BENCH.encode("utf-16"), "byte order mark of UTF-16; save it as UTF-8"),
        (b"\xfe\xff" + BENCH.encode("utf-16-be"), "byte order mark of UTF-16"),
        (BENCH.encode("utf-32"), "byte order mark of UTF-32"),
        (BENCH.encode("utf-16-le"), "rotor.toml:1: a NUL byte"),
        (
            BENCH.replace("[bus]", "# Größe\n[bus]").encode("latin-1"),
            "rotor.toml:9: byte 0xf6 is not UTF-8",
        ),
        (BENCH.encode() + b"\0\0\0", "a NUL byte"),
        (b"\0" * 4096, "rotor.toml:1: a NUL byte"),
        (b"", "device: missing (Who this device is, and how it starts)"),
        (b"\xef\xbb\xbf", "device: missing (Who this device is, and how it starts)"),
        (b"# " + b"x" * MAX_LINE, "rotor.toml:1: a line of more than"),
        (b"x = 1\n" * MAX_BYTES, f"more than {MAX_BYTES} bytes"),
        (b"a = " + b"[" * 1990, "nested deeper"),
        (b"a = " + b"{b = " * 390, "nested deeper"),
        (b".".join([b"a"] * 990) + b" = 1\n", "a: unknown key"),
        (b"a = " + b"9" * 1990, "a = 999"),
        (b"device = ", "rotor.toml:1: not valid TOML"),
        (b"\n[device]\nsite = 'a'\n[device]\n", "rotor.toml:4: not valid TOML"),
        (BENCH.replace("\n", "\r").encode(), "a line of more than"),
        (BENCH[: len(BENCH) // 2].encode() + b"\n]", "not valid TOML"),
        (b"".join(b"k%d = 1\n" % i for i in range(6000)), "6000 unknown keys"),
        (b"[[channel]]\n" * 200, "channel: 200 entries, at most 64; shorten it"),
    ],
)
def test_what_is_no_configuration_is_named(data: bytes, words: str, tmp_path: Path) -> None:
    path = tmp_path / "rotor.toml"
    path.write_bytes(data)
    assert words in refusal(path)


def test_a_thousand_digits_are_no_traceback(tmp_path: Path) -> None:
    path = tmp_path / "rotor.toml"
    path.write_text(BENCH.replace("rate_hz = 5000", "rate_hz = " + "5" * 1500))
    assert "rotor.toml:17: sampling.rate_hz = 5555" in refusal(path)
    path.write_text(BENCH.replace("rate_hz = 5000", "rate_hz = 0x" + "f" * 1900))
    assert "above the greatest, 10000" in refusal(path)


def test_what_is_no_file_is_named_and_never_waited_for(tmp_path: Path) -> None:
    assert "cannot be read (No such file" in refusal(tmp_path / "absent.toml")
    assert "/machine.toml: cannot be read (No such file" in refusal(tmp_path)
    os.mkfifo(tmp_path / "pipe.toml")
    assert "cannot be read (no regular file)" in refusal(tmp_path / "pipe.toml")
    assert "cannot be read (no regular file)" in refusal(Path("/dev/zero"))
    assert "cannot be read" in refusal(tmp_path / "rotor.toml" / "x.toml")
    assert "cannot be read" in refusal(Path("a\0b.toml"))
    loop = tmp_path / "loop.toml"
    loop.symlink_to(loop)
    assert "cannot be read" in refusal(loop)


def test_a_gigabyte_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "rotor.toml"
    with path.open("wb") as file:
        file.truncate(1 << 30)
    assert "more than" in refusal(path)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (BENCH.replace("rate_um_s = 50.0", "rate_um_s = -1"), 75),
        (BENCH.replace("rate_um_s = 50.0", '"rate_um_s" = -1'), 75),
        (BENCH.replace("rate_um_s = 50.0", "rate_um_s=-1"), 75),
        (BENCH.replace("[limits]", "x = '''\nrate_um_s = 1\n'''\n[limits]", 1), 75),
        ("device = 1\nactuator = { rate_um_s = -1 }\n", 2),
        ("device = 1\nactuator.rate_um_s = -1\n", 2),
        ("device = 1\nactuator . 'rate_um_s' = -1\n", 2),
    ],
)
def test_the_line_is_that_of_the_key(text: str, line: int) -> None:
    text = text.replace("rate_um_s = 50.0", "rate_um_s = -1")
    with pytest.raises(config.ConfigError) as caught:
        config.parse(text)
    faults = [fault for fault in caught.value.faults if fault.key == "actuator.rate_um_s"]
    assert [fault.line for fault in faults] == [line]


def test_a_value_cannot_command_the_terminal() -> None:
    text = BENCH.replace('site = "lab"', 'site = "\\u001b[31m\\nconfig error: x"')
    text = text.replace("[bus]", '["a\\u001bb"]\n[bus]')
    with pytest.raises(config.ConfigError) as caught:
        config.parse(text)
    assert "\x1b" not in str(caught.value)
    assert len(str(caught.value).splitlines()) == 2


def test_the_name_of_a_device_is_read_from_a_file_with_faults(tmp_path: Path) -> None:
    path = tmp_path / "rotor.toml"
    path.write_text(BENCH.replace("film_max_C = 60.0", "film_max_C = nan"))
    assert config.read_device(path) == config.parse(BENCH)[0].device
    path.write_text(BENCH.replace('rig = "bench"', 'rig = "../bench"').replace('site = "lab"', ""))
    with pytest.raises(config.ConfigError) as caught:
        config.read_device(path)
    assert [fault.key for fault in caught.value.faults] == ["device.site", "device.rig"]
    path.write_text("film_max_C = 60.0\n")
    with pytest.raises(config.ConfigError, match=r"device: missing \(Who this device is"):
        config.read_device(path)


def test_a_fault_shows_its_value_shortly_and_has_a_next_step() -> None:
    source = config.ConfigFile(Path("rotor.toml"), "")
    assert str(source.fault("a.b", 10**5000, "too much")) == (
        "config error: rotor.toml: a.b = (too large to show): too much; correct it"
    )
    assert source.fault("a", "x" * 500, "b; c").value == "x" * 60 + ".. (500 characters)"
    assert source.fault("a", [{"b": 1}], "b; c").value == ""


@pytest.mark.parametrize(
    ("line", "step"),
    [
        ("film_max_C = 60,5 # warm", "decimals stand behind a point: write 60.5"),
        ("film_max_C = -0,25", "decimals stand behind a point: write -0.25"),
        ("rig = my rig", 'text stands in quotes: write "my rig"'),
        ("film_max_C = 60.0.1", "correct the line"),
    ],
)
def test_a_line_that_is_no_toml_says_how_it_is_written(line: str, step: str) -> None:
    with pytest.raises(config.ConfigError) as caught:
        config.parse(f"[device]\n{line}\n")
    (fault,) = caught.value.faults
    assert (fault.line, fault.next_step) == (2, step)
    assert fault.cause.startswith("not valid TOML: ")


def test_what_is_missing_says_what_it_is_and_how_it_is_written(tmp_path: Path) -> None:
    (tmp_path / "machine.toml").write_text('name = "a"\n')
    (tmp_path / "device.toml").write_text('[device]\nsite = "x"\nrig = "a"\n')
    with pytest.raises(config.ConfigError) as caught:
        config.load(tmp_path)
    found = {fault.key: (fault.cause, fault.next_step) for fault in caught.value.faults}
    assert found["operating.speed_max_rpm"] == (
        "missing (Fastest speed in service (rpm, 60 .. 60000))",
        "write speed_max_rpm = .. under [operating]",
    )
    assert found["channel"][1] == "write [[channel]] with name, unit, scale, ok_low, ok_high"
    assert found["limits"][1].startswith("write [limits] with ")
