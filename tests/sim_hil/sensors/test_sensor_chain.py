"""From motion to counts: filter, contact law, marks, noise, calibration, range."""

import dataclasses

import msgspec
import numpy as np
import pytest
from scipy.signal import freqz

from sim_hil.plant.build import Build
from sim_hil.plant.duty import Duty
from sim_hil.plant.machine import SimulatedMachine
from sim_hil.plant.runs import record, run
from sim_hil.rigs import load_rig
from sim_hil.rotor.assembly import contact_parameters
from sim_hil.rotor.parameters import TRUTH_COLUMNS, Floats
from sim_hil.sensors.antialias import antialias_taps
from sim_hil.sensors.chain import SCALES, SensorChain, units
from sim_hil.sensors.kernel import contact_voltage

RIG = load_rig("bench")
NOMINAL = Build.nominal(RIG)
CIRCUIT = contact_parameters(RIG.contact)


@pytest.mark.parametrize(("rate", "substeps"), [(5000, 5), (10000, 3)])
def test_filter_is_60_dB_down_from_nyquist_and_flat_below(rate: int, substeps: int) -> None:
    hz = np.linspace(0, rate * substeps / 2, 20000)
    _, response = freqz(antialias_taps(substeps), worN=hz, fs=rate * substeps)
    gain_dB = 20 * np.log10(np.abs(response) + 1e-12)
    assert gain_dB[hz >= rate / 2].max() <= -60
    assert np.abs(gain_dB[hz <= 0.38 * rate]).max() < 0.05


def tone(hz: float, rate_hz: int) -> Floats:
    """What the motor's accelerometer gives, m/s2, when a force of that frequency shakes the motor;
    with its times."""
    shaken = msgspec.structs.replace(
        RIG.excitation, line_hz=hz, line_force_N=3000.0, tooth_force_N=0.0
    )
    machine = SimulatedMachine(
        dataclasses.replace(RIG, excitation=shaken), NOMINAL, 1, rate_hz=rate_hz
    )
    counts = run(machine, Duty.hold(3000, 100), 1.2, clearance=60e-6).counts
    return units(counts)[-rate_hz:, 4]


def amplitude(y: Floats, hz: float, rate_hz: int) -> float:
    window = np.hanning(len(y))
    wave = np.exp(-2j * np.pi * hz * np.arange(len(y)) / rate_hz)
    return float(2 * abs(np.sum((y - y.mean()) * window * wave)) / window.sum())


@pytest.mark.parametrize("hz", [2503.0, 2700.0, 4100.0])
def test_a_tone_above_nyquist_is_gone_through_the_whole_machine(hz: float) -> None:
    """Seen at 10 kHz, it must not come back folded at 5 kHz: 60 dB down."""
    seen, folded = (
        amplitude(tone(hz, 10_000), hz, 10_000),
        amplitude(tone(hz, 5000), 5000 - hz, 5000),
    )
    assert seen > 20.0 if hz < 4000 else seen > 5.0
    assert folded < 1e-3 * seen + 0.004  # and the noise of 5000 samples


def test_a_tone_above_nyquist_is_gone_at_10_khz_too() -> None:
    assert amplitude(tone(5100.0, 10_000), 4900.0, 10_000) < 0.03
    assert amplitude(tone(1900.0, 10_000), 1900.0, 10_000) == pytest.approx(
        amplitude(tone(1900.0, 5000), 1900.0, 5000), rel=0.03
    )


def test_contact_voltage_falls_as_the_film_thins_and_ends_at_zero() -> None:
    films = np.linspace(0, 60e-6, 200)
    volts = np.array([contact_voltage(h, 0.75e-6, CIRCUIT) for h in films])
    assert volts[0] == 0.0
    assert (np.diff(volts) >= 0).all()
    assert 0.2 < contact_voltage(8e-6, 0.75e-6, CIRCUIT) < 1.5
    assert contact_voltage(1e-6, 0.75e-6, CIRCUIT) < 0.01
    assert volts[-1] < 2.0


def chain_output(build: Build, signals: Floats, seed: int = 0) -> Floats:
    n = len(signals)
    normal = np.random.default_rng(seed).standard_normal((n, 8))
    return units(
        SensorChain(RIG, build).counts(
            signals, normal, np.zeros((n, 8)), np.zeros(n), np.zeros(n), {}
        )
    )


def test_noise_of_each_channel_is_that_of_its_data_sheet() -> None:
    y = chain_output(NOMINAL, np.full((20000, 8), 1.0) * np.array([0, 0, 0, 0, 0, 0, 1.0, 1.0]))
    expected = [0.1e-6, 0.1e-6, 0.05, 0.05, 0.05, NOMINAL.room_Pa, 0.01, 0.005]
    np.testing.assert_allclose(y.std(axis=0), expected, rtol=0.05)


def test_signals_beyond_the_range_stay_at_its_end() -> None:
    y = chain_output(NOMINAL, np.full((10, 8), 1e3))
    np.testing.assert_allclose(y[0], [250e-6, 250e-6, 200, 200, 200, 20, 10, 2.0])
    low = chain_output(NOMINAL, np.full((10, 8), -1e3))
    np.testing.assert_allclose(low[0], [-250e-6, -250e-6, -200, -200, -200, -20, 0, 0])


def test_calibration_errors_of_the_build_are_applied() -> None:
    build = dataclasses.replace(NOMINAL, gain=np.full(8, 1.03), zero=np.array([2e-6, *[0.0] * 7]))
    y = chain_output(build, np.full((5000, 8), 1.0) * np.array([1e-4, 1e-4, 10, 10, 10, 1, 1, 1]))
    np.testing.assert_allclose(y.mean(axis=0)[:3], [1.05e-4, 1.03e-4, 10.3], rtol=1e-3)


def test_probes_stand_at_45_and_135_degrees() -> None:
    recording = record(RIG, NOMINAL, Duty.hold(3000, 200), 0.4, clearance=60e-6, seed=1)
    x, y = (recording.column(f"eccentricity_{a}_m").mean() for a in "xy")
    probes = units(recording.counts)[:, :2].mean(axis=0)
    np.testing.assert_allclose(probes, np.array([x + y, y - x]) / np.sqrt(2), atol=0.05e-6)


def test_quantisation_is_that_of_the_wire() -> None:
    np.testing.assert_array_equal(SCALES, [1e-8, 1e-8, 1e-2, 1e-2, 1e-2, 1e-3, 1e-3, 1e-4])


def first_order_phase(recording_rate: int) -> float:
    """Phase of the first order of disp_x against the marks, degrees."""
    r = record(
        RIG, NOMINAL, Duty.hold(6000, 100), 1.0, clearance=60e-6, seed=4, rate_hz=recording_rate
    )
    turns = np.interp(r.time_s, r.mark_s, np.arange(len(r.mark_s)))
    inside = (r.time_s > r.mark_s[0]) & (r.time_s < r.mark_s[-1])
    y = units(r.counts)[inside, 0]
    return float(np.degrees(np.angle(np.sum((y - y.mean()) * np.exp(-2j * np.pi * turns[inside])))))


def test_samples_and_marks_share_one_time_whatever_the_rate() -> None:
    difference = first_order_phase(5000) - first_order_phase(10000)
    assert abs((difference + 180) % 360 - 180) < 1.0


def test_marks_come_once_per_turn_at_the_speed() -> None:
    r = record(RIG, NOMINAL, Duty.hold(4321, 100), 1.0, clearance=60e-6, seed=4)
    np.testing.assert_allclose(np.diff(r.mark_s), 60 / 4321, atol=2e-6)


def test_marks_follow_a_run_up_and_stop_with_the_rotor() -> None:
    machine = SimulatedMachine(RIG, NOMINAL, 1)
    batch = run(machine, Duty((0.0, 1.0), (600.0, 0.0), (100.0, 100.0)), 1.5, clearance=60e-6)
    edges = np.flatnonzero(batch.marks >= 0)
    assert len(edges) in (4, 5, 6)
    assert (np.diff(edges) > 0).all()
    assert edges[-1] < 5000


def test_runout_is_seen_by_the_probe_only() -> None:
    runout = np.zeros((2, 3))
    runout[0, 1] = 5e-6
    build = dataclasses.replace(NOMINAL, runout_m=runout)
    duty = Duty.hold(6000, 100)
    with_runout, without = (
        record(RIG, b, duty, 0.4, clearance=60e-6, seed=2) for b in (build, NOMINAL)
    )
    np.testing.assert_array_equal(with_runout.truth, without.truth)
    difference = units(with_runout.counts)[:, 0] - units(without.counts)[:, 0]
    assert np.ptp(difference) == pytest.approx(10e-6, rel=0.02)


def test_machine_repeats_bit_for_bit_and_differs_by_seed() -> None:
    duty = Duty((0.0, 0.3), (3000.0, 6000.0), (50.0, 200.0))
    first, again, other = (
        run(SimulatedMachine(RIG, NOMINAL, s), duty, 0.3, clearance=70e-6) for s in (5, 5, 6)
    )
    np.testing.assert_array_equal(first.counts, again.counts)
    np.testing.assert_array_equal(first.truth, again.truth)
    assert (first.counts != other.counts).any()
    assert first.truth.shape == (1500, len(TRUTH_COLUMNS))


def test_calls_of_any_length_give_the_same_samples() -> None:
    drive = Duty.hold(6000, 100).at(np.arange(601) / 5000)
    whole = SimulatedMachine(RIG, NOMINAL, 5).advance(drive, 60e-6, 1e5)
    pieces = SimulatedMachine(RIG, NOMINAL, 5)
    counts = [pieces.advance(drive[i : i + 8], 60e-6, 1e5).counts for i in range(0, 595, 7)]
    np.testing.assert_array_equal(np.concatenate(counts), whole.counts[:595])
