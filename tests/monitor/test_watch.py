"""Orbits of every bearing, and the machine's own normal state: fit, then detect."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from firmware_py import config
from firmware_py.brain import watch_normal
from firmware_py.brain.core import BrainCore
from firmware_py.brain.normal import NormalError
from firmware_py.brain.store import Models
from firmware_py.brain.watch import OrbitWatch
from firmware_py.records import (
    Advice,
    Belonging,
    CommandReply,
    CommissionState,
    Diagnosis,
    Forecast,
    Normal,
)
from tests.machine.test_parts import least as least  # the folder of the least machine
from tests.monitor.generator import Run

KIT = config.load(config.SHIPPED / "kit")[0]
SLOWER = KIT.replaced(sampling=msgspec.structs.replace(KIT.sampling, rate_hz=2000))
BELONGS = Belonging("monitor only", "f", "kit", "c")


def run_of(loaded: config.Config) -> Run:
    return Run(loaded, BrainCore(loaded, Models()))


def diagnoses(run: Run) -> list[Diagnosis]:
    return [record for record in run.said if isinstance(record, Diagnosis)]


def rows(n: int, speeds: np.ndarray, seed: int = 3) -> np.ndarray:
    """Figures of an orbit that speed explains, with a scatter of 0.05."""
    random = np.random.default_rng(seed)
    logs = np.log(speeds / 300.0)[:, None]
    return np.asarray(1.0 + logs * np.array([1.0, -0.5]) + 0.05 * random.standard_normal((n, 2)))


@pytest.mark.parametrize("steps", [[300.0], [200.0, 300.0, 450.0, 600.0, 800.0]])
def test_a_fit_holds_for_its_own_speeds_and_finds_what_moved(steps: list[float]) -> None:
    speeds = np.repeat(np.array(steps), 60 // len(steps))
    normal = watch_normal.fit(
        rows(60, speeds), speeds, ["a", "b"], ["orbit"], [2], np.full(2, 1e-3), BELONGS, 2.5
    )
    assert normal.own is not None
    assert normal.points == len(steps)
    for row in rows(200, np.full(200, 300.0), 4):
        away = watch_normal.residuals(normal.own, row, 300.0)
        assert watch_normal.by_part(normal.own, away)["orbit"] < 1.0
    moved = watch_normal.residuals(normal.own, rows(1, np.array([300.0]))[0] + 0.6, 300.0)
    assert watch_normal.by_part(normal.own, moved)["orbit"] > 1.0
    assert watch_normal.within(normal, 310.0)
    assert not watch_normal.within(normal, 1.3 * max(steps))


def test_too_little_and_what_is_not_finite_is_refused() -> None:
    speeds = np.full(10, 300.0)
    ask = (["a", "b"], ["orbit"], [2], np.full(2, 1e-3), BELONGS, 1.0)
    with pytest.raises(NormalError, match="10 decisions, at least 20 are needed"):
        watch_normal.fit(rows(10, speeds), speeds, *ask)
    bad = rows(30, np.full(30, 300.0))
    bad[4, 1] = np.nan
    with pytest.raises(NormalError, match="b: decision 4 is not finite"):
        watch_normal.fit(bad, np.full(30, 300.0), *ask)


@pytest.fixture(scope="module")
def commissioned() -> Run:
    """The kit, sampled at 2 kHz, commissioned over a minute at one speed."""
    run = run_of(SLOWER)
    run.seconds(4.0, 10)
    run.device.command("commission", action="start")
    run.seconds(56.0, 10)
    run.device.command("commission", action="stop")
    run.seconds(1.5, 10)
    return run


def test_before_commissioning_the_orbits_are_told_and_nothing_is_judged() -> None:
    run = run_of(KIT)
    run.seconds(2.0, 10)
    last = diagnoses(run)[-1]
    assert last.verdict == "uncommissioned"
    for name in ("de", "nde"):
        assert last.evidence[f"{name}_1x_um"] == pytest.approx(8.0, rel=0.03)
        assert last.evidence[f"{name}_2x_um"] == pytest.approx(1.0, rel=0.1)
    advice = [record for record in run.said if isinstance(record, Advice)][-1]
    assert advice.clearance_um is None
    assert advice.reasons[0] == "monitor only: no [actuator]: nothing can be commanded"
    assert not any(isinstance(record, Forecast) for record in run.said)


@pytest.mark.slow
def test_a_fault_that_appears_at_the_second_bearing_is_unknown_and_named(commissioned: Run) -> None:
    run = commissioned
    assert [r.reasons for r in run.said if isinstance(r, CommandReply)] == [[], []]
    assert [record for record in run.said if isinstance(record, Normal)]
    assert diagnoses(run)[-1].verdict == "normal"
    stands = [record for record in run.said if isinstance(record, CommissionState)][-1]
    assert (stands.phase, stands.points) == ("commissioned", 1)
    run.node.orbits["nde"].second_um = 4.0  # a coupling out of line
    run.seconds(4.0, 10)
    last = diagnoses(run)[-1]
    assert last.verdict == "unknown"
    assert last.unknown
    assert last.evidence["normal_nde"] > 1.0 > last.evidence["normal_de"]
    assert "departure_nde_2x_log" in last.evidence
    run.node.orbits["nde"].second_um = 1.0
    run.seconds(4.0, 10)
    assert diagnoses(run)[-1].verdict == "normal"


@pytest.mark.slow
def test_what_was_learned_is_adopted_by_the_next_brain_and_refused_by_another_machine(
    commissioned: Run, least: Path
) -> None:
    (learned,) = [record for record in commissioned.said if isinstance(record, Normal)]
    run = run_of(SLOWER)
    run.device.adopt(learned)
    run.seconds(5.0, 10)
    assert diagnoses(run)[-1].verdict == "normal"
    while run.node.speed_rpm < 4500.0:
        run.node.speed_rpm += 40.0
        run.seconds(0.02, 10)
    run.seconds(5.0, 10)
    assert diagnoses(run)[-1].verdict == "outside"
    other = run_of(config.load(least)[0])
    other.device.adopt(learned)
    other.seconds(2.0, 10)
    stands = [record for record in other.said if isinstance(record, CommissionState)][-1]
    assert stands.phase == "refused"
    assert "commission again" in stands.text


def test_whirl_and_a_broken_cable_are_words_of_their_own() -> None:
    run = run_of(KIT)
    run.node.orbits["nde"].half_um = 20.0
    run.seconds(2.0, 10)
    assert diagnoses(run)[-1].verdict == "whirl"
    assert diagnoses(run)[-1].evidence["nde_half_um"] == pytest.approx(20.0, rel=0.1)
    run.node.orbits["nde"].half_um = 0.0
    run.node.dead.add("nde_x")
    run.seconds(2.0, 10)
    assert diagnoses(run)[-1].verdict == "sensor_fault:nde_x"


def test_the_slow_roll_vector_is_taken_off_at_each_bearing() -> None:
    rolled = [
        msgspec.structs.replace(c, slow_roll_um=8.0, slow_roll_deg=-c.angle_deg)
        if c.bearing == "nde" else c
        for c in KIT.machine.channel
    ]  # fmt: skip
    run = run_of(KIT.replaced(channel=rolled))
    run.seconds(2.0, 10)
    evidence = diagnoses(run)[-1].evidence
    assert evidence["nde_1x_compensated_um"] < 0.3
    assert evidence["de_1x_compensated_um"] == pytest.approx(8.0, rel=0.03)


def test_the_brain_goes_on_from_its_snapshot() -> None:
    core = BrainCore(KIT, Models())
    run = Run(KIT, core)
    run.seconds(3.0, 10)
    parts = core.snapshot(0, run.now_ns)
    other = BrainCore(KIT, Models())
    other.restore(parts, core.recent)
    again = other.snapshot(0, run.now_ns)
    assert [part.state for part in again] == [part.state for part in parts]


def test_the_least_machine_is_watched_at_2_kHz(least: Path) -> None:
    loaded = config.load(least)[0]
    assert OrbitWatch(loaded).parts == ["shaft"]
    run = run_of(loaded)
    run.seconds(3.0, 5)
    last = diagnoses(run)[-1]
    assert last.verdict == "uncommissioned"
    assert last.evidence["shaft_1x_um"] == pytest.approx(8.0, rel=0.03)
