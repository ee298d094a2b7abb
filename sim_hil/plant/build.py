"""One build of a rig: how this example differs from the drawing, within the spread of its
``simulation.toml``."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from firmware_py.machine.contact import MIDDLING_M, ROUGHNESS_M
from sim_hil.rigs import ChannelData, RigData
from sim_hil.rigs.data import shifted
from sim_hil.rotor.parameters import N_SENSORS, Floats

GRADE_RPM = 6000.0
"""Balance grades G of the rig are meant at this speed, for the effective mass at the bearing."""

DECLARED_MARGIN = 1.03
"""Of the declared unbalance: as far as its digits go."""

_BOLT_SPREAD = 0.05
_ROOM_DB = (60.0, 75.0)
_HOUSING_HZ = (1600.0, 1450.0, 1700.0)
_REFERENCE_PA = 20e-6


def unbalance_of_grade(rig: RigData, grade: float) -> float:
    """Unbalance in kg m of balance grade G (ISO 21940-11: ``G = e omega`` in mm/s) at 6000 rpm."""
    return grade * 1e-3 * rig.rotor.effective_mass_kg / (GRADE_RPM * 2 * math.pi / 60)


@dataclass(frozen=True)
class Build:
    """Factors (1 = as drawn) and absolute errors of one build.

    ``bolt``: stiffness factors of the four pedestal and four motor bolts.  ``bolt_gap_m``: how far
    each would back off when loose.  ``gain``, ``zero``: calibration of the channels, SI.
    ``runout_m``: amplitude of the two displacement probes in orders 1 to 3, shape (2, 3).
    ``supply_delay``: of dead time, lag and slowness of the supply pressure; ``pump``: of what the
    pump gives and of the hold-up.
    """

    mass: float
    inertia: float
    coupling: float
    contact: float
    damping: float
    clearance_error_m: float
    viscosity: float
    unbalance_kg_m: float
    unbalance_angle_rad: float
    bolt: Floats
    bolt_gap_m: Floats
    gain: Floats
    zero: Floats
    runout_m: Floats
    runout_phase_rad: Floats
    housing_rad_s: Floats
    roughness_m: float
    room_Pa: float
    excitation: float
    motor_angle_rad: float
    supply_delay: float = 1.0
    pump: float = 1.0

    @classmethod
    def nominal(cls, rig: RigData) -> Build:
        """The drawing itself with ideal sensors and the rig's own normal unbalance."""
        return cls(
            mass=1.0,
            inertia=1.0,
            coupling=1.0,
            contact=1.0,
            damping=1.0,
            clearance_error_m=0.0,
            viscosity=1.0,
            unbalance_kg_m=rig.rotor.unbalance_kg_m,
            unbalance_angle_rad=0.0,
            bolt=np.ones(8),
            bolt_gap_m=np.full(8, 1e-4),
            gain=np.ones(N_SENSORS),
            zero=np.zeros(N_SENSORS),
            runout_m=np.zeros((2, 3)),
            runout_phase_rad=np.zeros((2, 3)),
            housing_rad_s=2 * math.pi * np.array(_HOUSING_HZ),
            roughness_m=MIDDLING_M,
            room_Pa=_REFERENCE_PA * 10 ** (66 / 20),
            excitation=1.0,
            motor_angle_rad=0.0,
        )

    @classmethod
    def draw(cls, rig: RigData, rng: np.random.Generator) -> Build:
        """One build within the declared spread (uniform; grade, gap and excitation log-uniform)."""
        spread, most = rig.spread, rig.build_errors

        def around(share: float) -> float:
            return 1.0 + float(rng.uniform(-share, share))

        def log_uniform(low: float, high: float, size: int | None = None) -> Floats:
            return np.exp(rng.uniform(math.log(low), math.log(high), size))

        gain, zero = _calibration(rig.channels, rng)
        # numbers of their own: what was drawn from a seed before there was a supply stays the same
        supply = rng.spawn(1)[0].uniform(-1.0, 1.0, 2).tolist()
        return cls(
            mass=around(most.mass_share),
            inertia=around(spread.inertia_share),
            coupling=around(spread.coupling_stiffness_share),
            contact=around(spread.contact_stiffness_share),
            damping=around(spread.foundation_damping_share),
            clearance_error_m=float(rng.uniform(-1, 1)) * most.clearance_m,
            viscosity=around(most.viscosity_share),
            unbalance_kg_m=unbalance_of_grade(rig, float(log_uniform(*_healthy_grades(rig)))),
            unbalance_angle_rad=float(rng.uniform(0, 2 * math.pi)),
            bolt=1.0 + rng.uniform(-_BOLT_SPREAD, _BOLT_SPREAD, 8),
            bolt_gap_m=log_uniform(
                shifted(spread.bolt_gap_min_um, -6), shifted(spread.bolt_gap_max_um, -6), 8
            ),
            gain=gain,
            zero=zero,
            runout_m=rng.uniform(0.0, most.runout_m, (2, 1)) * np.array([0.6, 0.3, 0.1]),
            runout_phase_rad=rng.uniform(0, 2 * math.pi, (2, 3)),
            housing_rad_s=2
            * math.pi
            * np.array(_HOUSING_HZ)
            * (1 + rng.uniform(-1, 1, 3) * spread.housing_mode_share),
            roughness_m=float(rng.uniform(*ROUGHNESS_M)),
            room_Pa=_REFERENCE_PA * 10 ** (float(rng.uniform(*_ROOM_DB)) / 20),
            excitation=float(log_uniform(0.5, 2.0)),
            motor_angle_rad=float(rng.uniform(0, 2 * math.pi)),
            supply_delay=1.0 + supply[0] * rig.supply.error_share,
            pump=1.0 + supply[1] * rig.supply.pump_error_share,
        )

    @classmethod
    def of_seed(cls, rig: RigData, seed: int) -> Build:
        """The build that belongs to the seed of a run."""
        return cls.draw(rig, np.random.default_rng([seed, 3]))


def _healthy_grades(rig: RigData) -> tuple[float, float]:
    """Grades of healthy builds: those of the spread, but none beyond the declared unbalance.

    The spread's grades are meant at :data:`GRADE_RPM`, and of a machine that turns five times as
    fast, and is balanced for it, they would make one that its own device trips.
    """
    least, most = rig.spread.normal_unbalance_min_G, rig.spread.normal_unbalance_max_G
    declared = DECLARED_MARGIN * rig.rotor.unbalance_kg_m / unbalance_of_grade(rig, 1.0)
    if not 0.0 < declared < most:
        return least, most
    return min(least, declared * least / most), declared


def _calibration(
    channels: tuple[ChannelData, ...], rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Gain and zero of each channel within its errors (uniform)."""
    gain = np.array([1 + rng.uniform(-1, 1) * c.gain_error_share for c in channels])
    zero = np.array([rng.uniform(-1, 1) * c.zero_error for c in channels])
    return gain, zero
