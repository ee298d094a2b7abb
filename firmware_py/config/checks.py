"""Values that contradict each other, or that the link cannot carry: refused with the arithmetic."""

from __future__ import annotations

from collections.abc import Iterator

from firmware_py.config.schema import Config
from firmware_py.config.source import ConfigFile
from firmware_py.records import CHANNELS, INSTANTS_PER_FRAME

Fault = tuple[str, object, str]
"""Key, value, cause with limit and next step."""

SERIAL_BYTES_PER_SAMPLE_FRAME = 74
"""One MAVLink 2 sample packet: 62 bytes of payload in a frame of 12."""

SERIAL_OVERHEAD_BYTES_S = 1350
"""The rig's other packets: node state and rig status 20 times a second, node info once."""

BUS_LOAD_LIMIT = 0.8
"""Share of the bus that sample frames may take."""


def check_related(config: Config, source: ConfigFile) -> None:
    """Raise :class:`~firmware_py.config.source.ConfigError` for the first contradiction found."""
    for check in (_geometry, _ranges, _limits, _timing, _channels, _capacity):
        for key, value, cause in check(config):
            raise source.error(key, value, cause)


def _geometry(config: Config) -> Iterator[Fault]:
    bearing, feed, actuator = config.bearing, config.feed, config.actuator
    low, high = bearing.radial_clearance_min_um, bearing.radial_clearance_max_um
    if low >= high:
        yield "bearing.radial_clearance_max_um", high, f"not above radial_clearance_min_um ({low:g})"
    for key, value in (
        ("bearing.radial_clearance_nominal_um", bearing.radial_clearance_nominal_um),
        ("actuator.safe_radial_clearance_um", actuator.safe_radial_clearance_um),
    ):
        if not low <= value <= high:
            yield key, value, f"outside the bearing's range {low:g} .. {high:g} um; choose one inside"
    if not feed.pressure_min_bar <= actuator.safe_pressure_bar <= feed.pressure_max_bar:
        span = f"{feed.pressure_min_bar:g} .. {feed.pressure_max_bar:g} bar"
        yield "actuator.safe_pressure_bar", actuator.safe_pressure_bar, f"outside the feed's range {span}"
    if feed.groove_area_min_mm2 > feed.groove_area_max_mm2:
        yield "feed.groove_area_min_mm2", feed.groove_area_min_mm2, (
            f"above groove_area_max_mm2 ({feed.groove_area_max_mm2:g}); exchange them")


def _ranges(config: Config) -> Iterator[Fault]:
    operating, oil = config.operating, config.oil
    for low_key, low, high_key, high in (
        (
            "operating.speed_min_rpm",
            operating.speed_min_rpm,
            "operating.speed_max_rpm",
            operating.speed_max_rpm,
        ),
        ("operating.load_min_N", operating.load_min_N, "operating.load_max_N", operating.load_max_N),
        ("oil.inlet_min_C", oil.inlet_min_C, "oil.inlet_max_C", oil.inlet_max_C),
        ("oil.inlet_max_C", oil.inlet_max_C, "oil.film_max_C", oil.film_max_C),
    ):
        if low > high:
            yield high_key, high, f"below {low_key} ({low:g}); raise it"


def _limits(config: Config) -> Iterator[Fault]:
    limits = config.limits
    diametral_um = 2 * config.bearing.radial_clearance_nominal_um
    for low_key, low, high_key, high in (
        (
            "displacement_alert_um",
            limits.displacement_alert_um,
            "displacement_danger_um",
            limits.displacement_danger_um,
        ),
        (
            "acceleration_alert_m_s2",
            limits.acceleration_alert_m_s2,
            "acceleration_danger_m_s2",
            limits.acceleration_danger_m_s2,
        ),
    ):
        if low >= high:
            yield f"limits.{low_key}", low, f"not below {high_key} ({high:g}); lower it"
    if limits.displacement_danger_um > 0.7 * diametral_um:
        yield (
            "limits.displacement_danger_um",
            limits.displacement_danger_um,
            (
                f"above 0.7 x diametral clearance ({diametral_um:g} um); lower it or set "
                "bearing.radial_clearance_nominal_um"
            ),
        )


def _timing(config: Config) -> Iterator[Fault]:
    actuator, rate_hz = config.actuator, config.sampling.rate_hz
    if actuator.command_period_ms * 3 > actuator.time_to_live_ms:
        yield (
            "actuator.command_period_ms",
            actuator.command_period_ms,
            (
                f"more than a third of time_to_live_ms ({actuator.time_to_live_ms}): two lost frames "
                "would expire the command; shorten it"
            ),
        )
    if 1_000_000 % rate_hz:
        yield "sampling.rate_hz", rate_hz, "its period is no whole number of us; use 5000 or 10000"


def _channels(config: Config) -> Iterator[Fault]:
    names = [channel.name for channel in config.channel]
    if names != list(CHANNELS):
        yield "channel", names, f"must be exactly {', '.join(CHANNELS)}, in this order"
    for index, channel in enumerate(config.channel):
        if channel.ok_low >= channel.ok_high:
            yield f"channel[{index}].ok_low", channel.ok_low, f"not below ok_high ({channel.ok_high:g})"
        if channel.scale == 0.0:
            yield f"channel[{index}].scale", channel.scale, "zero; give the SI value of one count"


def _capacity(config: Config) -> Iterator[Fault]:
    """Sampling rates that the link cannot carry."""
    rate_hz, bus = config.sampling.rate_hz, config.bus
    frames_s = rate_hz / INSTANTS_PER_FRAME
    if bus.link == "serial":
        if not bus.serial_port:
            yield "bus.serial_port", '""', 'empty with link = "serial"; name the port, e.g. "/dev/ttyUSB0"'
        needed = frames_s * SERIAL_BYTES_PER_SAMPLE_FRAME + SERIAL_OVERHEAD_BYTES_S
        room = bus.serial_baud / 10 * 0.95
        if needed > room:
            yield (
                "sampling.rate_hz",
                rate_hz,
                (
                    f"needs {frames_s:.0f} packets/s x {SERIAL_BYTES_PER_SAMPLE_FRAME} bytes + "
                    f"{SERIAL_OVERHEAD_BYTES_S} = {needed:.0f} bytes/s, but {bus.serial_baud} baud carries "
                    f"{room:.0f} (10 bits a byte, 95 %); lower the rate or raise bus.serial_baud"
                ),
            )
        return
    load = frames_s * can_frame_seconds(bus.nominal_bitrate, bus.data_bitrate)
    if load > BUS_LOAD_LIMIT:
        yield (
            "sampling.rate_hz",
            rate_hz,
            (
                f"{frames_s:.0f} CAN FD frames/s of 64 bytes take {100 * load:.0f} % of a bus at "
                f"{bus.nominal_bitrate}/{bus.data_bitrate} bit/s (limit {100 * BUS_LOAD_LIMIT:.0f} %); "
                "lower the rate or raise bus.data_bitrate"
            ),
        )


def can_frame_seconds(nominal_bitrate: int, data_bitrate: int) -> float:
    """Longest time of one 64-byte CAN FD frame with an 11-bit identifier, stuff bits included.

    ISO 11898-1: 30 bits at the nominal rate (start, identifier, flags, acknowledge, end, interframe) and
    5 + 512 + 28 at the data rate (flags, length, data, counted CRC); one stuff bit in five at worst.
    """
    nominal_bits, data_bits, stuffing = 30, 5 + 64 * 8 + 28, 1.2
    return stuffing * (nominal_bits / nominal_bitrate + data_bits / data_bitrate)
