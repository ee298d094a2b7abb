"""The film against published tables."""

from __future__ import annotations

import math
from collections.abc import Iterator

from sim_hil.film import Equilibrium, FeedPatch, equilibrium
from sim_hil.verify.closed_forms import MU, OMEGA, C, R
from sim_hil.verify.row import ComparisonRow, reference


def _state(eps: float, ratio: float) -> Equilibrium:
    return equilibrium(
        eccentricity_ratio=eps,
        inlet="groove_hmax",
        radius_m=R,
        length_m=2 * R * ratio,
        clearance_m=C,
        viscosity_Pa_s=MU,
        speed_rad_s=OMEGA,
    )


def raimondi_boyd() -> Iterator[ComparisonRow]:
    """Performance of the full bearing, L/D = 1, 1/2, 1/4: digits without a print in hand, which
    judge nothing; those of the excerpt do (:func:`raimondi_boyd_excerpt`)."""
    table = reference("raimondi_boyd_1958.json")
    for ratio, rows in table["rows"].items():
        for eps, sommerfeld, attitude, friction, flow, share, pressure in rows:
            state = _state(eps, float(ratio))
            length = 2 * R * float(ratio)
            side_flow = state.side_flow_m3_s / (R * C * OMEGA / (2 * math.pi) * length)
            mean = state.load_N / (length * 2 * R) / float(state.film.max_pressure_Pa)
            case = f"L/D={ratio} eps={eps}:"
            source = "Raimondi and Boyd 1958, digits recalled, no print in hand: not judged"
            angle = math.degrees(state.attitude_rad)
            for name, value, printed in (
                ("S", state.sommerfeld, sommerfeld),
                ("attitude, deg", angle, attitude),
                ("(R/c) f", state.friction_variable, friction),
                ("Q_s/(RcNL)", side_flow, flow * share),
                ("P/p_max", mean, pressure),
            ):
                yield ComparisonRow(f"{case} {name}", value, printed, source, None)


def raimondi_boyd_excerpt() -> Iterator[ComparisonRow]:
    """The columns of the L/D = 1 table that the stored excerpt shows."""
    table = reference("raimondi_boyd_LD1.json")
    for row in table["rows"]:
        state = _state(row["eps"], 1.0)
        case = f"L/D=1 eps={row['eps']} (excerpt):"
        yield ComparisonRow(f"{case} S", state.sommerfeld, row["S"], "raimondi_boyd_LD1.json", 2e-2)
        yield ComparisonRow(
            f"{case} (R/c) f",
            state.friction_variable,
            row["friction_var"],
            "raimondi_boyd_LD1.json",
            2e-2,
        )


def two_axial_grooves() -> Iterator[ComparisonRow]:
    """Static and dynamic columns of the bearing with grooves at right angles to the load, L/D =
    1/2."""
    table = reference("two_axial_grooves_LD05.json")
    for name, book in (("Lund", table["lund"]), ("Someya", table["someya"])):
        width, source, allowed = math.radians(book["groove_deg"]), book["source"], book["tolerance"]
        grooves = [FeedPatch("groove", angle, width, R, 0.0) for angle in (0.0, math.pi)]
        for sommerfeld, eps, attitude, *coefficients in book["rows"]:
            state = equilibrium(
                eccentricity_ratio=eps,
                feed=grooves,
                radius_m=R,
                length_m=R,
                clearance_m=C,
                viscosity_Pa_s=MU,
                speed_rad_s=OMEGA,
            )
            case = f"{name} eps={eps}:"
            digit = allowed["S"] + allowed.get("S_digit", 0.0) / sommerfeld
            yield ComparisonRow(f"{case} S", state.sommerfeld, sommerfeld, source, digit)
            angle = math.degrees(state.attitude_rad)
            yield ComparisonRow(
                f"{case} attitude, deg", angle, attitude, source, allowed["attitude_deg"], True
            )
            for letter, found, printed in zip(
                "KC", (state.stiffness, state.damping), coefficients, strict=False
            ):
                share = allowed["coefficients_of_the_largest"] * max(printed)
                for axes, value, expected in zip(
                    ("xx", "xy", "yx", "yy"), found.ravel(), printed, strict=True
                ):
                    yield ComparisonRow(
                        f"{case} {letter}{axes}", float(value), expected, source, share, True
                    )
