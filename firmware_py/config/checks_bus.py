"""Times that do not fit together, and sampling that the link or a turn of the shaft has no room
for."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from firmware_py import signals
from firmware_py.config.convert import Found
from firmware_py.config.instances import frame_instants
from firmware_py.config.sampling import PROTECTION, highest_rpm
from firmware_py.config.schema import Config

SERIAL_BYTES_PER_SAMPLE_FRAME: Final = {1: 74, 2: 75}
"""One MAVLink 2 sample packet, by wire schema: 62 or 63 bytes of payload in a frame of 12."""

SERIAL_OVERHEAD_BYTES_S: Final = {1: 1350, 2: 13_000}
"""The rig's other packets: node state and readings (schema 2: up to 8 pages) 20 times a second,
node info once."""

BUS_LOAD_LIMIT: Final = 0.8
"""Share of the bus that sample frames may take."""

BLOCK_S: Final = (0.002, 0.05)
"""Protection judges once a block: often enough beside its window of 0.1 s, and no more than every
other cycle."""

WINDOW_BLOCKS_MAX: Final = 250
"""Blocks of the longest window of protection, all of which it goes through at each block."""

FRESH_FRAMES_MIN: Final = 3
"""Frames that may be missing in a row before samples are stale."""

FRAMES_LOST: Final = 3
"""Periods of commands in a time to live: two lost frames do not expire it."""

INTERFACE_NAME_MAX: Final = 15
"""Longest name of a network interface in Linux."""


def _commands(config: Config) -> Iterator[Found]:
    actuator = config.machine.actuator
    if actuator.command_period_ms * FRAMES_LOST > actuator.time_to_live_ms:
        yield (
            "machine.actuator.command_period_ms",
            actuator.command_period_ms,
            (
                f"more than a third of time_to_live_ms ({actuator.time_to_live_ms}): two lost "
                f"frames would expire the "
                "command; shorten it"
            ),
        )


def _freshness(config: Config) -> Iterator[Found]:
    """Samples that are called fresh still carry a command through the node's time to live."""
    fresh_ms, actuator = config.sampling.fresh_age_ms, config.machine.actuator
    most_ms = actuator.time_to_live_ms - actuator.command_period_ms
    if fresh_ms > most_ms:
        yield (
            "sampling.fresh_age_ms",
            fresh_ms,
            (
                f"above {most_ms} ms, machine.actuator.time_to_live_ms less command_period_ms: the "
                "node would refuse commands that rest on such samples; shorten it"
            ),
        )


def _frames(config: Config) -> Iterator[Found]:
    fresh_ms = config.sampling.fresh_age_ms
    least_ms = FRESH_FRAMES_MIN * frame_instants(config) * 1e3 / config.sampling.rate_hz
    if fresh_ms < least_ms:
        yield (
            "sampling.fresh_age_ms",
            fresh_ms,
            (
                f"below {least_ms:g} ms, {FRESH_FRAMES_MIN} frames at sampling.rate_hz = "
                f"{config.sampling.rate_hz}: "
                "samples would never be fresh for long; lengthen it or raise the rate"
            ),
        )


def _period(config: Config) -> Iterator[Found]:
    if 1_000_000 % config.sampling.rate_hz:
        yield (
            "sampling.rate_hz",
            config.sampling.rate_hz,
            "its period is no whole number of us; use 5000 or 10000",
        )


def _turns(config: Config) -> Iterator[Found]:
    """Enough samples for protection; those for analysis are told by ``orbitd check``."""
    rate_hz, fastest_rpm = config.sampling.rate_hz, config.machine.operating.speed_max_rpm
    least_hz = PROTECTION * fastest_rpm / 60.0
    if rate_hz < least_hz:
        yield (
            "sampling.rate_hz",
            rate_hz,
            (
                f"below {least_hz:g}, {PROTECTION} samples a turn at "
                f"machine.operating.speed_max_rpm = {fastest_rpm:g}; raise it, or lower the speed "
                f"to {highest_rpm(config, PROTECTION):g} rpm"
            ),
        )


def _blocks(config: Config) -> Iterator[Found]:
    sampling = config.sampling
    block_s = sampling.frames_per_block * frame_instants(config) / sampling.rate_hz
    low_s, high_s = BLOCK_S
    if not low_s <= block_s <= high_s:
        step = "raise it" if block_s < low_s else "lower it"
        yield (
            "sampling.frames_per_block",
            sampling.frames_per_block,
            (
                f"a block of {block_s * 1e3:g} ms, allowed {low_s * 1e3:g} .. {high_s * 1e3:g} ms; "
                f"{step}"
            ),
        )
    blocks = 60.0 / config.limits.min_speed_rpm / block_s
    if blocks > WINDOW_BLOCKS_MAX:
        yield (
            "limits.min_speed_rpm",
            config.limits.min_speed_rpm,
            (
                f"a turn of {blocks:.0f} blocks, at most {WINDOW_BLOCKS_MAX}; raise it or "
                f"sampling.frames_per_block"
            ),
        )


def _link(config: Config) -> Iterator[Found]:
    """Names of the port and the interface."""
    bus = config.bus
    if bus.link == "serial" and not bus.serial_port:
        yield (
            "bus.serial_port",
            '""',
            'empty with link = "serial"; name the port, e.g. "/dev/ttyUSB0"',
        )
    if bus.link == "can" and bus.interface == "socketcan" and len(bus.channel) > INTERFACE_NAME_MAX:
        cause = f"longer than {INTERFACE_NAME_MAX} characters; name a CAN interface, e.g. can0"
        yield "bus.channel", bus.channel, cause


def _capacity(config: Config) -> Iterator[Found]:
    """Sampling rates that the link cannot carry."""
    rate_hz, bus = config.sampling.rate_hz, config.bus
    frames_s = rate_hz / frame_instants(config)
    if bus.link == "serial":
        each, other = (
            table[bus.schema] for table in (SERIAL_BYTES_PER_SAMPLE_FRAME, SERIAL_OVERHEAD_BYTES_S)
        )
        needed = frames_s * each + other
        room = bus.serial_baud / 10 * 0.95
        if needed > room:
            yield (
                "sampling.rate_hz",
                rate_hz,
                (
                    f"needs {frames_s:.0f} packets/s x {each} bytes + "
                    f"{other} = {needed:.0f} bytes/s, but {bus.serial_baud} baud "
                    f"carries {room:.0f} "
                    "(10 bits a byte, 95 %); lower the rate or raise bus.serial_baud"
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
                f"{bus.nominal_bitrate}/{bus.data_bitrate} bit/s (limit {100 * BUS_LOAD_LIMIT:.0f} "
                f"%); lower the rate or "
                "raise bus.data_bitrate"
            ),
        )


def can_frame_seconds(nominal_bitrate: int, data_bitrate: int) -> float:
    """Longest time of one 64-byte CAN FD frame with an 11-bit identifier, stuff bits included.

    ISO 11898-1: 30 bits at the nominal rate (start, identifier, flags, acknowledge, end,
    interframe) and 5 + 512 + 28 at the data rate (flags, length, data, counted CRC); one stuff bit
    in five at worst.
    """
    nominal_bits, data_bits, stuffing = 30, 5 + 64 * 8 + 28, 1.2
    return stuffing * (nominal_bits / nominal_bitrate + data_bits / data_bitrate)


def _layout(config: Config) -> Iterator[Found]:
    """What wire schema 2 can carry."""
    if config.bus.schema == 1:
        return
    n, rate_hz = len(config.machine.channel), config.sampling.rate_hz
    low, high = signals.CHANNELS_RANGE
    if not low <= n <= high:
        yield (
            "machine.channel",
            n,
            f"{n} channels, the wire carries {low} .. {high}; correct the list",
        )
    if n * rate_hz > signals.VALUES_PER_S_MAX:
        yield (
            "sampling.rate_hz",
            rate_hz,
            f"{n} channels make {n * rate_hz} samples/s, at most {signals.VALUES_PER_S_MAX}; lower "
            f"the rate or leave out channels",
        )
    least_hz = 1_000_000 // signals.SPAN_MAX_US
    if rate_hz < least_hz:
        cause = f"below {least_hz}: a frame spans at most {signals.SPAN_MAX_US} us; raise it"
        yield "sampling.rate_hz", rate_hz, cause


BUS_CHECKS: Final = (
    _layout, _commands, _freshness, _frames, _period, _turns, _blocks, _link, _capacity,
)  # fmt: skip
