"""The film with oil at the temperature that its friction makes."""

import numpy as np
import pytest

from sim_hil.film import FilmError, equilibrium
from sim_hil.film.thermal import thermal_equilibrium
from sim_hil.rigs import OilData

OIL = OilData(0.01, 0.03, 40.0, 850.0, 2000.0, 40.0, (40.0, 40.0), 60.0)
FILM = {
    "radius_m": 0.02,
    "length_m": 0.02,
    "clearance_m": 60e-6,
    "speed_rad_s": 1256.0,
    "grid": (64, 8),
}


def test_friction_heats_what_flows_out():
    state = thermal_equilibrium(oil=OIL, load_N=100.0, jacket_flow_m3_s=1e-6, **FILM)
    carried = 850 * 2000 * (state.equilibrium.side_flow_m3_s + 1e-6) * (state.oil_C - 40)
    assert state.power_W == pytest.approx(carried, rel=1e-5)
    assert state.power_W == pytest.approx(
        float(state.equilibrium.film.friction_torque_N_m) * 1256, rel=1e-12
    )
    cold = equilibrium(load_N=100.0, viscosity_Pa_s=0.01, **FILM)
    assert state.oil_C > 41
    assert state.viscosity_Pa_s == pytest.approx(0.01 * np.exp(-0.03 * (state.oil_C - 40)))
    assert state.power_W < float(cold.film.friction_torque_N_m) * 1256
    assert state.equilibrium.eccentricity_ratio > cold.eccentricity_ratio


def test_jacket_flow_makes_it_isothermal():
    state = thermal_equilibrium(oil=OIL, eccentricity_ratio=0.5, jacket_flow_m3_s=1.0, **FILM)
    assert state.oil_C == pytest.approx(40, abs=1e-3)


def test_a_film_without_outflow_is_refused():
    with pytest.raises(FilmError, match="do not carry its friction power off"):
        thermal_equilibrium(oil=OIL, eccentricity_ratio=0.5, rupture="full", **FILM)
    with pytest.raises(FilmError, match="jacket_flow_m3_s = -1"):
        thermal_equilibrium(oil=OIL, eccentricity_ratio=0.5, jacket_flow_m3_s=-1.0, **FILM)
