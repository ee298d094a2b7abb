"""What is known of the rig `bench` (rig_bench.json) comes out of the integrated plant."""

import dataclasses

import numpy as np
import pytest

from sim_hil.plant.build import Build
from sim_hil.plant.duty import Duty
from sim_hil.plant.machine import MAX_STEP_S, SimulatedMachine
from sim_hil.plant.runs import run
from sim_hil.rigs import RigData, load_rig
from sim_hil.rotor.parameters import TRUTH_COLUMNS


@pytest.fixture(scope="module")
def bench() -> RigData:
    return load_rig("bench")


class Follow:
    """The true trajectory of a machine that follows a duty."""

    def __init__(
        self,
        rig: RigData,
        duty: Duty,
        *,
        clearance: float,
        thermal: bool = True,
        build: Build | None = None,
        dt_s: float = MAX_STEP_S,
    ) -> None:
        machine = SimulatedMachine(
            rig,
            Build.nominal(rig) if build is None else build,
            0,
            clearance_m=clearance,
            thermal=thermal,
            max_step_s=dt_s,
        )
        self.truth = run(machine, duty, duty.seconds, clearance=clearance).truth

    def column(self, name: str) -> np.ndarray:
        return self.truth[:, TRUTH_COLUMNS.index(name)]

    @property
    def mean_power_W(self) -> float:
        return float(self.column("shaft_power_W").mean())


def last_half(found: Follow) -> Follow:
    found.truth = found.truth[len(found.truth) // 2 :]
    return found


def test_minimum_film_is_not_monotone_in_clearance(bench: RigData) -> None:
    still = dataclasses.replace(Build.nominal(bench), unbalance_kg_m=0.0)
    clearances = np.array([40, 60, 80, 100, 160]) * 1e-6
    duty = Duty.hold(3000, 100, 0.6)
    figures = [
        last_half(Follow(bench, duty, clearance=c, build=still, thermal=False))
        for c in clearances.tolist()
    ]
    film = [figure.column("min_film_m").min() * 1e6 for figure in figures]
    np.testing.assert_allclose(film, [26.2, 28.1, 28.2, 27.6, 25.2], atol=0.15)
    assert (np.diff([figure.mean_power_W for figure in figures]) < 0).all()


def test_power_of_the_fastest_lightest_point(bench: RigData) -> None:
    result = Follow(bench, Duty.hold(12000, 30, 0.6), clearance=60e-6, thermal=False)
    windage_W = bench.windage_W_s3 * (12000 * np.pi / 30) ** 3
    assert last_half(result).mean_power_W - windage_W == pytest.approx(265, rel=0.02)


@pytest.mark.parametrize(("clearance_um", "whirls"), [(60, False), (70, True)])
def test_half_order_whirl_sets_in_between_60_and_70_um(
    bench: RigData, clearance_um: int, whirls: bool
) -> None:
    result = last_half(
        Follow(bench, Duty.hold(12000, 30, 2.4), clearance=clearance_um * 1e-6, thermal=False)
    )
    x = result.column("eccentricity_x_m") - result.column("eccentricity_x_m").mean()
    order = np.fft.rfftfreq(len(x), 1 / 5000) / 200
    energy = np.abs(np.fft.rfft(x * np.hanning(len(x)))) ** 2
    share = energy[(order > 0.35) & (order < 0.6)].sum() / energy.sum()
    assert bool(share > 0.5) is whirls


def test_more_unbalance_quenches_whirl(bench: RigData) -> None:
    heavy = dataclasses.replace(Build.nominal(bench), unbalance_kg_m=6e-5)
    result = last_half(
        Follow(bench, Duty.hold(12000, 30, 1.5), clearance=70e-6, thermal=False, build=heavy)
    )
    x = result.column("eccentricity_x_m") - result.column("eccentricity_x_m").mean()
    order = np.fft.rfftfreq(len(x), 1 / 5000) / 200
    energy = np.abs(np.fft.rfft(x * np.hanning(len(x)))) ** 2
    assert energy[(order > 0.35) & (order < 0.6)].sum() < 0.05 * energy.sum()


@pytest.mark.parametrize(("rpm", "load_N", "clearance_um"), [(1500, 300, 40), (12000, 30, 60)])
def test_halving_the_step_changes_nothing_that_matters(
    bench: RigData, rpm: int, load_N: int, clearance_um: int
) -> None:
    """Stiffest corner and fastest corner: position and orbit within 0.5 % of the clearance."""
    coarse, fine = (
        last_half(
            Follow(bench, Duty.hold(rpm, load_N, 0.6), clearance=clearance_um * 1e-6, dt_s=dt_s)
        )
        for dt_s in (40e-6, 20e-6)
    )
    for name in ("eccentricity_x_m", "eccentricity_y_m"):
        assert coarse.column(name).mean() == pytest.approx(
            fine.column(name).mean(), abs=0.005 * clearance_um * 1e-6
        )
        assert np.ptp(coarse.column(name)) == pytest.approx(
            np.ptp(fine.column(name)), abs=0.005 * clearance_um * 1e-6
        )
    assert coarse.mean_power_W == pytest.approx(fine.mean_power_W, rel=0.005)


def test_friction_warms_the_oil_only_when_asked(bench: RigData) -> None:
    duty = Duty.hold(12000, 30, 1.0)
    warm = Follow(bench, duty, clearance=60e-6).column("oil_C")
    assert warm[-1] > 40.5
    assert (Follow(bench, duty, clearance=60e-6, thermal=False).column("oil_C") == 40.0).all()


def test_film_carries_the_load(bench: RigData) -> None:
    result = last_half(Follow(bench, Duty.hold(3000, 200, 0.6), clearance=60e-6))
    assert result.column("film_force_y_N").mean() == pytest.approx(200, rel=0.01)
    assert abs(result.column("film_force_x_N").mean()) < 2.0
