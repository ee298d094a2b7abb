"""The guard of a bearing that is fed from a groove opposite the load: load, interval, and films of
the solver."""

from math import isfinite, pi

import msgspec
import numpy as np
import pytest

from firmware_py.config import Config
from firmware_py.guard.envelope.load_estimate import LoadEstimator
from firmware_py.guard.envelope.retreat import Ramp
from firmware_py.guard.envelope.shield import Shield
from firmware_py.machine.groove import Groove
from firmware_py.machine.lubricant import viscosity_Pa_s
from sim_hil.film import equilibrium
from sim_hil.film.equilibrium import Equilibrium
from sim_hil.film.records import FeedPatch

from ..scripted_node import bench
from .test_load_estimate import RPM, look
from .test_shield import refusal

AREAS_MM2 = (160.0, 320.0)


def fed(**feed: float) -> Config:
    config = bench()
    bearing = msgspec.structs.replace(
        config.machine.bearing, load_error_share=0.03, attitude_error_deg=2.7
    )
    areas = dict(zip(("groove_area_min_mm2", "groove_area_max_mm2"), AREAS_MM2, strict=True))
    return config.replaced(
        bearing=bearing, feed=msgspec.structs.replace(config.machine.feed, **areas | feed)
    )


def film(
    load_N: float, rpm: float, clearance_m: float, bar: float | None, viscosity: float = 0.01
) -> Equilibrium:
    b = bench().machine.bearing
    feed = (
        () if bar is None else (FeedPatch("groove", 0.5 * pi, pi / 9, 0.8 * b.length_m, 1e5 * bar),)
    )
    return equilibrium(
        load_N=load_N, radius_m=b.journal_radius_m, length_m=b.length_m, clearance_m=clearance_m,
        viscosity_Pa_s=viscosity, speed_rad_s=rpm * RPM, feed=feed,
    )  # fmt: skip


def without_groove_there(fed_film: Equilibrium, rpm: float, clearance_m: float) -> float:
    """Load of the film without groove where that shaft runs, N."""
    b = bench().machine.bearing
    return equilibrium(
        eccentricity_ratio=fed_film.eccentricity_ratio,
        radius_m=b.journal_radius_m,
        length_m=b.length_m,
        clearance_m=clearance_m,
        viscosity_Pa_s=0.01,
        speed_rad_s=rpm * RPM,
    ).load_N


def test_without_a_groove_pressure_adds_nothing() -> None:
    groove, o = Groove(bench().machine), bench().machine.operating
    assert groove.film_loads_N == (o.load_min_N, o.load_max_N)
    assert groove.swing_N(2.0) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("load_N", "rpm", "clearance_um"), [(40.0, 10000.0, 90.0), (120.0, 6000.0, 110.0)]
)
@pytest.mark.parametrize("bar", [0.5, 1.5])
def test_the_interval_holds_the_films_load_at_any_pressure(
    load_N: float, rpm: float, clearance_um: float, bar: float
) -> None:
    """Seen at one pressure, held against the films at the least and the greatest."""
    config, clearance_m = fed(), clearance_um * 1e-6
    seen = look(film(load_N, rpm, clearance_m, bar).position_m, clearance_m, rpm)
    found = LoadEstimator(config).estimate(msgspec.structs.replace(seen, pressure_bar=bar))
    assert found.measured
    least, most = (
        without_groove_there(film(load_N, rpm, clearance_m, p), rpm, clearance_m)
        for p in (0.5, 3.0)
    )
    assert (
        0.4 * load_N
        < found.low_N
        <= least
        < most
        <= found.film_N * (1 + 1e-9) / LoadEstimator(config).oil.thinnest
    )


@pytest.mark.parametrize(("load_N", "rpm"), [(30.0, 12000.0), (60.0, 10000.0), (150.0, 5000.0)])
def test_every_admissible_clearance_keeps_film_and_stability_in_the_fed_solver(
    load_N: float, rpm: float
) -> None:
    """Whirl at the least pressure that may be set, film at the greatest."""
    config = fed()
    added = Groove(config.machine).added_N
    found = Shield(config).interval(rpm * RPM, load_N + added[0], load_N + added[1], 41.0)
    assert found is not None
    viscosity, number = viscosity_Pa_s(config.machine.lubricant, 60.0), rpm * RPM
    stable = film(load_N, rpm, found[1], 0.5, viscosity)
    speed = number * (found[1] * config.machine.rotor.mass_at_bearing_kg / load_N) ** 0.5
    assert not isfinite(stable.threshold) or speed < stable.threshold
    for clearance_m in found:
        thick = film(load_N, rpm, clearance_m, 3.0, viscosity_Pa_s(config.machine.lubricant, 42.0))
        assert (1 - thick.eccentricity_ratio) * clearance_m >= config.limits.min_film_um * 1e-6


def test_the_piston_stabilises_a_light_rotor_and_adds_to_an_announced_load() -> None:
    light = fed(), fed(pressure_min_bar=1.0)
    bounds = [
        Shield(c).interval(12000 * RPM, Groove(c.machine).film_loads_N[0], 60.0, 41.0)
        for c in (bench(), *light)
    ]
    highs = [b[1] for b in bounds if b]
    assert len(highs) == 3
    assert np.all(np.diff(highs) > 1e-6)
    ramp = [Ramp(0.5, 0.6, 1500 * RPM, 250.0)]
    plain, pressed = (
        Shield(c).interval(6000 * RPM, 80.0, 90.0, 41.0, announced=ramp) for c in (bench(), fed())
    )
    assert plain is not None
    assert pressed is not None
    assert pressed[1] < plain[1]


def test_a_refused_configuration_names_the_pressure_that_presses_too_much() -> None:
    text = refusal(fed())
    assert "up to 96 N by the groove at 3 bar" in text
    assert "feed.pressure_max_bar" in text
