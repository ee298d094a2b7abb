"""Figures of the moving rotor: orbit, run-up, modes, duty."""

from __future__ import annotations

import argparse

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.signal import spectrogram

from sim_hil.bound.limits import ORBIT_SHARE, BoundLimits, orbit_share
from sim_hil.plant.build import Build
from sim_hil.plant.duty import RAD_S_PER_RPM, Duty
from sim_hil.plant.response import Trajectory, equilibrium_at, simulate
from sim_hil.plots.style import BLUE, GREEN, GREY, ORANGE, RED, limit_line, new_figure, plain, point
from sim_hil.rigs import RigData, load_rig
from sim_hil.rotor.assembly import assemble
from sim_hil.rotor.modes import Support, modes
from sim_hil.rotor.parameters import Floats

UM = 1e6
_RATE_HZ = 10000.0
_RUN_UP_S = 20.0
_CAMPBELL_BEYOND = 1.25


def orbit(options: argparse.Namespace) -> Figure:
    """The last turns of a run in the clearance circle, enlarged beside, with the amplitude
    spectrum."""
    rig = load_rig(options.rig)
    clearance = options.clearance * 1e-6
    turns_s = 20 * 60 / abs(options.rpm)
    run = simulate(
        rig,
        Duty.hold(options.rpm, options.load, 1.5 + turns_s),
        clearance=clearance,
        rate_hz=_RATE_HZ,
        force=options.film,
        thermal=False,
    )
    tail = run.last(turns_s)
    figure = new_figure(
        (12, 4.4),
        "Orbit of the journal",
        f"{point(options)}; last 20 turns of {run.time_s[-1]:.1f} s",
    )
    whole, near, spectrum = figure.subplots(1, 3, width_ratios=[1, 1, 1.25])
    x, y = (tail.position_m * UM).T
    angle = np.linspace(0, 2 * np.pi, 200)
    whole.fill(
        clearance * UM * np.cos(angle), clearance * UM * np.sin(angle), color=GREY, alpha=0.1
    )
    whole.plot(
        clearance * UM * np.cos(angle),
        clearance * UM * np.sin(angle),
        color=GREY,
        label="clearance circle",
    )
    marks = np.flatnonzero(np.diff(np.floor(tail.column("angle_rad") / (2 * np.pi))))
    for axes in (whole, near):
        axes.plot(x, y, color=BLUE, linewidth=1, label="journal centre")
        axes.plot(x[marks], y[marks], "o", color=ORANGE, markersize=4, label="once-per-turn mark")
        axes.plot(x.mean(), y.mean(), "+", color=RED, markersize=8, label="mean position")
    whole.set_aspect("equal", adjustable="box")
    near.set_aspect("equal", adjustable="datalim")
    plain(whole, "x, µm", "y, µm", f"smallest film {tail.min_film_m.min() * UM:.1f} µm")
    swing = tail.peak_to_peak_m()
    percent = f"{100 * swing / clearance:.1f} % of c (limit {100 * ORBIT_SHARE:g} %)"
    plain(near, "x, µm", "y, µm", f"peak to peak {swing * UM:.2f} µm, {percent}")
    whole.legend(
        fontsize=7, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2, frameon=False
    )
    _spectrum(spectrum, run.last(1.0), abs(options.rpm) / 60)
    return figure


def _spectrum(axes: Axes, run: Trajectory, turn_hz: float) -> None:
    n = run.time_s.size
    window = np.hanning(n)
    order = np.fft.rfftfreq(n, 1 / _RATE_HZ) / turn_hz
    for name, path, color in zip("xy", run.position_m.T, (BLUE, GREEN), strict=True):
        amplitude = 2 * np.abs(np.fft.rfft((path - path.mean()) * window)) / window.sum()
        axes.semilogy(order, amplitude * UM, color=color, linewidth=0.9, label=name)
    axes.set_xlim(0, 4)
    axes.set_ylim(1e-4, None)
    axes.legend(fontsize=8)
    plain(axes, "order (frequency over speed)", "amplitude, µm", "spectrum of the last second")


def waterfall(options: argparse.Namespace) -> Figure:
    """Short spectra of x during a run-up through the whole speed range, and the orbit's size
    beside."""
    rig = load_rig(options.rig)
    low, high, rate_hz = rig.speed_min_rpm, rig.speed_max_rpm, 5000.0
    ramp = Duty((0.0, _RUN_UP_S), (low, high), (options.load, options.load))
    run = simulate(
        rig,
        ramp,
        clearance=options.clearance * 1e-6,
        rate_hz=rate_hz,
        force=options.film,
        thermal=False,
    )
    frequency, time_s, power = spectrogram(
        run.position_m[:, 0],
        rate_hz,
        "hann",
        2048,
        1792,
        nfft=8192,
        detrend="linear",
        scaling="spectrum",
        mode="psd",
    )
    rpm = np.interp(time_s, [0, _RUN_UP_S], [low, high])
    level = 10 * np.log10(np.maximum(2 * power, 1e-20) / 1e-12)
    caption = (
        f"rig {options.rig}, {options.load:g} N, radial clearance {options.clearance:g} µm, "
        f"{options.film} film, "
    )
    figure = new_figure(
        (10, 5.8), "Run-up: spectrum of the journal over speed", caption + f"{_RUN_UP_S:g} s ramp"
    )
    axes, size = figure.subplots(1, 2, sharey=True, width_ratios=[4, 1])
    shown = frequency <= 2.5 * high / 60
    mesh = axes.pcolormesh(
        frequency[shown],
        rpm,
        level[shown].T,
        cmap="magma",
        vmin=-60,
        vmax=30,
        shading="gouraud",
        rasterized=True,
    )
    for order in (0.5, 1.0, 2.0):
        axes.plot(order * rpm / 60, rpm, "--", color="white", linewidth=0.7, alpha=0.6)
        axes.annotate(
            f"{order:g}X",
            (order * rpm[-1] / 60, rpm[-1]),
            color=GREY,
            fontsize=9,
            ha="center",
            va="bottom",
        )
    axes.set_xlim(0, 2.5 * high / 60)
    axes.set_ylim(rpm[0], rpm[-1])
    figure.colorbar(mesh, ax=axes, location="left", label="amplitude of x, dB re 1 µm rms")
    plain(axes, "frequency, Hz", "speed, rpm")
    size.plot(
        100 * orbit_share(run), np.linspace(low, high, run.time_s.size), color=BLUE, linewidth=1
    )
    size.axvline(100 * ORBIT_SHARE, color=RED, linewidth=0.9, linestyle="--")
    size.set_xlim(0, None)
    plain(size, "peak to peak\nover clearance, %", "", "red: limit")
    return figure


def campbell(options: argparse.Namespace) -> Figure:
    """Damped frequencies and damping of the rotor on film and coupling, the film linear at each
    speed."""
    rig = load_rig(options.rig)
    speeds = np.linspace(rig.speed_min_rpm, _CAMPBELL_BEYOND * rig.speed_max_rpm, 60)
    rows = [
        (rpm, *mode)
        for rpm in speeds.tolist()
        for mode in zip(*_film_modes(rig, rpm, options.load, options.clearance * 1e-6), strict=True)
    ]
    rpm, frequency, damping, sense = np.array(rows, dtype=np.float64).T
    caption = f"rig {options.rig}, {options.load:g} N, radial clearance {options.clearance:g} µm; "
    caption += "K and C of the film at each static equilibrium, gyroscopic moment included"
    figure = new_figure((9, 6.6), "Campbell diagram", caption)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=[2, 1])
    senses = ((1, "forward", BLUE, "o"), (-1, "backward", ORANGE, "v"), (0, "straight", GREY, "s"))
    for value, name, color, mark in senses:
        of = sense == value
        if of.any():
            above.plot(
                rpm[of], frequency[of], mark, color=color, markersize=3.5, label=f"{name} whirl"
            )
            below.plot(rpm[of], damping[of], mark, color=color, markersize=3.5)
    unstable = damping < 0
    if unstable.any():
        above.plot(
            rpm[unstable],
            frequency[unstable],
            "o",
            markerfacecolor="none",
            color=RED,
            label="unstable",
        )
        above.set_title(
            f"unstable from about {100 * round(rpm[unstable].min() / 100)} rpm on",
            fontsize=10,
            color=RED,
        )
    for order in (0.5, 1.0, 2.0):
        above.plot(speeds, order * speeds / 60, "--", color=GREY, linewidth=0.9)
        inside = min(speeds[-1], 60 / order * 1.1 * frequency.max())
        above.annotate(
            f"{order:g}X",
            (inside, order * inside / 60),
            (4, -8),
            textcoords="offset points",
            color=GREY,
            fontsize=9,
        )
    for axes in (above, below):
        axes.axvline(rig.speed_max_rpm, color=GREY, linewidth=0.9, linestyle=":")
    above.annotate(
        " rig's largest speed", (rig.speed_max_rpm, 0), color=GREY, fontsize=8, va="bottom"
    )
    above.set_ylim(0, 1.15 * frequency.max())
    below.axhspan(-1, 0, color=RED, alpha=0.08)
    below.axhline(0, color=RED, linewidth=0.9)
    below.set_ylim(min(-0.1, 1.2 * damping.min()), None)
    below.annotate("unstable", (speeds[0], -0.02), color=RED, fontsize=8, va="top")
    plain(above, "", "damped frequency, Hz", above.get_title())
    plain(below, "speed, rpm", "damping ratio")
    above.legend(fontsize=8, loc="upper left", bbox_to_anchor=(0, 0.85))
    return figure


def _film_modes(
    rig: RigData, rpm: float, load_N: float, clearance_m: float
) -> tuple[Floats, Floats, Floats]:
    """Oscillating modes: frequency, Hz, damping ratio, sense of whirl."""
    plant = assemble(rig, Build.nominal(rig), 5e-5, thermal=False)
    s = plant.shaft
    film = equilibrium_at(rig, plant, rpm * RAD_S_PER_RPM, load_N, clearance_m)
    supports = [
        Support(s.to_bearing, film.stiffness_N_m, film.damping_N_s_m),
        Support(-s.to_coupling, s.coupling_stiffness, s.coupling_damping),
    ]
    found = modes(s.mass, s.diametral, s.polar, supports, rpm * RAD_S_PER_RPM)
    swings = found.frequency_rad_s > 1.0
    return (
        found.frequency_rad_s[swings] / (2 * np.pi),
        found.damping_ratio[swings],
        found.forward[swings].astype(np.float64),
    )


def duty(options: argparse.Namespace) -> Figure:
    """The published duty at a fixed clearance, film warmed by its friction."""
    rig = load_rig(options.rig)
    published = Duty.published(rig)
    clearance = options.clearance * 1e-6
    run = simulate(
        rig, published, clearance=clearance, rate_hz=_RATE_HZ, dt_s=7e-5, force=options.film
    )
    caption = (
        f"rig {options.rig}, fixed radial clearance {options.clearance:g} µm, {options.film} film, "
        "thermal; "
    )
    figure = new_figure((10, 8), "The published duty", caption + _summary(run))
    speed, load, power, film, share = figure.subplots(5, 1, sharex=True)
    each = 100
    time_s = run.time_s[::each]
    at = published.at(time_s)
    speed.plot(time_s, at[:, 0] / RAD_S_PER_RPM, color=BLUE)
    load.plot(time_s, at[:, 1], color=GREEN)
    starts = np.arange(0, run.time_s.size, each)
    power.plot(time_s, np.add.reduceat(run.power_W, starts) / each, color=ORANGE)
    film.plot(time_s, np.minimum.reduceat(run.min_film_m, starts) * UM, color=BLUE)
    share.plot(time_s, 100 * np.maximum.reduceat(orbit_share(run), starts), color=BLUE)
    for axes, label in (
        (speed, "speed, rpm"),
        (load, "load, N"),
        (power, "power, W"),
        (film, "smallest film, µm"),
        (share, "peak to peak\nover clearance, %"),
    ):
        plain(axes, "", label)
        axes.set_ylim(0, None)
    limits = BoundLimits.of_rig(rig)
    limit_line(film, limits.min_film_m * UM, f"least {limits.min_film_m * UM:g} µm")
    limit_line(share, 100 * ORBIT_SHARE, f"most {100 * ORBIT_SHARE:g} %")
    share.set_ylim(0, max(110 * ORBIT_SHARE, share.get_ylim()[1]))
    share.set_xlabel("time, s")
    share.set_xlim(0, published.seconds)
    figure.align_ylabels()
    return figure


def _summary(run: Trajectory) -> str:
    film, share = run.min_film_m.min() * UM, 100 * float(orbit_share(run).max())
    return (
        f"mean power {run.power_W.mean():.1f} W, thinnest film {film:.1f} µm, largest orbit "
        f"{share:.0f} % of c" + "".join(f"; {text}" for text in run.warnings)
    )
