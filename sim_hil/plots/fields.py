"""Figures over two variables: film pressure, and the map of power and limits."""

from __future__ import annotations

import argparse

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from sim_hil.bound.limits import ORBIT_SHARE, BoundLimits
from sim_hil.film import equilibrium, film_force
from sim_hil.film.records import FilmArguments, Floats
from sim_hil.plant.duty import RAD_S_PER_RPM
from sim_hil.plant.power_map import power_map
from sim_hil.plots.style import BLUE, GREY, ORANGE, RED, new_figure, plain
from sim_hil.rigs import load_rig

_MAP_SPEEDS = 15
_MAP_CLEARANCES = 21
_MAP_SECONDS = 1.0
_MAP_TITLES = ("shaft power, W", "smallest film, µm", "peak to peak over clearance")
_EDGE_SHARE = 2e-3
"""Of the largest pressure: below it the film counts as ruptured in the picture."""


def pressure(options: argparse.Namespace) -> Figure:
    """Pressure of the Reynolds film at the static equilibrium, over the unwrapped bearing and
    around its middle."""
    rig = load_rig(options.rig)
    b = rig.bearing
    film = FilmArguments(
        radius_m=b.radius_m,
        length_m=b.length_m,
        clearance_m=options.clearance * 1e-6,
        viscosity_Pa_s=rig.oil.viscosity_at(rig.oil.inlet_C),
        speed_rad_s=options.rpm * RAD_S_PER_RPM,
        grid=(240, 40),
    )
    rest = equilibrium(load_N=options.load, **film)
    angle, z, p = _pressure_field(rest.position_m, film)
    caption = (
        f"rig {options.rig}, {options.rpm:g} rpm, {options.load:g} N, radial clearance "
        f"{options.clearance:g} µm; "
    )
    caption += (
        f"eccentricity {rest.eccentricity_ratio:.3f}, attitude "
        f"{np.degrees(rest.attitude_rad):.1f}°, "
    )
    caption += "Reynolds rupture, ambient ends, isothermal"
    figure = new_figure((10, 6.4), "Film pressure at the static equilibrium", caption)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=[1.5, 1])
    edge = _EDGE_SHARE * p.max()
    mesh = above.contourf(angle, z, p.T, levels=np.linspace(0, p.max(), 25), cmap="viridis")
    above.contourf(angle, z, p.T, levels=[-1, edge], colors="none", hatches=["///"])
    above.contour(angle, z, p.T, levels=[edge], colors="white", linewidths=1.2)
    figure.colorbar(
        mesh, ax=above, location="top", shrink=0.7, label="pressure, MPa", ticks=MaxNLocator(7)
    )
    plain(above, "", "axial position, mm")
    middle = p[:, z.size // 2]
    below.fill_between(
        angle,
        0,
        1,
        where=middle <= edge,
        color=GREY,
        alpha=0.15,
        linewidth=0,
        label="ruptured film",
        transform=below.get_xaxis_transform(),
    )
    below.plot(angle, middle, color=BLUE, label="pressure in the middle plane")
    plain(below, "angle from x (right) towards y (up), degrees", "pressure, MPa")
    below.axvline(270, color=GREY, linewidth=0.9, linestyle=":", label="direction of the load")
    gap = below.twinx()
    e = rest.position_m
    thickness = 1e6 * (
        film["clearance_m"] - e @ [np.cos(np.radians(angle)), np.sin(np.radians(angle))]
    )
    gap.plot(angle, thickness, color=ORANGE)
    thinnest = int(np.argmin(thickness))
    gap.plot(angle[thinnest], thickness[thinnest], "o", color=ORANGE, markersize=4)
    gap.annotate(
        f"{thickness[thinnest]:.1f} µm",
        (angle[thinnest], thickness[thinnest]),
        (0, 7),
        color=ORANGE,
        textcoords="offset points",
        fontsize=8,
        ha="center",
    )
    gap.set_ylabel("film thickness, µm", color=ORANGE)
    gap.set_ylim(0, None)
    gap.spines["top"].set_visible(False)
    below.set_ylim(0, None)
    below.legend(fontsize=8, loc="lower left")
    below.set_xlim(0, 360)
    below.set_xticks(range(0, 361, 45))
    return figure


def _pressure_field(position_m: Floats, film: FilmArguments) -> tuple[Floats, Floats, Floats]:
    """Angles from 0 to 360 degrees, axial places, mm, and pressure, MPa, with the ring closed at
    both ends."""
    field = film_force(position_m, (0.0, 0.0), fields=True, **film)
    assert field.theta_rad is not None
    assert field.pressure_Pa is not None
    assert field.z_m is not None
    order = np.argsort(field.theta_rad)
    angle, p = np.degrees(field.theta_rad[order]), field.pressure_Pa[order] * 1e-6
    angle = np.concatenate([[angle[-1] - 360], angle, [angle[0] + 360]])
    return angle, field.z_m * 1e3, np.concatenate([p[-1:], p, p[:1]])


def power_and_limits(options: argparse.Namespace) -> Figure:
    """Power, smallest film and orbit over speed and clearance, at the rig's least load, the given
    one and its most."""
    rig = load_rig(options.rig)
    b = rig.bearing
    limits = BoundLimits.of_rig(rig)
    speed = np.linspace(rig.speed_min_rpm, rig.speed_max_rpm, _MAP_SPEEDS)
    clearance = np.linspace(b.clearance_min_m, b.clearance_max_m, _MAP_CLEARANCES)
    loads = np.array(sorted({rig.load_min_N, options.load, rig.load_max_N}))
    found = power_map(rig, speed, loads, clearance, seconds=_MAP_SECONDS, force=options.film)
    caption = (
        f"rig {options.rig}, {options.film} film, isothermal; last half of {_MAP_SECONDS:g} s at "
    )
    caption += (
        f"{speed.size} x {clearance.size} points each; hatched: film below "
        f"{limits.min_film_m * 1e6:g} µm or "
    )
    caption += f"peak to peak above {ORBIT_SHARE:g} of the clearance"
    caption += "".join(f"; somewhere {text}" for text in found.warnings)
    figure = new_figure((13, 3.7 * loads.size), "Power, film and vibration", caption)
    all_axes = figure.subplots(loads.size, 3, sharex=True, sharey=True, squeeze=False)
    share = found.peak_to_peak_m / clearance
    figures = (
        (np.log10(found.power_W), "magma"),
        (found.min_film_m * 1e6, "viridis"),
        (np.minimum(share, 1.0), "cividis"),
    )
    bad = np.maximum(1 - found.min_film_m / limits.min_film_m, share / ORBIT_SHARE - 1)
    for column, ((values, colors), title) in enumerate(zip(figures, _MAP_TITLES, strict=True)):
        levels = MaxNLocator(20).tick_values(float(values.min()), float(values.max()))
        for row, load in enumerate(loads.tolist()):
            axes = all_axes[row, column]
            mesh = axes.contourf(
                speed, clearance * 1e6, values[:, row].T, levels=levels, cmap=colors
            )
            axes.contourf(
                speed,
                clearance * 1e6,
                bad[:, row].T,
                levels=[0, np.inf],
                colors="none",
                hatches=["xx"],
            )
            axes.contour(
                speed, clearance * 1e6, bad[:, row].T, levels=[0], colors=RED, linewidths=2
            )
            plain(
                axes,
                "speed, rpm" * (row == loads.size - 1),
                f"{load:g} N\n\nradial clearance, µm" * (column == 0),
                title * (row == 0),
            )
        bar = figure.colorbar(mesh, ax=all_axes[:, column], location="bottom", aspect=40)
        if column == 0:
            ticks = [
                t for t in (5, 10, 20, 50, 100, 200, 400) if levels[0] <= np.log10(t) <= levels[-1]
            ]
            bar.set_ticks(np.log10(ticks).tolist(), labels=[str(t) for t in ticks])
    return figure
