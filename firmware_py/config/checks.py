"""Values that contradict each other: each check yields key, value, and the cause with its limit and
the next step.

A check reads what it needs from the configuration; where that has a fault of its own it is left
out.  A new one is a generator and its name in :data:`RELATED`: all run, and all that they find is
told at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import pi
from operator import attrgetter
from typing import Any, Final

from firmware_py.config.checks_bearings import BEARING_CHECKS
from firmware_py.config.checks_bus import BUS_CHECKS
from firmware_py.config.checks_channel import CHANNEL_CHECKS
from firmware_py.config.checks_feeds import FEED_CHECKS
from firmware_py.config.checks_machine import MACHINE_CHECKS
from firmware_py.config.checks_measures import MEASURE_CHECKS
from firmware_py.config.checks_network import NETWORK_CHECKS
from firmware_py.config.checks_oil import OIL_CHECKS
from firmware_py.config.convert import Found
from firmware_py.config.schema import Config
from firmware_py.machine.parts import ACTUATOR, has

ORDERED: Final = (
    ("machine.bearing.radial_clearance_min_um", "machine.bearing.radial_clearance_max_um", True),
    (
        "machine.bearing.radial_clearance_min_um",
        "machine.bearing.radial_clearance_nominal_um",
        False,
    ),
    (
        "machine.bearing.radial_clearance_nominal_um",
        "machine.bearing.radial_clearance_max_um",
        False,
    ),
    ("machine.bearing.radial_clearance_min_um", "machine.actuator.safe_radial_clearance_um", False),
    ("machine.actuator.safe_radial_clearance_um", "machine.bearing.radial_clearance_max_um", False),
    ("machine.feed.pressure_min_bar", "machine.feed.pressure_max_bar", False),
    ("machine.feed.pressure_min_bar", "machine.actuator.safe_pressure_bar", False),
    ("machine.actuator.safe_pressure_bar", "machine.feed.pressure_max_bar", False),
    ("machine.feed.groove_area_min_mm2", "machine.feed.groove_area_max_mm2", False),
    ("machine.operating.speed_min_rpm", "machine.operating.speed_max_rpm", True),
    ("machine.operating.load_min_N", "machine.operating.load_max_N", False),
    (
        "machine.operating.speed_ramp_unannounced_rpm_s",
        "machine.operating.speed_ramp_max_rpm_s",
        False,
    ),
    ("limits.min_speed_rpm", "machine.operating.speed_min_rpm", False),
    ("machine.lubricant.inlet_min_C", "machine.lubricant.inlet_max_C", False),
    ("machine.lubricant.inlet_max_C", "machine.lubricant.film_max_C", False),
    ("limits.displacement_alert_um", "limits.displacement_danger_um", True),
    ("limits.acceleration_alert_m_s2", "limits.acceleration_danger_m_s2", True),
    ("bus.nominal_bitrate", "bus.data_bitrate", False),
)
"""Key, key that it must not exceed, and whether they must differ."""

CLEARANCE_RATIO_MAX: Final = 0.02
CLEARANCE_RATIO_MIN: Final = 1e-4
"""Of the journal radius: thin-film theory ends above, and below heat takes up what is left."""

SPEED_HIGH_SHARES: Final = (1.03, 1.25)
"""Of the greatest declared speed: above where authority ends, and where a rotor is still whole."""

FILM_SHARE_MAX: Final = 0.8
"""Of the narrowest bearing: a film limit above leaves the shaft no place to be."""

RETREAT_MAX_S: Final = 10.0
"""Time to the retreat clearance from anywhere.  The guard looks this far ahead in steps of 0.05 to
0.1 s."""

FOLLOWING_SHARE_MAX: Final = 0.5
"""Of the range of the clearance: a following error above is not reached by every actuator that
stands still."""

UNBALANCE_SHARE_MAX: Final = 10.0
"""Of the largest load: an unbalance force above is no normal unbalance."""

WINDAGE_MAX_W: Final = 1e6

OIL_NODE_S: Final = (0.1, 3600.0)
"""Time constant of the oil behind the thermometer."""


def _ordered(low_key: str, high_key: str, differ: bool) -> Callable[[Config], Iterator[Found]]:
    """The check of one row of :data:`ORDERED`."""

    def check(config: Config) -> Iterator[Found]:
        low, high = attrgetter(low_key)(config), attrgetter(high_key)(config)
        fixed = low_key.endswith(".radial_clearance_min_um") and not has(config.machine, ACTUATOR)
        if low > high or (differ and not fixed and low == high):
            word = "not above" if differ else "below"
            yield high_key, high, f"{word} {low_key} = {low:g}; raise it, or lower the other"

    return check


def _shape(config: Config) -> Iterator[Found]:
    """Clearances beside the size of the journal."""
    bearing = config.machine.bearing
    low_um, high_um = (
        share * bearing.journal_radius_m * 1e6
        for share in (CLEARANCE_RATIO_MIN, CLEARANCE_RATIO_MAX)
    )
    if bearing.radial_clearance_min_um < low_um:
        yield (
            "machine.bearing.radial_clearance_min_um",
            bearing.radial_clearance_min_um,
            (
                f"below {low_um:g} um, {CLEARANCE_RATIO_MIN:g} of "
                "machine.bearing.journal_radius_m; widen it"
            ),
        )
    if bearing.radial_clearance_max_um > high_um:
        yield (
            "machine.bearing.radial_clearance_max_um",
            bearing.radial_clearance_max_um,
            (
                f"above {high_um:g} um, {CLEARANCE_RATIO_MAX:g} of "
                "machine.bearing.journal_radius_m; narrow it"
            ),
        )


def _built(config: Config) -> Iterator[Found]:
    """What a lift check may find leaves a bearing."""
    b = config.machine.bearing
    narrowest_um = (
        b.radial_clearance_min_um + b.radial_clearance_offset_um - b.radial_clearance_error_um
    )
    film_um = config.limits.min_film_um
    if narrowest_um <= 0.0:
        yield (
            "machine.bearing.radial_clearance_min_um",
            b.radial_clearance_min_um,
            (
                f"the film at rest may be {narrowest_um:g} um: radial_clearance_min_um "
                f"{b.radial_clearance_min_um:g} + offset {b.radial_clearance_offset_um:g} - error "
                f"{b.radial_clearance_error_um:g}; the shaft would not go in: measure the bearing"
            ),
        )
        return
    if film_um > FILM_SHARE_MAX * narrowest_um:
        yield (
            "limits.min_film_um",
            film_um,
            (
                f"above {FILM_SHARE_MAX:g} of the narrowest bearing, {narrowest_um:g} um "
                f"(machine.bearing.radial_clearance_min_um "
                "+ offset - error); lower it or widen the bearing"
            ),
        )


def _groove(config: Config) -> Iterator[Found]:
    bearing, area_mm2 = config.machine.bearing, config.machine.feed.groove_area_max_mm2
    projected_mm2 = 2.0 * bearing.journal_radius_m * bearing.length_m * 1e6
    if area_mm2 > projected_mm2:
        yield (
            "machine.feed.groove_area_max_mm2",
            area_mm2,
            (f"above the whole projected bearing, {projected_mm2:g} mm2; lower it"),
        )


def _oil_node(config: Config) -> Iterator[Found]:
    """A thermal node whose forecast neither jumps nor stands still."""
    capacity, cooling = (
        config.machine.lubricant.thermal_capacity_J_K,
        config.machine.lubricant.cooling_W_K,
    )
    low_s, high_s = OIL_NODE_S
    if capacity > 0.0 and not low_s * cooling <= capacity <= high_s * cooling:
        yield (
            "machine.lubricant.thermal_capacity_J_K",
            capacity,
            (
                f"its time constant over machine.lubricant.cooling_W_K = {cooling:g} is outside "
                f"{low_s:g} .. {high_s:g} s; correct one of them, or set 0 for no forecast of the "
                "oil"
            ),
        )


def _speed_high(config: Config) -> Iterator[Found]:
    """A trip speed above what the machine runs at, and not far above."""
    limit_rpm = config.limits.speed_high_rpm
    low_rpm, high_rpm = (
        share * config.machine.operating.speed_max_rpm for share in SPEED_HIGH_SHARES
    )
    if limit_rpm and not low_rpm <= limit_rpm <= high_rpm:
        yield (
            "limits.speed_high_rpm",
            limit_rpm,
            (
                f"outside {low_rpm:g} .. {high_rpm:g} rpm, {SPEED_HIGH_SHARES[0]:g} to "
                f"{SPEED_HIGH_SHARES[1]:g} of "
                "machine.operating.speed_max_rpm; choose one inside, or 0 for 1.1"
            ),
        )


def _retreat(config: Config) -> Iterator[Found]:
    """The way back to the retreat clearance ends in time."""
    b, a = config.machine.bearing, config.machine.actuator
    safe_um = a.safe_radial_clearance_um
    way_um = max(b.radial_clearance_max_um - safe_um, safe_um - b.radial_clearance_min_um)
    if way_um > RETREAT_MAX_S * a.rate_um_s:
        yield (
            "machine.actuator.rate_um_s",
            a.rate_um_s,
            (
                f"{way_um:g} um to the safe clearance take {way_um / a.rate_um_s:.3g} s, at most "
                f"{RETREAT_MAX_S:g}; narrow "
                "machine.bearing.radial_clearance_min_um .. max_um or take a faster actuator"
            ),
        )


def _following(config: Config) -> Iterator[Found]:
    """Errors of the actuator, and reversals of its target, that there can be."""
    a, b, feed = config.machine.actuator, config.machine.bearing, config.machine.feed
    most_um = FOLLOWING_SHARE_MAX * (b.radial_clearance_max_um - b.radial_clearance_min_um)
    if a.following_error_um > most_um:
        yield (
            "machine.actuator.following_error_um",
            a.following_error_um,
            (
                f"above {most_um:g} um, {FOLLOWING_SHARE_MAX:g} of the bearing's range, an "
                f"actuator that stands still is "
                "hardly further off; lower it"
            ),
        )
    if a.following_error_bar > feed.pressure_min_bar:
        yield (
            "machine.actuator.following_error_bar",
            a.following_error_bar,
            (
                f"above machine.feed.pressure_min_bar ({feed.pressure_min_bar:g}), a supply that "
                "has failed is off by no more; lower it"
            ),
        )
    most = 30_000 // a.command_period_ms
    if a.reversals_per_minute_max > most:
        yield (
            "machine.actuator.reversals_per_minute_max",
            a.reversals_per_minute_max,
            (
                f"above {most}, half of the commands of a minute "
                "(machine.actuator.command_period_ms); lower it"
            ),
        )


def _unbalance(config: Config) -> Iterator[Found]:
    rotor, o = config.machine.rotor, config.machine.operating
    w = o.speed_max_rpm * pi / 30.0
    force_N, most_N = rotor.unbalance_normal_kg_m * w * w, UNBALANCE_SHARE_MAX * o.load_max_N
    if force_N > most_N:
        yield (
            "machine.rotor.unbalance_normal_kg_m",
            rotor.unbalance_normal_kg_m,
            (
                f"turns with {force_N:.3g} N at machine.operating.speed_max_rpm, more than "
                f"{UNBALANCE_SHARE_MAX:g} times "
                f"load_max_N ({most_N:.3g} N); balance the rotor or lower the speed"
            ),
        )


def _windage(config: Config) -> Iterator[Found]:
    """Windage that leaves the shaft power something of the film."""
    w = config.machine.operating.speed_max_rpm * pi / 30.0
    power_W = config.machine.rotor.windage_W_s3 * w * w * w
    if power_W > WINDAGE_MAX_W:
        yield (
            "machine.rotor.windage_W_s3",
            config.machine.rotor.windage_W_s3,
            (
                f"{power_W:.3g} W at machine.operating.speed_max_rpm, at most {WINDAGE_MAX_W:g}; "
                "correct its unit"
            ),
        )


RELATED: Final[tuple[Callable[[Any], Iterator[Found]], ...]] = (
    *(_ordered(*row) for row in ORDERED),
    _shape,
    _built,
    _groove,
    _oil_node,
    _speed_high,
    _retreat,
    _following,
    _unbalance,
    _windage,
    *MACHINE_CHECKS,
    *FEED_CHECKS,
    *BEARING_CHECKS,
    *OIL_CHECKS,
    *CHANNEL_CHECKS,
    *MEASURE_CHECKS,
    *BUS_CHECKS,
    *NETWORK_CHECKS,
)
"""Every check of values together."""
