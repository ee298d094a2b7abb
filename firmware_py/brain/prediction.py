"""The predictor: what each candidate clearance would bring in a declared future, with intervals
(ISO 13374 PA).

The synchronised film model answers for every candidate at once: equilibrium, friction power, 1X
response, stability.  Intervals come from the covariance of load, viscosity, clearance and unbalance
(sigma points) and from declared model errors, stretched by factors found on training episodes.
Speed and load follow the declared future, the oil follows the friction through its heat balance,
growing faults follow their rates.  Where the clearance and the future are those of this moment, the
same figures are the virtual sensors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.channel_map import ChannelMap
from firmware_py.acquire.windows import MAX_SECONDS, MIN_SECONDS, TURNS
from firmware_py.brain.estimate import Estimate, Synchroniser, SynchroniserState
from firmware_py.brain.film import Film, Points, Steady
from firmware_py.brain.intervals import (
    NEAR_WHIRL,
    SIGMA_90,
    IntervalFactors,
    deviation_of,
    interval,
    sigma_points,
    state_of,
)
from firmware_py.brain.measurement import CLEARANCE, UM, VISCOSITY, Measured, starved_share
from firmware_py.brain.orbit import balanced
from firmware_py.brain.store import Model
from firmware_py.brain.time_simulation import Motion, simulate
from firmware_py.brain.unbalance import (
    Imbalance,
    ImbalanceFilter,
    ImbalanceState,
)
from firmware_py.config import Config
from firmware_py.machine.lubricant import viscosity_Pa_s

Floats = NDArray[np.float64]

HORIZON_S: Final = 2.0
CANDIDATES: Final = 16
POWER_ERROR: Final = 0.02
SWING_ERROR: Final = 0.1
SWING_ERROR_M: Final = 2e-7
FILM_ERROR_M: Final = 3e-7
MARGIN_ERROR: Final = 0.02
OIL_SLOPE_S: Final = 1.0
HISTORY: Final = 25
"""Estimates remembered: those of the longest window, at the advice's rate, and some more."""
DAMPING_LEAST: Final = 0.01
LIMIT_TIMES_S: Final = (0.0, 1.0, 2.0, 4.0, 8.0, 15.0, 30.0, 60.0)
"""Where a growing fault is looked for beyond its limit."""


@dataclass(frozen=True, slots=True)
class Future:
    """What is declared to happen meanwhile: the horizon, its end's speed (None: held) and the
    load's change."""

    seconds: float = HORIZON_S
    speed_rad_s: float | None = None
    load_change_N: float = 0.0

    @property
    def moves(self) -> bool:
        """Whether speed or load change."""
        return self.speed_rad_s is not None or self.load_change_N != 0.0


HELD: Final = Future()


@dataclass(frozen=True, slots=True)
class Outlook:
    """Forecast for ``n`` clearances; each quantity has shape (n, 3): low, expected, high.

    ``peak_to_peak_m`` is the shaft's own motion at the probes, without runout; ``residual_m`` is by
    how much the probes report more than that now (runout, harmonics, noise).  ``power_W`` is the
    shaft's, ``friction_W`` the film's part.  ``whirl_margin`` is the damping ratio of the least
    damped mode, ``possible`` (n,) says where the film carries the load at all, ``deviation`` (n, 4)
    holds the model's own standard deviations of power, peak-to-peak, film and margin, ``regime``
    (n,) which factors stretch them.
    """

    clearance_m: Floats
    peak_to_peak_m: Floats
    power_W: Floats
    min_film_m: Floats
    whirl_margin: Floats
    possible: NDArray[np.bool_]
    residual_m: float
    friction_W: Floats
    deviation: Floats
    regime: tuple[str, ...]


class Synchronised(msgspec.Struct, frozen=True, array_like=True):
    """What the synchronised model said of load and viscosity at ``t_ns``, and the oil measured."""

    t_ns: int
    load_N: float
    viscosity_Pa_s: float
    oil_outlet_C: float


class PredictorState(msgspec.Struct):
    """What the predictor remembers: its filters', the newest :data:`HISTORY` estimates, and the
    half order of the last window with the damping ratio that it was seen at."""

    synchroniser: SynchroniserState
    imbalance: ImbalanceState
    history: list[Synchronised] = []
    half_m: float = 0.0
    half_damping: float = 1.0


class Predictor:
    """Surrogate-based predictive model of the running machine.

    Parameters
    ----------
    model
        ``surrogate.onnx``.
    config
        Bearing, rotor, oil, probes.
    factors
        Stretch of the intervals.
    """

    def __init__(
        self, model: Model, config: Config, factors: IntervalFactors | None = None
    ) -> None:
        self._film = Film(
            model.session,
            config.machine.bearing.journal_radius_m,
            config.machine.bearing.length_m,
            config.machine.rotor.mass_at_bearing_kg,
        )
        self._synchroniser = Synchroniser(self._film, config)
        self._factors, self._probes_state = factors or IntervalFactors(), state_of(config)
        self._oil, self._windage_W_s3 = config.machine.lubricant, config.machine.rotor.windage_W_s3
        angles = np.radians([channel.angle_deg for channel in config.machine.channel[:2]])
        self._probes = np.column_stack([np.cos(angles), np.sin(angles)])
        self._slow_roll_m = slow_roll_forward(config)
        self._load_range_N = (
            config.machine.operating.load_min_N,
            config.machine.operating.load_max_N,
        )
        bearing = config.machine.bearing
        self._imbalance = ImbalanceFilter(config.machine)
        self._state = PredictorState(self._synchroniser.state, self._imbalance.state)
        self.candidates_m: Floats = 1e-6 * np.linspace(
            bearing.radial_clearance_min_um, bearing.radial_clearance_max_um, CANDIDATES
        )
        self.label = model.label

    @property
    def state(self) -> PredictorState:
        """All that changes, the filters' included."""
        return self._state

    @state.setter
    def state(self, state: PredictorState) -> None:
        self._state = state
        self._synchroniser.state, self._imbalance.state = state.synchroniser, state.imbalance

    def estimate(self, measured: Measured) -> Estimate:
        """Synchronise the model with the machine; the same ``t_ns`` again only reads the
        estimate."""
        estimate = self._synchroniser.step(measured)
        history = self._state.history
        history.append(
            Synchronised(
                measured.t_ns, estimate.load_N, estimate.viscosity_Pa_s, measured.oil_outlet_C
            )
        )
        del history[:-HISTORY]
        return estimate

    def learn(self, measured: Measured, forward_m: complex) -> None:
        """Let a window speak about unbalance and runout, by its forward first order and its
        half-order band.

        Parameters
        ----------
        measured
            Means over the window; ``t_ns`` is its end.
        forward_m
            Complex amplitude, phase from the mark.
        """
        turns_s = TURNS * 2.0 * math.pi / max(measured.speed_rad_s, 1.0)
        length_ns = round(1e9 * min(max(turns_s, MIN_SECONDS), MAX_SECONDS))
        start_ns = measured.t_ns - length_ns
        inside = [
            (then.load_N, then.viscosity_Pa_s)
            for then in self._state.history
            if start_ns <= then.t_ns <= measured.t_ns
        ]
        if not inside:
            inside = [(e.load_N, e.viscosity_Pa_s) for e in (self._synchroniser.step(measured),)]
        load_N, viscosity = np.mean(inside, axis=0).tolist()
        clearance_m = self._synchroniser.clearance_m(measured)
        points = Points(
            *(np.array([v]) for v in (measured.speed_rad_s, clearance_m, viscosity, load_N))
        )
        steady = self._film.steady(points)
        unbalance = np.array([abs(self._imbalance.present.unbalance_kg_m) + 1e-9])
        x, y = (balanced(self._film, points, steady, unbalance).first_m[0] / unbalance[0]).tolist()
        self._imbalance.step(
            start_ns + length_ns // 2, forward_m - self._slow_roll_m, 0.5 * (x + 1j * y)
        )
        state = self._state
        state.synchroniser.unbalance_kg_m = abs(self._imbalance.at(measured.t_ns).unbalance_kg_m)
        state.half_m, state.half_damping = measured.half_m, float(steady.damping_ratio[0])

    def static_film(self) -> tuple[float, float]:
        """See :meth:`firmware_py.brain.estimate.Synchroniser.static_film`."""
        return self._synchroniser.static_film()

    @property
    def unbalance_interval_kg_m(self) -> tuple[float, float, float]:
        """90 % interval: low, expected, high."""
        present = self._imbalance.present
        size, half = present.size_kg_m, SIGMA_90 * present.size_sd_kg_m
        return max(0.0, size - half), size, size + half

    def forecast(
        self, measured: Measured, estimate: Estimate, clearances_m: Floats, future: Future = HELD
    ) -> Outlook:
        """What the clearances ``clearances_m`` (n,), reached by then, would bring at the end of
        ``future``."""
        every = np.append(clearances_m, measured.clearance_m)
        points = self._points(measured, estimate, every, future)
        steady = self._film.steady(points)
        warming_K = self._warming(
            measured, steady.power_W.reshape(len(every), -1)[:, 0], estimate, future
        )
        if np.abs(warming_K).max() > 0.1:
            thinner = np.exp(
                -self._oil.viscosity_slope_per_K
                * np.repeat(warming_K, len(points.load_N) // len(every))
            )
            points = Points(
                points.speed_rad_s,
                points.clearance_m,
                points.viscosity_Pa_s * thinner,
                points.load_N,
            )
            steady = self._film.steady(points)
        regime = "fault" if self.growing(estimate) else "ramp" if future.moves else "steady"
        imbalance = self._imbalance.at(measured.t_ns, future.seconds)
        starved = starved_share(estimate.ahead(future.seconds)[2])
        return self._outlook(measured, every, points, steady, imbalance, starved, regime)

    def simulate(
        self, measured: Measured, estimate: Estimate, clearances_m: Floats, turns: int = 40
    ) -> Motion:
        """The present operating point at each clearance (n,) followed in time, on demand (a
        fraction of a second)."""
        n, error_m = len(clearances_m), estimate.clearance_m - measured.clearance_m
        points = Points(
            np.full(n, measured.speed_rad_s),
            clearances_m + error_m,
            np.full(n, estimate.viscosity_Pa_s),
            np.full(n, estimate.load_N),
        )
        return simulate(self._film, points, np.full(n, self._imbalance.present.size_kg_m), turns)

    def sense(self, measured: Measured, estimate: Estimate) -> Outlook:
        """Virtual sensors: smallest film and friction power of this moment (the bearing force is
        the load)."""
        return self.forecast(measured, estimate, np.array([measured.clearance_m]), Future(0.0))

    def growing(self, estimate: Estimate) -> bool:
        """Whether unbalance, viscosity or clearance change at a clear rate."""
        return bool(estimate.growing.any()) or self._imbalance.present.growing

    def time_to_limit(
        self, measured: Measured, estimate: Estimate, min_film_m: float, swing_m: float
    ) -> tuple[float, float, float]:
        """Seconds until film or peak-to-peak passes its limit at the present clearance: earliest,
        expected, latest.

        At most the last of :data:`LIMIT_TIMES_S`, which also says never.
        """
        here = np.array([measured.clearance_m])
        rooms = []
        for seconds in LIMIT_TIMES_S:
            look = self.forecast(measured, estimate, here, Future(seconds))
            film, swing = look.min_film_m[0] - min_film_m, swing_m - look.peak_to_peak_m[0, ::-1]
            rooms.append(np.minimum(film, swing))
        low, expected, high = (_crossing(np.array(column)) for column in zip(*rooms, strict=True))
        return low, expected, high

    def _points(
        self, measured: Measured, estimate: Estimate, every: Floats, future: Future
    ) -> Points:
        """Sigma points of every clearance at the end of ``future``."""
        mean, covariance, _ = estimate.ahead(future.seconds)
        sigma = sigma_points(mean, covariance)
        k, n = len(sigma), len(every)
        law = viscosity_Pa_s(self._oil, measured.oil_outlet_C)
        load = np.clip(np.exp(sigma[:, 0]) + future.load_change_N, *self._load_range_N)
        speed = measured.speed_rad_s if future.speed_rad_s is None else future.speed_rad_s
        return Points(
            np.full(k * n, speed),
            np.repeat(every, k) + np.tile(sigma[:, CLEARANCE], n) * UM,
            np.tile(law * np.exp(sigma[:, VISCOSITY]), n),
            np.tile(load, n),
        )

    def _warming(
        self, measured: Measured, friction_W: Floats, estimate: Estimate, future: Future
    ) -> Floats:
        """By how many kelvin the oil will be warmer (n,): heat balance of one node, ``C T' = P - G
        (T - T_in)``."""
        capacity, cooling = self._oil.thermal_capacity_J_K, self._oil.cooling_W_K
        if not (capacity and cooling and future.seconds):
            return np.zeros_like(friction_W)
        tau_s = capacity / cooling
        settled = 1.0 - math.exp(-future.seconds / tau_s)
        followed = 1.0 - settled * tau_s / future.seconds if future.moves else settled
        now_W = self._friction_now_W(measured, estimate)
        return (
            settled * capacity * self._oil_slope_K_s() + followed * (friction_W - now_W)
        ) / cooling

    def _friction_now_W(self, measured: Measured, estimate: Estimate) -> float:
        here = (
            measured.speed_rad_s,
            estimate.clearance_m,
            estimate.viscosity_Pa_s,
            estimate.load_N,
        )
        _, _, torque = self._film.equilibrium(Points(*(np.array([v]) for v in here)))
        return float(torque[0]) * measured.speed_rad_s

    def _oil_slope_K_s(self) -> float:
        """Slope of the oil's temperature over the newest :data:`OIL_SLOPE_S`."""
        history = self._state.history
        oldest_ns = history[-1].t_ns - OIL_SLOPE_S * 1e9
        t, oil = np.array(
            [(then.t_ns, then.oil_outlet_C) for then in history if then.t_ns >= oldest_ns]
        ).T
        t_s = (t - t.mean()) * 1e-9
        spread = float(t_s @ t_s)
        return float(t_s @ oil) / spread if spread > 0.05 else 0.0

    def _outlook(
        self,
        measured: Measured,
        every: Floats,
        points: Points,
        steady: Steady,
        imbalance: Imbalance,
        starved: float,
        regime: str,
    ) -> Outlook:
        shape = (len(every), -1)
        unbalance = np.full(len(points.load_N), imbalance.size_kg_m)
        motion = 2.0 * np.abs(steady.response_m_per_kg_m @ self._probes.T).max(axis=1) * unbalance
        half_m = self._half_order(steady.damping_ratio)
        film = steady.min_film_m(points.clearance_m, unbalance)
        friction = steady.power_W + steady.orbit_power_W_per_kg2_m2 * unbalance**2
        friction += (
            starved * self._film.shear_torque(points, steady.position_m) * points.speed_rad_s
        )
        motion, film, friction = self._finite(
            points, steady, unbalance, (motion, film, friction), shape[0]
        )
        uncertain = math.hypot(SWING_ERROR, imbalance.size_sd_kg_m / imbalance.size_kg_m)
        orbit = motion.reshape(shape)[:, 0]
        windage = self._windage_W_s3 * points.speed_rad_s**3
        values = [
            (friction + windage).reshape(shape),
            (motion + 2.0 * half_m).reshape(shape),
            np.maximum(film - half_m, 0.0).reshape(shape),
            steady.damping_ratio.reshape(shape),
        ]
        model = [
            POWER_ERROR * values[0][:, 0],
            np.hypot(uncertain * orbit, SWING_ERROR_M),
            np.hypot(0.5 * uncertain * orbit, FILM_ERROR_M),
            np.full(len(every), MARGIN_ERROR),
        ]
        deviation = np.column_stack(
            [deviation_of(v, m) for v, m in zip(values, model, strict=True)]
        )
        whirling = (values[3][:, 0] < NEAR_WHIRL) & (regime != "fault")
        regimes = tuple("near_whirl" if near else regime for near in whirling)
        power, swing, least, margin = (
            interval(
                values[i][:, 0],
                deviation[:, i],
                [self._factors.of(self._probes_state, r, name) for r in regimes],
            )
            for i, name in enumerate(("power_W", "peak_to_peak_m", "min_film_m", "whirl_margin"))
        )
        possible = np.asarray(steady.converged.reshape(shape).all(axis=1))
        residual_m = max(0.0, measured.peak_to_peak_m - float(swing[-1, 1]))
        film_power = power - windage.reshape(shape)[:, :1]
        return Outlook(
            every[:-1],
            np.maximum(swing[:-1], 0.0),
            power[:-1],
            least[:-1],
            margin[:-1],
            possible[:-1],
            residual_m,
            film_power[:-1],
            deviation[:-1],
            regimes[:-1],
        )

    def _finite(
        self,
        points: Points,
        steady: Steady,
        unbalance: Floats,
        linear: tuple[Floats, Floats, Floats],
        n: int,
    ) -> tuple[Floats, Floats, Floats]:
        """Motion, smallest film and friction of the linear film, corrected as each candidate's
        expected orbit is."""
        each = len(unbalance) // n
        expected = slice(None, None, each)
        here, still = points[expected], steady[expected]
        orbit = balanced(self._film, here, still, unbalance[expected])
        motion, film, friction = linear
        finite = orbit.swing_m(self._probes)
        larger = finite / np.maximum(motion[expected], 1e-12)
        thicker = orbit.min_film_m(here, still) - film[expected]
        dearer = orbit.power_W - still.orbit_power_W_per_kg2_m2 * unbalance[expected] ** 2
        return (
            motion * np.repeat(larger, each),
            film + np.repeat(thicker, each),
            friction + np.repeat(dearer, each),
        )

    def _half_order(self, damping_ratio: Floats) -> Floats:
        """Half-order amplitude: what was measured, more where the damping falls (response of a mode
        to noise)."""
        now = max(self._state.half_damping, DAMPING_LEAST)
        return np.asarray(
            self._state.half_m * np.sqrt(now / np.maximum(damping_ratio, DAMPING_LEAST))
        )


def slow_roll_forward(config: Config) -> complex:
    """Forward first order (m) of the runout that the slow-roll procedure found."""
    probes = [
        c.slow_roll_um * UM * np.exp(1j * math.radians(c.slow_roll_deg))
        for c in config.machine.channel[:2]
    ]
    x, y = (ChannelMap.from_config(config).to_xy @ np.array(probes)).tolist()
    return 0.5 * complex(x + 1j * y)


def _crossing(room: Floats) -> float:
    """First time at which ``room`` over :data:`LIMIT_TIMES_S` falls below zero, linear between;
    else the last."""
    below = np.flatnonzero(room < 0.0)
    if not below.size:
        return LIMIT_TIMES_S[-1]
    i = int(below[0])
    if i == 0:
        return 0.0
    before, after = room[i - 1], room[i]
    return float(
        LIMIT_TIMES_S[i - 1] + (LIMIT_TIMES_S[i] - LIMIT_TIMES_S[i - 1]) * before / (before - after)
    )
