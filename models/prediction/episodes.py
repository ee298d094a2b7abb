"""Episodes of the whole machine for the predictor: drawn from a seed, heard by the brain's own
stages, judged later.

An episode is ten seconds: the slowest speed, a run-up, and two forecasts of two seconds, whose
future is declared and then takes place.  Four regimes take turns: steady (the clearance may move),
ramp (speed and load move as well), near whirl, and a fault that grows (unbalance, starvation,
wear).  Every recording is heard twice: with the sensors as they are built, and after
the slow-roll and zero procedure.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np
from msgspec.structs import replace as changed
from numpy.typing import NDArray

from firmware_py.acquire.channel_map import ChannelMap
from firmware_py.acquire.orders import analyse
from firmware_py.acquire.recorded_windows import iter_windows
from firmware_py.brain.intervals import REGIMES
from firmware_py.config import Config
from firmware_py.errors import OrbitdError
from firmware_py.machine.probes import after_zeroing
from firmware_py.records import Block, Quality, RigReading, RigStatus
from models.prediction.truth import damping_ratio
from sim_hil.faults.machine import STARVED_SHARE, WEAR_M, worn_bore
from sim_hil.plant.build import Build
from sim_hil.plant.duty import RAD_S_PER_RPM, Duty
from sim_hil.plant.machine import Batch, SimulatedMachine
from sim_hil.plant.runs import SimulatedRecording, recording_of, run
from sim_hil.rigs import RigData

Floats = NDArray[np.float64]

FORECASTS_S: Final = (5.5, 8.0)
HORIZON_S: Final = 2.0
SECONDS: Final = 10.2
BLOCK: Final = 100
"""Samples in a block."""
TRUTH_S: Final = 0.2
"""Truth of a moment is taken over this time about it."""

RATE_SHARE: Final = 0.9
"""Of the fastest unannounced change of speed and load that an episode's point moves with."""
FAULT_START_S: Final = 3.0
FAULTS: Final = {"unbalance": (6.3, 40.0), "starvation": (0.15, 0.6), "wear": (0.05, 0.25)}
"""Severity that is reached at the end, low and high."""
FAULT_STEP_S: Final = 0.1
SLOW_ROLL_SHARE: Final = 0.4
"""Of the slowest speed, at the lightest load: the slow-roll procedure."""
DAMPING: Final = {"near_whirl": (0.02, 0.13)}
DAMPING_ELSE: Final = (0.15, math.inf)
WARMER_C: Final = 2.0
"""Outlet over inlet where an episode's points are chosen."""
REACH: Final = {"near_whirl": 0.05, "fault": 0.0}
REACH_ELSE: Final = 0.5
"""How far the clearance moves at most, as a share of its range."""
TRIES: Final = 1000
"""Draws after which a regime that this machine does not know gives way to a steady one, and the
margin of a steady one to whatever keeps a film."""


class NoEpisode(OrbitdError, ValueError):
    """No forecast can be tried on the machine."""


@dataclass(frozen=True)
class ForecastEpisode:
    """What is going to happen; ``clearance_m`` holds before, between and after the two forecasts'
    moves."""

    number: int
    regime: str
    build: Build
    duty: Duty
    clearance_m: tuple[float, float, float]
    inlet_C: float
    fault: str
    severity: float
    seed: int

    def clearance(self, time_s: float) -> float:
        """Target of the actuator."""
        return self.clearance_m[sum(time_s >= t for t in FORECASTS_S)]


@dataclass(frozen=True)
class TrueState:
    """What was true about a moment: SI; ``load_N`` is the static bearing load."""

    power_W: float
    peak_to_peak_m: float
    min_film_m: float
    whirl_margin: float
    load_N: float
    friction_W: float
    static_film_m: float


def draw(rig: RigData, seed: int, number: int) -> ForecastEpisode:
    """Episode ``number`` of ``seed``; regimes take turns."""
    rng = np.random.default_rng([seed, number])
    regime = REGIMES[number % len(REGIMES)]
    build = Build.draw(rig, rng)
    inlet_C = float(rng.uniform(*rig.oil.episodes_C))
    fault = str(rng.choice(list(FAULTS))) if regime == "fault" else ""
    severity = float(rng.uniform(*FAULTS[fault])) if fault else 0.0
    regime, points, clearance = _course(rig, regime, inlet_C, rng)
    corners = [(0.0, *points[0]), (1.2, *points[0]), (4.0, *points[1])]
    for start_s, before, after in zip(FORECASTS_S, points[1:], points[2:], strict=False):
        corners += [(start_s, *before), (start_s + HORIZON_S + 0.2, *after)]
    time_s, speed, load = zip(*corners, strict=True)
    return ForecastEpisode(
        number,
        regime,
        build,
        Duty(time_s, speed, load),
        clearance,
        inlet_C,
        fault,
        severity,
        int(rng.integers(2**31)),
    )


Points = list[tuple[float, float]]
Clearances = tuple[float, float, float]


def _course(
    rig: RigData, regime: str, inlet_C: float, rng: np.random.Generator
) -> tuple[str, Points, Clearances]:
    """Regime, operating points and clearances of an episode.

    Raises
    ------
    NoEpisode
        None keeps a film.
    """
    other = ["steady"] if regime in DAMPING else []
    ways = [(each, False) for each in (regime, *other)] + [([regime, *other][-1], True)]
    for played, anywhere in ways:
        for _ in range(TRIES):
            points = [(rig.speed_min_rpm, _point(rig, rng)[1]), _point(rig, rng)]
            for _ in range(2 * (played == "ramp")):
                points.append(_near(rig, points[-1], rng))
            clearance = _clearances(rig, played, rng)
            pairs = zip(
                [points[0], points[1], *points[2:], points[-1]][:4],
                [clearance[0], clearance[0], *clearance[1:]],
                strict=False,
            )
            within = (0.0, math.inf) if anywhere else DAMPING.get(played, DAMPING_ELSE)
            if all(_feasible(rig, within, i, *pair, inlet_C) for i, pair in enumerate(pairs)):
                return played, points, clearance
    raise NoEpisode(
        f"rig {rig.name}: none of {TRIES} drawn operating points keeps "
        f"{rig.min_film_m * 1e6:g} um of film without whirl; `orbitd rig show` says where it does: "
        "narrow operating.speed and operating.load, or the clearance"
    )


def _point(rig: RigData, rng: np.random.Generator) -> tuple[float, float]:
    """Speed (rpm) and load (N)."""
    load = math.exp(rng.uniform(math.log(rig.load_min_N), math.log(rig.load_max_N)))
    return float(rng.uniform(rig.speed_min_rpm, rig.speed_max_rpm)), load


def _near(
    rig: RigData, point: tuple[float, float], rng: np.random.Generator
) -> tuple[float, float]:
    """A point that two seconds at the declared rates can reach."""
    speed = point[0] + float(rng.uniform(-2.0, 2.0)) * RATE_SHARE * rig.speed_ramp_rpm_s
    load = point[1] + float(rng.uniform(-2.0, 2.0)) * RATE_SHARE * rig.load_ramp_N_s
    return (
        min(max(speed, rig.speed_min_rpm), rig.speed_max_rpm),
        min(max(load, rig.load_min_N), rig.load_max_N),
    )


def _clearances(rig: RigData, regime: str, rng: np.random.Generator) -> tuple[float, float, float]:
    """A clearance and two moves of it, each as likely as none; small ones near whirl, none under a
    fault."""
    low, high = rig.bearing.clearance_min_m, rig.bearing.clearance_max_m
    reach_m = REACH.get(regime, REACH_ELSE) * (high - low)
    values = [float(rng.uniform(low, high))]
    for _ in FORECASTS_S:
        moved = values[-1] + float(rng.uniform(-reach_m, reach_m)) * (rng.random() < 0.5)
        values.append(min(max(moved, low), high))
    return values[0], values[1], values[2]


def _feasible(
    rig: RigData,
    damping: tuple[float, float],
    index: int,
    point: tuple[float, float],
    clearance_m: float,
    inlet_C: float,
) -> bool:
    """Whether the nominal machine runs there with a ratio of ``damping``; the first point is only
    on the way."""
    viscosity = rig.oil.viscosity_at(inlet_C + WARMER_C)
    film_m, ratio = damping_ratio(rig, point[0] * RAD_S_PER_RPM, point[1], clearance_m, viscosity)
    low, high = damping
    return film_m > rig.min_film_m and ratio > low and (index == 0 or ratio < high)


def play(rig: RigData, episode: ForecastEpisode, rate_hz: int = 5000) -> SimulatedRecording:
    """What the device would receive, and the truth; faults grow linearly from :data:`FAULT_START_S`
    on."""
    machine = SimulatedMachine(
        rig,
        episode.build,
        episode.seed,
        rate_hz=rate_hz,
        inlet_C=episode.inlet_C,
        clearance_m=episode.clearance_m[0],
    )
    edges = [0.0, SECONDS]
    if episode.fault:
        edges = [0.0, *np.arange(FAULT_START_S, SECONDS, FAULT_STEP_S).tolist(), SECONDS]
    batches = []
    for start_s, end_s in pairwise(edges):
        if start_s > 0.0:
            machine.inject(episode.fault, _severity(rig, episode, start_s))
        batches.append(
            run(
                machine, episode.duty, end_s - start_s, clearance=episode.clearance, start_s=start_s
            )
        )
    whole = Batch(
        *(
            np.concatenate([getattr(b, name) for b in batches])
            for name in ("counts", "truth", "marks")
        )
    )
    return recording_of(machine, whole, np.random.default_rng([episode.seed, 1]))


def _severity(rig: RigData, episode: ForecastEpisode, time_s: float) -> float:
    share = max(0.0, time_s - FAULT_START_S) / (SECONDS - FAULT_START_S)
    start = 0.0
    if episode.fault == "unbalance":
        unit = 1e-3 * rig.rotor.effective_mass_kg / (6000.0 * RAD_S_PER_RPM)
        start = max(episode.build.unbalance_kg_m / unit, 0.4)
    return start + share * max(episode.severity - start, 0.0)


def heard(recording: SimulatedRecording) -> Iterator[Block | RigReading]:
    """The recording as the guard would pass it on: blocks, and readings before the block in which
    they came."""
    period_us = round(1e6 / recording.rate_hz)
    start_us = round(float(recording.time_s[0]) * 1e6)
    marks = np.round(recording.mark_s * 1e6).astype(np.int64)
    status = recording.status
    for seq in range(len(recording.counts) // BLOCK):
        first = seq * BLOCK
        tick = start_us + first * period_us
        end = tick + BLOCK * period_us
        inside = marks[(marks >= tick) & (marks < end)]
        known = marks[marks < end]
        speed = 2.0 * math.pi * 1e6 / float(known[-1] - known[-2]) if len(known) > 1 else 0.0
        yield Block(
            seq,
            tick * 1000,
            period_us * 1000,
            tick,
            period_us,
            Quality.GOOD,
            0xFF,
            speed,
            len(known),
            inside.tolist(),
            recording.counts[first : first + BLOCK].astype("<i2").tobytes(),
        )
        for row in status[(status[:, 0] * 1e6 >= tick) & (status[:, 0] * 1e6 < end)]:
            at_us = round(row[0] * 1e6)
            said = RigStatus(0, at_us, row[1], row[2], row[3] * 1e6, row[4] * 1e-5)
            yield RigReading(seq, at_us * 1000, 0, said, None)


def truth_at(
    rig: RigData, episode: ForecastEpisode, recording: SimulatedRecording, time_s: float
) -> TrueState:
    """What was true about ``time_s``."""
    middle = round(time_s * recording.rate_hz)
    half = round(0.5 * TRUTH_S * recording.rate_hz)
    rows = slice(max(0, middle - half), middle + half)
    power, speed = recording.column("shaft_power_W")[rows], recording.column("speed_rad_s")[rows]
    x, y = recording.column("eccentricity_x_m")[rows], recording.column("eccentricity_y_m")[rows]
    load, clearance, viscosity = (
        float(recording.column(name)[rows].mean())
        for name in ("load_N", "clearance_m", "viscosity_Pa_s")
    )
    carried, drop_m = _fault_of_film(rig, episode, time_s)
    _, ratio = damping_ratio(
        rig, float(speed.mean()), load, clearance, viscosity * carried, episode.build
    )
    windage = float(np.mean(rig.windage_W_s3 * speed**3))
    swing = max(np.ptp(_at_rest(a * x + b * y)) for a, b in rig.probes)
    return TrueState(
        float(power.mean()),
        float(swing),
        float(recording.column("min_film_m")[rows].min()),
        ratio,
        load,
        float(power.mean()) - windage,
        clearance - math.hypot(float(x.mean()), float(y.mean()) + drop_m),
    )


def _fault_of_film(rig: RigData, episode: ForecastEpisode, time_s: float) -> tuple[float, float]:
    """What starvation leaves of the load that the film carries, and how far (m) wear has lowered
    the bore's middle."""
    severity = _severity(rig, episode, time_s)
    carried = (1.0 - STARVED_SHARE * severity) ** 2.5 if episode.fault == "starvation" else 1.0
    _, drop_m = worn_bore(
        WEAR_M * severity if episode.fault == "wear" else 0.0, rig.bearing.clearance_nominal_m
    )
    return carried, drop_m


def _at_rest(signal: Floats) -> Floats:
    """Without the straight line that a moving operating point adds."""
    t = np.linspace(-1.0, 1.0, signal.size)
    return np.asarray(signal - t * (t @ signal) / (t @ t))


def as_shipped(config: Config, rng: np.random.Generator) -> Config:
    """The device's configuration with a contact channel that is calibrated as well as declared."""
    contact = config.machine.contact
    if contact is None:
        return config
    share = 1.0 + contact.film_error_share * float(rng.standard_normal())
    return config.replaced(contact=changed(contact, film_ohm_per_m=contact.film_ohm_per_m * share))


def after_procedure(config: Config, rig: RigData, build: Build, rng: np.random.Generator) -> Config:
    """``config`` after the slow-roll and zero procedure on this build, with the residual errors
    that the device reckons with.

    The first order at slow roll is measured (a recording of the turning machine through the
    device's own order analysis); zero and gain are set as if by a bump test, which this rig cannot
    play: the true ones, missed by what is left.
    """
    left = after_zeroing(config.machine)
    vectors = slow_roll_vectors(rig, build, int(rng.integers(2**31)))
    vectors = vectors + left.forward_runout_m * np.exp(2j * np.pi * rng.random(2)) * rng.random(2)
    channels = []
    for i, channel in enumerate(config.machine.channel[:2]):
        gain = build.gain[i] * (1.0 + left.gain_share * float(rng.uniform(-1, 1)))
        zero = build.zero[i] + left.zero_m * float(rng.uniform(-1, 1))
        channels.append(
            changed(
                channel,
                scale=channel.scale / gain,
                offset=-zero / gain,
                zeroed=True,
                slow_roll_um=float(abs(vectors[i])) * 1e6,
                slow_roll_deg=math.degrees(float(np.angle(vectors[i]))),
            )
        )
    return config.replaced(channel=[*channels, *config.machine.channel[2:]])


def slow_roll_vectors(rig: RigData, build: Build, seed: int) -> NDArray[np.complex128]:
    """Complex first orders (2,) of the two probes (m) of a machine at slow roll."""
    machine = SimulatedMachine(rig, build, seed)
    duty = Duty.hold(SLOW_ROLL_SHARE * rig.speed_min_rpm, rig.load_min_N)
    run(machine, duty, 0.5, clearance=rig.bearing.clearance_nominal_m)
    recording = recording_of(
        machine,
        run(machine, duty, 1.3, clearance=rig.bearing.clearance_nominal_m),
        np.random.default_rng([seed, 1]),
    )
    as_probes = replace(ChannelMap.wire(), to_xy=np.eye(2))
    windows = iter_windows(
        recording.counts,
        round(float(recording.time_s[0]) * 1e6),
        np.round(recording.mark_s * 1e6).astype(np.int64),
        recording.rate_hz,
        channels=as_probes,
    )
    usable = [window for window in windows if not window.quality & Quality.NO_MARK]
    return np.asarray(analyse(usable[-1]).harmonics[:2, 0])
