"""Every fault shows where the literature says, on one and the same drawn build."""

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from sim_hil.faults import (
    MACHINE_FAULTS,
    SENSOR_FAULTS,
    UnknownFault,
    apply_machine_faults,
    check_fault,
)
from sim_hil.faults.machine import loosen, worn_bore
from sim_hil.plant.build import Build, unbalance_of_grade
from sim_hil.plant.duty import Duty
from sim_hil.plant.machine import SimulatedMachine
from sim_hil.plant.runs import SimulatedRecording, record, run
from sim_hil.rigs import load_rig
from sim_hil.rotor.assembly import assemble
from sim_hil.rotor.parameters import Floats
from sim_hil.sensors.chain import units

RIG = load_rig("bench")
BUILD = Build.draw(RIG, np.random.default_rng(7))
RATE = 5000
VERTICAL, HORIZONTAL, MOTOR, PRESSURE, CONTACT = 2, 3, 4, 6, 7


@cache
def recorded(
    faults: tuple[tuple[str, float], ...] = (), rpm: float = 6000, load_N: float = 100
) -> SimulatedRecording:
    duty = Duty.hold(rpm, load_N)
    return record(
        RIG, BUILD, duty, 2.0, clearance=60e-6, seed=11, faults=dict(faults), rate_hz=RATE
    )


def measured(
    faults: Mapping[str, float] | None = None, rpm: float = 6000, load_N: float = 100
) -> Floats:
    return units(recorded(tuple((faults or {}).items()), rpm, load_N).counts)


def order(signal: Floats, number: float, rpm: float = 6000) -> float:
    """Amplitude of one order."""
    t = np.arange(len(signal)) / RATE
    window = np.hanning(len(signal))
    wave = np.exp(-2j * np.pi * number * rpm / 60 * t)
    return float(2 * abs(np.sum((signal - signal.mean()) * window * wave)) / window.sum())


def whirl(y: Floats, number: float, rpm: float = 6000) -> tuple[float, float]:
    """Amplitudes of the forward and the backward turning part of one order of the probes' orbit,
    m."""
    orbit = y[:, 0] + 1j * y[:, 1]
    window = np.hanning(len(orbit)) / np.hanning(len(orbit)).sum()
    wave = np.exp(-2j * np.pi * number * rpm / 60 * np.arange(len(orbit)) / RATE)
    moving = (orbit - orbit.mean()) * window
    return float(abs(np.sum(moving * wave))), float(abs(np.sum(moving * wave.conj())))


def joined(y: Floats) -> float:
    """Vertical-horizontal correlation of the housing between 250 and 900 Hz: its modes' common
    motion."""
    spectrum = np.fft.rfft(y - y.mean(axis=0), axis=0)
    hz = np.fft.rfftfreq(len(y), 1 / RATE)
    v, h = spectrum[(hz > 250) & (hz < 900)][:, [VERTICAL, HORIZONTAL]].T
    return float(np.real(np.vdot(h, v)) / np.sqrt(np.vdot(h, h).real * np.vdot(v, v).real))


def centre_hz(signal: Floats) -> float:
    """Centre of the housing's energy between 250 and 900 Hz."""
    energy = np.abs(np.fft.rfft(signal - signal.mean())) ** 2
    hz = np.fft.rfftfreq(len(signal), 1 / RATE)
    band = (hz > 250) & (hz < 900)
    return float((energy * hz)[band].sum() / energy[band].sum())


def test_unbalance_raises_the_first_order_and_little_else() -> None:
    healthy, faulty = measured(), measured({"unbalance": 40.0})
    assert order(faulty[:, HORIZONTAL], 1) > 5 * order(healthy[:, HORIZONTAL], 1)
    assert order(faulty[:, HORIZONTAL], 1) > 2 * order(faulty[:, HORIZONTAL], 2)


def test_unbalance_orbit_turns_forward() -> None:
    forward, backward = whirl(measured({"unbalance": 40.0}), 1)
    assert forward > 1.5 * backward


def test_grade_of_the_rig_file() -> None:
    assert unbalance_of_grade(RIG, 6.14) == pytest.approx(RIG.rotor.unbalance_kg_m, rel=0.01)


def test_a_loose_bolt_joins_vertical_and_lateral_motion_with_the_sign_of_its_side() -> None:
    healthy = joined(measured())
    a, c = joined(measured({"pedestal_bolt": 0.0})), joined(measured({"pedestal_bolt_c": 0.0}))
    assert abs(a - healthy) > 0.05
    assert abs(c - healthy) > 0.05
    assert np.sign(a - healthy) != np.sign(c - healthy)


def test_the_effect_of_a_bolt_grows_as_its_preload_goes() -> None:
    steps = [
        abs(joined(measured({"pedestal_bolt": left})) - joined(measured()))
        for left in (75.0, 25.0, 0.0)
    ]
    assert steps[0] < steps[1] < steps[2]


def test_two_bolts_lower_the_modes_more_than_one() -> None:
    one, two = measured({"pedestal_bolt": 25.0}), measured({"pedestal_two_bolts": 25.0})
    frequencies = [centre_hz(y[:, VERTICAL]) for y in (measured(), one, two)]
    assert frequencies[0] > frequencies[1] + 5 > frequencies[2] + 10


def test_motor_bolt_shows_at_the_motor_not_at_the_pedestal() -> None:
    healthy, faulty = measured(), measured({"motor_bolt": 0.0})
    assert abs(centre_hz(faulty[:, MOTOR]) - centre_hz(healthy[:, MOTOR])) > 15
    assert abs(centre_hz(faulty[:, VERTICAL]) - centre_hz(healthy[:, VERTICAL])) < 15


def test_pedestal_and_motor_bolt_is_both() -> None:
    plant = assemble(RIG, BUILD, 1e-5)
    both = apply_machine_faults(plant, RIG, BUILD, {"pedestal_and_motor_bolt": 25.0})
    assert (
        both.pedestal == apply_machine_faults(plant, RIG, BUILD, {"pedestal_bolt": 25.0}).pedestal
    )
    assert both.motor == apply_machine_faults(plant, RIG, BUILD, {"motor_bolt": 25.0}).motor


def test_a_foot_that_lifts_truncates_the_wave() -> None:
    """Strong unbalance lifts the loose foot: harmonics that the tight pedestal does not have."""
    tight = measured({"unbalance": 100.0}, 9000)
    loose = measured({"unbalance": 100.0, "pedestal_two_bolts": 0.0}, 9000)

    assert order(loose[:, VERTICAL], 4, 9000) > 10 * order(tight[:, VERTICAL], 4, 9000)
    assert order(loose[:, VERTICAL], 3, 9000) > 10 * order(tight[:, VERTICAL], 3, 9000)


def test_misalignment_shows_at_twice_the_speed_and_loads_the_side() -> None:
    healthy, faulty = measured(), measured({"misalignment": 1.0})
    assert order(faulty[:, HORIZONTAL], 2) > 5 * order(healthy[:, HORIZONTAL], 2)
    assert order(faulty[:, HORIZONTAL], 2) > 2 * order(faulty[:, HORIZONTAL], 1)
    # the twofold order turns forward, and the probes see the journal pushed to the side
    forward, backward = whirl(faulty, 2)
    assert forward > 1.5 * whirl(healthy, 2)[0]
    assert forward > backward
    aside = (faulty - healthy)[:, :2].mean(axis=0)
    assert aside[0] - aside[1] > 3e-6


def test_misalignment_grows_with_its_severity() -> None:
    twofold = [
        order(measured({"misalignment": s})[:, HORIZONTAL], 2) for s in (0.0, 0.25, 0.5, 1.0)
    ]
    assert (np.diff(twofold) > 0).all()


def test_rub_truncates_the_wave_and_turns_the_orbit_backward() -> None:
    """Light contact: harmonics where there were none; backward motion, and friction, grow."""
    healthy, rubbing = ({"unbalance": 16.0, **rub} for rub in ({}, {"rub": 0.8}))
    free, touched = (measured(f, 9000, 60) for f in (healthy, rubbing))
    for number in (3, 5, 6):
        assert order(touched[:, VERTICAL], number, 9000) > 10 * order(
            free[:, VERTICAL], number, 9000
        )
    assert whirl(touched, 1, 9000)[1] > 1.1 * whirl(free, 1, 9000)[1]
    assert whirl(touched, 1, 9000)[0] < whirl(free, 1, 9000)[0]
    power = [
        recorded(tuple(f.items()), 9000, 60).column("shaft_power_W").mean()
        for f in (healthy, rubbing)
    ]
    assert power[1] > power[0] + 20


def test_a_seal_pressed_on_holds_the_orbit() -> None:
    before, after = (measured({"unbalance": 16.0, **rub}, 9000, 60) for rub in ({}, {"rub": 1.0}))
    assert np.ptp(after[:, 1]) < 0.9 * np.ptp(before[:, 1])


def test_a_seal_that_does_not_touch_changes_nothing() -> None:
    np.testing.assert_array_equal(measured({"rub": 0.1}), measured())


def test_starvation_thins_the_film_and_lets_the_journal_sink() -> None:
    steps = [measured({"starvation": s}) for s in (0.0, 0.5, 1.0)]
    contact = [y[:, CONTACT].mean() for y in steps]
    height = [y[:, :2].mean(axis=0).sum() for y in steps]
    assert (np.diff(contact) < -0.02).all()
    assert (np.diff(height) < -5e-6).all()


def test_wear_lowers_the_journal_and_saves_power_by_more_clearance() -> None:
    healthy, worn = (recorded(f) for f in ((), (("wear", 1.0),)))
    sunk = (units(worn.counts) - units(healthy.counts))[:, :2].mean(axis=0).sum()
    assert sunk < -5e-6
    assert worn.column("shaft_power_W").mean() < healthy.column("shaft_power_W").mean()
    # the actuator does not know
    assert worn.status[:, 3].mean() == pytest.approx(60e-6, abs=1e-6)


def test_worn_bore_has_mean_and_first_order_of_the_profile() -> None:
    c = 6e-5
    psi = np.arange(-np.pi, np.pi, 1e-4)
    for mean in (1e-7, 2e-6, 6e-6):
        depth, drop = worn_bore(mean, c)
        profile = np.maximum(depth - c * (1 - np.cos(psi)), 0.0)
        assert profile.mean() == pytest.approx(mean, rel=1e-3)
        assert drop == pytest.approx(2 * (profile * np.cos(psi)).mean(), rel=1e-3)
    assert worn_bore(0.0, c) == (0.0, 0.0)


def test_oil_whirl_arises_by_itself_at_half_the_speed_and_turns_forward() -> None:
    """No fault: a wide clearance under a light load.  A narrow one at the same point stays
    quiet."""
    quiet, whirling = (
        units(
            record(RIG, BUILD, Duty.hold(12000, 30), 2.0, clearance=c, seed=11, settle_s=1.0).counts
        )
        for c in (50e-6, 100e-6)
    )
    numbers = np.arange(0.40, 0.52, 0.005)
    spectrum = [[whirl(y, n, 12000) for n in numbers] for y in (quiet, whirling)]
    still, half = (np.array(s).max(axis=0) for s in spectrum)
    assert half[0] > 10e-6
    assert half[0] > 3 * half[1]
    assert half[0] > 20 * still[0]
    assert half[0] > whirl(whirling, 1, 12000)[0]


def test_supply_pressure_is_lost_and_starves_the_film() -> None:
    at_once = replace(RIG, supply=replace(RIG.supply, hold_up_s=0.0))  # no accumulator
    healthy, held = measured(), measured({"pressure_loss": 0.8})
    lost = units(
        record(
            at_once, BUILD, Duty.hold(6000, 100), 2.0, clearance=60e-6, seed=11,
            faults={"pressure_loss": 0.8}, rate_hz=RATE,
        ).counts
    )  # fmt: skip
    hold_up_s = RIG.supply.hold_up_s * BUILD.pump  # the record begins after some settling
    low, high = (0.2 + 0.8 * math.exp(-after_s / hold_up_s) for after_s in (2.8, 2.0))
    assert low < held[-10:, PRESSURE].mean() < high
    assert lost[-1000:, PRESSURE].mean() == pytest.approx(0.2, abs=0.02)
    assert lost[-1000:, CONTACT].mean() < healthy[-1000:, CONTACT].mean() - 0.005
    # enough pressure is left: the film does not know
    half = measured({"pressure_loss": 0.5})
    assert half[-1000:, CONTACT].mean() == pytest.approx(healthy[-1000:, CONTACT].mean(), abs=1e-3)


def test_loosening_nothing_changes_nothing() -> None:
    foot = assemble(RIG, BUILD, 1e-5).pedestal
    assert loosen(foot, 0, 100.0, 1e-4) == foot


@pytest.mark.parametrize("name", list(MACHINE_FAULTS))
def test_healthy_end_of_every_severity_is_nearly_healthy(name: str) -> None:
    if name == "unbalance":
        return
    plant = assemble(RIG, BUILD, 1e-5)
    same = apply_machine_faults(plant, RIG, BUILD, {name: MACHINE_FAULTS[name].healthy})
    assert same._replace(excite=same.excite._replace(rub_gap=0.0)) == plant


@pytest.mark.parametrize(
    ("kind", "check"),
    [
        ("gain", lambda y, h: y.std() == pytest.approx(0.5 * h.std(), rel=0.05)),
        ("offset", lambda y, h: y.mean() - h.mean() == pytest.approx(40.0, rel=0.01)),
        (
            "drift",
            lambda y, h: (
                y[-500:].mean() - y[:500].mean() == pytest.approx(40.0 * 0.9 / 60, rel=0.1)
            ),
        ),
        ("stuck", lambda y, h: y.std() == 0.0),
        ("dropout", lambda y, h: 0.15 < np.mean(y == 0.0) < 0.25),
        ("clipping", lambda y, h: np.abs(y).max() <= 1.0 + 1e-9),
        ("hum", lambda y, h: y.std() == pytest.approx(10 / np.sqrt(2), rel=0.05)),
    ],
)
def test_sensor_faults_change_their_channel_alone(kind: str, check: object) -> None:
    healthy, faulty = (SimulatedMachine(RIG, BUILD, 3) for _ in range(2))
    faulty.inject(f"sensor_{kind}:acc_bearing_vertical", 1.0)
    duty = Duty.hold(9000, 100)
    a, b = (units(run(m, duty, 1.0, clearance=60e-6).counts) for m in (healthy, faulty))
    assert callable(check)
    assert check(b[:, VERTICAL], a[:, VERTICAL])
    np.testing.assert_array_equal(np.delete(a, VERTICAL, 1), np.delete(b, VERTICAL, 1))


def test_runout_of_a_probe_is_a_dent_once_a_turn() -> None:
    healthy, dented = (SimulatedMachine(RIG, BUILD, 3) for _ in range(2))
    dented.inject("sensor_runout:disp_x", 0.4)
    duty = Duty.hold(1500, 100)
    a, b = (units(run(m, duty, 1.0, clearance=60e-6).counts) for m in (healthy, dented))
    dent = b[:, 0] - a[:, 0]
    assert dent.max() == pytest.approx(10e-6, rel=0.02)
    assert np.count_nonzero((dent[1:] > 5e-6) & (dent[:-1] <= 5e-6)) in (24, 25, 26)
    assert np.median(dent) == 0.0
    np.testing.assert_array_equal(a[:, 1:], b[:, 1:])


def test_unknown_names_and_severities_are_refused() -> None:
    assert len(SENSOR_FAULTS) == 8
    for name, severity in (
        ("bent_shaft", 1.0),
        ("sensor_gain:disp_z", 1.0),
        ("sensor_x:disp_x", 1.0),
        ("sensor_runout:microphone", 1.0),
    ):
        with pytest.raises(UnknownFault, match="choose one of"):
            check_fault(name, severity)
    with pytest.raises(UnknownFault, match=r"outside 0 \.\. 100"):
        check_fault("pedestal_bolt", 101.0)
    with pytest.raises(UnknownFault, match="outside"):
        check_fault("rub", float("nan"))


def test_healed_machine_is_the_healthy_one() -> None:
    machine = SimulatedMachine(RIG, BUILD, 1)
    machine.inject("wear", 1.0)
    machine.heal()
    assert machine.faults == {}
    assert machine.wear_m == BUILD.clearance_error_m
