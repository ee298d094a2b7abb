from dataclasses import replace
from math import isfinite, pi

import msgspec
import numpy as np
import pytest

from firmware_py.config import SHIPPED, Config, load
from firmware_py.guard.envelope.retreat import GROWTH_TURNS, Box, Ramp
from firmware_py.guard.envelope.shield import FITTING_MARGIN, VIBRATION_MARGIN, Shield
from firmware_py.guard.envelope.shield_check import check_safe
from firmware_py.machine.film import static_film
from firmware_py.machine.lubricant import viscosity_Pa_s
from firmware_py.machine.parts import monitor_only
from sim_hil import simulate
from sim_hil.film import equilibrium
from sim_hil.plant.build import Build
from sim_hil.plant.duty import Duty
from sim_hil.rigs import load_rig

from ..scripted_node import bench

RPM = pi / 30
SAFE_M = 50e-6


@pytest.mark.parametrize("rpm", [3000.0, 6000.0, 12000.0])
def test_a_heavier_load_never_has_a_narrower_bound_of_whirl(rpm: float) -> None:
    """What lets the smallest credible load decide."""
    shield = Shield(bench())
    bounds = [
        shield._whirl_bound(rpm * RPM, load_N, 0.009) for load_N in np.geomspace(20.0, 400.0, 300)
    ]
    assert bounds == sorted(bounds)


@pytest.mark.parametrize("rpm", [1500.0, 3000.0, 6000.0, 9000.0, 12000.0])
@pytest.mark.parametrize("load_N", [30.0, 100.0, 300.0])
def test_every_admissible_clearance_keeps_film_and_stability_in_the_film_solver(
    rpm: float, load_N: float
) -> None:
    """Ends and middle of each interval, held against the Reynolds equilibrium at the thinnest
    oil."""
    config = bench()
    found = Shield(config).interval(rpm * RPM, load_N, load_N, 41.0)
    if found is None:
        assert load_N == 300.0
        return
    assert found[0] <= SAFE_M <= found[1] + 1e-12
    viscosity = viscosity_Pa_s(config.machine.lubricant, 42.0)
    for clearance_m in (found[0], 0.5 * (found[0] + found[1]), found[1]):
        state = equilibrium(
            load_N=load_N,
            radius_m=config.machine.bearing.journal_radius_m,
            length_m=config.machine.bearing.length_m,
            clearance_m=clearance_m,
            viscosity_Pa_s=viscosity,
            speed_rad_s=rpm * RPM,
        )
        assert (1 - state.eccentricity_ratio) * clearance_m >= config.limits.min_film_um * 1e-6
        mass = config.machine.rotor.mass_at_bearing_kg
        number = rpm * RPM * (clearance_m * mass / load_N) ** 0.5
        assert not isfinite(state.threshold) or number < state.threshold


def test_wide_clearances_are_there_where_load_and_speed_allow() -> None:
    shield = Shield(bench())
    wide = shield.interval(6000 * RPM, 80.0, 125.0, 41.0)
    narrow = shield.interval(12000 * RPM, 30.0, 40.0, 41.0)
    assert wide is not None
    assert wide[1] > 90e-6
    assert narrow is not None
    assert narrow[1] < 70e-6


def test_reachability_the_actuator_outruns_the_fastest_ramps_from_every_admissible_clearance() -> (
    None
):
    """Replays the worst ramps at a finer step than the shield's own, retreating at the rate limit:
    no whirl grows."""
    config = bench()
    shield, a, o = Shield(config), config.machine.actuator, config.machine.operating
    reach_s = a.time_to_live_ms * 1e-3 + a.time_constant_s
    oil = (
        viscosity_Pa_s(config.machine.lubricant, config.machine.lubricant.film_max_C)
        * shield._viscosity.thinnest
    )
    for rpm in range(1500, 12001, 1500):
        for load_N in (30.0, 60.0, 100.0, 200.0):
            found = shield.interval(rpm * RPM, load_N, load_N, 41.0)
            if found is None:
                continue
            grown_turns = 0.0
            for t in np.arange(0.0, 3.0, 0.013):
                speed = min(o.speed_max_rpm, rpm + o.speed_ramp_unannounced_rpm_s * t) * RPM
                light = max(o.load_min_N, load_N - o.load_ramp_unannounced_N_s * t)
                clearance_m = max(SAFE_M, found[1] - a.rate_um_s * 1e-6 * max(0.0, t - reach_s))
                excess = max(0.0, clearance_m / shield._whirl_bound(speed, light, oil) - 1.0)
                assert t > 0.0 or excess < 1e-6
                grown_turns += excess * 0.013 * speed / (2 * pi)
            assert grown_turns <= GROWTH_TURNS * (1 + 1e-6)


@pytest.mark.parametrize("unbalance_share", [0.0, 0.1, 0.2, 0.3, 0.5, 0.7])
@pytest.mark.parametrize(("rpm", "load_N"), [(12000.0, 30.0), (12000.0, 60.0), (9000.0, 30.0)])
def test_of_a_range_of_viscosities_an_end_whirls_first(
    rpm: float, load_N: float, unbalance_share: float
) -> None:
    unbalance = unbalance_share * load_N / (rpm * RPM) ** 2
    shield = Shield(changed("rotor", unbalance_normal_kg_m=unbalance, unbalance_measured=True))
    bounds = [
        shield._whirl_bound(rpm * RPM, load_N, viscosity)
        for viscosity in np.linspace(0.005, 0.012, 30)
    ]
    assert min(bounds) > 0.99 * min(bounds[0], bounds[-1])


def test_a_rotor_out_of_balance_whirls_the_earlier_in_thick_oil_and_the_shield_counts_on_it() -> (
    None
):
    shield = Shield(changed("rotor", unbalance_normal_kg_m=5e-6, unbalance_measured=True))
    ends = []
    for oil in ((0.9, 0.9), (1.1, 1.1), (0.9, 1.1)):
        found = shield.interval(12000 * RPM, 30.0, 30.0, 41.0, oil=oil)
        assert found is not None
        ends.append(found[1])
    thin_m, thick_m, either_m = ends
    assert either_m == thick_m < thin_m


@pytest.mark.parametrize(("rpm", "load_N"), [(6000.0, 100.0), (9000.0, 60.0), (4500.0, 200.0)])
@pytest.mark.parametrize(("to_rpm", "to_N"), [(12000.0, 30.0), (1500.0, 300.0)])
@pytest.mark.parametrize("ramp_s", [0.0, 0.5, 2.0])
def test_an_announced_ramp_of_any_steepness_finds_the_clearance_ready(
    rpm: float, load_N: float, to_rpm: float, to_N: float, ramp_s: float
) -> None:
    """The actuator follows the interval's upper end at its rate; all along the ramp it stays within
    the interval that belongs to the present point alone."""
    config = bench()
    shield, rate = Shield(config), config.machine.actuator.rate_um_s * 1e-6
    any_oil = shield._viscosity.thinnest, shield._viscosity.thickest
    clearance_m, step_s = 160e-6, 0.05
    for now in np.arange(-shield.lead_s, ramp_s + 0.5, step_s):
        share = 1.0 if now >= ramp_s else max(0.0, now / ramp_s) if ramp_s else float(now >= 0)
        speed, load = (rpm + share * (to_rpm - rpm)) * RPM, load_N + share * (to_N - load_N)
        ahead = [Ramp(-now, ramp_s - now, to_rpm * RPM, to_N)]
        found = shield.interval(speed, load, load, 41.0, announced=ahead)
        alone = shield.interval(speed, load, load, 41.0)
        assert found is not None
        assert alone is not None
        assert found[1] <= alone[1]
        if now > 0:
            point = shield._bounds(
                Box(speed, speed, load, load),
                41.0,
                speed,
                any_oil[0],
                shield._whirling(41.0, any_oil),
            )
            assert clearance_m <= max(point[1], SAFE_M) + 1e-9
        clearance_m += min(max(found[1] - clearance_m, -rate * step_s), rate * step_s)


def test_a_ramp_far_ahead_narrows_nothing_yet() -> None:
    shield = Shield(bench())
    ramp = Ramp(shield.lead_s + 0.1, shield.lead_s + 1.0, 12000 * RPM, 30.0)
    free = shield.interval(6000 * RPM, 90.0, 110.0, 41.0)
    assert shield.interval(6000 * RPM, 90.0, 110.0, 41.0, announced=[ramp]) == free


@pytest.mark.parametrize("slower", [1.0, 0.5, 0.2])
def test_a_slower_actuator_never_widens_the_interval(slower: float) -> None:
    config = bench()
    lame = config.replaced(
        actuator=msgspec.structs.replace(
            config.machine.actuator, rate_um_s=config.machine.actuator.rate_um_s * slower
        ),
    )
    for rpm in (3000, 6000, 9000):
        full = Shield(config).interval(rpm * RPM, 90.0, 110.0, 41.0)
        less = Shield(lame).interval(rpm * RPM, 90.0, 110.0, 41.0)
        assert full is not None
        assert less is not None
        assert full[0] <= less[0]
        assert less[1] <= full[1]


def test_doubt_about_the_load_never_widens_the_interval() -> None:
    shield = Shield(bench())
    for rpm in range(1500, 12001, 500):
        sure = shield.interval(rpm * RPM, 100.0, 100.0, 41.0)
        unsure = shield.interval(rpm * RPM, 60.0, 160.0, 41.0)
        if sure is not None and unsure is not None:
            assert sure[0] <= unsure[0]
            assert unsure[1] <= sure[1]
        assert sure is not None or unsure is None


def test_a_rotor_further_out_of_balance_never_has_a_wider_interval() -> None:
    shields = [
        Shield(changed("rotor", unbalance_normal_kg_m=kg_m)) for kg_m in (0.0, 5e-6, 1.7e-5, 3e-5)
    ]
    for rpm, load_N in ((12000.0, 50.0), (11000.0, 40.0), (12000.0, 35.0)):
        ends = [shield.interval(rpm * RPM, load_N, load_N, 41.0) for shield in shields]
        highs = [end[1] if end else 0.0 for end in ends]
        assert highs == sorted(highs, reverse=True)
        assert highs[-1] < highs[0]


def test_a_measured_unbalance_counts_whole_and_that_of_a_grade_in_part() -> None:
    shields = [Shield(changed("rotor", unbalance_measured=measured)) for measured in (True, False)]
    highs = [shield.interval(12000 * RPM, 50.0, 50.0, 41.0) for shield in shields]
    assert highs[0] is not None
    assert highs[1] is not None
    assert highs[0][1] < highs[1][1] - 1e-6


@pytest.mark.parametrize("offset_um", [-3.0, 3.0])
def test_a_bearing_that_is_wider_than_it_tells_has_its_bound_of_whirl_so_much_earlier(
    offset_um: float,
) -> None:
    told, built = Shield(bench()), Shield(changed("bearing", radial_clearance_offset_um=offset_um))
    bounds = [shield._whirl_bound(12000 * RPM, 50.0, 0.008) for shield in (told, built)]
    assert bounds[1] == pytest.approx(bounds[0] - offset_um * 1e-6, abs=1e-12)
    assert built._capacity(60e-6) == pytest.approx(
        told._capacity((60.0 + offset_um) * 1e-6), rel=1e-9
    )


def test_whirl_has_not_grown_within_the_turns_that_the_retreat_may_take() -> None:
    """The rotor on the Reynolds film, at rest in a clearance 5 % wider than that of its whirl."""
    rig, speed, load_N = load_rig("bench"), 12000 * RPM, 50.0
    film = static_film(rig.bearing.radius_m, rig.bearing.length_m)
    per_number, viscosity = (
        load_N / (rig.rotor.effective_mass_kg * speed**2),
        rig.oil.viscosity_Pa_s,
    )
    clearance_m = (
        1.05 * per_number / film.whirl_share(per_number**2 * load_N / (viscosity * speed), 0.2)
    )
    build = replace(Build.nominal(rig), unbalance_kg_m=0.2 * load_N / speed**2)
    for turns, grown in ((GROWTH_TURNS / 0.05, False), (800.0, True)):
        run = simulate(
            rig,
            Duty.hold(12000.0, load_N, turns * 2 * pi / speed),
            clearance=clearance_m,
            build=build,
            inlet_C=rig.oil.reference_C,
            thermal=False,
        )
        assert (run.last(0.02).peak_to_peak_m() > 0.5 * clearance_m) == grown


@pytest.mark.parametrize("p2p_um", np.arange(18.0, 27.0, 0.5))
def test_vibration_may_fill_its_share_of_the_clearance_and_no_more(p2p_um: float) -> None:
    found = Shield(bench()).interval(6000 * RPM, 90.0, 110.0, 41.0, p2p_um * 1e-6, SAFE_M)
    assert found is not None
    assert found[0] == pytest.approx(min(max(40e-6, p2p_um * 2e-6), SAFE_M))


@pytest.mark.parametrize("clearance_um", [55.0, 80.0, 120.0, 160.0])
@pytest.mark.parametrize("share", np.arange(0.05, 0.6, 0.05))
def test_vibration_narrows_a_wide_clearance_before_its_limit(
    clearance_um: float, share: float
) -> None:
    """Below the margin it may widen, above it must narrow; never below the safe clearance, never
    wider than without."""
    shield, point = Shield(bench()), (6000 * RPM, 90.0, 110.0, 41.0)
    free = shield.interval(*point)
    found = shield.interval(*point, share * clearance_um * 1e-6, clearance_um * 1e-6)
    assert free is not None
    assert found is not None
    kept_m = clearance_um * 1e-6 * VIBRATION_MARGIN * 0.5 / share
    if share <= 0.5:  # narrower at once, the present vibration would not fit
        kept_m = max(kept_m, 2 * share * clearance_um * 1e-6 / FITTING_MARGIN)
    assert found[1] == pytest.approx(min(free[1], max(kept_m, SAFE_M)))
    narrows = VIBRATION_MARGIN * 0.5 + 1e-9 < share < FITTING_MARGIN * 0.5 or share > 0.5
    assert not narrows or found[1] < clearance_um * 1e-6


@pytest.mark.parametrize("p2p_um", [52.0, 57.0, 61.0])
def test_a_vibration_that_no_narrowing_makes_smaller_is_not_narrowed_into_its_limit(
    p2p_um: float,
) -> None:
    """That of an unbalance well above the critical speed; the interval follows as the actuator
    does."""
    shield, clearance_m = Shield(bench()), 130e-6
    for _ in range(200):
        found = shield.interval(6000 * RPM, 90.0, 110.0, 41.0, p2p_um * 1e-6, clearance_m)
        assert found is not None
        clearance_m += min(max(found[1] - clearance_m, -1e-6), 1e-6)
    assert p2p_um * 1e-6 == pytest.approx(0.5 * FITTING_MARGIN * clearance_m)


@pytest.mark.parametrize("speed", [0.0, -100.0, float("nan")])
def test_no_speed_no_interval(speed: float) -> None:
    assert Shield(bench()).interval(speed, 100.0, 100.0, 41.0) is None


def test_hotter_oil_never_helps() -> None:
    shield = Shield(bench())
    ends = [shield.interval(3000 * RPM, 100.0, 150.0, t) for t in range(30, 70, 2)]
    highs = [found[1] if found else 0.0 for found in ends]
    assert highs == sorted(highs, reverse=True)


# ------------------------------------------------------------------ the safe value at configuration


def changed(section: str, **values: float) -> Config:
    config = bench()
    part = msgspec.structs.replace(getattr(config.machine, section), **values)
    return config.replaced(**{section: part})


def refusal(config: Config) -> str:
    return "\n".join(f"{key} = {value}: {cause}" for key, value, cause in check_safe(config))


def test_the_shipped_safe_value_is_admissible_everywhere_in_the_film_solver() -> None:
    config, _ = load(SHIPPED / "bench")
    assert not refusal(config)
    hot = viscosity_Pa_s(config.machine.lubricant, config.machine.lubricant.inlet_max_C)
    for rpm in (1500.0, 3000.0, 6000.0, 12000.0):
        state = equilibrium(
            load_N=300.0,
            radius_m=0.02,
            length_m=0.02,
            clearance_m=SAFE_M,
            viscosity_Pa_s=hot,
            speed_rad_s=rpm * RPM,
        )
        assert (1 - state.eccentricity_ratio) * SAFE_M >= 10e-6


def test_an_unsafe_safe_value_is_refused_with_the_range_that_would_do() -> None:
    config = changed("actuator", safe_radial_clearance_um=80.0)
    text = refusal(config)
    assert "actuator.safe_radial_clearance_um = 80" in text
    assert "40 .. 59 um" in text


def test_the_ends_of_the_admissible_range_are_where_the_refusal_begins() -> None:
    low_m, high_m = Shield(bench()).fixed_range() or (0.0, 0.0)
    assert Shield(bench()).admits_fixed(high_m)
    assert not Shield(bench()).admits_fixed(high_m + 1e-6)
    assert low_m == pytest.approx(40e-6)


def test_an_impossible_range_is_refused() -> None:
    config = changed("operating", load_max_N=600.0)
    assert "no fixed clearance is admissible" in refusal(config)


def test_a_film_as_thick_as_the_clearance_carries_nothing() -> None:
    config = bench()
    limits = msgspec.structs.replace(config.limits, min_film_um=60.0)
    config = msgspec.structs.replace(config, limits=limits)
    assert not Shield(config).admits_fixed(SAFE_M)
    assert Shield(config).interval(6000.0 * RPM, 100.0, 100.0, 40.0) is None
    assert refusal(config)


def test_a_long_bearing_is_outside_the_verified_domain() -> None:
    config = changed("bearing", length_m=0.05)
    assert monitor_only(config.machine) == (
        "L/D = 1.25: the guard's bounds are verified up to 1 (bearing.length_m 0.05, "
        "journal_radius_m 0.02)",
    )
    assert list(check_safe(config)) == []
