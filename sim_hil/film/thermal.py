"""The film with the oil at the temperature that its own friction makes: one node, steady.

    torque |omega| = rho c_p (Q + Q_jacket) (T - T_inlet),   mu = mu(T)

`Q` is what leaves at the ends (fed or not), `Q_jacket` what is pumped through beside the film. The
same balance and viscosity law as the rig's, which follows it in time
(`sim_hil.rotor.bearing.heat_oil`).
"""

from dataclasses import dataclass
from typing import Unpack

import numpy as np

from sim_hil.rigs import OilData

from .balance import bracketed_root
from .equilibrium import Equilibrium, equilibrium
from .records import FilmError, FilmRules

_HOTTEST_RISE_K = 500.0


@dataclass(frozen=True)
class ThermalEquilibrium:
    """An equilibrium and the oil temperature that belongs to it.

    Parameters
    ----------
    equilibrium
        With the viscosity at `oil_C`.
    oil_C, viscosity_Pa_s
        Temperature, degrees Celsius, and viscosity of the oil in the film.
    power_W
        Friction power, which the oil carries off.
    """

    equilibrium: Equilibrium
    oil_C: float
    viscosity_Pa_s: float
    power_W: float


def thermal_equilibrium(
    *,
    oil: OilData,
    clearance_m: float,
    speed_rad_s: float,
    load_N: float | None = None,
    eccentricity_ratio: float | None = None,
    load_angle_rad: float = -np.pi / 2,
    jacket_flow_m3_s: float = 0.0,
    **film: Unpack[FilmRules],
) -> ThermalEquilibrium:
    """Equilibrium of the journal with warm oil; isothermal is `equilibrium` with the viscosity at
    the inlet.

    Parameters
    ----------
    oil
        Viscosity law, density, heat capacity and inlet temperature.
    jacket_flow_m3_s
        OilData at inlet temperature that is pumped through beside the film's own flow, m3/s.
    load_N, eccentricity_ratio, load_angle_rad, clearance_m, speed_rad_s, **film
        As in `equilibrium`.

    Raises
    ------
    FilmError
        As `equilibrium`; or a negative jacket flow; or no temperature within 500 K of the inlet
        carries the power off.
    """
    if not (np.isfinite(jacket_flow_m3_s) and jacket_flow_m3_s >= 0):
        raise FilmError(f"jacket_flow_m3_s = {jacket_flow_m3_s}: must be finite and not below zero")

    def at(oil_C: float) -> Equilibrium:
        return equilibrium(
            load_N=load_N,
            eccentricity_ratio=eccentricity_ratio,
            load_angle_rad=load_angle_rad,
            clearance_m=clearance_m,
            speed_rad_s=speed_rad_s,
            viscosity_Pa_s=oil.viscosity_at(oil_C),
            **film,
        )

    def surplus(oil_C: float) -> float:
        """Friction power less what the oil carries off, over the friction power."""
        state = at(oil_C)
        carried = (
            oil.density_kg_m3 * oil.heat_capacity_J_kgK * (state.side_flow_m3_s + jacket_flow_m3_s)
        )
        return 1 - carried * (oil_C - oil.inlet_C) / max(_power(state, speed_rad_s), 1e-300)

    low, high = oil.inlet_C, oil.inlet_C + 8.0
    while surplus(high) > 0:
        low, high = high, oil.inlet_C + 2 * (high - oil.inlet_C)
        if high > oil.inlet_C + _HOTTEST_RISE_K:
            raise FilmError(
                f"the film's own flow and jacket_flow_m3_s = {jacket_flow_m3_s} do not carry its "
                f"friction power off "
                f"below {low:.6g} C; give it a feed or a jacket flow"
            )
    oil_C = bracketed_root(surplus, low, high, 1e-6)
    state = at(oil_C)
    return ThermalEquilibrium(state, oil_C, oil.viscosity_at(oil_C), _power(state, speed_rad_s))


def _power(state: Equilibrium, speed_rad_s: float) -> float:
    return float(state.film.friction_torque_N_m) * abs(speed_rad_s)
