"""What a machine lacks, what that switches off, and for which reasons it is monitor only.

A table or key that the rig folder leaves out is filled with a stand-in of :data:`PARTS`, so that
:class:`~firmware_py.machine.schema.Machine` stays one type; ``Machine.absent`` names the parts
whose figures are stand-ins.  No stand-in decides or is shown: who needs a part asks :func:`has`
first.

:func:`monitor_only` is the one place that says when a machine is **monitor only**: protection,
orbit analysis and the machine's own normal state work; nothing is commanded, and no envelope is
told.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple

from firmware_py import signals
from firmware_py.machine.domain import outside_laws
from firmware_py.machine.schema import JournalBearing, Machine
from firmware_py.machine.values import NAME_PATTERN

ACTUATOR, FEED, LUBRICANT, ROTOR = "actuator", "feed", "lubricant", "rotor"
BEARING, CLEARANCE, LOAD, RAMPS = "bearing", "clearance", "load", "ramps"
READINGS, OTHERS = "reading", "other_bearing"


class OptionalPart(NamedTuple):
    """A part of the description that a rig folder may leave out.

    ``table`` of ``machine.toml`` holds it, whole or the keys of ``stand_in`` alone; ``off`` is what
    its absence switches off, for people.
    """

    name: str
    table: str
    stand_in: Mapping[str, Any]
    off: str
    whole: bool = True


PARTS: Final = (
    OptionalPart(
        ACTUATOR,
        "actuator",
        {"safe_radial_clearance_um": 100.0, "safe_pressure_bar": 1.0, "rate_um_s": 50.0},
        "commands and arming; the clearance is fixed",
    ),
    OptionalPart(
        FEED,
        "feed",
        {"pressure_min_bar": 1.0, "pressure_max_bar": 1.0},
        "limits of the supply pressure, and the commanded pressure",
    ),
    OptionalPart(
        LUBRICANT,
        "lubricant",
        {
            "viscosity_at_40C_Pa_s": 0.03,
            "viscosity_slope_per_K": 0.03,
            "inlet_min_C": 20.0,
            "inlet_max_C": 50.0,
            "film_max_C": 90.0,
        },
        "laws of the film, limits of the oil's temperature",
    ),
    OptionalPart(
        ROTOR,
        "rotor",
        {"unbalance_normal_kg_m": 0.0, "effective_mass_at_bearing_kg": 1.0},
        "onset of whirl, envelope",
    ),
    OptionalPart(
        BEARING,
        "bearing",
        {"journal_radius_m": 0.02, "length_m": 0.02},
        "laws of the film: static position, load, envelope",
        whole=False,
    ),
    OptionalPart(
        CLEARANCE,
        "bearing",
        {
            "radial_clearance_min_um": 100.0,
            "radial_clearance_max_um": 100.0,
            "radial_clearance_nominal_um": 100.0,
        },
        "the cap of displacement limits by the clearance, plausibility of the probes by position",
        whole=False,
    ),
    OptionalPart(
        LOAD,
        "operating",
        {"load_min_N": 1.0, "load_max_N": 1.0},
        "plausibility of the probes by static position, envelope",
        whole=False,
    ),
    OptionalPart(
        RAMPS,
        "operating",
        {"speed_ramp_unannounced_rpm_s": 1.0, "load_ramp_unannounced_N_s": 0.01},
        "announcements, envelope",
        whole=False,
    ),
)
"""Parts whose figures other stages read: stand-ins keep their types whole."""

NOMINAL: Final = "radial_clearance_nominal_um"
"""Of a clearance that is fixed, enough: it stands for both ends of the range."""

HELD_AT: Final = {
    "safe_radial_clearance_um": ("bearing", NOMINAL),
    "safe_pressure_bar": ("feed", "pressure_min_bar"),
}
"""Where a machine without an actuator stays: keys of the stand-in, and whose values they take."""

MISSPELT_MAX: Final = 20
"""Unknown tables of which it is guessed what they mean."""

OFF_BY_CHANNEL: Final = {
    "acc_bearing_vertical": "vibration of the bearing's housing, classifier",
    "acc_bearing_horizontal": "vibration of the bearing's housing, classifier",
    "acc_motor": "vibration of the motor's housing, classifier",
    "microphone": "classifier",
    "supply_pressure": "the second source of the supply pressure, classifier, policy",
    "contact_resistance": "film check, classifier",
}
"""What the absence of a standard fast channel switches off."""

OFF_BY_READING: Final = {
    "shaft_power": "forecast of power, learning of the oil",
    "oil_outlet": "limits of the oil's temperature, laws of the film",
    "clearance_actual": "supervision of the actuator; the clearance is that of the drawing",
    "pressure_actual": "limits of the supply pressure by the reading",
}
"""What the absence of a standard slow reading switches off."""


class Absence(NamedTuple):
    """One thing that a machine lacks, and what is off for that."""

    name: str
    off: str


class Reason(NamedTuple):
    """Why a machine is monitor only: when it holds, and what a person reads."""

    holds: Callable[[Machine], bool]
    text: str


def has(machine: Machine, part: str) -> bool:
    """Whether ``machine`` really has ``part``: its figures are no stand-ins."""
    return part not in machine.absent


def bearings_of(machine: Machine) -> list[JournalBearing]:
    """Every bearing, the first one first."""
    return [machine.bearing, *machine.other_bearing]


def clearance_known(machine: Machine, bearing: JournalBearing) -> bool:
    """Whether the clearance of one of its bearings is no stand-in."""
    first = bearing is machine.bearing
    return has(machine, CLEARANCE if first else part_of(CLEARANCE, bearing.name))


def has_reading(machine: Machine, name: str) -> bool:
    """Whether the rig sends the slow reading ``name``; without ``[[reading]]`` it sends the
    standard ones, if it sends any."""
    if READINGS in machine.absent:
        return False
    names = [row.name for row in machine.reading]
    return name in (names or signals.STANDARD_READING)


def has_film(machine: Machine) -> bool:
    """Whether the film at rest is described: size, clearance, load and lubricant are known."""
    return all(has(machine, part) for part in (BEARING, CLEARANCE, LOAD, LUBRICANT))


def has_film_law(machine: Machine) -> bool:
    """Whether the film at rest is described, and is one of which the device's own laws tell."""
    return has_film(machine) and machine.pads is None and not machine.feed_port


REASONS: Final = (
    *(
        Reason(lambda m, name=name: not has(m, name), text)  # type: ignore[misc]
        for name, text in (
            (ACTUATOR, "no [actuator]: nothing can be commanded"),
            (FEED, "no [feed]: a command carries a supply pressure"),
            (LUBRICANT, "no [lubricant]: the film cannot be computed"),
            (ROTOR, "no [rotor]: the onset of whirl cannot be computed"),
        )
    ),
    Reason(
        lambda m: m.pads is not None,
        "[pads]: the guard's laws of the film are proven for a round bore only",
    ),
    Reason(
        lambda m: m.foreign is not None,
        "[foreign]: on a bus that knows nothing of orbitd the device only listens",
    ),
)
"""Every reason for which a machine is monitor only."""


def monitor_only(machine: Machine) -> tuple[str, ...]:
    """Why ``machine`` is monitor only, as texts; empty: it may be controlled.

    It lacks what a command needs, or lies where the guard's laws are not proven.
    """
    lacking = tuple(reason.text for reason in REASONS if reason.holds(machine))
    return lacking or (tuple(outside_laws(machine)) if has_film(machine) else ())


def absences(machine: Machine) -> list[Absence]:
    """All that ``machine`` lacks of what this version knows, with what is off for that."""
    names = {channel.name for channel in machine.channel}
    found = [Absence(f"[{part.table}]" if part.whole else part.name, part.off)
             for part in PARTS if not has(machine, part.name)]  # fmt: skip
    found += [
        Absence(f"{part.name} of bearing {other.name}", part.off)
        for other in machine.other_bearing
        for part in PARTS
        if part_of(part.name, other.name) in machine.absent
    ]
    if machine.contact is None:
        found.append(Absence("[contact]", "film check: what the contact channel means"))
    found += [Absence(f"channel {n}", off) for n, off in OFF_BY_CHANNEL.items() if n not in names]
    found += [
        Absence(f"reading {n}", off)
        for n, off in OFF_BY_READING.items()
        if not has_reading(machine, n)
    ]
    return found


def completed(machine: dict[str, Any]) -> dict[str, Any]:
    """The tables of ``machine.toml`` with stand-ins for the parts that it leaves out.

    Single keys may be left out beside a missing actuator only.  What is there is not judged here,
    and a table that a misspelt one may mean is not filled: it stays a fault.
    """
    known = Machine.__struct_fields__
    misspelt = [name for name in machine if name not in known][:MISSPELT_MAX]
    meant = {each for n in misspelt for each in difflib.get_close_matches(n[:64], known, 1)}
    fixed = ACTUATOR not in machine and ACTUATOR not in meant
    filled, absent = dict(machine), list[str]()
    for part in PARTS:
        table = filled.get(part.table, {})
        if part.table in meant or not isinstance(table, dict) or not (part.whole or fixed):
            continue
        if part.table not in machine if part.whole else part.stand_in.keys().isdisjoint(table):
            absent.append(part.name)
            filled[part.table] = {**table, **part.stand_in}
        elif part.name == CLEARANCE and NOMINAL in table:
            ends = dict.fromkeys(part.stand_in, table[NOMINAL])
            filled[part.table] = {**ends, **table}
    filled, lacking = _others(filled)
    absent += lacking
    if not fixed:
        return {**filled, "absent": absent} if absent else filled
    if READINGS not in machine and READINGS not in meant:
        absent.append(READINGS)
    for key, (name, of) in HELD_AT.items():
        value = filled[name].get(of) if isinstance(filled.get(name), dict) else None
        if value is not None:
            filled[ACTUATOR] = {**filled[ACTUATOR], key: value}
    return {**filled, "absent": absent}


def part_of(part: str, bearing: str) -> str:
    """What the part of a further bearing is called in ``Machine.absent``."""
    return f"{part}/{bearing}"


def _others(machine: dict[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """``machine`` with stand-ins for size and clearance of its further bearings, and which are."""
    rows, absent = machine.get(OTHERS), list[str]()
    if not isinstance(rows, list):
        return machine, absent
    filled = list[Any]()
    for row in rows:
        whole, name = row, row.get("name") if isinstance(row, dict) else None
        named = isinstance(name, str) and re.search(NAME_PATTERN, name)
        for part in (each for each in PARTS if each.table == BEARING and named):
            if part.stand_in.keys().isdisjoint(row):
                absent.append(part_of(part.name, str(name)))
                whole = {**whole, **part.stand_in}
            elif part.name == CLEARANCE and NOMINAL in row:
                whole = {**dict.fromkeys(part.stand_in, row[NOMINAL]), **whole}
        filled.append(whole)
    return {**machine, OTHERS: filled}, absent


def stand_in_keys(machine: object) -> frozenset[str]:
    """Keys of :class:`~firmware_py.config.Config` whose values in the table ``machine`` are
    stand-ins."""
    absent = machine.get("absent", ()) if isinstance(machine, dict) else ()
    found = set[str]()
    for part in PARTS:
        if isinstance(absent, list | tuple) and part.name in absent:
            place = f"machine.{part.table}"
            found |= {place} if part.whole else {f"{place}.{key}" for key in part.stand_in}
    return frozenset(found)


def stand_ins(machine: Machine) -> frozenset[str]:
    """Tables and keys of ``machine.toml`` whose values in ``machine`` are stand-ins, and ends of a
    fixed clearance, for which the nominal one is enough."""
    whole = stand_in_keys({"absent": machine.absent})
    if ACTUATOR in machine.absent:
        ends = next(part.stand_in.keys() for part in PARTS if part.name == CLEARANCE) - {NOMINAL}
        whole |= {f"machine.bearing.{key}" for key in ends}
    return frozenset(key.removeprefix("machine.") for key in whole) | {
        f"{OTHERS}[{i}].{key}"
        for i, other in enumerate(machine.other_bearing)
        for part in PARTS
        if part_of(part.name, other.name) in machine.absent
        for key in part.stand_in
    }
