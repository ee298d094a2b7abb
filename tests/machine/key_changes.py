"""Each key of ``machine.toml``, another value for it, and the machine in which it is changed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

import msgspec
from msgspec import inspect

from firmware_py import config as configuration
from firmware_py import signals
from firmware_py.config import Config
from firmware_py.config.checks import RELATED
from firmware_py.machine import FastChannel, FeedPort, Machine, SlowChannel

CHANGED: Final[Mapping[str, Any]] = {
    "name": "other",
    "bearing.radial_clearance_offset_um": 0.5,
    "lubricant.film_at_outlet": False,
    "feed.pressure_max_bar": 2.9,
    "feed.pressure_nominal_bar": 1.1,
    "feed.groove_area_min_mm2": 1.0,
    "feed.groove_area_max_mm2": 2.0,
    "feed.full_film_bar": 0.24,
    "feed_port.kind": "port",
    "feed_port.axial_mm": 2.0,
    "feed_port.pressure_bar": 2.0,
    "rotor.unbalance_measured": True,
    "rotor.effective_mass_at_bearing_kg": 1.8,
    "rotor.shaft_end_to_cg_m": 0.3,
    "operating.speed_min_rpm": 1600.0,
    "operating.speed_max_rpm": 11_900.0,
    "operating.load_min_N": 31.0,
    "operating.load_max_N": 295.0,
    "actuator.safe_radial_clearance_um": 50.5,
    "actuator.time_to_live_ms": 110,
    "actuator.command_period_ms": 21,
    "actuator.reversals_per_minute_max": 310,
    "lubricant.inlet_max_C": 41.0,
    "lubricant.inlet_min_C": 34.0,
    "lubricant.film_max_C": 61.0,
    "channel.name": "cover_velocity",
    "channel.unit": "mm/s",
    "channel.ok_low": -244e-6,
    "channel.ok_high": 244e-6,
    "channel.offset": 1e-6,
    "channel.angle_deg": 40.0,
    "channel.slow_roll_um": 1.0,
    "channel.slow_roll_deg": 10.0,
    "channel.zeroed": True,
    "channel.kind": "temperature",
    "channel.wire_scale": 2e-5,
    "channel.words": "velocity of the casing",
    "channel.range_low": -240e-6,
    "channel.range_high": 240e-6,
    "readings.shaft_power_max_W": 5000.0,
    "readings.pressure_max_bar": 7.0,
    "readings.oil_outlet_min_C": -21.0,
    "reading.name": "housing",
    "reading.kind": "pressure",
    "reading.ok_low": -10.0,
    "reading.ok_high": 90.0,
    "reading.words": "the housing",
}
"""Values of keys that 7 % more would not change, or change into no machine."""

BOTH_ZEROED: Final = {"channel.zeroed": True, "channel@1.zeroed": True}
NEEDS: Final[Mapping[str, Mapping[str, Any]]] = {
    "feed.groove_area_min_mm2": {"feed.groove_area_max_mm2": 2.0},
    "channel.slow_roll_deg": {"channel.slow_roll_um": 1.0},
    "channel.zeroed": {"channel@1.zeroed": True},
    "channel.zeroed_gain_error_share": BOTH_ZEROED,
    "channel.zeroed_zero_error": BOTH_ZEROED,
    "channel.zeroed_runout_m": BOTH_ZEROED,
}
"""What else a key needs to say anything (``table@row.key``); it stands in the machine before and
after."""

CAPILLARY_KEYS: Final = ("feed_port.kind", "feed_port.capillary_length_mm")

WATCHED: Final = ("other_bearing.", "bearing.name", "channel.bearing", "foreign.", "map.", "pads.")
"""Keys of bearings that are only watched, and of foreign buses: the bench has none, and a machine
with pads is monitor only."""

SCHEMA_2: Final = (
    "channel.name",
    "channel.unit",
    "channel.kind",
    "channel.wire_scale",
    "channel.words",
)
"""Keys of a channel of its own, the ninth."""

EXTRA: Final = SlowChannel(name="casing", kind="temperature")
NINTH: Final = FastChannel(name="casing_velocity", unit="m/s", scale=1e-5, ok_low=-0.3, ok_high=0.3,
                           kind="velocity")  # fmt: skip


def keys() -> list[str]:
    """Every key of ``machine.toml`` as ``table.key``; of a list of tables, the first row's."""
    return [key for key in _all_keys() if not key.startswith(WATCHED)]


def _all_keys() -> Iterator[str]:
    described = inspect.type_info(Machine)
    assert isinstance(described, inspect.StructType)
    for field in described.fields:
        kinds = field.type.types if isinstance(field.type, inspect.UnionType) else (field.type,)
        kind = kinds[0].item_type if isinstance(kinds[0], inspect.ListType) else kinds[0]
        if isinstance(kind, inspect.StructType):
            yield from (f"{field.name}.{each.name}" for each in kind.fields)
        elif field.name != "absent":  # found, never written
            yield field.name


def base(key: str) -> Config:
    """The bench as it is before ``key`` is changed: a reading of its own under wire schema 2 where
    the key is one's."""
    config = configuration.load(configuration.SHIPPED / "bench")[0]
    bus = msgspec.structs.replace(config.bus, schema=2)
    if key in SCHEMA_2:
        config = config.replaced(bus=bus, channel=[*config.machine.channel, NINTH])
    if key.startswith("reading."):
        standard = [SlowChannel(name=row.name) for row in signals.READINGS]
        config = config.replaced(bus=bus, reading=[*standard, EXTRA])
    if key.startswith("feed_port."):
        config = with_ports(config, key)
    for other, value in NEEDS.get(key, {}).items():
        config = _with(config, other, value)
    return config


def with_ports(config: Config, key: str) -> Config:
    """``config`` fed through three openings instead of its groove, the first of the kind that has
    ``key``."""
    first = FeedPort("orifice", 90.0, bore_mm=0.5)
    if key in CAPILLARY_KEYS:
        first = FeedPort("capillary", 90.0, bore_mm=0.5, capillary_length_mm=20.0)
    if "recess" in key or key.endswith("air_share"):
        first = msgspec.structs.replace(
            first, recess_width_deg=20.0, recess_length_mm=8.0, recess_volume_mm3=50.0
        )
    if key.endswith("air_share"):
        first = msgspec.structs.replace(first, air_share=0.02)
    rest = [FeedPort("port", angle, bore_mm=1.0, pressure_bar=1.0) for angle in (200.0, 320.0)]
    drawn = ("groove_angle_deg", "groove_width_deg", "groove_length_share")
    feed = msgspec.structs.replace(
        config.machine.feed,
        groove_area_min_mm2=0.0,
        groove_area_max_mm2=0.0,
        **dict.fromkeys(drawn),
    )
    return config.replaced(feed=feed, feed_port=[first, *rest])


def changed(config: Config, key: str) -> Config:
    """``config`` with another value of ``key``."""
    table, _, name = key.rpartition(".")
    if name in ("assumed", "measured"):
        rows = getattr(config.machine, table)
        first = rows[0] if isinstance(rows, list) else rows
        taken = (*first.assumed, *first.measured, "assumed", "measured")
        free = [k for k in first.__struct_fields__ if k not in taken]
        return _with(config, key, (*getattr(first, name), free[-1]))
    if key in CHANGED:
        return _with(config, key, CHANGED[key])
    value = _value(config, key)
    assert isinstance(value, float | int), f"{key} = {value!r}: name a value in CHANGED"
    assert value, f"{key} = {value!r}: name a value in CHANGED"
    return _with(config, key, type(value)(1.07 * value))


def _value(config: Config, key: str) -> Any:
    table, _, name = key.rpartition(".")
    rows = getattr(config.machine, table)
    return getattr(rows[_row(key)] if isinstance(rows, list) else rows, name)


def _row(key: str) -> int:
    return -1 if key.startswith("reading.") or key in SCHEMA_2 else 0


def _with(config: Config, key: str, value: Any) -> Config:
    table, _, name = key.rpartition(".")
    if not table:
        return config.replaced(machine=msgspec.structs.replace(config.machine, **{name: value}))
    table, _, at = table.partition("@")
    rows = getattr(config.machine, table)
    if not isinstance(rows, list):
        return config.replaced(**{table: msgspec.structs.replace(rows, **{name: value})})
    rows, row = list(rows), int(at) if at else _row(key)
    rows[row] = msgspec.structs.replace(rows[row], **{name: value})
    return config.replaced(**{table: rows})


def faults(config: Config) -> list[tuple[str, object, str]]:
    """What a check of values together has against ``config``."""
    return [found for check in RELATED for found in check(config)]


def fed(key: str) -> bool:
    """Whether the key is tried where the supply pressure is a second action."""
    return key.startswith(("feed.", "actuator.pressure"))
