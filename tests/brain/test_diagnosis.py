"""From heads to words: the six classes, pooling over windows, what has no vote, how long a verdict
stands."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from firmware_py.acquire.channel_map import ChannelMap
from firmware_py.acquire.features import GROUPS
from firmware_py.acquire.windows import Window, Windower
from firmware_py.brain.diagnosis import Diagnoser, drivers
from firmware_py.brain.store import HEADS
from firmware_py.brain.verdict import CLASSES, WINDOWS, class_probabilities, is_whirl, log_odds
from firmware_py.records import Block, Quality

from .machine import CONFIG, RATE, Machine, model
from .onnx_models import classifier

MACHINE = CONFIG.machine


SECOND = 1_000_000_000


def window(machine: Machine | None = None) -> Window:
    windower = Windower(ChannelMap.wire(), RATE)
    found: list[Window] = []
    for record in (machine or Machine()).run(1.0):
        if isinstance(record, Block):
            found += windower.step(record)
        else:
            windower.note(record)  # type: ignore[arg-type]
    return found[-1]


GOOD = window()


def at(second: float, of: Window = GOOD, **changed: object) -> Window:
    return replace(of, end_ns=round(second * SECOND), **changed)  # type: ignore[arg-type]


def words(diagnoser: Diagnoser, windows: list[Window]) -> list[str]:
    return [diagnoser.step(w)[0].verdict for w in windows]


@pytest.mark.parametrize("name", CLASSES)
def test_clear_heads_name_their_class(name: str) -> None:
    heads = np.array([0.97 if i in CLASSES[name] else 0.03 for i in range(4)])
    classes = dict(zip(CLASSES, class_probabilities(log_odds(heads[None]))[0], strict=True))
    assert max(classes, key=lambda k: classes[k]) == name
    assert classes[name] > 0.9
    assert sum(classes.values()) == pytest.approx(1.0)
    bias = tuple(float(np.log(p / (1 - p))) for p in heads)
    diagnoser = Diagnoser(model(classifier(bias)), MACHINE)
    assert words(diagnoser, [at(0.25 * i) for i in range(12)])[-1] == name


@pytest.mark.parametrize(
    ("named_above", "word"),
    [
        ({"unbalance": 50.0}, "unbalance"),
        ({"unbalance": 60.0}, "doubt"),
        ({"motor_bolt_loose": 60.0}, "unbalance"),
    ],
)
def test_a_fault_is_named_only_from_its_own_odds_against_normal(
    named_above: dict[str, float], word: str
) -> None:
    likely = classifier((-9.0, -9.0, -9.0, 4.0), named_above=named_above)  # odds of unbalance: 54.6
    assert words(Diagnoser(model(likely), MACHINE), [at(0.25 * i) for i in range(12)])[-1] == word


def test_heads_are_named_as_in_the_class_definitions() -> None:
    assert HEADS == ("pedestal bolt A", "pedestal bolt B", "motor bolt", "unbalance")
    diagnosis, _ = Diagnoser(model(classifier((3.0, -3.0, -3.0, -3.0))), MACHINE).step(GOOD)
    assert diagnosis.heads["pedestal bolt A"] == pytest.approx(1 / (1 + np.exp(-3)), abs=1e-6)
    assert list(diagnosis.heads) == list(HEADS)
    assert json.loads(json.dumps(diagnosis.evidence)) == diagnosis.evidence


def test_one_wild_window_does_not_turn_the_verdict() -> None:
    """Features are averaged: nine quiet windows against a loud one."""
    loud = window(Machine(unbalance_kg_m=1e-4))
    diagnoser = Diagnoser(
        model(classifier((-3.0, -3.0, -3.0, -3.0), unbalance_above=-5.4)), MACHINE
    )
    assert set(words(diagnoser, [at(0.25 * i) for i in range(WINDOWS + 1)])[WINDOWS:]) == {"normal"}
    assert words(diagnoser, [at(3.0, loud)]) == ["normal"]
    assert words(diagnoser, [at(3.25 + 0.25 * i, loud) for i in range(WINDOWS)])[-1] == "unbalance"


def test_old_windows_lose_their_vote() -> None:
    diagnoser = Diagnoser(model(classifier()), MACHINE)
    assert words(diagnoser, [at(0.25 * i) for i in range(WINDOWS)])[-1] == "normal"
    assert words(diagnoser, [at(60.0)]) == ["doubt"]


@pytest.mark.parametrize(
    "changed",
    [
        {"quality": int(Quality.NO_MARK)},
        {"clearance_m": float("nan")},
        {"shaft_power_W": float("nan")},
    ],
)
def test_windows_without_marks_or_readings_have_no_vote(changed: dict[str, object]) -> None:
    diagnoser = Diagnoser(model(classifier()), MACHINE)
    words(diagnoser, [at(0.25 * i) for i in range(WINDOWS)])
    diagnosis, _ = diagnoser.step(at(3.0, **changed))
    assert diagnosis.verdict == "none"
    assert diagnosis.evidence["windows"] == WINDOWS


def test_answers_that_are_not_finite_are_counted_and_have_no_vote() -> None:
    diagnoser = Diagnoser(model(classifier(score=float("nan"))), MACHINE)
    assert words(diagnoser, [at(1.0)]) == ["none"]
    assert diagnoser.counters["model_answers_refused"] == 1


def test_every_bad_channel_is_named() -> None:
    diagnoser = Diagnoser(model(classifier()), MACHINE)
    assert words(diagnoser, [at(1.0, channel_ok=0b1101_1110)]) == ["sensor_fault:disp_x+microphone"]


def test_a_verdict_is_confirmed_when_it_has_stood() -> None:
    diagnoser = Diagnoser(model(classifier()), MACHINE)
    told = [diagnoser.step(at(0.25 * i))[0] for i in range(30)]
    normal = [d for d in told if d.verdict == "normal"]
    assert [d.evidence["held_s"] for d in normal] == pytest.approx(
        [0.25 * i for i in range(len(normal))]
    )
    assert [bool(d.evidence["confirmed"]) for d in normal] == [
        0.25 * i >= 3.0 for i in range(len(normal))
    ]
    assert all(b.seq == a.seq + 1 for a, b in pairwise(told))


@pytest.mark.parametrize(
    ("half_m", "whirls"), [(0.0, False), (2.5e-6, False), (4e-6, True), (20e-6, True)]
)
def test_whirl_needs_share_and_size(half_m: float, whirls: bool) -> None:
    diagnosis, orders = Diagnoser(None, MACHINE).step(window(Machine(half_m=half_m)))
    assert orders is not None
    seen = orders.subsync_share, orders.half_forward, 60e-6
    assert is_whirl(*(np.array([value]) for value in seen)) == [whirls]
    assert (diagnosis.verdict == "whirl") is whirls


def test_evidence_carries_the_amplitudes_that_were_there() -> None:
    machine = Machine(half_m=4e-6)
    diagnosis, _ = Diagnoser(None, MACHINE).step(window(machine))
    assert diagnosis.evidence["shaft_half_um"] == pytest.approx(4.0, rel=0.03)
    assert diagnosis.evidence["speed_rpm"] == pytest.approx(6000, rel=1e-3)
    assert diagnosis.evidence["acc_motor_1x_m_s2"] == pytest.approx(2.0, rel=0.02)


def test_first_order_is_told_without_the_runout_and_against_the_last_normal() -> None:
    orders = Diagnoser(None, MACHINE).step(GOOD)[1]
    assert orders is not None
    forward_m = complex(0.5 * (orders.harmonics[0, 0] + 1j * orders.harmonics[1, 0]))
    diagnoser = Diagnoser(model(classifier((-5.0,) * 4)), MACHINE, slow_roll_m=0.25 * forward_m)
    told = [diagnoser.step(at(0.25 * i))[0] for i in range(30)]
    assert told[-1].evidence["shaft_1x_compensated_um"] == pytest.approx(
        0.75e6 * abs(forward_m), rel=1e-6
    )
    assert told[-1].evidence["shaft_1x_move_um"] == pytest.approx(0.0, abs=1e-9)
    assert "shaft_1x_move_um" not in told[0].evidence
    loud = window(Machine(unbalance_kg_m=1e-4))
    assert diagnoser.step(at(8.0, loud))[0].evidence["shaft_1x_move_um"] > 1.0


def test_drivers_name_the_groups_that_speak_for_the_verdict() -> None:
    log_odds = np.zeros((len(GROUPS), 4))
    log_odds[GROUPS.index("contact_orders"), 3] = 4.0
    log_odds[GROUPS.index("acc_motor_ringing")] = [-1.0, 0.0, -0.5, 0.0]
    log_odds[GROUPS.index("operation"), 0] = 2.0
    assert drivers(log_odds, "unbalance") == {
        "driver_contact_orders": 4.0,
        "driver_acc_motor_ringing": 1.5,
    }
    assert drivers(log_odds, "doubt") == {}


def test_a_faster_recording_gives_the_same_words() -> None:
    diagnoser = Diagnoser(model(classifier()), MACHINE)
    slow = [diagnoser.step(at(0.25 * i))[0] for i in range(WINDOWS)][-1]
    doubled = replace(
        GOOD,
        samples=np.repeat(GOOD.samples, 2, axis=0),
        marks=2 * GOOD.marks + 0.5,
        rate_hz=2 * GOOD.rate_hz,
    )
    diagnoser = Diagnoser(model(classifier()), MACHINE)
    fast = [diagnoser.step(at(0.25 * i, doubled))[0] for i in range(WINDOWS)][-1]
    assert fast.verdict == slow.verdict
    for name in ("shaft_forward_1x_um", "acc_motor_1x_m_s2", "speed_rpm"):
        assert fast.evidence[name] == pytest.approx(slow.evidence[name], rel=0.02), name
