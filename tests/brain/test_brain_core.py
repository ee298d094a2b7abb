"""The brain as a whole on a simulated clock: it names, forecasts, advises at a fixed rate, and says
why not."""

from __future__ import annotations

import dataclasses
from itertools import pairwise

import msgspec
import numpy as np
import pytest

from firmware_py.brain.core import ADVICE_PERIOD_NS, BrainCore
from firmware_py.brain.store import Models
from firmware_py.records import (
    Advice,
    ArmState,
    Block,
    Diagnosis,
    Forecast,
    GuardState,
    Mode,
    PeerRecord,
    RigReading,
    WindowRecord,
    decode,
    encode,
)

from .machine import CONFIG, Machine, film, model, models
from .onnx_models import actor

STEP_NS = 24_000_000


def guard_state(target_um: float = 60.0, **changed: object) -> GuardState:
    state = GuardState(
        seq=0,
        t_ns=0,
        mode=Mode.AUTO,
        arm_state=ArmState.ARMED,
        authority=True,
        authority_reasons=[],
        speed_rad_s=628.0,
        load_estimate_N=100.0,
        clearance_low_um=40.0,
        clearance_high_um=160.0,
        target_clearance_um=target_um,
        target_pressure_bar=1.0,
        clearance_actual_um=60.0,
        peak_to_peak_um=(5.0, 5.0),
        run_permit=True,
        trip_request=False,
        node_following=True,
        alarms=[],
        counters={},
    )
    return msgspec.structs.replace(state, **changed)


def feed(core: BrainCore, records: list[PeerRecord], now_ns: int = 0) -> list[PeerRecord]:
    """Hand over the records as the loop would, four blocks at a time, at their own time."""
    out: list[PeerRecord] = []
    batch: list[PeerRecord] = []
    for record in records:
        batch.append(record)
        if isinstance(record, Block):
            now_ns = record.t_acq_ns + 6_000_000
            if len(batch) >= 4:
                out += core.step(batch, now_ns)
                batch = []
    return out + core.step(batch, now_ns)


def of(kind: type, records: list[PeerRecord]) -> list:
    return [record for record in records if isinstance(record, kind)]


@pytest.fixture(scope="module")
def healthy() -> list[PeerRecord]:
    core = BrainCore(CONFIG, models(), "cpu")
    return feed(core, [guard_state(), *Machine().run(5.0)])


def test_advice_comes_at_a_fixed_rate(healthy: list[PeerRecord]) -> None:
    advices = of(Advice, healthy)
    steps = [b.t_ns - a.t_ns for a, b in pairwise(advices)]
    assert len(advices) == pytest.approx(50, abs=2)
    assert all(abs(step - ADVICE_PERIOD_NS) <= STEP_NS for step in steps)


def test_healthy_machine_is_normal_and_gets_the_actors_clearance(healthy: list[PeerRecord]) -> None:
    last = of(Diagnosis, healthy)[-1]
    assert (last.verdict, last.doubt, last.unknown) == ("normal", False, False)
    assert last.probability > 0.9
    advice = of(Advice, healthy)[-1]
    assert advice.clearance_um == pytest.approx(80.0)
    assert advice.reasons == []
    assert advice.pressure_bar == CONFIG.machine.actuator.safe_pressure_bar
    assert not advice.qualified  # the test models are provisional


def test_before_enough_windows_it_doubts(healthy: list[PeerRecord]) -> None:
    verdicts = [d.verdict for d in of(Diagnosis, healthy)]
    assert verdicts[:9] == ["doubt"] * 9
    assert set(verdicts[9:]) == {"normal"}
    assert of(Advice, healthy)[0].clearance_um is None
    assert of(Advice, healthy)[0].reasons == [
        "no gap-free samples of a turning shaft yet",
        "no diagnosis yet",
    ]


def test_every_window_is_recorded_for_replay(healthy: list[PeerRecord]) -> None:
    diagnoses, windows = of(Diagnosis, healthy), of(WindowRecord, healthy)
    assert [d.seq for d in diagnoses] == [w.diagnosis_seq for w in windows]
    assert [d.t_acq_ns for d in diagnoses] == [w.last_t_acq_ns for w in windows]
    assert {w.cpu_features for w in windows} == {"cpu"}


def test_the_same_records_give_the_same_bytes() -> None:
    records = [guard_state(), *Machine().run(4.0)]
    runs = [[encode(r) for r in feed(BrainCore(CONFIG, models(), ""), records)] for _ in range(2)]
    assert runs[0] == runs[1]
    assert all(decode(data) is not None for data in runs[0])


def test_forecast_brackets_what_then_happens() -> None:
    machine = Machine()
    core = BrainCore(CONFIG, models(80e-6), "")
    forecast: Forecast = of(Forecast, feed(core, [guard_state(), *machine.run(5.0)]))[-1]
    assert forecast.conditional_on == "speed, load and oil held; clearance follows the advice"
    assert forecast.clearance_um == pytest.approx(80.0)
    film_um = (machine.clearance_m - np.hypot(*film().steady(machine.points()).position_m[0])) * 1e6
    assert forecast.now_min_film_um is not None
    assert (
        forecast.now_min_film_um[0] < film_um < forecast.now_min_film_um[2] + 1.5
    )  # the orbit takes its part
    assert forecast.now_friction_W is not None
    assert forecast.now_friction_W[1] == pytest.approx(
        float(film().steady(machine.points()).power_W[0]), rel=0.05
    )
    assert forecast.time_to_limit_s is None  # nothing grows
    machine.clearance_m = 80e-6
    then: Forecast = of(Forecast, feed(core, machine.run(1.0)))[-1]
    for name in ("power_W", "min_film_um", "peak_to_peak_um", "whirl_margin"):
        low, expected, high = getattr(forecast, name)
        assert low < getattr(then, name)[1] < high, name
        assert low < expected < high
    assert forecast.power_W[1] == pytest.approx(then.power_W[1], rel=0.05)
    assert forecast.load_N[0] < machine.load_N < forecast.load_N[2]
    assert forecast.viscosity_Pa_s[0] < machine.viscosity_Pa_s < forecast.viscosity_Pa_s[2]
    assert forecast.unbalance_kg_m[0] < machine.unbalance_kg_m < forecast.unbalance_kg_m[2]


@pytest.mark.parametrize(
    ("state", "clearance_um", "why"),
    [
        (guard_state(), 80.0, "clearance follows the advice"),
        (guard_state(mode=Mode.MONITOR), 60.0, "clearance goes to the guard's target"),
        (guard_state(90.0, authority=False), 90.0, "clearance goes to the guard's target"),
        (guard_state(node_following=False, authority=False), 60.0, "clearance held"),
        (
            guard_state(300.0, authority=False),
            60.0 + 50 * 1.95,
            "clearance goes to the guard's target",
        ),
    ],
)
def test_forecast_says_which_future_it_assumes(
    state: GuardState, clearance_um: float, why: str
) -> None:
    forecast = of(Forecast, feed(BrainCore(CONFIG, models(), ""), [state, *Machine().run(2.0)]))[-1]
    assert forecast.clearance_um == pytest.approx(clearance_um)
    assert forecast.conditional_on.endswith(why)


def test_unbalance_is_named() -> None:
    machine = Machine()
    core = BrainCore(CONFIG, models(unbalance_above=-5.0), "")
    feed(core, machine.run(4.0))
    machine.unbalance_kg_m *= 10
    diagnoses = of(Diagnosis, feed(core, machine.run(8.0)))
    last = diagnoses[-1]
    assert last.verdict == "unbalance"
    assert last.evidence["confirmed"] == 1.0
    assert last.evidence["shaft_forward_1x_um"] > 10
    assert diagnoses[0].evidence["confirmed"] == 0.0
    assert diagnoses[0].verdict == "normal"


def test_a_poor_proposal_is_overruled_by_the_predictor() -> None:
    core = BrainCore(CONFIG, models(160e-6), "")
    machine = Machine(speed_rpm=12000, load_N=30, oil_C=60, clearance_m=45e-6)
    advice = of(Advice, feed(core, [guard_state(), *machine.run(4.0)]))[-1]
    assert advice.clearance_um is not None
    assert advice.clearance_um < 100
    assert advice.reasons == []
    assert advice.forecast is not None
    assert "; actor's 160 um overruled: " in advice.forecast.conditional_on
    assert "damping ratio" in advice.forecast.conditional_on
    assert core.counters["proposals_overruled"] > 0


def last_reasons(core: BrainCore, records: list[PeerRecord]) -> list[str]:
    advice = of(Advice, feed(core, records))[-1]
    assert advice.clearance_um is None
    return advice.reasons


def test_whirl_is_its_own_verdict_and_withholds_the_advice() -> None:
    core = BrainCore(CONFIG, models(), "")
    records = [guard_state(), *Machine(half_m=10e-6).run(4.0)]
    reasons = last_reasons(core, records)
    assert len(reasons) == 1
    assert reasons[0].startswith("whirl: ")
    assert of(Diagnosis, feed(BrainCore(CONFIG, models(), ""), records))[-1].verdict == "whirl"


def test_a_bad_channel_is_a_sensor_fault_and_never_a_machine_fault() -> None:
    machine = Machine()
    core = BrainCore(CONFIG, models(unbalance_above=-9.0), "")
    records = [
        msgspec.structs.replace(r, channel_ok=0xFE) if isinstance(r, Block) else r
        for r in machine.run(4.0)
    ]
    out = feed(core, [guard_state(), *records])
    assert {d.verdict for d in of(Diagnosis, out)} == {"sensor_fault:disp_x"}
    assert of(Advice, out)[-1].reasons == ["channel not OK: disp_x"]


def test_unknown_withholds_the_advice_after_a_while() -> None:
    core = BrainCore(CONFIG, models(score=2.0), "")
    machine = Machine()
    out = feed(core, machine.run(3.0))
    assert of(Diagnosis, out)[-1].unknown
    assert of(Advice, out)[-1].clearance_um is not None
    assert last_reasons(core, machine.run(2.0))[0].startswith("diagnosis unknown for ")


def test_ambiguous_heads_are_doubt() -> None:
    out = feed(BrainCore(CONFIG, models(bias=(0.2, -4, -4, -4)), ""), Machine().run(5.0))
    last = of(Diagnosis, out)[-1]
    assert (last.verdict, last.doubt) == ("doubt", True)
    assert last.classes["pedestal_bolt_loose"] == pytest.approx(0.55, abs=0.02)


def test_silence_makes_the_advice_stale_but_not_silent() -> None:
    core = BrainCore(CONFIG, models(), "")
    machine = Machine()
    feed(core, machine.run(4.0))
    advice = of(Advice, core.step([], machine.now_ns + 2_000_000_000))
    assert len(advice) == 1
    assert advice[0].clearance_um is None
    assert [reason.split(" ")[0] for reason in advice[0].reasons] == ["samples", "rig", "the"]


def test_absent_models_are_reasons() -> None:
    refused = {kind: f"{kind}.onnx: gone" for kind in ("classifier", "actor", "surrogate")}
    core = BrainCore(CONFIG, Models(refusals=refused), "")
    reasons = last_reasons(core, Machine().run(2.0))
    assert [f"no {kind}: {kind}.onnx: gone" for kind in refused] == reasons[:3]


def test_without_classifier_there_is_a_forecast_but_no_diagnosis_and_no_advice() -> None:
    whole = models()
    core = BrainCore(
        CONFIG, dataclasses.replace(whole, classifier=None, refusals={"classifier": "gone"}), ""
    )
    out = feed(core, Machine().run(3.0))
    assert of(Diagnosis, out)[-1].verdict == "none"
    assert of(Advice, out)[-1].reasons == [
        "no classifier: gone",
        "no diagnosis from the newest window",
    ]
    assert of(Forecast, out)


def test_an_actor_that_answers_nan_is_a_counted_reason() -> None:
    whole = models()
    core = BrainCore(CONFIG, dataclasses.replace(whole, actor=model(actor(float("nan")))), "")
    reasons = last_reasons(core, Machine().run(3.0))
    assert "not finite" in reasons[0]
    assert core.counters["forecasts_refused"] > 0


def test_outside_the_actors_domain_there_is_no_advice() -> None:
    narrow = model(actor(80e-6, domain='{"speed_rad_s": [100.0, 300.0]}'))
    core = BrainCore(CONFIG, dataclasses.replace(models(), actor=narrow), "")
    assert "speed_rad_s 628.3 outside the actor's domain 100 .. 300" in last_reasons(
        core, Machine().run(3.0)
    )


def test_a_pile_of_windows_drops_the_oldest_counted() -> None:
    core = BrainCore(CONFIG, models(), "")
    machine = Machine()
    out = core.step(machine.run(5.0), machine.now_ns)
    diagnoses = of(Diagnosis, out)
    assert len(diagnoses) == 2
    assert core.counters["windows_dropped"] == core.counters["windows"] - 2
    assert machine.now_ns - diagnoses[-1].t_acq_ns < 250_000_000


def test_a_reading_that_stopped_is_named() -> None:
    core = BrainCore(CONFIG, models(), "")
    machine = Machine()
    feed(core, machine.run(4.0))
    reasons = last_reasons(core, [r for r in machine.run(0.6) if not isinstance(r, RigReading)])
    assert reasons[0].startswith("rig status is ")
