"""The film against closed forms: short, long and lightly loaded bearing, squeeze film, Petroff's
friction."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from typing import Final

import numpy as np

from sim_hil.film import FilmForce, equilibrium, film_force
from sim_hil.film.equilibrium import whirl_threshold
from sim_hil.film.records import Floats, Rupture
from sim_hil.verify.row import ComparisonRow, reference

R: Final = 0.02
C: Final = 60e-6
MU: Final = 0.01
OMEGA: Final = 300.0
UNIT_N_M: Final = MU * OMEGA * R * (R / C) ** 2
"""mu omega R (R/c)^2: load per length of the dimensionless load one, N/m."""

_NAMES = ("xx", "xy", "yx", "yy")
_film_of = partial(film_force, radius_m=R, clearance_m=C, viscosity_Pa_s=MU)
_turning = partial(_film_of, speed_rad_s=OMEGA)


def short_bearing() -> Iterator[ComparisonRow]:
    """Ocvirk's pi film: the finite film at small length, and the whirl formula on the exact
    coefficients."""
    source = "short bearing, pi film (Ocvirk), closed form"
    for row in reference("short_bearing_closed_form.json")["rows"]:
        eps = row["eps"]
        state = equilibrium(
            eccentricity_ratio=eps,
            rupture="gumbel",
            radius_m=R,
            length_m=R / 8,
            clearance_m=C,
            viscosity_Pa_s=MU,
            speed_rad_s=OMEGA,
        )
        case = f"short bearing L/D=1/16 eps={eps}:"
        # 3 %: circumferential flow, which the closed form leaves out, is of the order of (L/D)^2 /
        # (1 - eps)
        yield ComparisonRow(
            f"{case} S (L/D)^2", state.sommerfeld / 16**2, row["S_times_LD2"], source, 3e-2
        )
        yield ComparisonRow(
            f"{case} attitude, deg",
            math.degrees(state.attitude_rad),
            row["attitude_deg"],
            source,
            0.5,
            True,
        )
        sommerfeld, turned = row["S_times_LD2"] * 16**2, math.sin(math.radians(row["attitude_deg"]))
        friction = 2 * math.pi**2 * sommerfeld / math.sqrt(1 - eps * eps) + eps / 2 * turned
        yield ComparisonRow(f"{case} (R/c) f", state.friction_variable, friction, source, 3e-2)
        for letter, matrix in (("K", state.stiffness), ("C", state.damping)):
            # of the largest coefficient: the smallest ones are differences of large ones
            allowed = 3e-2 * max(abs(row[letter + name]) for name in _NAMES)
            for name, value in zip(_NAMES, matrix.ravel(), strict=True):
                yield ComparisonRow(
                    f"{case} {letter}{name}",
                    float(value),
                    row[letter + name],
                    source,
                    allowed,
                    True,
                )
        stiffness, damping = (
            np.array([row[k + n] for n in _NAMES]).reshape(2, 2) for k in ("K", "C")
        )
        yield from _whirl(
            case, row, whirl_threshold(stiffness, damping), (state.whirl_ratio, state.threshold)
        )


def _whirl(
    case: str, row: dict[str, float | None], exact: tuple[float, float], finite: tuple[float, float]
) -> Iterator[ComparisonRow]:
    source = "whirl threshold (Lund 1966) of the short bearing"
    for k, name in enumerate(("whirl_ratio", "threshold_omega_sqrt_cm_over_W")):
        value = row[name]
        if value is None:
            stable = float(math.isnan(exact[k]) and math.isnan(finite[k]))
            yield ComparisonRow(
                f"{case} no {name}: stable at any speed", stable, 1.0, source, 0.0, True
            )
        else:
            yield ComparisonRow(f"{case} {name} of the exact K, C", exact[k], value, source, 5e-4)
            yield ComparisonRow(f"{case} {name}", finite[k], value, source, 1e-2)


def short_bearing_forces() -> Iterator[ComparisonRow]:
    """Force and side flow of a journal that rests or whirls."""
    length = R / 16
    scale = MU * R * length**3 / C**2
    source = "short bearing, pi film, closed form"
    for eps, whirl in ((0.2, 0.0), (0.5, 0.0), (0.6, 0.0), (0.5, 60.0)):
        slip = OMEGA - 2 * whirl
        radial = -(eps**2) * slip / (1 - eps**2) ** 2
        tangential = math.pi * eps * slip / (4 * (1 - eps**2) ** 1.5)
        film = _turning((eps * C, 0.0), (0.0, whirl * eps * C), rupture="gumbel", length_m=length)
        case = f"short bearing L/D=1/32 eps={eps} whirl={whirl / OMEGA:.1f} omega:"
        yield ComparisonRow(f"{case} F_r, N", float(film.force_N[0]), radial * scale, source, 5e-3)
        yield ComparisonRow(
            f"{case} F_t, N", float(film.force_N[1]), tangential * scale, source, 5e-3
        )
        if not whirl:
            flow = eps * OMEGA * R * C * length
            yield ComparisonRow(
                f"{case} side flow, m3/s",
                float(film.side_flow_m3_s),
                flow,
                "mass balance, pi film",
                2e-2,
            )


def squeeze_film() -> Iterator[ComparisonRow]:
    """Damping of a filled film without rotation, along and across the eccentricity; Petroff's
    friction."""
    rate = 1e-3
    for eps in (0.0, 0.6):
        g = 1 - eps * eps
        short, long = math.pi * MU * R * (R / 16) ** 3 / C**3, 12 * math.pi * MU * (R / C) ** 3
        cases = (
            ("along", (rate, 0.0), short * (1 + 2 * eps**2) / g**2.5, long / g**1.5),
            ("across", (0.0, rate), short / g**1.5, 2 * long / ((2 + eps**2) * math.sqrt(g))),
        )
        for name, velocity, of_short, of_long in cases:
            state = ((eps * C, 0.0), velocity)
            film = _film_of(*state, rupture="full", length_m=R / 16, speed_rad_s=0.0)
            value = -float(film.force_N @ velocity) / rate**2
            yield ComparisonRow(
                f"squeeze film L/D=1/32 eps={eps} {name}, N s/m",
                value,
                of_short,
                "short bearing",
                5e-3,
            )
            force, _ = _infinite(*state, "full", 0.0)
            value = -float(force @ velocity) / rate**2
            yield ComparisonRow(
                f"squeeze film, long, eps={eps} {name}, N s/m per m",
                value,
                of_long,
                "long bearing",
                1e-3,
            )
    film = _turning((0.0, 0.0), (0.0, 0.0), length_m=R)
    petroff = 2 * math.pi * MU * OMEGA * R**3 * R / C
    yield ComparisonRow(
        "friction torque at eps=0, N m", float(film.friction_torque_N_m), petroff, "Petroff", 1e-9
    )


def long_bearing() -> Iterator[ComparisonRow]:
    """Sommerfeld's infinitely long bearing."""
    for row in reference("long_bearing_closed_form.json")["rows"]:
        eps = row["eps"]
        for kind in ("full", "half"):
            force, torque = _infinite(
                (eps * C, 0.0), (0.0, 0.0), "full" if kind == "full" else "gumbel", OMEGA
            )
            load = float(np.hypot(*force))
            expected = row[kind]
            case, source = (
                f"long bearing {kind} eps={eps}:",
                f"{kind} Sommerfeld (1904), closed form",
            )
            yield ComparisonRow(f"{case} W_bar", load / UNIT_N_M, expected["W_bar"], source, 1e-3)
            yield ComparisonRow(
                f"{case} S", UNIT_N_M / (math.pi * load), expected["S"], source, 1e-3
            )
            attitude = math.degrees(math.atan2(force[1], -force[0]))
            yield ComparisonRow(
                f"{case} attitude, deg", attitude, expected["attitude_deg"], source, 0.05, True
            )
            if kind == "full":
                yield ComparisonRow(
                    f"{case} (R/c) f", torque / (load * C), expected["friction_var"], source, 1e-3
                )


def _infinite(
    position: tuple[float, float], velocity: tuple[float, float], rupture: Rupture, speed: float
) -> tuple[Floats, float]:
    """Force, N/m, and torque, N, that one more length of a long bearing adds.

    The ends of two bearings of different length on the same axial cells cancel in the difference.
    """

    def film(cells: int) -> FilmForce:
        return _film_of(
            position,
            velocity,
            length_m=R * cells * 4 / 3,
            rupture=rupture,
            speed_rad_s=speed,
            grid=(360, cells),
        )

    long, short = film(24), film(12)
    added = R * 12 * 4 / 3
    torque = float(long.friction_torque_N_m - short.friction_torque_N_m) / added
    return (long.force_N - short.force_N) / added, torque


def light_load() -> Iterator[ComparisonRow]:
    """Full films with ends: what side leakage leaves of the infinitely long bearing's load.

    To first order in eps that is `1 - tanh(L/D)/(L/D)`, exactly; beyond, :func:`_side_leakage`.
    """
    eps = 1e-3
    for ratio in (0.5, 1.0, 8.0):
        load = _full_load(eps, ratio) / (6 * math.pi * eps)
        source = "exact for eps -> 0: 1 - tanh(L/D)/(L/D)"
        case = f"light load L/D={ratio}: load over the infinitely long bearing's"
        yield ComparisonRow(case, load, 1 - math.tanh(ratio) / ratio, source, 2e-3)
    for row in reference("long_bearing_closed_form.json")["rows"]:
        source = (
            "long bearing x side leakage; the 3 % that its file allows at L/D=8 leave the ends' "
            "1/8 out"
        )
        expected = row["full"]["W_bar"] * _side_leakage(row["eps"], 8.0)
        yield ComparisonRow(
            f"L/D=8 eps={row['eps']} full: W_bar",
            _full_load(row["eps"], 8.0),
            expected,
            source,
            3e-3,
        )


def _side_leakage(eps: float, ratio: float) -> float:
    """Share of the infinitely long full bearing's load that is left between two ends.

    Kantorovich's one-term solution `p = p_long(theta) (1 - cosh(lambda z/R) / cosh(lambda L/D))` of
    Reynolds' equation, `lambda^2 = int h^3 p_long'^2 / int h^3 p_long^2`, whose mean along z is `1
    - tanh(x)/x`, x = lambda L/D.
    """
    theta = 2 * math.pi * np.arange(4096) / 4096
    h = 1 + eps * np.cos(theta)
    long = np.sin(theta) * (2 + eps * np.cos(theta)) / h**2
    slope = (np.roll(long, -1) - np.roll(long, 1)) / (theta[2] - theta[0])
    x = ratio * math.sqrt(float(np.sum(h**3 * slope**2) / np.sum(h**3 * long**2)))
    return 1 - math.tanh(x) / x


def _full_load(eps: float, ratio: float) -> float:
    """W_bar of the full film."""
    film = _turning(
        (eps * C, 0.0), (0.0, 0.0), rupture="full", length_m=2 * R * ratio, grid=(360, 60)
    )
    return float(np.hypot(*film.force_N)) / (UNIT_N_M * 2 * R * ratio)
