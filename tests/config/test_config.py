"""Every wrong configuration is refused with file, line, key, value, limit and next step."""

from __future__ import annotations

from pathlib import Path

import pytest

from firmware_py import config

BENCH = (config.SHIPPED / "bench.toml").read_text()


@pytest.mark.parametrize("path", sorted(config.SHIPPED.glob("*.toml")), ids=lambda p: p.name)
def test_shipped_configurations_load(path: Path) -> None:
    loaded, _ = config.load(path)
    assert loaded.device.rig == path.stem


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("displacement_danger_um = 70.0", "displacement_danger_um = 260", "0.7 x diametral clearance (120 um); lower"),
        ("min_film_um = 10.0", "min_flim_um = 10.0", "limits.min_flim_um: unknown key"),
        ("rate_um_s = 50.0", "rate_um_s = -1", "actuator.rate_um_s = -1: expected `float` > 0.0"),
        ("rate_hz = 5000", 'rate_hz = "5000"', "sampling.rate_hz = 5000: expected `int`"),
        ("rate_hz = 5000", "rate_hz = 3000", "no whole number of us"),
        ("safe_radial_clearance_um = 50.0", "safe_radial_clearance_um = 170.0", "40 .. 160 um"),
        ("safe_pressure_bar = 1.0", "safe_pressure_bar = 9.0", "0.5 .. 3 bar"),
        ("command_period_ms = 20", "command_period_ms = 50", "two lost frames would expire the command"),
        ("displacement_alert_um = 45.0", "displacement_alert_um = 70.0", "not below displacement_danger_um (70)"),
        ("data_bitrate = 5_000_000", "data_bitrate = 1_000_000", "115 % of a bus at 1000000/1000000 bit/s"),
        ('link = "can"', 'link = "serial"', "name the port"),
        ('name = "disp_y"', 'name = "disp_z"', "must be exactly disp_x, disp_y"),
        ("ok_low = -0.1\nok_high = 9.9", "ok_low = 9.9\nok_high = 9.9", "channel[6].ok_low"),
        ("scale = 0.001\nok_low = -19.9", "scale = 0.0\nok_low = -19.9", "channel[5].scale"),
        ("speed_max_rpm = 12000.0", "speed_max_rpm = 1000.0", "below operating.speed_min_rpm"),
        ("inlet_max_C = 42.0", "inlet_max_C = 30.0", "below oil.inlet_min_C"),
        ("radial_clearance_max_um = 160.0", "radial_clearance_max_um = 30.0", "not above radial_clearance_min_um"),
    ],
)
def test_contradiction_is_named(old: str, new: str, words: str) -> None:
    assert old in BENCH
    with pytest.raises(config.ConfigError) as refusal:
        config.parse(BENCH.replace(old, new), Path("rotor.toml"))
    text = str(refusal.value)
    assert words in text
    assert text.startswith("config error: rotor.toml")


def test_line_number_is_that_of_the_key() -> None:
    changed = BENCH.replace("displacement_danger_um = 70.0", "displacement_danger_um = 260")
    line = next(i for i, text in enumerate(changed.splitlines(), 1) if text.startswith("displacement_danger_um"))
    with pytest.raises(config.ConfigError, match=f"rotor.toml:{line}: limits.displacement_danger_um = 260"):
        config.parse(changed, Path("rotor.toml"))


def test_line_number_inside_an_array_of_tables() -> None:
    changed = BENCH.replace("ok_low = -195.0\nok_high = 195.0\n", "ok_low = 5\nok_high = 1\n", 1)
    with pytest.raises(config.ConfigError, match=r"channel\[2\]\.ok_low = 5") as refusal:
        config.parse(changed, Path("rotor.toml"))
    line = int(str(refusal.value).split(":")[2])
    assert changed.splitlines()[line - 1] == "ok_low = 5"


def test_serial_rate_is_refused_with_the_arithmetic() -> None:
    slow = BENCH.replace('link = "can"', 'link = "serial"\nserial_port = "/dev/ttyUSB0"\nserial_baud = 921600')
    with pytest.raises(config.ConfigError, match=r"1667 packets/s x \d+ bytes \+ \d+ = \d+ bytes/s, but 921600 baud"):
        config.parse(slow)
    config.parse(slow.replace("921600", "3000000"))


@pytest.mark.parametrize("text", ["device = ", "[device]\nsite = 'a'\n[device]\n"])
def test_syntax_errors_are_named(text: str) -> None:
    with pytest.raises(config.ConfigError, match="not valid TOML"):
        config.parse(text)


def test_missing_file_and_binary_file(tmp_path: Path) -> None:
    with pytest.raises(config.ConfigError, match="cannot be read"):
        config.load(tmp_path / "absent.toml")
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(config.ConfigError, match="cannot be read"):
        config.load(binary)


def test_missing_table_is_named() -> None:
    with pytest.raises(config.ConfigError, match="device: missing"):
        config.parse("")


def test_viscosity_law() -> None:
    oil = config.parse(BENCH)[0].oil
    assert oil.viscosity_Pa_s(40.0) == pytest.approx(0.010)
    assert oil.viscosity_Pa_s(60.0) == pytest.approx(0.010 * 0.5488, rel=1e-3)
