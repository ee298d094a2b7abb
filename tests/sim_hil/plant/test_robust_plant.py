"""The machine where films break down: standstill, reversal, contact, whirl, loose bolts; and bad
input."""

import dataclasses
import math
from collections.abc import Callable
from itertools import count, islice
from typing import NamedTuple

import numpy as np
import pytest

from firmware_py.config import SHIPPED, load
from firmware_py.records import DeviceHeartbeat
from firmware_py.wire.codec import CanCodec
from sim_hil.faults import FaultSet
from sim_hil.film.direct import DirectFilm, direct_force
from sim_hil.film.table import FilmTable
from sim_hil.film.table_kernel import CONTACT_STIFFNESS_N_M, EPS_TABLE, table_force
from sim_hil.plant.build import Build
from sim_hil.plant.machine import MachineError, SimulatedMachine
from sim_hil.rigs import load_rig
from sim_hil.rotor.assembly import AssemblyError
from sim_hil.rotor.parameters import TRUTH_COLUMNS, Floats
from sim_hil.server import make_rig

RIG = load_rig("bench")
CHUNK_S = 0.01
MAX_LOAD_N = 300.0
WORST = {"unbalance": 100.0}


class Truth(NamedTuple):
    """The columns that are judged."""

    eccentricity_m: Floats
    clearance_m: Floats
    power_W: Floats

    def beyond_film_m(self) -> float:
        """How far the journal went past the film into the asperities, m, at the most."""
        return float((self.eccentricity_m - EPS_TABLE * self.clearance_m).max())


def drive_through(
    machine: SimulatedMachine,
    seconds: float,
    load_N: float,
    rpm: Callable[[float], float],
    clearance: Callable[[float], float],
) -> Truth:
    """Run with speed and clearance as functions of the elapsed share of the time."""
    n = round(CHUNK_S * machine.rate_hz)
    chunks = round(seconds / CHUNK_S)
    rows = []
    for i in range(chunks):
        share = (i + np.arange(n + 1) / n) / chunks
        drive = np.column_stack(
            [[rpm(float(s)) * math.pi / 30 for s in share], np.full(n + 1, load_N)]
        )
        rows.append(machine.advance(drive, clearance(i / chunks), RIG.supply.nominal_Pa).truth)
    truth = np.concatenate(rows)
    assert np.isfinite(truth).all()
    column = {name: truth[:, i] for i, name in enumerate(TRUTH_COLUMNS)}
    e = np.hypot(column["eccentricity_x_m"], column["eccentricity_y_m"])
    return Truth(e, column["clearance_m"], column["shaft_power_W"])


def hold(
    rpm: float,
    load_N: float,
    clearance_m: float = 60e-6,
    seconds: float = 0.6,
    seed: int = 1,
    faults: FaultSet | None = None,
) -> Truth:
    machine = SimulatedMachine(RIG, Build.of_seed(RIG, seed), seed, clearance_m=clearance_m)
    for name, severity in (faults or {}).items():
        machine.inject(name, severity)
    return drive_through(machine, seconds, load_N, lambda _: rpm, lambda _: clearance_m)


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("load_N", [0.0, 100.0, MAX_LOAD_N, 3 * MAX_LOAD_N])
def test_standstill_ends_on_the_asperities_at_rest(seed: int, load_N: float) -> None:
    truth = hold(0.0, load_N, 50e-6, 2.5, seed)
    assert truth.beyond_film_m() <= 1.1 * load_N / CONTACT_STIFFNESS_N_M + 1e-9
    last = truth.power_W[-1000:]
    assert abs(last).max() < 1e-2
    assert np.ptp(truth.eccentricity_m[-1000:]) < 1e-7
    # held by the contact, not still sinking: it carries the load when the film squeezes no more
    if load_N >= 100.0:
        assert truth.beyond_film_m() == pytest.approx(load_N / CONTACT_STIFFNESS_N_M, rel=0.15)


def test_a_machine_that_begins_at_standstill_lies_on_the_wall() -> None:
    machine = SimulatedMachine(RIG, Build.nominal(RIG), 1)
    truth = drive_through(
        machine, 0.02, 300.0, lambda _: 0.0, lambda _: RIG.bearing.clearance_nominal_m
    )
    assert truth.beyond_film_m() == pytest.approx(300.0 / CONTACT_STIFFNESS_N_M, rel=0.5)
    assert truth.eccentricity_m.min() > 0.95 * truth.clearance_m.min()


def test_a_fast_rig_has_steps_enough_a_turn() -> None:
    fast = dataclasses.replace(RIG, speed_max_rpm=30_000.0)
    machine = SimulatedMachine(fast, Build.nominal(fast), 1, rate_hz=10_000)
    assert machine._substeps == 3
    assert SimulatedMachine(RIG, Build.nominal(RIG), 1, rate_hz=10_000)._substeps == 3


def test_standstill_carries_the_load_at_any_step() -> None:
    depth = []
    for step_s in (40e-6, 10e-6):
        machine = SimulatedMachine(RIG, Build.nominal(RIG), 1, clearance_m=40e-6, max_step_s=step_s)
        truth = drive_through(machine, 1.0, 900.0, lambda _: 0.0, lambda _: 40e-6)
        depth.append(float(truth.eccentricity_m[-1]))
    assert depth[0] == pytest.approx(depth[1], abs=1e-9)


def test_coast_to_standstill_and_up_again_returns_to_where_it_was() -> None:
    machine = SimulatedMachine(RIG, Build.of_seed(RIG, 1), 1, clearance_m=50e-6, thermal=False)
    truth = drive_through(
        machine,
        4.0,
        100.0,
        lambda s: 6000 * min(1.0, max(0.0, 3.5 * abs(s - 0.5) - 0.6)),
        lambda _: 50e-6,
    )
    assert truth.beyond_film_m() < 1e-6
    middle = len(truth.power_W) // 2
    assert abs(truth.power_W[middle - 500 : middle + 500]).max() < 1e-2
    before, after = truth.eccentricity_m[500:1000].mean(), truth.eccentricity_m[-500:].mean()
    assert after == pytest.approx(before, rel=0.02)


def test_reversal_mirrors_the_power() -> None:
    forward, backward = hold(6000.0, 100.0), hold(-6000.0, 100.0)
    assert backward.power_W[-1000:].mean() == pytest.approx(
        forward.power_W[-1000:].mean(), rel=0.01
    )
    machine = SimulatedMachine(RIG, Build.of_seed(RIG, 1), 1)
    truth = drive_through(machine, 1.5, 100.0, lambda s: 6000 * (1 - 2 * s), lambda _: 60e-6)
    assert truth.beyond_film_m() < 0
    assert truth.power_W.min() >= 0


@pytest.mark.parametrize("rpm", [600.0, 12000.0])
@pytest.mark.parametrize("load_N", [0.0, MAX_LOAD_N, 3 * MAX_LOAD_N])
def test_loads_at_the_ends_of_speed(rpm: float, load_N: float) -> None:
    truth = hold(rpm, load_N)
    assert truth.beyond_film_m() < 0
    assert 0.0 < truth.power_W.min() < truth.power_W.max() < 1000.0


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_whirl_and_the_worst_unbalance_stay_bounded(seed: int) -> None:
    for truth in (
        hold(12000.0, 30.0, 160e-6, seed=seed),
        hold(12000.0, 30.0, 160e-6, seed=seed, faults=WORST),
        hold(
            12000.0,
            30.0,
            40e-6,
            seed=seed,
            faults={**WORST, "pedestal_two_bolts": 0.0, "motor_bolt": 0.0},
        ),
    ):
        assert truth.beyond_film_m() < 2e-6
        assert 0.0 < truth.power_W.min() < truth.power_W.max() < 2000.0


@pytest.mark.parametrize(
    "faults",
    [
        {"pedestal_two_bolts": 0.0},
        {"rub": 1.0, "unbalance": 100.0},
        {"starvation": 1.0, "pressure_loss": 1.0},
    ],
)
@pytest.mark.parametrize("rpm", [0.0, 300.0, 6000.0])
def test_faults_at_their_worst_under_three_times_the_load(faults: FaultSet, rpm: float) -> None:
    truth = hold(rpm, 3 * MAX_LOAD_N, 40e-6, faults=faults)
    assert truth.beyond_film_m() <= 2 * 3 * MAX_LOAD_N / CONTACT_STIFFNESS_N_M
    # asperities give back what they stored when a loose pedestal yields
    assert -2.0 < truth.power_W.min() <= truth.power_W.max() < 1000.0


def test_clearance_steps_at_the_rate_limit() -> None:
    machine = SimulatedMachine(RIG, Build.of_seed(RIG, 1), 1, clearance_m=160e-6)
    truth = drive_through(
        machine, 3.0, MAX_LOAD_N, lambda _: 3000.0, lambda s: 40e-6 if s < 0.8 else 160e-6
    )
    assert truth.clearance_m.min() < 45e-6
    assert truth.beyond_film_m() < 0
    still = drive_through(
        machine, 3.0, MAX_LOAD_N, lambda _: 0.0, lambda s: 40e-6 if s < 0.8 else 160e-6
    )
    # the closing wall carries the resting journal along
    assert still.beyond_film_m() < 1.2 * MAX_LOAD_N / CONTACT_STIFFNESS_N_M


@pytest.mark.parametrize("eps", [0.9, 0.97, 0.985])
def test_film_between_a_resting_journal_and_a_closing_wall(eps: float) -> None:
    c, rate = 60e-6, -50e-6
    film = DirectFilm.make(256, 8)
    table = table_force(
        FilmTable.load(0.5).coefficients, 0.0, -eps * c, 0.0, 0.0, 0.0, c, 0.01, 0.02, 0.02, rate
    )
    solved = direct_force(
        film.ring, film.axial, film.work, 0.0, -eps * c, 0.0, 0.0, 0.0, c, 0.01, 0.02, 0.02, rate
    )
    assert table[1] == pytest.approx(solved[1], rel=0.02)
    assert table[1] > 0


def test_the_rig_survives_a_trip_to_standstill_and_a_new_start() -> None:
    config, _ = load(SHIPPED / "bench")
    codec, rig = CanCodec(), make_rig(config, "bench", 1)

    clock = count(0, 20_000_000)

    def run(seconds: float, beat: DeviceHeartbeat) -> None:
        for now_ns in islice(clock, round(seconds / 0.02)):
            rig.step(now_ns, [codec.encode(beat, now_ns)])

    run(1.0, DeviceHeartbeat(0, 7, 2, 3, True, False))
    running = rig.truth[-1]
    run(9.0, DeviceHeartbeat(1, 7, 2, 3, False, True))
    still = rig.truth[-1]
    assert (still.speed_rad_s, still.coasting) == (0.0, True)
    assert abs(still.power_W) < 1e-3
    assert 0.0 < still.min_film_um < 1.0
    run(0.1, DeviceHeartbeat(2, 7, 2, 3, True, False))
    assert rig.drive.start()
    run(9.0, DeviceHeartbeat(3, 7, 2, 3, True, False))
    again = rig.truth[-1]
    assert again.speed_rad_s == running.speed_rad_s
    assert again.power_W == pytest.approx(running.power_W, rel=0.05)
    assert again.min_film_um == pytest.approx(running.min_film_um, rel=0.05)


@pytest.mark.parametrize(
    ("speed", "load_N", "clearance_m", "pressure_Pa", "named"),
    [
        (math.nan, 100.0, 60e-6, 1e5, "speed or load"),
        (600.0, math.inf, 60e-6, 1e5, "speed or load"),
        (600.0, 100.0, 0.0, 1e5, "clearance"),
        (600.0, 100.0, math.nan, 1e5, "clearance"),
        (600.0, 100.0, 200e-6, 1e5, "clearance"),
        (600.0, 100.0, 60e-6, math.nan, "pressure"),
        (1e200, 100.0, 60e-6, 1e5, "times the greatest declared speed"),
        (1e5, 100.0, 60e-6, 1e5, "times the greatest declared speed"),
        (600.0, 1e200, 60e-6, 1e5, "no finite answer"),
    ],
)
def test_bad_input_is_refused_by_name(
    speed: float, load_N: float, clearance_m: float, pressure_Pa: float, named: str
) -> None:
    machine = SimulatedMachine(RIG, Build.nominal(RIG), 1)
    with pytest.raises(MachineError, match=named):
        machine.advance(np.tile([speed, load_N], (11, 1)), clearance_m, pressure_Pa)


@pytest.mark.parametrize("step_s", [0.0, -1e-6, 60e-6, 100e-6, 200e-6, math.nan])
def test_a_step_beyond_the_verified_one_is_refused(step_s: float) -> None:
    with pytest.raises(MachineError, match="max_step_s"):
        SimulatedMachine(RIG, Build.nominal(RIG), 1, max_step_s=step_s)


@pytest.mark.parametrize("rate_hz", [0, -5000, 500, 3000, 44100])
def test_a_rate_without_whole_microseconds_is_refused(rate_hz: int) -> None:
    with pytest.raises(MachineError, match="rate_hz"):
        SimulatedMachine(RIG, Build.nominal(RIG), 1, rate_hz=rate_hz)


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"mass_kg": -6.0}, "shaft.mass"),
        ({"mass_kg": 0.0}, "shaft.mass"),
        ({"diametral_inertia_kg_m2": math.nan}, "shaft.diametral"),
        ({"coupling_stiffness_N_m": -1e7}, "shaft.coupling_stiffness"),
        ({"unbalance_kg_m": math.inf}, "shaft.unbalance"),
    ],
)
def test_an_absurd_rotor_is_refused(changed: dict[str, float], named: str) -> None:
    rig = dataclasses.replace(RIG, rotor=dataclasses.replace(RIG.rotor, **changed))
    with pytest.raises(AssemblyError, match=named):
        SimulatedMachine(rig, Build.nominal(rig), 1)


def test_absurd_oil_clearance_and_start_are_refused() -> None:
    thin = dataclasses.replace(RIG, oil=dataclasses.replace(RIG.oil, viscosity_Pa_s=0.0))
    with pytest.raises(AssemblyError, match=r"film\.viscosity"):
        SimulatedMachine(thin, Build.nominal(thin), 1)
    with pytest.raises(AssemblyError, match="must leave a gap"):
        SimulatedMachine(RIG, dataclasses.replace(Build.nominal(RIG), clearance_error_m=-50e-6), 1)
    with pytest.raises(AssemblyError, match=r"film\.inlet_C"):
        SimulatedMachine(RIG, Build.nominal(RIG), 1, inlet_C=math.nan)
    with pytest.raises(MachineError, match="clearance = 500 um"):
        SimulatedMachine(RIG, Build.nominal(RIG), 1, clearance_m=500e-6)
    with pytest.raises(MachineError, match="pressure"):
        SimulatedMachine(RIG, Build.nominal(RIG), 1, pressure_Pa=-1.0)
    with pytest.raises(MachineError, match="drive of shape"):
        SimulatedMachine(RIG, Build.nominal(RIG), 1).advance(np.zeros(5), 60e-6, 1e5)
