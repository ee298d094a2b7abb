"""Whether a model fits a machine: by the machine's values, never by its name.

A card carries the figures of each machine that its model was made for (:func:`figures_of`);
:data:`ROWS` says how far each may differ.  Cards written before they carried figures name
rigs only, and are read as made for the shipped rigs of those names.

======  ================================================================================
rule    holds when
======  ================================================================================
share   this machine's figure differs by at most that share of the model's
within  this machine's range lies inside the model's, widened by that much at both ends
exact   both are the same
======  ================================================================================

A figure that a rig folder does not give (the coupling of a rotor that was weighed, not drawn) is
not compared.  Each fast channel of the model's machine is compared too, kind, unit and angle
exactly: what a channel of that name shows is an input of the diagnosis.  Sampling rate, windows
and channel order are compared by :mod:`~firmware_py.brain.store`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from math import pi
from typing import Final, Literal, NamedTuple

from firmware_py import config, signals
from firmware_py.machine import FastChannel, Machine
from firmware_py.machine.folder import shipped_names
from firmware_py.machine.parts import BEARING, CLEARANCE, FEED, has, stand_in_keys

Range = tuple[float, float]
Figure = float | str | Range
Figures = Mapping[str, Figure]
"""Of one machine by key of ``machine.toml``; both ends of a range stand under one key."""

RAD_S_PER_RPM: Final = pi / 30.0
DIAGNOSIS: Final = ("classifier",)
FILTERED: Final = ("classifier", "predictor")
ALL: Final = ("classifier", "actor", "predictor")
"""Kinds of what was learned on a machine.  A film surrogate takes sizes, oil and speed as inputs:
its domain says where it holds."""


class Row(NamedTuple):
    """One figure: where the machine has it, and how far a model's machine may differ from it."""

    key: str
    of: Callable[[Machine], Figure | None]
    rule: Literal["share", "within"]
    tolerance: float
    kinds: tuple[str, ...] = ALL


ROWS: Final = (
    Row("bearing.journal_radius_m", lambda m: m.bearing.journal_radius_m, "share", 0.02),
    Row("bearing.length_m", lambda m: m.bearing.length_m, "share", 0.02),
    Row(
        "bearing.radial_clearance_um",
        lambda m: (m.bearing.radial_clearance_min_um, m.bearing.radial_clearance_max_um),
        "within",
        1.0,
    ),
    Row(
        "lubricant.viscosity_at_40C_Pa_s",
        lambda m: m.lubricant.viscosity_at_40C_Pa_s,
        "share",
        0.1,
    ),
    Row(
        "lubricant.viscosity_slope_per_K", lambda m: m.lubricant.viscosity_slope_per_K, "share", 0.1
    ),
    Row(
        "lubricant.inlet_C",
        lambda m: (m.lubricant.inlet_min_C, m.lubricant.inlet_max_C),
        "within",
        5.0,
    ),
    Row(
        "feed.pressure_bar",
        lambda m: (m.feed.pressure_min_bar, m.feed.pressure_max_bar),
        "within",
        0.1,
    ),
    Row("rotor.mass_at_bearing_kg", lambda m: m.rotor.mass_at_bearing_kg, "share", 0.1),
    Row(
        "rotor.coupling_stiffness_N_m",
        lambda m: m.rotor.coupling_stiffness_N_m,
        "share",
        0.5,
        FILTERED,
    ),
    Row(
        "operating.speed_rpm",
        lambda m: (m.operating.speed_min_rpm, m.operating.speed_max_rpm),
        "within",
        60.0,
    ),
    Row(
        "operating.load_N",
        lambda m: (m.operating.load_min_N, m.operating.load_max_N),
        "within",
        10.0,
    ),
    Row("actuator.rate_um_s", lambda m: m.actuator.rate_um_s, "share", 0.2, ("actor",)),
    Row(
        "contact.circuit_V",
        lambda m: m.contact.circuit_V if m.contact else None,
        "share",
        0.02,
        FILTERED,
    ),
    Row(
        "contact.circuit_ohm",
        lambda m: m.contact.circuit_ohm if m.contact else None,
        "share",
        0.05,
        FILTERED,
    ),
    Row(
        "contact.film_ohm_per_m",
        lambda m: m.contact.film_ohm_per_m if m.contact else None,
        "share",
        0.1,
        FILTERED,
    ),
)
"""Every figure that a model may depend on.

Bearings are ground to better than 2 %, and film force goes with the square of the sizes over
clearance; a batch of oil differs by 10 % (``lubricant.viscosity_error_share``), the mass of a
rotor with another coupling half by as much; a coupling's stiffness is seldom known better than
within half.  The normal unbalance is not compared: balancing may better it at any time.
"""

_CHANNEL: Final = "channel."


def figures_of(machine: Machine) -> dict[str, Figure]:
    """What a card says of ``machine``."""
    lacking = stand_in_keys({"absent": machine.absent})
    found = {row.key: row.of(machine) for row in ROWS if not _lacks(row.key, lacking)}
    channels = {_CHANNEL + each.name: _shown_by(each) for each in machine.channel}
    return {key: value for key, value in (found | channels).items() if value is not None}


@cache
def figures_of_shipped(name: str) -> Figures:
    """Of the shipped rig ``name``, as the package has it."""
    return figures_of(config.read_machine(name))


def machines_of(rigs: Sequence[str]) -> dict[str, Figures]:
    """Of the shipped ones among ``rigs``, by name."""
    shipped = shipped_names()
    return {name: figures_of_shipped(name) for name in rigs if name in shipped}


def misfit(kind: str, machines: Mapping[str, Figures], machine: Machine) -> str:
    """Why a model of ``kind``, made for ``machines``, does not fit ``machine``; empty: it does.

    Every figure that differs from those of the most alike of them, with both values and the
    tolerance.
    """
    if not any(kind in row.kinds for row in ROWS):
        return ""
    if not machines:
        return "its card says of no machine that it was made for it"
    here, lacking = figures_of(machine), stand_in_keys({"absent": machine.absent})
    absent = [row.key for row in ROWS if kind in row.kinds and _lacks(row.key, lacking)]
    found = {
        name: [
            *(f"{key} {_text(there[key])}, here absent" for key in absent if key in there),
            *_differences(kind, there, here),
        ]
        for name, there in machines.items()
    }
    name = min(found, key=lambda each: len(found[each]))
    return f"made for {name!r}: " + ", ".join(found[name]) if found[name] else ""


def outside_domain(domain: Mapping[str, Range], machine: Machine) -> list[str]:
    """Ranges of ``machine`` that do not lie inside a model's ``domain``, as sentences."""
    b, o, f = machine.bearing, machine.operating, machine.feed
    lacking = {
        name
        for part, name in (
            (BEARING, "length_over_diameter"),
            (CLEARANCE, "clearance_m"),
            (FEED, "supply_pressure_bar"),
        )
        if not has(machine, part)
    }
    ratio = b.length_m / (2 * b.journal_radius_m)
    ranges: dict[str, Range] = {
        "length_over_diameter": (ratio, ratio),
        "clearance_m": (b.radial_clearance_min_um * 1e-6, b.radial_clearance_max_um * 1e-6),
        "speed_rad_s": (o.speed_min_rpm * RAD_S_PER_RPM, o.speed_max_rpm * RAD_S_PER_RPM),
        "supply_pressure_bar": (f.pressure_min_bar, f.pressure_max_bar),
    }
    return [
        f"domain {name} {_text(domain[name])}, here {'absent' if name in lacking else _text(value)}"
        for name, value in ranges.items()
        if name in domain and (name in lacking or not _within(domain[name], value, 1e-6))
    ]


def _lacks(key: str, lacking: frozenset[str]) -> bool:
    """Whether what a row names is a stand-in: of a range, whose ends are keys, the least end
    counts."""
    table, _, name = key.partition(".")
    quantity, _, unit = name.rpartition("_")
    own = {table, f"{table}.{name}", f"{table}.{quantity}_min_{unit}"}
    return not lacking.isdisjoint(f"machine.{each}" for each in own)


def _differences(kind: str, there: Figures, here: Figures) -> list[str]:
    found = []
    for row in ROWS:
        if kind not in row.kinds or row.key not in here:
            continue
        if row.key not in there:
            found.append(f"its card lacks {row.key}")
        elif not _alike(row, there[row.key], here[row.key]):
            found.append(
                f"{row.key} {_text(there[row.key])}, here {_text(here[row.key])} ({_limit(row)})"
            )
    if kind in DIAGNOSIS:
        found += [
            f"{key} {value}, here {here.get(key, 'absent')} (exact)"
            for key, value in there.items()
            if key.startswith(_CHANNEL) and here.get(key) != value
        ]
    return found


def _alike(row: Row, there: Figure, here: Figure) -> bool:
    if isinstance(there, tuple) and isinstance(here, tuple):
        return _within(there, here, row.tolerance)
    if isinstance(there, float) and isinstance(here, float):
        return abs(here - there) <= row.tolerance * abs(there) * (1.0 + 1e-9)
    return there == here


def _within(there: Range, here: Range, margin: float) -> bool:
    return there[0] - margin <= here[0] and here[1] <= there[1] + margin


def _limit(row: Row) -> str:
    if row.rule == "share":
        return f"within {100 * row.tolerance:g} %"
    return f"at most {row.tolerance:g} beyond"


def _text(figure: Figure) -> str:
    if isinstance(figure, tuple):
        return f"{figure[0]:.6g} .. {figure[1]:.6g}"
    return figure if isinstance(figure, str) else f"{figure:.6g}"


def _shown_by(channel: FastChannel) -> str:
    kind = signals.fast_kind(channel.name, channel.kind)
    name = kind.name if kind else channel.kind
    return f"{name}, {channel.unit}, {channel.angle_deg % 360.0:g} deg"
