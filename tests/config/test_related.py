"""Values that contradict each other are refused with file, line, key, value, limit and next
step."""

from __future__ import annotations

from pathlib import Path

import pytest

from firmware_py import config, signals
from firmware_py.machine.folder import shipped_names
from firmware_py.machine.lubricant import viscosity_Pa_s
from tests.first_schema import BENCH


@pytest.mark.parametrize("name", shipped_names())
def test_shipped_configurations_load(name: str) -> None:
    loaded, _ = config.load(config.SHIPPED / name)
    assert loaded.device.rig == loaded.machine.name == name


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "displacement_danger_um = 70.0",
            "displacement_danger_um = 260",
            "0.7 x diametral clearance (120 um); lower",
        ),
        ("rate_hz = 5000", "rate_hz = 3000", "no whole number of us"),
        (
            "rate_hz = 5000",
            "rate_hz = 1000",
            "below 4000, 20 samples a turn at operating.speed_max_rpm = 12000",
        ),
        (
            "safe_radial_clearance_um = 50.0",
            "safe_radial_clearance_um = 170.0",
            "bearing.radial_clearance_max_um = 160.0: below actuator.safe_radial_clearance_um "
            "= 170",
        ),
        (
            "safe_pressure_bar = 1.0",
            "safe_pressure_bar = 9.0",
            "below actuator.safe_pressure_bar = 9",
        ),
        (
            "pressure_max_bar = 3.0",
            "pressure_max_bar = 0.2",
            "feed.pressure_max_bar = 0.2: below feed.pressure_min_bar",
        ),
        (
            "command_period_ms = 20",
            "command_period_ms = 50",
            "two lost frames would expire the command",
        ),
        (
            "displacement_alert_um = 45.0",
            "displacement_alert_um = 70.0",
            "displacement_danger_um = 70.0: not above limits.displacement_alert_um = 70",
        ),
        (
            "acceleration_alert_m_s2 = 40.0",
            "acceleration_alert_m_s2 = 90.0",
            "not above limits.acceleration_alert_m_s2",
        ),
        (
            "acceleration_danger_m_s2 = 80.0",
            "acceleration_danger_m_s2 = 120.0",
            "above 97.5 m/s2 rms: its peaks",
        ),
        (
            "speed_high_rpm = 0.0",
            "speed_high_rpm = 12100.0",
            "outside 12360 .. 15000 rpm, 1.03 to 1.25 of operating.speed_max_rpm",
        ),
        ("speed_high_rpm = 0.0", "speed_high_rpm = 18000.0", "choose one inside, or 0 for 1.1"),
        (
            "data_bitrate = 5_000_000",
            "data_bitrate = 1_000_000",
            "115 % of a bus at 1000000/1000000 bit/s",
        ),
        ("data_bitrate = 5_000_000", "data_bitrate = 500_000", "below bus.nominal_bitrate = 1e+06"),
        ('link = "can"', 'link = "serial"', "name the port"),
        ('name = "disp_y"', 'name = "disp_z"', "must be exactly disp_x, disp_y"),
        ('unit = "Pa"', 'unit = "dB"', "channel[5].unit = dB: the wire carries Pa"),
        ("ok_low = -0.1\nok_high = 9.9", "ok_low = 9.9\nok_high = 9.9", "channel[6].ok_low"),
        (
            "ok_low = -0.1\nok_high = 9.9",
            "ok_low = -0.1\nok_high = 40.0",
            "40000 counts, the channel reads up to 32500",
        ),
        (
            "ok_low = -0.1\nok_high = 9.9",
            "ok_low = -0.1\nok_high = 2.9",
            "not all of the feed's pressures and of none, 0 .. 3",
        ),
        ("ok_low = -0.1\nok_high = 2.2", "ok_low = -0.1\nok_high = 1.9", "contact.circuit_V"),
        (
            "ok_low = -19.9\nok_high = 19.9",
            "ok_low = 1.0\nok_high = 1.9",
            "less than 1000 counts above ok_low",
        ),
        ("scale = 0.001\nok_low = -19.9", "scale = 0.0\nok_low = -19.9", "channel[5].scale"),
        (
            "scale = 1e-8",
            "scale = 1e-2",
            "channel[0].scale = 0.01: outside 1e-09 .. 1e-07 m a count",
        ),
        (
            "angle_deg = 135.0",
            "angle_deg = 45.0",
            "channel[1].angle_deg = 45.0: its axis lies 0 degrees from",
        ),
        ("angle_deg = 135.0", "angle_deg = 225.0", "channel[1].angle_deg"),
        ("angle_deg = 135.0", "angle_deg = 20.0", "channel[1].angle_deg"),
        (
            "ok_low = -245e-6\nok_high = 245e-6",
            "ok_low = -245e-6\nok_high = 150e-6",
            "the shaft may stand 160 um off",
        ),
        (
            "ok_low = -245e-6\nok_high = 245e-6",
            "ok_low = -30e-6\nok_high = 30e-6",
            "of what disp_x can read",
        ),
        ("speed_max_rpm = 12000.0", "speed_max_rpm = 1000.0", "not above operating.speed_min_rpm"),
        (
            "speed_ramp_unannounced_rpm_s = 2000.0",
            "speed_ramp_unannounced_rpm_s = 5000.0",
            "speed_ramp_max_rpm_s",
        ),
        (
            "alert_delay_s = 1.0",
            "min_speed_rpm = 2000.0",
            "speed_min_rpm = 1500.0: below limits.min_speed_rpm",
        ),
        (
            "frames_per_block = 10",
            "frames_per_block = 3",
            "a block of 1.8 ms, allowed 2 .. 50 ms; raise it",
        ),
        (
            "frames_per_block = 10",
            "frames_per_block = 100",
            "a block of 60 ms, allowed 2 .. 50 ms; lower it",
        ),
        (
            "fresh_age_ms = 20.0",
            "fresh_age_ms = 90.0",
            "above 80 ms, actuator.time_to_live_ms less command_period_ms",
        ),
        (
            "fresh_age_ms = 20.0",
            "fresh_age_ms = 1.0",
            "below 1.8 ms, 3 frames at sampling.rate_hz = 5000",
        ),
        ("inlet_max_C = 42.0", "inlet_max_C = 30.0", "below oil.inlet_min_C"),
        ("film_max_C = 60.0", "film_max_C = 41.0", "below oil.inlet_max_C"),
        (
            "thermal_capacity_J_K = 250.0",
            "thermal_capacity_J_K = 1.0",
            "time constant over oil.cooling_W_K = 60",
        ),
        (
            "radial_clearance_max_um = 160.0",
            "radial_clearance_max_um = 30.0",
            "not above bearing.radial_clearance_min_um",
        ),
        (
            "radial_clearance_nominal_um = 60.0",
            "radial_clearance_nominal_um = 36.0",
            "below bearing.radial_clearance_min",
        ),
        (
            "journal_radius_m = 0.02",
            "journal_radius_m = 0.007",
            "above 140 um, 0.02 of bearing.journal_radius_m",
        ),
        (
            "journal_radius_m = 0.02",
            "journal_radius_m = 0.5",
            "below 50 um, 0.0001 of bearing.journal_radius_m",
        ),
        ("min_film_um = 10.0", "min_film_um = 31.0", "above 0.8 of the narrowest bearing, 38 um"),
        (
            "pressure_max_bar = 3.0",
            "pressure_max_bar = 3.0\ngroove_area_max_mm2 = 900.0",
            "projected bearing, 800 mm2",
        ),
        (
            "pressure_max_bar = 3.0",
            "pressure_max_bar = 3.0\ngroove_area_min_mm2 = 9.0",
            "below feed.groove_area_min_mm2",
        ),
        (
            "rate_um_s = 50.0",
            "rate_um_s = 10.0",
            "110 um to the safe clearance take 11 s, at most 10",
        ),
        (
            "command_period_ms = 20",
            "command_period_ms = 20\nfollowing_error_um = 61.0",
            "above 60 um, 0.5 of the bearing",
        ),
        (
            "command_period_ms = 20",
            "command_period_ms = 20\nfollowing_error_bar = 0.6",
            "above feed.pressure_min_bar (0.5)",
        ),
        (
            "command_period_ms = 20",
            "command_period_ms = 20\nreversals_per_minute_max = 1501",
            "above 1500, half of",
        ),
        (
            "unbalance_normal_kg_m = 1.7e-5",
            "unbalance_normal_kg_m = 1.7e-2",
            "turns with 2.68e+04 N",
        ),
        ("windage_W_s3 = 5e-9", "windage_W_s3 = 5e-3", "rotor.windage_W_s3"),
        (
            "windage_W_s3 = 5e-9",
            "windage_W_s3 = 9e-4",
            "W at operating.speed_max_rpm, at most 1e+06",
        ),
    ],
)
def test_contradiction_is_named(old: str, new: str, words: str) -> None:
    assert old in BENCH
    with pytest.raises(config.ConfigError) as refusal:
        config.parse(BENCH.replace(old, new, 1), Path("rotor.toml"))
    text = str(refusal.value)
    assert words in text
    assert text.startswith("config error: rotor.toml")


def test_line_number_is_that_of_the_key() -> None:
    changed = BENCH.replace("displacement_danger_um = 70.0", "displacement_danger_um = 260")
    line = next(
        i
        for i, text in enumerate(changed.splitlines(), 1)
        if text.startswith("displacement_danger_um")
    )
    with pytest.raises(
        config.ConfigError, match=f"rotor.toml:{line}: limits.displacement_danger_um = 260"
    ):
        config.parse(changed, Path("rotor.toml"))


def test_line_number_inside_an_array_of_tables() -> None:
    changed = BENCH.replace("ok_low = -195.0\nok_high = 195.0\n", "ok_low = 5\nok_high = 1\n", 1)
    with pytest.raises(config.ConfigError, match=r"channel\[2\]\.ok_low = 5") as refusal:
        config.parse(changed, Path("rotor.toml"))
    line = int(str(refusal.value).split(":")[2])
    assert changed.splitlines()[line - 1] == "ok_low = 5"


def test_two_that_go_well_alone() -> None:
    blocks = BENCH.replace("frames_per_block = 10", "frames_per_block = 5")
    slow = BENCH.replace("alert_delay_s = 1.0", "min_speed_rpm = 60.0")
    config.parse(blocks)
    config.parse(slow)
    with pytest.raises(
        config.ConfigError, match=r"min_speed_rpm = 60\.0: a turn of 333 blocks, at most 250"
    ):
        config.parse(blocks.replace("alert_delay_s = 1.0", "min_speed_rpm = 60.0"))
    hub = BENCH.replace('channel = "orbitd0"', 'channel = "canofthewholemachinehall"')
    config.parse(hub)
    with pytest.raises(config.ConfigError, match="longer than 15 characters; name a CAN interface"):
        config.parse(hub.replace('interface = "orbitd_hub"', 'interface = "socketcan"'))


def test_fewer_channels_are_one_fault_and_no_traceback() -> None:
    for kept in range(8):
        text = "[[channel]]".join(BENCH.split("[[channel]]")[: kept + 1])
        with pytest.raises(config.ConfigError) as refusal:
            config.parse(text)
        assert [fault.key for fault in refusal.value.faults] == ["channel"]


def test_the_shipped_channels_are_those_of_the_kinds() -> None:
    for name in ("bench", "seed"):
        loaded = config.load(config.SHIPPED / name)[0]
        for channel, row in zip(loaded.machine.channel, signals.CHANNELS, strict=True):
            kind = signals.FAST[row.kind]
            assert (channel.name, channel.unit, channel.scale) == (
                row.name,
                kind.unit,
                kind.wire_scale,
            )


def test_serial_rate_is_refused_with_the_arithmetic() -> None:
    slow = BENCH.replace(
        'link = "can"', 'link = "serial"\nserial_port = "/dev/ttyUSB0"\nserial_baud = 921600'
    )
    with pytest.raises(
        config.ConfigError,
        match=r"1667 packets/s x \d+ bytes \+ \d+ = \d+ bytes/s, but 921600 baud",
    ):
        config.parse(slow)
    config.parse(slow.replace("921600", "3000000"))


def test_missing_table_is_named() -> None:
    with pytest.raises(config.ConfigError, match="device: missing"):
        config.parse("")


def test_viscosity_law() -> None:
    oil = config.parse(BENCH)[0].machine.lubricant
    assert viscosity_Pa_s(oil, 40.0) == pytest.approx(0.010)
    assert viscosity_Pa_s(oil, 60.0) == pytest.approx(0.010 * 0.5488, rel=1e-3)


@pytest.mark.parametrize(
    ("before", "after", "parts"),
    [
        (
            "oil_pressure_low_danger_bar = 0.25",
            "oil_pressure_low_danger_bar = 0.45",
            ("danger_bar = 0.45", "0.4", "lower"),
        ),
        (
            "oil_pressure_low_alert_bar = 0.4",
            "oil_pressure_low_alert_bar = 0.6",
            ("feed.pressure_min_bar (0.5)", "lower"),
        ),
        (
            "oil_pressure_low_danger_bar = 0.25",
            "oil_pressure_low_danger_bar = 0.4",
            ("not below", "lower"),
        ),
        (
            "oil_pressure_low_danger_bar = 0.25",
            "oil_pressure_low_danger_bar = 0.01",
            ("supply that has failed", "raise"),
        ),
        (
            "pressure_min_bar = 0.5",
            "pressure_min_bar = 0.0",
            ("feed.pressure_min_bar (0)", "lower"),
        ),
        (
            "oil_outlet_high_danger_C = 70.0",
            "oil_outlet_high_danger_C = 60.0",
            ("not below", "danger_C (60)"),
        ),
        (
            "oil_outlet_high_alert_C = 60.0",
            "oil_outlet_high_alert_C = 75.0",
            ("oil_outlet_high_danger_C (70)", "lower"),
        ),
        (
            "oil_outlet_high_alert_C = 60.0",
            "oil_outlet_high_alert_C = 41.0",
            ("oil.inlet_max_C (42)", "raise"),
        ),
        (
            "oil_outlet_high_alert_C = 60.0",
            "oil_outlet_high_alert_C = 65.0",
            ("oil.film_max_C (60)", "lower"),
        ),
        ("oil_outlet_max_C = 150.0", "oil_outlet_max_C = 70.0", ("could not be read", "raise")),
        ("oil_outlet_min_C = -20.0", "oil_outlet_min_C = 35.0", ("oil.inlet_min_C (35)", "lower")),
        (
            "pressure_max_bar = 0.0",
            "pressure_max_bar = 3.0",
            ("feed.pressure_max_bar (3)", "raise"),
        ),
    ],
)
def test_limits_and_ranges_of_the_oil_that_cannot_act_or_would_alarm(
    before: str, after: str, parts: tuple[str, ...]
) -> None:
    assert before in BENCH
    with pytest.raises(config.ConfigError) as found:
        config.parse(BENCH.replace(before, after))
    for part in parts:
        assert part in str(found.value)
