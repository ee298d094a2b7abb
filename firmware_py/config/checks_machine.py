"""Figures of the machine that belong together: its drawing, and where each figure comes from."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

from msgspec import inspect

from firmware_py.config.convert import Found
from firmware_py.config.schema import Config
from firmware_py.machine import Machine
from firmware_py.machine.parts import monitor_only
from firmware_py.machine.static import shaft_beyond_m
from firmware_py.machine.supply import flow_most_m3_s, held_s, retreat_s, source_bar
from firmware_py.machine.values import MachineTable

SAME_ROTOR: Final = (0.5, 2.0)
"""Weighed over drawn effective mass: outside it is another rotor, or another unit."""

SLENDER_MAX: Final = 200.0
"""Length between coupling and bearing over the journal radius: long turbine shafts have 60."""

DRAWING: Final = ("mass_kg", "diametral_inertia_kg_m2", "coupling_to_cg_m", "bearing_to_cg_m")
"""Keys of ``rotor`` from which its effective mass follows."""

PUMP: Final = ("pump_shut_off_bar", "pump_flow_max_m3_s")

GROOVE: Final = ("groove_angle_deg", "groove_width_deg", "groove_length_share")


def _tables() -> Iterator[tuple[str, tuple[str, ...]]]:
    """Tables of ``machine.toml``, and the keys of each for its figures."""
    described = inspect.type_info(Machine)
    assert isinstance(described, inspect.StructType)
    for field in described.fields:
        kinds = field.type.types if isinstance(field.type, inspect.UnionType) else (field.type,)
        kind = kinds[0].item_type if isinstance(kinds[0], inspect.ListType) else kinds[0]
        if isinstance(kind, inspect.StructType):
            own = kind.cls.__struct_fields__
            yield field.name, tuple(k for k in own if k not in MachineTable.__struct_fields__)


def _provenance(name: str, keys: tuple[str, ...]) -> Callable[[Config], Iterator[Found]]:
    """The check that ``assumed`` and ``measured`` of one table name keys of it, none in both."""

    def check(config: Config) -> Iterator[Found]:
        value = getattr(config.machine, name)
        rows = enumerate(value) if isinstance(value, list) else ((None, value),)
        for i, table in rows:
            if table is not None:
                yield from _named(f"machine.{name}" + ("" if i is None else f"[{i}]"), table, keys)

    return check


def _named(place: str, table: MachineTable, keys: tuple[str, ...]) -> Iterator[Found]:
    for word, names in (("assumed", table.assumed), ("measured", table.measured)):
        for key in names:
            if key not in keys:
                cause = f"no figure of this table; name some of {', '.join(keys)}, or remove it"
                yield f"{place}.{word}", key, cause
    for key in table.measured:
        if key in table.assumed:
            yield f"{place}.measured", key, "assumed as well; remove it from one of the two"


def _drawing(config: Config) -> Iterator[Found]:
    """The effective mass is weighed, or follows from the drawing."""
    rotor = config.machine.rotor
    weighed, drawn = rotor.effective_mass_at_bearing_kg, rotor.drawn_mass_at_bearing_kg
    low, high = SAME_ROTOR
    if weighed is None and drawn is None:
        missing = ", ".join(key for key in DRAWING if getattr(rotor, key) is None)
        cause = f"missing, and so is {missing}; set it where the rotor was weighed, else those"
        yield "machine.rotor.effective_mass_at_bearing_kg", None, cause
    elif weighed is not None and drawn is not None and not low <= weighed / drawn <= high:
        yield (
            "machine.rotor.effective_mass_at_bearing_kg",
            weighed,
            f"{weighed / drawn:.3g} times that of the drawing ({drawn:.4g}); correct one of them",
        )


def _mode(config: Config) -> Iterator[Found]:
    """What is monitor only starts in that mode."""
    mode, why = config.device.mode_at_start, monitor_only(config.machine)
    if why and mode != "monitor":
        yield "device.mode_at_start", mode, f'monitor only: {"; ".join(why)}; write "monitor"'


def _shaft(config: Config) -> Iterator[Found]:
    """A rotor that there can be: inertias of a body, lengths of a shaft, the bearing on it."""
    rotor, bearing = config.machine.rotor, config.machine.bearing
    mass, j_d, j_p = rotor.mass_kg, rotor.diametral_inertia_kg_m2, rotor.polar_inertia_kg_m2
    a, b = rotor.coupling_to_cg_m, rotor.bearing_to_cg_m
    if j_d is not None and j_p is not None and j_p > 2.0 * j_d:
        cause = (
            f"above twice machine.rotor.diametral_inertia_kg_m2 = {j_d:g}, which no body has; "
            f"exchange or correct them"
        )
        yield "machine.rotor.polar_inertia_kg_m2", j_p, cause
    if a is not None and b is not None:
        between, most = a + b, SLENDER_MAX * bearing.journal_radius_m
        if between > most:
            key, far = max(("coupling_to_cg_m", a), ("bearing_to_cg_m", b), key=lambda k: k[1])
            yield (
                f"machine.rotor.{key}",
                far,
                f"{between:g} m between coupling and bearing are "
                f"{between / bearing.journal_radius_m:g} journal radii, at most {SLENDER_MAX:g} "
                f"({most:g} m); if these are millimetres, write {far * 1e-3:g}",
            )
        elif mass is not None and j_d is not None and j_d > mass * between * between:
            yield (
                "machine.rotor.diametral_inertia_kg_m2",
                j_d,
                f"above mass times the square of the length between coupling and bearing, "
                f"{mass:g} kg x ({between:g} m)^2 = {mass * between * between:.3g}; correct its "
                f"unit",
            )
    beyond_m = shaft_beyond_m(config.machine)
    if beyond_m is not None and b is not None and beyond_m < 0.0:
        yield (
            "machine.rotor.bearing_to_cg_m",
            b,
            f"the bearing lies outside the shaft: it ends {b + 0.5 * bearing.length_m:g} m from "
            f"the centre of gravity ({b:g} and half of bearing.length_m), the shaft at "
            f"{rotor.shaft_end_to_cg_m:g} "
            f"(machine.rotor.shaft_end_to_cg_m); correct one of them",
        )


def _groove_drawn(config: Config) -> Iterator[Found]:
    feed = config.machine.feed
    given = [getattr(feed, key) is not None for key in GROOVE]
    if any(given) and not all(given):
        key = GROOVE[given.index(False)]
        yield f"machine.feed.{key}", None, f"missing beside {GROOVE[given.index(True)]}; set it"


def _pads(config: Config) -> Iterator[Found]:
    """The pads fit into a turn."""
    pads = config.machine.pads
    if pads is not None and pads.arc_deg * pads.count > 360.0 * (1.0 + 1e-9):
        yield (
            "machine.pads.arc_deg",
            pads.arc_deg,
            f"{pads.count} pads of that arc take {pads.arc_deg * pads.count:g} deg; at most "
            f"{360.0 / pads.count:g} each (machine.pads.count)",
        )


def _nominal_pressure(config: Config) -> Iterator[Found]:
    feed = config.machine.feed
    nominal = feed.pressure_nominal_bar
    if nominal is not None and not feed.pressure_min_bar <= nominal <= feed.pressure_max_bar:
        yield (
            "machine.feed.pressure_nominal_bar",
            nominal,
            f"outside {feed.pressure_min_bar:g} .. {feed.pressure_max_bar:g}, "
            "machine.feed.pressure_min_bar .. pressure_max_bar; correct it",
        )


def _pump(config: Config) -> Iterator[Found]:
    """The pump is described whole, and keeps the greatest pressure at the film's greatest flow."""
    feed = config.machine.feed
    given = [getattr(feed, key) is not None for key in PUMP]
    if any(given) and not all(given):
        key = PUMP[given.index(False)]
        yield f"machine.feed.{key}", None, f"missing beside {PUMP[given.index(True)]}; set it"
    least_bar = source_bar(config.machine)
    if least_bar < feed.pressure_max_bar:
        yield (
            "machine.feed.pressure_max_bar",
            feed.pressure_max_bar,
            f"the pump gives {least_bar:.3g} bar at the film's greatest flow of "
            f"{flow_most_m3_s(config.machine):.3g} m3/s (machine.feed.pump_shut_off_bar, "
            "pump_flow_max_m3_s, pump_error_share); lower it, or take a larger pump",
        )


def _full_film(config: Config) -> Iterator[Found]:
    full_bar, least_bar = config.machine.feed.full_film_bar, config.machine.feed.pressure_min_bar
    if full_bar is not None and full_bar >= least_bar:
        cause = f"not below machine.feed.pressure_min_bar ({least_bar:g}); lower it"
        yield "machine.feed.full_film_bar", full_bar, cause


def _hold_up(config: Config) -> Iterator[Found]:
    """Where there is a hold-up, the film stays full from the alert on until the retreat is done."""
    feed, alert_bar = config.machine.feed, config.oil_pressure_limits_bar[0]
    held, needed = held_s(feed, alert_bar), retreat_s(config.machine)
    if feed.hold_up_s > 0.0 and held < needed:
        yield (
            "machine.feed.hold_up_s",
            feed.hold_up_s,
            f"after the loss of the pump the film stays full for {held:.3g} s from the alert at "
            f"{alert_bar:g} bar on (machine.feed.full_film_bar, pump_error_share), and the retreat "
            f"takes {needed:.3g} s (machine.actuator.rate_um_s); raise "
            "limits.oil_pressure_low_alert_bar, or take a larger accumulator",
        )


def _ranges(config: Config) -> Iterator[Found]:
    for i, c in enumerate(config.machine.channel):
        low, high = c.range_low, c.range_high
        if (low is None) != (high is None):
            key = "range_low" if low is None else "range_high"
            yield f"machine.channel[{i}].{key}", None, "missing beside the other end; set it"
        elif low is not None and high is not None and low >= high:
            cause = f"not below range_high ({high:g}); lower it"
            yield f"machine.channel[{i}].range_low", low, cause


MACHINE_CHECKS: Final[tuple[Callable[[Config], Iterator[Found]], ...]] = (
    *(_provenance(name, keys) for name, keys in _tables()),
    _drawing,
    _mode,
    _shaft,
    _groove_drawn,
    _pads,
    _nominal_pressure,
    _pump,
    _full_film,
    _hold_up,
    _ranges,
)
