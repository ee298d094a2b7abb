"""Commissioning in the brain: what is learned from, what is not, and what the learned state
changes."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from firmware_py.brain.commissioning import belonging
from firmware_py.brain.core import BrainCore
from firmware_py.brain.diagnosis import Diagnoser
from firmware_py.brain.normal import NormalError, check_belongs
from firmware_py.config import parse
from firmware_py.records import (
    Alarm,
    Baseline,
    BrainSnapshot,
    BrainStep,
    CommandReply,
    CommandRequest,
    CommissionState,
    Diagnosis,
    GuardState,
    Mode,
    Normal,
    PeerRecord,
    WindowRecord,
)
from tests.first_schema import BENCH as FIRST_SCHEMA

from .machine import CONFIG, Machine, models
from .test_brain_core import feed, guard_state, of

MACHINE = CONFIG.machine


SPEEDS_RPM = (5000.0, 5800.0, 6800.0, 7900.0, 9200.0)


def ask(core: BrainCore, action: str, seq: int = 1) -> list[PeerRecord]:
    """What the brain answers; not what it records of itself."""
    said = core.step([CommandRequest(seq=seq, verb="commission", action=action)], 0)
    return [record for record in said if not isinstance(record, BrainSnapshot | BrainStep)]


def run_over_the_range(
    core: BrainCore, guard: GuardState, speeds: tuple[float, ...] = SPEEDS_RPM
) -> list[PeerRecord]:
    machine, out = Machine(), []
    for speed in speeds:
        machine.speed_rpm = speed
        out += feed(core, [guard, *machine.run(5.0)])
    return out


def brain(**of_classifier: object) -> BrainCore:
    return BrainCore(CONFIG, models(fleet=True, **of_classifier), "")


@pytest.fixture(scope="module")
def learned() -> tuple[Normal, CommissionState]:
    """The state of a machine that ran over its range in mode monitor, and the last word before it
    was learned."""
    core = brain()
    assert of(CommandReply, ask(core, "start")) == [CommandReply(1, True, [])]
    said = run_over_the_range(core, guard_state(mode=Mode.MONITOR))
    reply, state, normal = ask(core, "stop", 2)
    assert reply == CommandReply(2, True, [])
    assert isinstance(state, CommissionState)
    assert state.phase == "commissioned"
    assert isinstance(normal, Normal)
    return normal, of(CommissionState, said)[-1]


def test_a_run_over_the_range_is_learned_and_its_progress_shown(
    learned: tuple[Normal, CommissionState],
) -> None:
    normal, state = learned
    assert state.phase == "gathering"
    assert state.points >= len(SPEEDS_RPM) - 1
    assert 4 <= state.speed_steps <= state.speed_steps_declared
    assert state.ranges["speed_rad_s"] == pytest.approx(
        (5000 * math.pi / 30, 9200 * math.pi / 30), rel=0.01
    )
    assert (normal.decisions, normal.points) == (state.decisions, state.points)
    assert max(normal.variance) < 2.0
    assert normal.quiet == [0.0] * 4


def test_decisions_are_against_the_own_state_and_say_so(
    learned: tuple[Normal, CommissionState],
) -> None:
    core = brain()
    core.step([learned[0]], 0)
    out = feed(core, [guard_state(), *Machine(speed_rpm=6000.0).run(4.0)])
    why = of(Diagnosis, out)[-1].evidence
    assert of(Diagnosis, out)[-1].verdict == "normal"
    assert -1.0 < why["normal_floating"] < 1.0
    assert why["shaft_1x_baseline_um"] == pytest.approx(why["shaft_1x_compensated_um"], rel=0.3)
    assert (
        why["shaft_1x_move_um"]
        < 0.3 * why["shaft_1x_compensated_um"] + why["shaft_1x_baseline_scatter_um"]
    )
    assert len({record.normal for record in of(WindowRecord, out)}) == 1
    assert of(WindowRecord, out)[-1].normal == of(CommissionState, out)[-1].normal != ""


@pytest.mark.parametrize(
    ("guard", "reason"),
    [
        (guard_state(mode=Mode.AUTO), "mode auto"),
        (
            guard_state(mode=Mode.MONITOR, alarms=[Alarm("disp_x_alert", 1, 0, 1.0, 1.0, False)]),
            "alarm disp_x_alert",
        ),
    ],
)
def test_what_must_not_be_learned_from_is_left_out_and_counted(
    guard: GuardState, reason: str
) -> None:
    core = brain()
    ask(core, "start")
    state = of(CommissionState, run_over_the_range(core, guard, SPEEDS_RPM[:1]))[-1]
    assert state.decisions == 0
    assert state.left_out[reason] > 0


def test_too_little_is_refused_by_name_and_goes_on() -> None:
    core = brain()
    ask(core, "start")
    run_over_the_range(core, guard_state(mode=Mode.MANUAL), SPEEDS_RPM[:1])
    reply, state, *rest = ask(core, "stop")
    assert isinstance(reply, CommandReply)
    assert not reply.accepted
    assert "at least 4 are needed" in reply.reasons[0]
    assert isinstance(state, CommissionState)
    assert state.phase == "gathering"
    assert not rest
    assert of(CommissionState, ask(core, "cancel"))[0].phase == "none"
    assert "nothing is being gathered" in of(CommandReply, ask(core, "stop"))[0].reasons[0]


def test_faults_that_the_classifier_names_meanwhile_are_told() -> None:
    core = brain(bias=(-4.0, -4.0, -4.0, 2.0))
    ask(core, "start")
    run_over_the_range(core, guard_state(mode=Mode.MONITOR))
    reply, _, normal = ask(core, "stop")
    assert isinstance(reply, CommandReply)
    assert "decisions were named unbalance" in reply.reasons[0]
    assert isinstance(normal, Normal)
    assert normal.quiet[3] == pytest.approx(3.0, abs=1e-3)


def test_a_state_of_another_classifier_is_refused_by_name_and_the_fleet_judges(
    learned: tuple[Normal, CommissionState],
) -> None:
    core = brain()
    other = msgspec.structs.replace(learned[0].belongs, classifier="f" * 64)
    core.step([msgspec.structs.replace(learned[0], belongs=other)], 0)
    out = feed(core, [guard_state(), *Machine().run(4.0)])
    state = of(CommissionState, out)[-1]
    assert state.phase == "refused"
    assert "classifier 'ffffffffffff', this device has '000000000000'" in state.text
    assert "shaft_1x_baseline_scatter_um" not in of(Diagnosis, out)[-1].evidence
    assert of(CommissionState, ask(core, "forget"))[0].phase == "none"


def test_a_classifier_without_statistics_of_the_fleet_is_refused_by_name(
    learned: tuple[Normal, CommissionState],
) -> None:
    core = BrainCore(CONFIG, models(), "")
    assert "no statistics of healthy machines" in of(CommandReply, ask(core, "start"))[0].reasons[0]
    core.step([learned[0]], 0)
    assert of(CommissionState, ask(core, "cancel"))[0].phase == "refused"


def test_another_configuration_of_the_sensors_is_another_machine() -> None:
    classifier = models(fleet=True).classifier
    assert classifier is not None
    turned = msgspec.structs.replace(CONFIG.machine.channel[0], angle_deg=44.0)
    changed = CONFIG.replaced(channel=[turned, *CONFIG.machine.channel[1:]])
    assert belonging(classifier, CONFIG) == belonging(classifier, CONFIG)
    # that of a state learned from a file of the first schema
    assert belonging(classifier, parse(FIRST_SCHEMA)[0]) == belonging(classifier, CONFIG)
    drawn = msgspec.structs.replace(CONFIG.machine.bearing, assumed=("length_m",))
    assert belonging(classifier, CONFIG.replaced(bearing=drawn)) == belonging(classifier, CONFIG)
    assert (
        belonging(classifier, changed).configuration != belonging(classifier, CONFIG).configuration
    )


@pytest.mark.parametrize(
    ("table", "figure", "value"),
    [
        ("rotor", "mass_kg", 6.5),
        ("rotor", "effective_mass_at_bearing_kg", 1.8),
        ("rotor", "windage_W_s3", 6e-9),
        ("rotor", "shaft_power_error_W", 1.0),
        ("readings", "oil_outlet_error_C", 0.5),
    ],
)
def test_a_state_learned_with_other_figures_of_the_film_check_is_refused(
    table: str, figure: str, value: float
) -> None:
    classifier = models(fleet=True).classifier
    assert classifier is not None
    other = msgspec.structs.replace(getattr(CONFIG.machine, table), **{figure: value})
    learned = belonging(classifier, CONFIG.replaced(**{table: other}))
    normal = Normal(
        learned, 1.0, 24, 6, {}, [3.0, 5.0], [1.2, 1.1], [1.0, 1.1], [0.0] * 4,
        Baseline([6.5, 6e-5, 0.3], [0.5, 2e-5, 0.2], [(1.0, -2.0)] * 5, 0.2),
    )  # fmt: skip
    with pytest.raises(NormalError, match="learned with configuration") as refusal:
        check_belongs(normal, belonging(classifier, CONFIG))
    assert "mass, windage and power error" in str(refusal.value)
    assert "commission again" in str(refusal.value)


@pytest.mark.parametrize(
    ("bias", "motor", "score", "verdict"),
    [
        (-4.0, 2.0, 0.0, "normal"),
        (-4.0, 2.6, 0.0, "unknown"),
        (3.0, 2.6, 0.0, "unbalance"),
        (3.0, 2.6, 2.0, "unknown"),
        (-4.0, 2.0, 2.0, "normal"),
    ],
)
def test_own_state_decides_what_is_unknown(
    learned: tuple[Normal, CommissionState], bias: float, motor: float, score: float, verdict: str
) -> None:
    """A motor that has become louder; a taught fault keeps its name; the fleet's novelty alone says
    nothing."""
    from .machine import model
    from .onnx_models import classifier
    from .test_diagnosis import GOOD, at

    diagnoser = Diagnoser(
        model(classifier((-4.0, -4.0, -4.0, bias), score=score, fleet=True)), MACHINE
    )
    diagnoser.use(learned[0])
    samples = GOOD.samples.copy()
    samples[:, 4] *= motor / 2.0
    told = [diagnoser.step(at(0.25 * i, samples=samples))[0] for i in range(12)][-1]
    assert told.verdict == verdict
    assert np.isfinite(told.evidence["normal_floating"])
