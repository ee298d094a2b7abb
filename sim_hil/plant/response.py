"""The rotor of equation (2) on its film, without pedestal, motor and sensors.

`sim_hil.plant.runs` follows the whole machine with everything that shakes it; here stands the rotor
alone, deterministic, much faster, and with a choice of films.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from firmware_py.errors import OrbitdError
from sim_hil.film import FilmError, FilmNotConverged
from sim_hil.film.balance import position_of_load
from sim_hil.film.bearing import Bearing
from sim_hil.film.bore import PadBore
from sim_hil.film.equilibrium import linear_coefficients
from sim_hil.film.feeding import feed_patches
from sim_hil.film.model import FilmModel, load_model, tabulate
from sim_hil.film.table import FilmTable
from sim_hil.film.table_kernel import CONTACT_STIFFNESS_N_M, EPS_TABLE
from sim_hil.plant.build import Build
from sim_hil.plant.duty import Duty
from sim_hil.plant.validity import doubts, refusal
from sim_hil.rigs import RigData
from sim_hil.rotor.assembly import assemble, rig_film
from sim_hil.rotor.film_law import DirectLaw, Law, LinearLaw
from sim_hil.rotor.network_law import RawNetworkLaw, ReducedNetworkLaw
from sim_hil.rotor.parameters import Floats, Plant, State, new_state
from sim_hil.rotor.rigid import COLUMNS, RENEW_STEPS, advance_rotor

PlayedSchedule = float | Callable[[float], float]
"""A constant, or a function of the time in seconds."""
Force = (
    Literal["direct", "table", "linear"]
    | Path
    | str
    | FilmModel
    | FilmTable
    | ReducedNetworkLaw
    | RawNetworkLaw
)
STEP_S = 50e-6
SAMPLES_PER_TURN = 50
"""At least so many rows a turn where orbits are judged."""
COMMAND_S = 1e-3
"""A target that is a function of time is read this often, and held between."""
LONGEST_STEP_S = 200e-6
LOW_FILM_SHARE = 0.01
"""Below this share of the clearance the asperities touch (`EPS_TABLE`)."""


class SimulationError(OrbitdError, ValueError):
    """A run that cannot be made, or that left the finite numbers; the message names cause, value
    and limit."""

    exit_code = 2


class RunDiverged(SimulationError):
    """A run that left the finite numbers."""


@dataclass(frozen=True)
class FilmEvent:
    """What happened at a time: `contact` (asperities touch) or `release`."""

    time_s: float
    name: str


@dataclass(frozen=True)
class Trajectory:
    """A run, one row per `1 / rate_hz`.

    Parameters
    ----------
    time_s
        End of each row's period, shape (n,).
    rows
        `COLUMNS` of `sim_hil.rotor.rigid`: journal x, y, m, and velocity, m/s, relative to the
        bearing; smallest film, m, and mean power, W, over the period; clearance, m, oil
        temperature, Celsius, shaft angle, rad, mean side flow, m3/s, and supply pressure, Pa; shape
        (n, 11).
    events
        Contacts and releases.
    warnings
        What is not proven of it (:mod:`sim_hil.plant.validity`), with value and limit.
    """

    time_s: Floats
    rows: Floats
    events: tuple[FilmEvent, ...]
    warnings: tuple[str, ...] = ()

    def column(self, name: str) -> Floats:
        """One column by name."""
        return np.asarray(self.rows[:, COLUMNS.index(name)])

    @property
    def position_m(self) -> Floats:
        """Journal centre (x, y), m, shape (n, 2)."""
        return self.rows[:, :2]

    @property
    def power_W(self) -> Floats:
        """Dissipated power: friction moment times speed, less film force times velocity, plus
        windage."""
        return self.column("power_W")

    def pump_power_W(self, efficiency: float) -> Floats:
        """Power of a pump that feeds what runs off at the ends, at the supply pressure."""
        return self.column("pressure_Pa") * self.column("side_flow_m3_s") / efficiency

    @property
    def min_film_m(self) -> Floats:
        """Smallest film of each period."""
        return self.column("min_film_m")

    def last(self, seconds: float) -> Trajectory:
        """The last `seconds` of the run."""
        kept = self.time_s > self.time_s[-1] - seconds - 1e-9
        return replace(self, time_s=self.time_s[kept], rows=self.rows[kept])

    def peak_to_peak_m(self) -> float:
        """Larger peak-to-peak of the two axes."""
        return float(np.ptp(self.position_m, axis=0).max())


def simulate(
    rig: RigData,
    duty: Duty,
    *,
    clearance: PlayedSchedule,
    dt_s: float = STEP_S,
    force: Force = "table",
    seed: int = 0,
    seconds: float | None = None,
    thermal: bool = True,
    pressure: PlayedSchedule | None = None,
    rate_hz: float = 5000.0,
    build: Build | None = None,
    inlet_C: float | None = None,
    fed: bool = False,
) -> Trajectory:
    """Follow `duty` (to its end when `seconds` is None) with the journal starting at rest at its
    equilibrium; on the wall where it does not turn.

    Parameters
    ----------
    clearance
        Target of the actuator (rate, lag and backlash as the rig's), m: a number or a function of
        time, s.
    pressure
        Target of the supply pressure, Pa, likewise; nominal when None.
    dt_s
        Longest integration step; a period of `rate_hz` is cut into equal steps.
    force
        `table`: Reynolds film, tabulated; `direct`: Guembel film solved at each call; `linear`:
        springs and dampers around the equilibrium of the start; a `FilmTable` (`FilmTable.build`);
        a film model or the path of its ONNX file, tabulated once; or a network of `network_law`.
    seed
        Draws the shaft angle at the start.
    thermal
        False holds the oil at its inlet temperature.
    inlet_C
        Temperature of the oil that comes in, Celsius; the rig's own when None.
    fed
        The film with the rig's groove, where the supply pressure carries load, instead of the unfed
        periodic film (with `force="table"` only). A rig with feed ports has no unfed film: there
        `table` and `linear` alone know its film. Films are laminar and without inertia:
        `sim_hil.film.domain` says how far that holds.

    Raises
    ------
    SimulationError
        A clearance outside the rig's range, a pressure that no supply has, a step too long, too
        few of them a turn, or a speed far beyond the rig's.
    RunDiverged
        It left the finite numbers.
    """
    if not (0 < dt_s <= LONGEST_STEP_S and rate_hz > 0):
        raise SimulationError(
            f"dt_s = {dt_s}, rate_hz = {rate_hz}: both above zero, and the step at most "
            f"{LONGEST_STEP_S} s"
        )
    period = 1 / rate_hz
    total = round((duty.seconds if seconds is None else seconds) / period)
    if total < 1:
        raise SimulationError(
            f"seconds = {seconds}: shorter than one period of rate_hz = {rate_hz}"
        )
    time_s = np.arange(total + 1, dtype=np.float64) * period
    target = _targets(rig, clearance, pressure, time_s[:-1])
    plant = assemble(
        rig, Build.nominal(rig) if build is None else build, dt_s, inlet_C=inlet_C, thermal=thermal
    )
    drive = duty.at(time_s)
    steps = max(1, math.ceil(period / dt_s - 1e-9))
    low, high = float(drive[:, 0].min()), float(drive[:, 0].max())
    if why := refusal(rig, low, high, period / steps):
        raise SimulationError(why)
    start = equilibrium_at(
        rig, plant, float(drive[0, 0]), float(drive[0, 1]), float(target[0, 0]), target[0, 1]
    )
    law = _fed_law(rig, force) if _feeds_act(rig, force, fed) else _law(rig, plant, force, start)
    w, state = _at_rest(plant, start, target[0], seed)
    rows = np.empty((total, len(COLUMNS)))
    advance_rotor(
        plant.shaft,
        plant.film,
        plant.act,
        law,
        w,
        state.scalar,
        drive,
        target,
        period,
        steps,
        RENEW_STEPS,
        rows,
    )
    if not np.all(np.isfinite(rows)):
        lost_s = time_s[int(np.argmax(~np.isfinite(rows).all(axis=1)))]
        raise RunDiverged(
            f"dt_s = {dt_s}: the run left the finite numbers at {lost_s:.4f} s; take a shorter step"
        )
    widest = float(target[:, 0].max()) + plant.film.wear
    thinnest = _viscosity(plant, float(rows[:, COLUMNS.index("oil_C")].max()))
    unproven = doubts(rig, max(-low, high), widest, thinnest, period / steps)
    return Trajectory(time_s[1:], rows, _events(time_s[1:], rows), unproven)


@dataclass(frozen=True)
class StaticStart:
    """Static equilibrium of the journal: position, m, and where it was computed."""

    position_m: Floats
    stiffness_N_m: Floats
    damping_N_s_m: Floats
    load_N: float


def equilibrium_at(
    rig: RigData,
    plant: Plant,
    speed_rad_s: float,
    load_N: float,
    clearance_m: float,
    supply_Pa: float | None = None,
) -> StaticStart:
    """Where the journal rests, with K and C along x and y; the load may point upwards (below zero).

    Without speed, and under more than the film carries, it lies on the wall; without load it stands
    in the middle.  Feed ports stand at `supply_Pa`, nominal when None.
    """
    film = plant.film
    c = clearance_m + film.wear
    bore = PadBore.of(rig.bearing.pads)
    if speed_rad_s == 0.0:
        return on_the_wall(c, load_N, bore)
    bearing = Bearing(
        film.radius,
        film.length,
        c,
        _viscosity(plant, film.inlet_C),
        speed_rad_s,
        feed=(
            *(bore.grooves(film.length) if bore else ()),
            *feed_patches(
                rig.supply.ports,
                film.radius,
                rig.oil.density_kg_m3,
                rig.supply.nominal_Pa if supply_Pa is None else float(supply_Pa),
            ),
        ),
        grid=(96, 12),
        pads=bore,
    )
    try:
        place = position_of_load(bearing, np.array([0.0, -load_N])) if load_N else np.zeros(2)
    except FilmNotConverged:
        return on_the_wall(c, load_N, bore)
    if bearing.gap_m(place) <= (1 - EPS_TABLE) * c:
        return on_the_wall(c, load_N, bore)
    return StaticStart(place, *linear_coefficients(bearing, place, np.eye(2)), load_N)


def _viscosity(plant: Plant, oil_C: float) -> float:
    film = plant.film
    return film.viscosity * math.exp(-film.viscosity_slope * (oil_C - film.reference_C))


def on_the_wall(clearance_m: float, load_N: float, bore: PadBore | None = None) -> StaticStart:
    """A journal that lies on the asperities in the direction of its load, in the middle without
    one."""
    reach = 1.0 if bore is None else bore.reach(-math.copysign(math.pi / 2, load_N))
    depth = EPS_TABLE * reach * clearance_m + abs(load_N) / CONTACT_STIFFNESS_N_M
    place = np.array([0.0, -math.copysign(depth, load_N) if load_N else 0.0])
    return StaticStart(place, np.zeros((2, 2)), np.zeros((2, 2)), load_N)


def _over(schedule: PlayedSchedule, time_s: Floats) -> Floats:
    """A schedule at the given times, read every `COMMAND_S`."""
    if not callable(schedule):
        return np.full(time_s.size, schedule)
    tick = np.floor(time_s / COMMAND_S + 1e-6).astype(np.int64)
    return np.array(
        [schedule(t) for t in (np.arange(tick[-1] + 1) * COMMAND_S).tolist()], dtype=np.float64
    )[tick]


def _targets(
    rig: RigData, clearance: PlayedSchedule, pressure: PlayedSchedule | None, time_s: Floats
) -> Floats:
    """Clearance, m, and supply pressure, Pa, that the actuator is to follow, shape (n, 2)."""
    supply = rig.supply.nominal_Pa if pressure is None else pressure
    target = np.column_stack([_over(clearance, time_s), _over(supply, time_s)])
    _check_clearance(rig, target[:, 0])
    if not (target[:, 1].min() >= 0.0 and np.isfinite(target[:, 1]).all()):
        raise SimulationError(
            "pressure: a supply pressure is finite and not negative, Pa above ambient"
        )
    return target


def _check_clearance(rig: RigData, clearance_m: Floats) -> None:
    low, high = rig.bearing.clearance_min_m, rig.bearing.clearance_max_m
    for value in (float(clearance_m.min()), float(clearance_m.max())):
        if not low - 1e-12 <= value <= high + 1e-12:
            raise SimulationError(
                f"clearance = {value * 1e6:.2f} um: outside the radial range {low * 1e6:g} to "
                f"{high * 1e6:g} um of rig {rig.name}"
            )


def _feeds_act(rig: RigData, force: Force, fed: bool) -> bool:
    """Whether the film is the tabulated one with the rig's groove or openings."""
    return fed or (bool(rig.supply.ports) and force != "linear")


def _fed_law(rig: RigData, force: Force) -> Law:
    if force != "table":
        what = "the feed ports of the rig" if rig.supply.ports else "the groove"
        raise SimulationError(
            f"force = {force!r} with a film that is fed: only the table knows {what}; take it"
        )
    try:
        return rig_film(rig, fed=True)
    except FilmError as error:
        raise SimulationError(str(error)) from error


def _law(rig: RigData, plant: Plant, force: Force, start: StaticStart) -> Law:
    shape = plant.film.length / (2 * plant.film.radius)
    if isinstance(force, ReducedNetworkLaw | RawNetworkLaw):
        return force
    if force == "linear":
        if start.load_N and not start.damping_N_s_m.any():
            raise SimulationError(
                "force = linear: a film at rest has no stiffness; start with the machine turning"
            )
        return LinearLaw.of(
            (start.position_m, np.array([0.0, start.load_N])),
            start.stiffness_N_m,
            start.damping_N_s_m,
        )
    if rig.bearing.pads is not None:
        if force != "table":
            raise SimulationError(
                f"force = {force!r} with pads: only the table knows them; take force='table'"
            )
        return rig_film(rig, fed=False)
    try:
        table = FilmTable.load(shape) if force in ("table", "direct") else _table_of(force, shape)
    except FilmError as error:
        raise SimulationError(str(error)) from error
    if abs(table.length_over_diameter - shape) > 1e-9:
        raise SimulationError(
            f"force: a film for length/diameter {table.length_over_diameter}, rig {rig.name} has "
            f"{shape}"
        )
    return DirectLaw.make(table.coefficients) if force == "direct" else table.coefficients


def _table_of(force: Path | str | FilmModel | FilmTable, shape: float) -> FilmTable:
    """The table of a film that is not built in."""
    if isinstance(force, FilmTable):
        return force
    if callable(force):
        return tabulate(force, shape)
    if not Path(force).exists():
        raise SimulationError(
            f"force = {str(force)!r}: use direct, table, linear, a film model or its ONNX file"
        )
    return tabulate(*load_model(Path(force)))


def _at_rest(plant: Plant, start: StaticStart, target: Floats, seed: int) -> tuple[Floats, State]:
    """Rotor hinged at the coupling end with the journal at its equilibrium; actuator at its first
    target."""
    s = plant.shaft
    span = s.to_bearing + s.to_coupling
    w = np.zeros(8)
    w[2:4] = start.position_m / span
    w[0:2] = s.to_coupling * w[2:4]
    angle = float(np.random.default_rng(seed).uniform(0, 2 * np.pi))
    return w, new_state(1, float(target[0]), float(target[1]), plant.film.inlet_C, angle)


def _events(time_s: Floats, rows: Floats) -> tuple[FilmEvent, ...]:
    film, clearance = rows[:, COLUMNS.index("min_film_m")], rows[:, COLUMNS.index("clearance_m")]
    touching = np.concatenate([[False], film < LOW_FILM_SHARE * clearance])
    changes = np.flatnonzero(np.diff(touching))
    return tuple(
        FilmEvent(float(time_s[i]), "contact" if touching[i + 1] else "release") for i in changes
    )
