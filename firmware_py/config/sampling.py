"""How many samples of a turn there are, and up to which speed they suffice."""

from __future__ import annotations

from typing import Final

from firmware_py.config.schema import Config

PROTECTION: Final = 20
"""Samples a turn: with so many a peak-to-peak of one order reads 1.2 % low at worst."""

ANALYSIS: Final = 64
"""Samples a turn: orders up to the tenth, with six samples each, as in an analyser's spectrum."""


def samples_per_turn(config: Config) -> float:
    """At the greatest declared speed."""
    return config.sampling.rate_hz * 60.0 / config.machine.operating.speed_max_rpm


def highest_rpm(config: Config, samples: int) -> float:
    """Greatest speed with at least ``samples`` a turn."""
    return config.sampling.rate_hz * 60.0 / samples


def described(config: Config) -> str:
    """For people: how many there are, and up to which speed they suffice for what."""
    most_rpm = config.machine.operating.speed_max_rpm
    return (
        f"{samples_per_turn(config):.3g} samples a turn at {most_rpm:g} rpm; protection has its "
        f"{PROTECTION} up to {highest_rpm(config, PROTECTION):.0f} rpm, analysis of the orbit its "
        f"{ANALYSIS} up to {highest_rpm(config, ANALYSIS):.0f} rpm"
    )
