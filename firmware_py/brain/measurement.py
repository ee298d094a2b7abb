"""What the instruments say of the film, and what each of them tells about load, viscosity and
clearance.

Parameters of one machine, in this order: ``ln`` load; ``ln`` viscosity over the oil's law; error of
the reported clearance (um); zero of the shaft position x, y (um); gains of the two probes; offset
of the shaft power (W); ``ln`` of the contact channel's film resistance over its declared one;
``ln`` of the film's filled share.

A starved film carries less than it shears: of the viscosity it carries with (the second parameter),
the share ``s`` is filled, friction falls with ``s`` and load capacity with ``s^2.5``.

What cannot be told apart: in an isothermal plain film the position follows from one number, the
Sommerfeld number ``viscosity speed / load (R / c)^2``, so its Fisher information about load and
viscosity is singular. Shaft power measures viscosity where friction is large against the channel's
error, the oil temperature bounds it everywhere, and the contact resistance measures the smallest
film, which tells position from clearance.  A starved film and a thinner oil differ in friction
alone; wear of the bore and a drifting probe differ in the contact resistance alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.channel_map import ChannelMap
from firmware_py.brain.film import Film, Points
from firmware_py.brain.orbit import Orbit, balanced
from firmware_py.config import Config
from firmware_py.config.instances import places
from firmware_py.machine import Machine
from firmware_py.machine.contact import contact_volt, roughness_volt
from firmware_py.machine.lubricant import viscosity_Pa_s
from firmware_py.machine.probes import as_built, probe_errors

Floats = NDArray[np.float64]

LOAD, VISCOSITY, CLEARANCE, ZERO_X, ZERO_Y, GAIN_1, GAIN_2, POWER, CONTACT, FILLED = range(10)
PARAMETERS: Final = 10
ROWS: Final = ("position_x", "position_y", "shaft_power", "contact")
UM: Final = 1e-6

MEANS_LAG_S: Final = 0.1
"""Mean position and contact voltage are this much older than the speed."""
READING_AGE_S: Final = 0.05
"""Clearance and power are this much older than the speed."""
POSITION_MODEL_UM: Final = 0.1
"""Mean of an orbit against the static position, and the surrogate's own error."""
ORBIT_CURVATURE: Final = 0.3
"""Error of the modelled shift by an orbit, as a share of its amplitude squared over the
clearance."""
RUNOUT_ALL_ORDERS: Final = (5.0, 3.0)
"""Amplitude of all that a probe's runout makes over the greatest of one order (a fraction)."""
WHIRL_SHARE: Final = 0.15
"""Of the clearance: amplitude beyond the modelled one that is called whirl."""
POWER_MODEL: Final = (0.2, 0.007)
"""Deviation of the modelled power: W, and share."""
CONTACT_MEAN_SHARE: Final = 0.3
"""Deviation of the mean contact voltage over the noise of its sample."""
CONTACT_NOISE_V: Final = 0.005
"""Of a sample, where the channel names no ``noise_rms``."""

CARRIES: Final = 2.5
"""A film whose share ``s`` is filled carries ``s`` to this power: exponent of the load in the
film's length."""

_LOG_STEP: Final = 0.01
_FLAT: Final = math.sqrt(3.0)
"""A quantity that is even within +-a has the standard deviation a over this."""


@dataclass(frozen=True, slots=True)
class Measured:
    """What the newest whole turns and readings say about the bearing, SI.

    ``peak_to_peak_m`` is the probes'; ``contact_V`` is NaN without the channel; ``half_m`` is the
    amplitude of the orbit's half-order band.
    """

    speed_rad_s: float
    clearance_m: float
    mean_x_m: float
    mean_y_m: float
    peak_to_peak_m: float
    shaft_power_W: float
    oil_outlet_C: float
    contact_V: float = math.nan
    half_m: float = 0.0
    t_ns: int = 0

    @property
    def observed(self) -> Floats:
        """What the filter takes, shape (4,): um, W, V in the order of :data:`ROWS`."""
        return np.array(
            [self.mean_x_m / UM, self.mean_y_m / UM, self.shaft_power_W, self.contact_V]
        )

    def at_means(self, last: Measured) -> Measured:
        """The readings taken back to the middle of the means, along their change since ``last``."""
        elapsed_s = (self.t_ns - last.t_ns) * 1e-9
        share, slow = (
            min(1.0, lag_s / elapsed_s) for lag_s in (MEANS_LAG_S, MEANS_LAG_S - READING_AGE_S)
        )
        return replace(
            self,
            speed_rad_s=self.speed_rad_s - share * (self.speed_rad_s - last.speed_rad_s),
            clearance_m=self.clearance_m - slow * (self.clearance_m - last.clearance_m),
            shaft_power_W=self.shaft_power_W - slow * (self.shaft_power_W - last.shaft_power_W),
        )


@dataclass(frozen=True, slots=True)
class Errors:
    """Declared errors of sensors and build as standard deviations (even distributions: half-width
    over root 3)."""

    zero_um: float
    gain: float
    clearance_um: float
    power_W: float
    oil_C: float
    viscosity: float

    @classmethod
    def of(cls, config: Config) -> Errors:
        """Those of the configuration: what commissioning measured is known better than the
        drawing."""
        machine, probes = config.machine, probe_errors(config.machine)
        return cls(
            probes.zero_m / UM / _FLAT,
            probes.gain_share / _FLAT,
            machine.bearing.radial_clearance_error_um / _FLAT,
            machine.rotor.shaft_power_error_W / _FLAT,
            machine.readings.oil_outlet_error_C / _FLAT,
            machine.lubricant.viscosity_error_share / _FLAT,
        )

    def log_viscosity(self, slope_per_K: float) -> float:
        """Deviation of ``ln`` viscosity over the law at the measured temperature: batch of oil and
        thermometer."""
        return math.hypot(self.viscosity, slope_per_K * self.oil_C)


@dataclass(frozen=True, slots=True)
class Shown:
    """What the sensors show of a film.

    Attributes
    ----------
    values, slopes
        Shapes (4,) and (4, 10): :data:`ROWS` and their slopes by the parameters.
    position_m
        Shape (4, 2): equilibria to start from next time.
    reach_m
        How far the modelled orbit goes from its mean.
    runout_m
        Most that the probes' runout may add to an amplitude.
    """

    values: Floats
    slopes: Floats
    position_m: Floats
    reach_m: float
    runout_m: float

    def whirls(self, measured: Measured) -> bool:
        """Whether the shaft moves far more than the modelled orbit and any runout: means then tell
        nothing at rest."""
        beyond_m = 0.5 * measured.peak_to_peak_m - self.runout_m - self.reach_m
        return beyond_m > WHIRL_SHARE * measured.clearance_m


class Instruments:
    """Predicts what the sensors show of a film.

    Parameters
    ----------
    film
        The surrogate of this bearing.
    config
        Oil, rotor, probes, contact channel.
    """

    def __init__(self, film: Film, config: Config) -> None:
        self._film = film
        self._oil, self._windage, self._contact = (
            config.machine.lubricant,
            config.machine.rotor.windage_W_s3,
            config.machine.contact,
        )
        runout = as_built(config.machine)
        self._runout_m = runout.forward_runout_m
        self._runout_most_m = runout.runout_m * RUNOUT_ALL_ORDERS[0] / RUNOUT_ALL_ORDERS[1]
        self._clearance_noise_um = config.machine.actuator.position_noise_um
        self._contact_noise_V = CONTACT_MEAN_SHARE * _contact_noise_V(config.machine)
        to_xy = ChannelMap.from_config(config).to_xy
        probes = np.linalg.inv(to_xy)
        self._gains = np.stack([np.outer(to_xy[:, i], probes[i]) for i in range(2)])

    def predict(
        self,
        theta: Floats,
        measured: Measured,
        unbalance_kg_m: float = 0.0,
        start_m: Floats | None = None,
    ) -> Shown:
        """What the sensors show at ``theta`` (10,), from the positions ``start_m`` (4, 2) on."""
        points = self._around(theta, measured)
        clearance = points.clearance_m
        position, found, torque = self._film.equilibrium(points, start_m)
        orbit = self._orbit(points, position, found, torque, unbalance_kg_m)
        mean = position + orbit.shift_m
        shown_um = mean @ self._gain(theta).T / UM + theta[ZERO_X : ZERO_Y + 1]
        speed = measured.speed_rad_s
        starved = self._film.shear_torque(points, position) * speed
        friction = torque * speed + starved * starved_share(theta[FILLED]) + orbit.power_W
        power = friction + self._windage * speed**3 + theta[POWER]
        on_the_way = position[:, None] + orbit.path_m()
        film_m = clearance[:, None] - np.hypot(on_the_way[..., 0], on_the_way[..., 1])
        volt = self._volt(film_m * math.exp(theta[CONTACT])).mean(axis=1)
        columns = np.column_stack([shown_um, power, volt])
        slopes = np.zeros((4, PARAMETERS))
        slopes[:, : CLEARANCE + 1] = (columns[1:] - columns[0]).T / _LOG_STEP
        slopes[:, CLEARANCE] *= UM / clearance[0]
        slopes[:2, ZERO_X : ZERO_Y + 1] = np.eye(2)
        slopes[:2, GAIN_1 : GAIN_2 + 1] = (self._gains @ mean[0]).T / UM
        slopes[2, POWER] = 1.0
        slopes[2, FILLED] = (
            starved[0]
            * (starved_share(theta[FILLED] + _LOG_STEP) - starved_share(theta[FILLED]))
            / _LOG_STEP
        )
        more = self._volt(film_m[0] * math.exp(theta[CONTACT] + _LOG_STEP)).mean()
        slopes[3, CONTACT] = (more - volt[0]) / _LOG_STEP
        way_m = on_the_way[0] - mean[0]
        reach_m = float(np.hypot(*way_m.T).max())
        return Shown(columns[0], slopes, position, reach_m, self._runout_most_m)

    def static_film(self, theta: Floats, measured: Measured) -> tuple[float, Floats]:
        """Film (m) at the mean position that the probes report, and its slopes (10,) by the
        parameters ``theta``."""
        gain = self._gain(theta)
        mean_m = np.linalg.solve(
            gain, [measured.mean_x_m, measured.mean_y_m] - theta[ZERO_X : ZERO_Y + 1] * UM
        )
        eccentricity_m = float(np.hypot(*mean_m))
        outward = np.linalg.solve(gain.T, mean_m / max(eccentricity_m, 1e-9))
        slopes = np.zeros(PARAMETERS)
        slopes[CLEARANCE] = UM
        slopes[ZERO_X : ZERO_Y + 1] = outward * UM
        slopes[GAIN_1 : GAIN_2 + 1] = self._gains @ mean_m @ outward
        return measured.clearance_m + theta[CLEARANCE] * UM - eccentricity_m, slopes

    def _gain(self, theta: Floats) -> Floats:
        """What the probes make of a position, shape (2, 2)."""
        return np.asarray(np.eye(2) + np.tensordot(theta[GAIN_1 : GAIN_2 + 1], self._gains, 1))

    def _orbit(
        self,
        points: Points,
        position: Floats,
        found: NDArray[np.bool_],
        torque: Floats,
        unbalance_kg_m: float,
    ) -> Orbit:
        """The orbit (1,) at the first of ``points``."""
        here = points[:1]
        steady = self._film.about(here, position[:1], found[:1], torque[:1])
        return balanced(self._film, here, steady, np.array([unbalance_kg_m]))

    def noise(self, values: Floats, slopes: Floats, measured: Measured) -> Floats:
        """Covariance (4, 4) of what varies from reading to reading: model, noise, orbit, reported
        clearance."""
        amplitude_m = max(0.0, 0.5 * measured.peak_to_peak_m - self._runout_m)
        curved_um = ORBIT_CURVATURE * amplitude_m**2 / measured.clearance_m / UM
        position = math.hypot(POSITION_MODEL_UM, curved_um)
        volt = math.hypot(
            self._contact_noise_V,
            0.0 if self._contact is None else roughness_volt(self._contact, values[3]),
        )
        own = np.array(
            [
                position,
                position,
                math.hypot(POWER_MODEL[0], POWER_MODEL[1] * values[2]),
                math.hypot(volt, curved_um * slopes[3, CLEARANCE]),
            ]
        )
        reported = self._clearance_noise_um * slopes[:, CLEARANCE]
        return np.asarray(np.diag(own**2) + np.outer(reported, reported))

    def _around(self, theta: Floats, measured: Measured) -> Points:
        """The operating point at ``theta``, and one step of ``ln`` load, ``ln`` viscosity, ``ln``
        clearance each."""
        steps = _LOG_STEP * np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
        base = np.array(
            [
                theta[LOAD],
                theta[VISCOSITY] + math.log(viscosity_Pa_s(self._oil, measured.oil_outlet_C)),
                math.log(measured.clearance_m + theta[CLEARANCE] * UM),
            ]
        )
        load, viscosity, clearance = np.exp(base + steps).T
        return Points(np.full(4, measured.speed_rad_s), clearance, viscosity, load)

    @property
    def has_contact(self) -> bool:
        """Whether the configuration says what the contact channel means."""
        return self._contact is not None

    def _volt(self, film_m: Floats) -> Floats:
        return (
            np.zeros_like(film_m) if self._contact is None else contact_volt(self._contact, film_m)
        )


def _contact_noise_V(machine: Machine) -> float:
    place = places(machine.channel).of("contact_resistance")
    noise_V = machine.channel[place].noise_rms if place >= 0 else None
    return CONTACT_NOISE_V if noise_V is None else noise_V


def starved_share(log_filled: float) -> float:
    """Friction beyond the film's own, over the shear torque at the viscosity with which it
    carries."""
    return math.exp((1.0 - CARRIES) * log_filled) - 1.0


def information(
    instruments: Instruments,
    errors: Errors,
    slope_per_K: float,
    contact_share: float,
    load_N: float,
    measured: Measured,
) -> dict[str, Floats]:
    """Fisher information (3, 3) about ``ln`` load, ``ln`` viscosity, clearance error (um), by what
    gives it.

    One reading, the instruments' constant errors counted in its variance: what position, shaft
    power, contact resistance, oil temperature and the clearance sensor tell, each alone.
    """
    theta = np.zeros(PARAMETERS)
    theta[LOAD] = math.log(load_N)
    shown = instruments.predict(theta, measured)
    values, slopes = shown.values, shown.slopes
    constant = np.array(
        [errors.zero_um, errors.zero_um, errors.gain, errors.gain, errors.power_W, contact_share]
    )
    bias = slopes[:, ZERO_X:FILLED] * constant
    variance = instruments.noise(values, slopes, measured) + bias @ bias.T
    found = {}
    for name, rows in {"position": [0, 1], "shaft_power": [2], "contact": [3]}.items():
        part = slopes[rows, : CLEARANCE + 1]
        found[name] = np.asarray(part.T @ np.linalg.solve(variance[np.ix_(rows, rows)], part))
    found["oil_temperature"] = np.diag([0.0, errors.log_viscosity(slope_per_K) ** -2, 0.0])
    found["clearance_sensor"] = np.diag([0.0, 0.0, errors.clearance_um**-2])
    return found
