"""What the oil supply can give, and how long it lasts once the pump is lost.

The pump (or the relief valve behind it) gives ``p0`` at no flow and ``p0 (1 - Q / Q_max)`` at the
flow ``Q``.  After its loss the check valve closes and the accumulator feeds the bearing: the
pressure falls with one time constant, ``p = p1 exp(-t / hold_up)``.
"""

from __future__ import annotations

from math import inf, log, pi
from typing import Final

from firmware_py.machine.feeds import RESTRICTED
from firmware_py.machine.lubricant import viscosity_Pa_s
from firmware_py.machine.restrictor import restrictor
from firmware_py.machine.schema import ClearanceActuator, Feed, Machine

READING_S: Final = 0.1
"""Age of a slow reading: a period of 50 ms, and once that again."""

FULL_SHARE: Final = 0.5
"""Of the least pressure that may be set: where the film is no longer full, where nobody says."""


def nominal_bar(feed: Feed) -> float:
    """Supply pressure of normal service; where nobody says, the middle of its range."""
    middle = 0.5 * (feed.pressure_min_bar + feed.pressure_max_bar)
    return middle if feed.pressure_nominal_bar is None else feed.pressure_nominal_bar


def full_film_bar(feed: Feed) -> float:
    """Supply pressure below which the film is not full."""
    return FULL_SHARE * feed.pressure_min_bar if feed.full_film_bar is None else feed.full_film_bar


def flow_most_m3_s(machine: Machine) -> float:
    """The most that can run off at the ends of the film, or through its feeds.

    The journal drags ``U (c + e) L / 2`` in at the widest gap and ``U (c - e) L / 2`` out at the
    narrowest, ``U = w R``: what leaves between is ``w R L e``, less than with ``e = c``.
    Restrictors let through the most into a film without pressure, and the most at once with the
    film ``2 c`` wide at each.
    """
    b, w = machine.bearing, machine.operating.speed_max_rpm * pi / 30.0
    clearance_m = 1e-6 * (
        b.radial_clearance_max_um + b.radial_clearance_offset_um + b.radial_clearance_error_um
    )
    dragged = w * b.journal_radius_m * b.length_m * clearance_m
    return max(dragged, restricted_m3_s(machine, 2.0 * clearance_m))


def restricted_m3_s(machine: Machine, film_m: float) -> float:
    """What all restrictors together let through at the greatest supply pressure into a film of that
    thickness without pressure, in the thinnest lubricant."""
    oil, radius_m = machine.lubricant, machine.bearing.journal_radius_m
    mu = viscosity_Pa_s(oil, oil.film_max_C)
    total = 0.0
    for port in machine.feed_port:
        law = restrictor(port, radius_m, oil.density_kg_m3)
        if port.kind in RESTRICTED and any(law[:4]) and port.pressure_bar is None:
            drop_Pa = 1e5 * machine.feed.pressure_max_bar
            total += law.flow_m3_s(drop_Pa, mu, film_m)
    return total


def source_bar(machine: Machine) -> float:
    """What the weakest credible pump still gives at the greatest flow of the film; infinite where
    the pump is not described."""
    feed = machine.feed
    if feed.pump_shut_off_bar is None or feed.pump_flow_max_m3_s is None:
        return inf
    weakest = 1.0 - feed.pump_error_share
    left = 1.0 - flow_most_m3_s(machine) / (weakest * feed.pump_flow_max_m3_s)
    return weakest * feed.pump_shut_off_bar * max(0.0, left)


def held_s(feed: Feed, from_bar: float) -> float:
    """How long after the loss of the pump, with the shortest credible hold-up, the film stays full
    once the pressure has fallen to ``from_bar``."""
    full_bar = full_film_bar(feed)
    if from_bar <= full_bar:
        return 0.0
    if full_bar == 0.0:
        return inf
    return (1.0 - feed.pump_error_share) * feed.hold_up_s * log(from_bar / full_bar)


def retreat_s(machine: Machine) -> float:
    """From an alarm until the clearance is back at its retreat value, from anywhere.

    A reading is up to one period old, the last command lives for its time to live, and the actuator
    runs at its rate behind its lag.
    """
    b, a = machine.bearing, machine.actuator
    safe_um = a.safe_radial_clearance_um
    way_um = max(b.radial_clearance_max_um - safe_um, safe_um - b.radial_clearance_min_um)
    return way_um / a.rate_um_s + a.time_to_live_ms * 1e-3 + a.time_constant_s + READING_S


def target_slew_bar_s(machine: Machine) -> float:
    """The fastest that the pressure's target may move: its whole range in one time constant, and no
    faster than the slowest credible supply."""
    feed, lag_s = machine.feed, machine.actuator.pressure_time_constant_s
    most = (feed.pressure_max_bar - feed.pressure_min_bar) / lag_s
    slew = slowest_slew_bar_s(machine.actuator)
    return most if slew is None else min(most, slew)


def slowest_slew_bar_s(actuator: ClearanceActuator) -> float | None:
    """The slowest credible slew of the pressure; None where none is declared."""
    slew = actuator.pressure_slew_bar_s
    return None if slew is None else slew * (1.0 - actuator.pressure_error_share)


def slowest_s(actuator: ClearanceActuator) -> tuple[float, float]:
    """Longest credible dead time and time constant of the pressure."""
    longer = 1.0 + actuator.pressure_error_share
    return actuator.pressure_dead_time_s * longer, actuator.pressure_time_constant_s * longer
