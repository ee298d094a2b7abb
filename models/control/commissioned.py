"""A machine as its commissioning leaves it: the guard's configuration says what was measured of
this very build.

What every test-rig lab does, each with the error that is left (uniform): the **lift check** (the
shaft pressed from wall to wall of its bearing: clearance less what the actuator tells),
**weighing** (mass, and inertias by the pendulum, for the apparent mass at the bearing in forward
whirl), the **balancing protocol** (residual unbalance), the **zero procedure** (gain and zero of
both displacement probes), and the torque meter's zero at rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from firmware_py.config import Config
from firmware_py.guard.measurement.motion import DISPLACEMENTS
from firmware_py.machine.probes import after_zeroing
from sim_hil.gym.control_task import OBSERVATIONS, Episode
from sim_hil.plant.build import Build
from sim_hil.rigs import RigData, RotorData

CLEARANCE_ERROR_M: Final = 0.5e-6
MASS_ERROR: Final = 0.005
UNBALANCE_ERROR: Final = 0.1
WHIRL_ERROR: Final = 0.005
"""What the apparent mass at one frequency leaves of coupling, pedestal and gyroscopic moments."""

WHIRL_ORDER_MAX: Final = 0.515
"""No plain bearing of ``L/D`` 1/2 whirls at more of the speed (0.512 at eccentricity 0.4,
``equilibrium``)."""

POWER_ERROR_W: Final = 1.0

Observation = NDArray[np.float32]
_X, _Y = (list(OBSERVATIONS).index(f"eccentricity_{axis}_m") for axis in "xy")
_POWER = list(OBSERVATIONS).index("shaft_power_W")


@dataclass(frozen=True)
class Commissioned:
    """What is known of one machine.

    Parameters
    ----------
    config
        The guard's.
    gain, zero_m
        What is left of the errors of both displacement probes, over those of the build: shown less
        ``zero_m``, over ``gain``, is the shaft within what the zero procedure
        leaves (:func:`~firmware_py.machine.probes.after_zeroing`); shape (2,) each.
    power_zero_W
        What the torque meter showed at rest, to :data:`POWER_ERROR_W`.
    """

    config: Config
    gain: NDArray[np.float64]
    zero_m: NDArray[np.float64]
    power_zero_W: float
    probes: NDArray[np.float64]

    @classmethod
    def of(cls, config: Config, rig: RigData, episode: Episode) -> Commissioned:
        """Measured on its machine; errors follow from the build itself: the same build, the same
        errors."""
        build = episode.build
        rng = np.random.default_rng(np.array([build.mass, build.clearance_error_m]).view(np.uint64))
        lift, weight, balance, power, *probes = rng.uniform(-1.0, 1.0, 8).tolist()
        bearing = msgspec.structs.replace(
            config.machine.bearing,
            radial_clearance_error_um=1e6 * CLEARANCE_ERROR_M,
            radial_clearance_offset_um=1e6 * (build.clearance_error_m + CLEARANCE_ERROR_M * lift),
        )
        mass_kg = apparent_mass_kg(
            rig.rotor, build, 0.5 * config.machine.operating.speed_max_rpm * pi / 30.0
        )
        rotor = msgspec.structs.replace(
            config.machine.rotor,
            mass_error_share=MASS_ERROR,
            whirl_error_share=WHIRL_ERROR,
            unbalance_measured=True,
            shaft_power_error_W=POWER_ERROR_W,
            effective_mass_at_bearing_kg=mass_kg * (1.0 + MASS_ERROR * weight),
            unbalance_normal_kg_m=build.unbalance_kg_m
            * (1.0 + UNBALANCE_ERROR * balance)
            / (1.0 - UNBALANCE_ERROR),
        )
        channel = [
            msgspec.structs.replace(c, zeroed=c.zeroed or i in DISPLACEMENTS)
            for i, c in enumerate(config.machine.channel)
        ]
        left = after_zeroing(config.machine)
        gain = build.gain[:2] * (1.0 + left.gain_share * np.array(probes[:2]))
        zero_m = build.zero[:2] + left.zero_m * np.array(probes[2:])
        known = config.replaced(bearing=bearing, rotor=rotor, channel=channel)
        zero_W = episode.power_error_W + POWER_ERROR_W * power
        return cls(known, gain, zero_m, zero_W, rig.probes)

    def corrected(self, observation: Observation) -> Observation:
        """``observation`` (11,) with what calibrated probes and torque meter show."""
        shown = self.probes @ observation[[_X, _Y]].astype(np.float64)
        seen = observation.copy()
        seen[[_X, _Y]] = np.linalg.solve(self.probes, (shown - self.zero_m) / self.gain)
        seen[_POWER] -= self.power_zero_W
        return seen


def apparent_mass_kg(rotor: RotorData, build: Build, frequency_rad_s: float) -> float:
    """Force over acceleration at the bearing of a rigid rotor that hangs in its coupling and whirls
    forward, kg.

    With the bearing's and the coupling's displacement as coordinates: ``M_bb + M_bh^2 w^2 / (k -
    M_hh w^2)``.  The gyroscopic moment of a forward whirl acts as less inertia, ``J_d - J_p /
    order``.
    """
    a, b = rotor.coupling_to_cg_m, rotor.bearing_to_cg_m
    mass, span2 = rotor.mass_kg * build.mass, (a + b) ** 2
    inertia = (
        rotor.diametral_inertia_kg_m2 - rotor.polar_inertia_kg_m2 / WHIRL_ORDER_MAX
    ) * build.inertia
    at_bearing, at_hinge = (mass * a * a + inertia) / span2, (mass * b * b + inertia) / span2
    between = (mass * a * b - inertia) / span2
    w2 = frequency_rad_s * frequency_rad_s
    return at_bearing + between * between * w2 / (
        rotor.coupling_stiffness_N_m * build.coupling - at_hinge * w2
    )
