"""Figures over two variables: film pressure, and the map of power and limits."""

from __future__ import annotations

import argparse

import numpy as np
from matplotlib.figure import Figure

from sim_hil.bound.limits import ORBIT_SHARE, Limits
from sim_hil.duty import RAD_S_PER_RPM
from sim_hil.film import equilibrium, film_force
from sim_hil.film.records import FilmArguments, Floats
from sim_hil.plots.style import BLUE, ORANGE, RED, new_figure, plain
from sim_hil.response import power_map
from sim_hil.rigs import load_rig, read_json

_MAP_SPEEDS = 15
_MAP_CLEARANCES = 25


def pressure(options: argparse.Namespace) -> Figure:
    """Pressure of the Reynolds film at the static equilibrium, over the unwrapped bearing and around its middle."""
    rig = load_rig(options.rig)
    b = rig.bearing
    film = FilmArguments(
        radius_m=b.radius_m, length_m=b.length_m, clearance_m=options.clearance * 1e-6,
        viscosity_Pa_s=rig.oil.viscosity_at(rig.oil.inlet_C), speed_rad_s=options.rpm * RAD_S_PER_RPM, grid=(240, 40),
    )  # fmt: skip
    rest = equilibrium(load_N=options.load, **film)
    angle, z, p = _pressure_field(rest.position_m, film)
    caption = f"rig {options.rig}, {options.rpm:g} rpm, {options.load:g} N, radial clearance {options.clearance:g} µm; "
    caption += f"eccentricity {rest.eccentricity_ratio:.3f}, attitude {np.degrees(rest.attitude_rad):.1f}°, "
    caption += "Reynolds rupture, ambient ends, isothermal"
    figure = new_figure((10, 6), "Film pressure at the static equilibrium", caption)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=[1.5, 1])
    mesh = above.contourf(angle, z, p.T, levels=24, cmap="viridis")
    above.contour(angle, z, p.T, levels=[1e-9 * p.max()], colors="white", linewidths=1.2)
    figure.colorbar(mesh, ax=above, label="pressure, MPa")
    plain(above, "", "axial position, mm", "white line: edge of the ruptured film")
    below.plot(angle, p[:, z.size // 2], color=BLUE, label="pressure in the middle plane")
    plain(below, "angle from x (right) towards y (up), degrees", "pressure, MPa")
    gap = below.twinx()
    e = rest.position_m
    gap.plot(angle, (film["clearance_m"] - e[0] * np.cos(np.radians(angle)) - e[1] * np.sin(np.radians(angle))) * 1e6,
             color=ORANGE, label="film thickness")  # fmt: skip
    gap.set_ylabel("film thickness, µm", color=ORANGE)
    gap.set_ylim(0, None)
    gap.spines["top"].set_visible(False)
    below.set_xlim(0, 360)
    below.set_xticks(range(0, 361, 45))
    return figure


def _pressure_field(position_m: Floats, film: FilmArguments) -> tuple[Floats, Floats, Floats]:
    """Angles from 0 to 360 degrees, axial places, mm, and pressure, MPa, with the ring closed at both ends."""
    field = film_force(position_m, (0.0, 0.0), fields=True, **film)
    assert field.theta_rad is not None
    assert field.pressure_Pa is not None
    assert field.z_m is not None
    order = np.argsort(field.theta_rad)
    angle, p = np.degrees(field.theta_rad[order]), field.pressure_Pa[order] * 1e-6
    angle = np.concatenate([[angle[-1] - 360], angle, [angle[0] + 360]])
    return angle, field.z_m * 1e3, np.concatenate([p[-1:], p, p[:1]])


def power_and_limits(options: argparse.Namespace) -> Figure:
    """Power, smallest film and orbit over speed and clearance at one load; the admissible region is outlined."""
    rig = load_rig(options.rig)
    b = rig.bearing
    limits = Limits.of(read_json("duty_bench.json"))
    speed = np.linspace(rig.speed_min_rpm, rig.speed_max_rpm, _MAP_SPEEDS)
    clearance = np.linspace(b.clearance_min_m, b.clearance_max_m, _MAP_CLEARANCES)
    found = power_map(rig, speed, np.array([options.load]), clearance, seconds=1.0)
    power, film, swing = (a[:, 0, :].T for a in (found.power_W, found.min_film_m, found.peak_to_peak_m))
    share = swing / clearance[:, None]
    slack = np.minimum(film / limits.min_film_m - 1, 1 - share / ORBIT_SHARE)
    caption = f"rig {options.rig}, {options.load:g} N, isothermal, last half of 1 s at each of "
    caption += f"{speed.size} x {clearance.size} points; red line: edge of film ≥ {limits.min_film_m * 1e6:g} µm "
    caption += f"and peak to peak ≤ {ORBIT_SHARE:g} c"
    figure = new_figure((13, 4.6), "Power, film and vibration", caption)
    panels = (
        ("shaft power, W", np.log10(power), "magma", power),
        ("smallest film, µm", film * 1e6, "viridis", None),
        ("peak to peak over clearance", np.minimum(share, 1.0), "cividis", None),
    )
    for axes, (title, values, colors, labelled) in zip(figure.subplots(1, 3, sharey=True), panels, strict=True):
        mesh = axes.contourf(speed, clearance * 1e6, values, levels=20, cmap=colors)
        bar = figure.colorbar(mesh, ax=axes)
        if labelled is not None:
            ticks = [t for t in (5, 10, 20, 50, 100, 200, 400) if labelled.min() <= t <= labelled.max()]
            bar.set_ticks(np.log10(ticks).tolist(), labels=[str(t) for t in ticks])
        axes.contour(speed, clearance * 1e6, slack, levels=[0.0], colors=RED, linewidths=2)
        plain(axes, "speed, rpm", "radial clearance, µm" if title == panels[0][0] else "", title)
    return figure
