"""The film against published tables."""

from __future__ import annotations

import math
from collections.abc import Iterator

from sim_hil.film import Equilibrium, equilibrium
from sim_hil.verify.closed_forms import MU, OMEGA, C, R
from sim_hil.verify.row import Row, reference


def _state(eps: float, ratio: float) -> Equilibrium:
    return equilibrium(
        eccentricity_ratio=eps, inlet="groove_hmax", radius_m=R, length_m=2 * R * ratio, clearance_m=C,
        viscosity_Pa_s=MU, speed_rad_s=OMEGA,
    )  # fmt: skip


def raimondi_boyd() -> Iterator[Row]:
    """Performance of the full bearing, L/D = 1, 1/2, 1/4; the digits of 1958 carry one to two percent."""
    table = reference("raimondi_boyd_1958.json")
    allowed = table["tolerance"]
    for ratio, rows in table["rows"].items():
        for eps, sommerfeld, attitude, friction, flow, share, pressure in rows:
            state = _state(eps, float(ratio))
            length = 2 * R * float(ratio)
            side_flow = state.side_flow_m3_s / (R * C * OMEGA / (2 * math.pi) * length)
            mean = state.load_N / (length * 2 * R) / float(state.film.max_pressure_Pa)
            case = f"L/D={ratio} eps={eps}:"
            source = "Raimondi and Boyd 1958, digits recalled, not checked against print"
            angle = math.degrees(state.attitude_rad)
            yield Row(f"{case} S", state.sommerfeld, sommerfeld, source, allowed["S"])
            yield Row(f"{case} attitude, deg", angle, attitude, source, allowed["attitude_deg"], True)
            yield Row(f"{case} (R/c) f", state.friction_variable, friction, source, allowed["friction_var"])
            yield Row(f"{case} Q_s/(RcNL)", side_flow, flow * share, source, allowed["side_flow"])
            yield Row(f"{case} P/p_max", mean, pressure, source, allowed["P_over_pmax"])


def raimondi_boyd_excerpt() -> Iterator[Row]:
    """The columns of the L/D = 1 table that the stored excerpt shows."""
    table = reference("raimondi_boyd_LD1.json")
    for row in table["rows"]:
        state = _state(row["eps"], 1.0)
        case = f"L/D=1 eps={row['eps']} (excerpt):"
        yield Row(f"{case} S", state.sommerfeld, row["S"], "raimondi_boyd_LD1.json", 2e-2)
        yield Row(f"{case} (R/c) f", state.friction_variable, row["friction_var"], "raimondi_boyd_LD1.json", 2e-2)
