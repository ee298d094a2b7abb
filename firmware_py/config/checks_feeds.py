"""Openings of the feed that can be built: complete, on the bearing, none over another, and with a
restrictor that its law holds for."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import combinations
from math import degrees, pi
from typing import Final

from firmware_py.config.convert import Found
from firmware_py.config.schema import Config
from firmware_py.machine.feeds import CAPILLARY, GROOVE, ORIFICE, RESTRICTED, FeedPort
from firmware_py.machine.parts import FEED, has
from firmware_py.machine.restrictor import Opening, opening

BORES_MIN: Final = 20.0
"""Length of a capillary over its bore: below, its entrance counts."""

_DRAWN: Final = ("groove_angle_deg", "groove_width_deg", "groove_length_share",
                 "groove_area_min_mm2", "groove_area_max_mm2")  # fmt: skip


def _complete(config: Config) -> Iterator[Found]:
    """Each kind has its figures, and none of another's."""
    for i, port in enumerate(config.machine.feed_port):
        place = f"machine.feed_port[{i}]"
        needed = {
            "bore_mm": port.kind in RESTRICTED or (port.kind != GROOVE and not _recessed(port)),
            "capillary_length_mm": port.kind == CAPILLARY,
            "recess_width_deg": port.kind == GROOVE or port.recess_length_mm is not None,
            "recess_length_mm": port.kind == GROOVE or port.recess_width_deg is not None,
        }
        for key, must in needed.items():
            if must and getattr(port, key) is None:
                yield f"{place}.{key}", None, f"missing of this {port.kind}; set it"
        if port.kind != CAPILLARY and port.capillary_length_mm is not None:
            cause = f'a {port.kind} has no length; remove it, or write kind = "capillary"'
            yield f"{place}.capillary_length_mm", port.capillary_length_mm, cause
        if port.kind != ORIFICE and port.discharge_coefficient != 0.61:
            cause = f'a {port.kind} has none; remove it, or write kind = "orifice"'
            yield f"{place}.discharge_coefficient", port.discharge_coefficient, cause
        if port.pressure_bar is None and not has(config.machine, FEED):
            yield f"{place}.pressure_bar", None, "missing, and so is [feed]; set one of them"


def _recessed(port: FeedPort) -> bool:
    return port.recess_width_deg is not None or port.recess_length_mm is not None


def _capillary(config: Config) -> Iterator[Found]:
    for i, port in enumerate(config.machine.feed_port):
        bore, length = port.bore_mm, port.capillary_length_mm
        if port.kind == CAPILLARY and bore and length and length < BORES_MIN * bore:
            yield (
                f"machine.feed_port[{i}].capillary_length_mm",
                length,
                f"{length / bore:.3g} bores, below {BORES_MIN:g}: the law of a capillary leaves "
                f"out its entrance; lengthen it to {BORES_MIN * bore:g}, or describe an orifice",
            )


def _on_the_bearing(config: Config) -> Iterator[Found]:
    bearing = config.machine.bearing
    half_m = 0.5 * bearing.length_m
    for i, port in enumerate(config.machine.feed_port):
        place, at = f"machine.feed_port[{i}]", opening(port, bearing.journal_radius_m)
        reach_m = abs(at.axial_m) + 0.5 * at.length_m
        if reach_m > half_m or (port.kind != GROOVE and reach_m == half_m):
            yield (
                f"{place}.axial_mm",
                port.axial_mm,
                f"the opening reaches {1e3 * reach_m:g} mm from the middle of the bearing, which "
                f"ends at {1e3 * half_m:g} (half of bearing.length_m); shorten or move it",
            )
        bore_m = 1e-3 * (port.bore_mm or 0.0)
        least_m = min(at.length_m, at.width_rad * bearing.journal_radius_m)
        if bore_m > 1.001 * least_m > 0.0:
            yield (
                f"{place}.bore_mm",
                port.bore_mm,
                f"wider than the recess that it opens into, {1e3 * least_m:g} mm; lower it",
            )


def _apart(config: Config) -> Iterator[Found]:
    """No opening lies over another."""
    radius_m = config.machine.bearing.journal_radius_m
    places = [opening(port, radius_m) for port in config.machine.feed_port]
    for (i, one), (k, other) in combinations(enumerate(places), 2):
        if _overlap(one, other):
            yield (
                f"machine.feed_port[{k}].angle_deg",
                config.machine.feed_port[k].angle_deg,
                f"lies over feed_port[{i}] at {degrees(one.angle_rad):g} deg; move one of them",
            )


def _overlap(one: Opening, other: Opening) -> bool:
    turn = abs(one.angle_rad - other.angle_rad) % (2.0 * pi)
    around = min(turn, 2.0 * pi - turn) < 0.5 * (one.width_rad + other.width_rad)
    return around and abs(one.axial_m - other.axial_m) < 0.5 * (one.length_m + other.length_m)


def _told_once(config: Config) -> Iterator[Found]:
    """Not beside the groove of [feed]."""
    if not config.machine.feed_port:
        return
    for key in _DRAWN:
        value = getattr(config.machine.feed, key)
        if value:
            cause = "stands beside [[feed_port]], which tells of every opening; remove one of them"
            yield f"machine.feed.{key}", value, cause


FEED_CHECKS: Final[tuple[Callable[[Config], Iterator[Found]], ...]] = (
    _complete,
    _capillary,
    _on_the_bearing,
    _apart,
    _told_once,
)
