"""Limits of the oil and ranges of the slow readings: within what is declared, and within what can
be read."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

from firmware_py.config.convert import Found
from firmware_py.config.schema import Config

PRESSURE_SEEN_BAR: Final = 0.05
"""What zero and noise of a pressure sensor leave of a supply that has failed."""


def _pressure(config: Config) -> Iterator[Found]:
    """Limits of low supply pressure, as set or as they follow from the feed."""
    alert_bar, danger_bar = config.oil_pressure_limits_bar
    if danger_bar >= alert_bar > 0.0:
        yield (
            "limits.oil_pressure_low_danger_bar",
            danger_bar,
            (f"not below oil_pressure_low_alert_bar ({alert_bar:g}); lower it"),
        )
    if danger_bar < PRESSURE_SEEN_BAR:
        yield (
            "limits.oil_pressure_low_danger_bar",
            danger_bar,
            (
                f"below {PRESSURE_SEEN_BAR:g} bar, a supply that has failed does not show less; "
                f"raise it, and "
                "machine.feed.pressure_min_bar above it"
            ),
        )
    if alert_bar > config.machine.feed.pressure_min_bar:
        yield (
            "limits.oil_pressure_low_alert_bar",
            alert_bar,
            (
                f"above machine.feed.pressure_min_bar ({config.machine.feed.pressure_min_bar:g}), "
                "which may be commanded; lower it"
            ),
        )


def _outlet(config: Config) -> Iterator[Found]:
    """Limits of a hot outlet, as set or as they follow from the film."""
    oil, (alert_C, danger_C) = config.machine.lubricant, config.oil_outlet_limits_C
    if alert_C >= danger_C:
        yield (
            "limits.oil_outlet_high_alert_C",
            alert_C,
            (f"not below oil_outlet_high_danger_C ({danger_C:g}); lower it"),
        )
    if alert_C < oil.inlet_max_C:
        yield (
            "limits.oil_outlet_high_alert_C",
            alert_C,
            (
                f"below machine.lubricant.inlet_max_C ({oil.inlet_max_C:g}): oil as declared would "
                "alarm; raise it"
            ),
        )
    if alert_C > oil.film_max_C:
        yield (
            "limits.oil_outlet_high_alert_C",
            alert_C,
            (
                f"above machine.lubricant.film_max_C ({oil.film_max_C:g}), up to which the film is "
                "proven; lower it"
            ),
        )
    if danger_C >= config.machine.readings.oil_outlet_max_C:
        yield (
            "machine.readings.oil_outlet_max_C",
            config.machine.readings.oil_outlet_max_C,
            (
                f"not above limits.oil_outlet_high_danger_C ({danger_C:g}), which could not be "
                f"read; raise it"
            ),
        )


def _readings(config: Config) -> Iterator[Found]:
    """Ranges that would refuse what is declared."""
    readings, oil, feed = config.machine.readings, config.machine.lubricant, config.machine.feed
    if readings.oil_outlet_min_C >= oil.inlet_min_C:
        yield (
            "machine.readings.oil_outlet_min_C",
            readings.oil_outlet_min_C,
            (f"not below machine.lubricant.inlet_min_C ({oil.inlet_min_C:g}); lower it"),
        )
    most_bar = readings.pressure_max_bar
    if 0.0 < most_bar <= feed.pressure_max_bar:
        yield (
            "machine.readings.pressure_max_bar",
            most_bar,
            (
                f"not above machine.feed.pressure_max_bar ({feed.pressure_max_bar:g}), which may "
                "be commanded; raise it"
            ),
        )


OIL_CHECKS: Final[tuple[Callable[[Config], Iterator[Found]], ...]] = (_pressure, _outlet, _readings)
