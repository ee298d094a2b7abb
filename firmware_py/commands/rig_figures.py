"""What follows from a rig folder, as tables of figures: by the laws that the device runs on.

Each table says in a line what it is good for.  What a machine lacks leaves its tables out, by
name; what needs a simulator says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import degrees, pi
from typing import Any, Final, NamedTuple

from firmware_py.config import Config
from firmware_py.config.sampling import ANALYSIS, PROTECTION, highest_rpm, samples_per_turn
from firmware_py.guard.envelope.cost import Corner, Cost, corners
from firmware_py.guard.envelope.shield import Shield
from firmware_py.machine import Machine
from firmware_py.machine.domain import INERTIA_LIMIT, TAYLOR_LIMIT, film_domain
from firmware_py.machine.film import static_film
from firmware_py.machine.lubricant import viscosity_Pa_s
from firmware_py.machine.parts import ACTUATOR, has
from firmware_py.machine.static import (
    Resting,
    greatest_load_N,
    resting,
    shaft_beyond_m,
    sommerfeld,
    stable_clearance_m,
)

Cell = float | str | None
LINEAR: Final = "sim_hil.rotor.linear_film:linear_film"
"""Damping and modes, by name as entry points are: the device does not import the simulator."""

CLEARANCES: Final = 7
"""Clearances, and speeds, at which whirl is looked for."""

RPM: Final = 30.0 / pi
ONSET_STEPS: Final = 60
"""Halvings and steps of the search for the onset of whirl: to 1e-3 of speed."""
ONSET_MOST: Final = 4.0
"""Of the greatest declared speed: whirl is not looked for beyond."""


class RigFigures(NamedTuple):
    """A table: its key for programs, its title, what it is good for, and its figures."""

    key: str
    title: str
    meaning: str
    columns: tuple[str, ...]
    rows: list[list[Cell]]


class FigureState(NamedTuple):
    """A corner of the declared range in the retreat value, in the warmest oil of the inlet."""

    corner: Corner
    clearance_m: float
    viscosity: float
    rest: Resting | None

    @property
    def name(self) -> str:
        """For people."""
        return f"{self.corner.speed_rad_s * RPM:.0f} rpm, {self.corner.load_N:g} N"


def states(config: Config) -> list[FigureState]:
    """The four corners."""
    machine = config.machine
    film = static_film(machine.bearing.journal_radius_m, machine.bearing.length_m)
    built_um = (
        machine.actuator.safe_radial_clearance_um + machine.bearing.radial_clearance_offset_um
    )
    mu = viscosity_Pa_s(machine.lubricant, machine.lubricant.inlet_max_C)
    return [
        FigureState(each, built_um * 1e-6, mu, resting(film, built_um * 1e-6, mu, *each))
        for each in corners(config)
    ]


def groups(config: Config) -> RigFigures:
    """Dimensionless groups over the whole declared range."""
    machine = config.machine
    b, o, oil = machine.bearing, machine.operating, machine.lubricant
    radius, length = b.journal_radius_m, b.length_m
    narrow, wide = b.radial_clearance_min_um * 1e-6, b.radial_clearance_max_um * 1e-6
    slow, fast = o.speed_min_rpm / RPM, o.speed_max_rpm / RPM
    thick, thin = (viscosity_Pa_s(oil, t) for t in (oil.inlet_min_C, oil.film_max_C))
    least = sommerfeld(radius, length, wide, thin, slow, o.load_max_N)
    most = sommerfeld(radius, length, narrow, thick, fast, o.load_min_N)
    low = film_domain(radius, narrow, oil.density_kg_m3, thick, slow)
    high = film_domain(radius, wide, oil.density_kg_m3, thin, fast)
    rows: list[list[Cell]] = [
        ["L/D", 0.5 * length / radius, 0.5 * length / radius, 1.0,
         "length over diameter; the guard's laws end at the limit"],
        ["c/R", narrow / radius, wide / radius, None, "clearance ratio; usual are 0.001 .. 0.003"],
        ["Sommerfeld", least, most, None,
         "mu N L D / W (R/c)^2: below 0.1 heavily loaded, above 1 light and prone to whirl"],
        ["bearing number", 12.0 * pi * least, 12.0 * pi * most, None,
         "6 mu w R^2 / (p c^2), p = W / (L D): the same, as film papers have it"],
        ["Re", low.reynolds, high.reynolds, None, "inertia over friction around the gap"],
        ["Ta", low.taylor, high.taylor, TAYLOR_LIMIT, "Re sqrt(c/R): vortices above the limit"],
        ["Re*", low.inertia, high.inertia, INERTIA_LIMIT,
         "rho w c^2 / mu: above the limit the film equation leaves out what counts"],
    ]  # fmt: skip
    return RigFigures(
        "groups", "Dimensionless groups",
        "which regime the film is in over the declared range; a limit passed somewhere is no "
        "fault, but figures there are not proven",
        ("group", "least", "greatest", "limit", "meaning"), rows,
    )  # fmt: skip


def film(config: Config) -> RigFigures:
    """The film at rest at the corners."""
    machine = config.machine
    law = static_film(machine.bearing.journal_radius_m, machine.bearing.length_m)
    thin_m = config.limits.min_film_um * 1e-6
    rows: list[list[Cell]] = []
    for state in states(config):
        speed = state.corner.speed_rad_s
        most_N = greatest_load_N(law, state.clearance_m, thin_m, state.viscosity * speed)
        wind_W = machine.rotor.windage_W_s3 * speed * speed * speed
        rest = state.rest
        found: list[Cell] = [None, None, None, None]
        if rest:
            found = [
                rest.film_m * 1e6, rest.eccentricity, degrees(rest.attitude_rad),
                rest.friction_W + wind_W,
            ]  # fmt: skip
        rows.append([state.name, *found, most_N])
    return RigFigures(
        "film", "Film at rest at the corners",
        f"in {'the retreat value' if has(machine, ACTUATOR) else 'its clearance,'} "
        f"{machine.actuator.safe_radial_clearance_um:g} um, oil at "
        f"{machine.lubricant.inlet_max_C:g} degC; it must stay above limits.min_film_um = "
        f"{config.limits.min_film_um:g} um",
        ("corner", "film um", "eccentricity", "attitude deg", "power W", "carries at that limit N"),
        rows,
    )  # fmt: skip


def stiffness(config: Config, linear: Sequence[Any]) -> RigFigures:
    """The eight coefficients at the corners; damping only with ``linear``, one for each corner."""
    return stiffness_of(
        [
            (
                state.name,
                state.rest.stiffness_N_m if state.rest else None,
                linear[i] if linear else None,
            )
            for i, state in enumerate(states(config))
        ]
    )


def stiffness_of(found: Sequence[tuple[str, Any, Any]]) -> RigFigures:
    """The eight coefficients: a corner's name, its stiffness, and what has its damping."""
    rows: list[list[Cell]] = []
    for name, stiff, damped in found:
        k: list[Cell] = [None] * 4
        c: list[Cell] = [None] * 4
        if stiff:
            k = [value for row in stiff for value in row]
        if damped:
            c = [value for row in damped.damping_N_s_m for value in row]
        rows.append([name, *k, *c])
    return RigFigures(
        "coefficients",
        "Stiffness N/m and damping N s/m at the corners",
        "axis 1 along the load, 2 at 90 deg in the direction of rotation; K12 and K21 of opposite "
        "sign are what drives whirl",
        ("corner", *(f"{letter}{axes}" for letter in "KC" for axes in ("11", "12", "21", "22"))),
        rows,
    )


def criticals(config: Config, linear: Sequence[Any]) -> RigFigures:
    """Damped modes of the rigid rotor on the film, at the corners."""
    return criticals_of([(s.name, at) for s, at in zip(states(config), linear, strict=True)])


def criticals_of(linear: Sequence[tuple[str, Any]]) -> RigFigures:
    """Damped modes of each named film; None has none."""
    senses = {1: "forward", -1: "backward", 0: "straight"}
    rows: list[list[Cell]] = [
        [name, mode.frequency_rpm, mode.damping_ratio, senses[mode.sense]]
        for name, found in linear
        if found
        for mode in found.modes
    ]
    return RigFigures(
        "criticals",
        "Critical speeds: modes of the rigid rotor on the film",
        "a mode at the speed of its corner with a damping ratio below 0.1 is a resonance; a "
        "negative one is whirl",
        ("corner", "mode rpm", "damping ratio", "sense"),
        rows,
    )


def rotor(config: Config) -> RigFigures:
    """What of the rotor acts on the film."""
    machine = config.machine
    r, o = machine.rotor, machine.operating
    fast = o.speed_max_rpm / RPM
    force_N = r.unbalance_normal_kg_m * fast * fast
    rows: list[list[Cell]] = [
        ["mass at the bearing", r.mass_at_bearing_kg, "kg",
         "weighed" if r.effective_mass_at_bearing_kg else "from the drawing"],
        ["normal unbalance at the greatest speed", force_N, "N", "turns with the shaft"],
        ["over the least load", force_N / o.load_min_N, "", "above 1 the shaft lifts each turn"],
    ]  # fmt: skip
    if (left_m := shaft_beyond_m(machine)) is not None:
        rows.append(["shaft beyond the bearing", left_m, "m", "below 0 it lies outside"])
    columns = ("figure", "value", "unit", "meaning")
    return RigFigures("rotor", "Rotor", "what of it acts on the film", columns, rows)


def onset(config: Config) -> RigFigures:
    """Speed at which whirl begins, over clearance."""
    b, o = config.machine.bearing, config.machine.operating
    rows: list[list[Cell]] = [
        [um, *(onset_rpm(config.machine, um * 1e-6, n) for n in (o.load_min_N, o.load_max_N))]
        for um in _spread(b.radial_clearance_min_um, b.radial_clearance_max_um)
    ]
    return RigFigures(
        "whirl",
        "Onset of whirl over clearance",
        f"of the balanced rigid rotor, {config.machine.rotor.mass_at_bearing_kg:.3g} kg at the "
        f"bearing, in the worse of coldest and hottest oil; -: not below {ONSET_MOST:g} times the "
        f"greatest speed",
        ("clearance um", f"rpm at {o.load_min_N:g} N", f"rpm at {o.load_max_N:g} N"),
        rows,
    )


def stable(config: Config) -> RigFigures:
    """Clearance that just whirls, over speed."""
    b, o = config.machine.bearing, config.machine.operating
    rows: list[list[Cell]] = [
        [
            rpm,
            *(
                _within(
                    stable_clearance_m(config.machine, rpm / RPM, n) * 1e6,
                    b.radial_clearance_max_um,
                )
                for n in (o.load_min_N, o.load_max_N)
            ),
        ]
        for rpm in _spread(o.speed_min_rpm, o.speed_max_rpm)
    ]
    return RigFigures(
        "stable",
        "Widest stable clearance over speed",
        "of the same rotor; -: all that the bearing has",
        ("speed rpm", f"um at {o.load_min_N:g} N", f"um at {o.load_max_N:g} N"),
        rows,
    )


def _spread(low: float, high: float) -> list[float]:
    """Evenly from ``low`` to ``high``; one value where they are the same."""
    steps = CLEARANCES - 1
    return [low + i / steps * (high - low) for i in range(CLEARANCES)] if high > low else [low]


def onset_rpm(machine: Machine, clearance_m: float, load_N: float) -> float | None:
    """Least speed at which the rotor whirls in that clearance, from a tenth of the least declared
    speed on."""
    low = 0.1 * machine.operating.speed_min_rpm / RPM
    most = ONSET_MOST * machine.operating.speed_max_rpm / RPM
    ratio = (most / low) ** (1.0 / ONSET_STEPS)
    speed = low
    while stable_clearance_m(machine, speed, load_N) >= clearance_m:
        speed *= ratio
        if speed > most:
            return None
    low, high = speed / ratio, speed
    while high - low > 1e-3 * high:
        middle = 0.5 * (low + high)
        if stable_clearance_m(machine, middle, load_N) >= clearance_m:
            low = middle
        else:
            high = middle
    return high * RPM


def admissible(config: Config, found: Sequence[Cost]) -> RigFigures:
    """What the guard admits, over the whole range and at its corners."""
    low_m, high_m = Shield(config).fixed_range() or (None, None)
    rows: list[list[Cell]] = [
        ["everywhere, at any time", _um(low_m), _um(high_m), None],
    ]
    for corner, admitted in zip(corners(config), found[0].corners, strict=True):
        name = f"now at {corner.speed_rad_s * RPM:.0f} rpm, {corner.load_N:g} N"
        low, high, power_W = admitted or (None, None, None)
        rows.append([name, _um(low), _um(high), power_W])
    return RigFigures(
        "admissible", "Admissible radial clearance",
        "by the guard: the retreat value must lie in the first row; a measured state admits more",
        ("where", "from um", "to um", "power in the widest W"), rows,
    )  # fmt: skip


def budget(config: Config, found: Sequence[Cost]) -> RigFigures:
    """What each uncertainty costs, beside all as declared."""
    known = found[0]
    columns = ["retreat range um"]
    for corner in corners(config):
        columns += [f"um at {corner.speed_rad_s * RPM:.0f} rpm, {corner.load_N:g} N", "W"]
    rows: list[list[Cell]] = []
    for cost in found[1:]:
        row: list[Cell] = [cost.name, round((cost.range_m - known.range_m) * 1e6, 1) + 0.0]
        for before, after in zip(known.corners, cost.corners, strict=True):
            if before and after:
                row += [
                    round((after.high_m - before.high_m) * 1e6, 1) + 0.0,
                    round(before.power_W - after.power_W, 1) + 0.0,
                ]
            else:
                row += [None, None]
        rows.append(row)
    return RigFigures(
        "budget",
        "Field error budget",
        "what is gained where that uncertainty is gone: um of admissible radial clearance, and W "
        "of shaft power in the widest; 0 where the bearing's own range bounds it. Spend on the "
        "largest, then on the next",
        ("uncertainty", *columns),
        rows,
    )


def sampling(config: Config) -> RigFigures:
    """Samples a turn, and up to which speed they suffice."""
    most = config.machine.operating.speed_max_rpm
    rows: list[list[Cell]] = [
        [name, samples_per_turn(config), float(least), highest_rpm(config, least),
         "yes" if highest_rpm(config, least) >= most else "not up to the greatest speed"]
        for name, least in (("protection", PROTECTION), ("analysis of the orbit", ANALYSIS))
    ]  # fmt: skip
    return RigFigures(
        "sampling", "Samples a turn",
        f"{config.sampling.rate_hz} Hz at {most:g} rpm",
        ("for", "samples a turn", "needed", "enough up to rpm", "enough"), rows,
    )  # fmt: skip


def _within(value: float, most: float) -> float | None:
    """None above ``most``: no bound."""
    return value if value <= most else None


def _um(value_m: float | None) -> float | None:
    return None if value_m is None else value_m * 1e6
