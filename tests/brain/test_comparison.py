"""Two sets side by side: agreement, would-be commands within the guard's interval, and forecasts
against what came."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from firmware_py.brain.comparison import HELD_UM, Comparison
from firmware_py.brain.observation import Present
from firmware_py.brain.policy import Policy, Proposal
from firmware_py.brain.prediction import Outlook
from firmware_py.brain.store import Models
from firmware_py.brain.verdict import WINDOWS
from firmware_py.records import Diagnosis

from .machine import CONFIG
from .test_brain_core import guard_state

SECOND_NS = 1_000_000_000
SETTINGS = msgspec.structs.replace(CONFIG.models, disagreement_decisions=10)
NO_PREDICTOR = Policy(Models(), CONFIG)


def said(verdict: str, windows: int = WINDOWS) -> Diagnosis:
    return Diagnosis(
        1, 0, 0, verdict, 1.0, {}, {}, False, False, {"windows": float(windows)}, "model"
    )


def present(t_s: float, power_W: float, swing_um: float, um: float = 60.0) -> Present:
    return Present(
        round(t_s * 1e9), 0, 500.0, (0.0, 0.0), (0.0, 0.0), swing_um * 1e-6, 1.0, um * 1e-6,
        power_W, 50.0, 0xFF,
    )  # fmt: skip


def proposal(um: float | None, power_W: float = 0.0, swing_um: float = 0.0) -> Proposal:
    three = lambda value: np.array([[value - 1.0, value, value + 1.0]])  # noqa: E731
    outlook = Outlook(
        np.array([60e-6]), three(swing_um * 1e-6), three(power_W), three(1e-5), three(0.5),
        np.array([True]), 0.0, three(power_W), np.ones((1, 4)), ("steady",),
    )  # fmt: skip
    return Proposal(None if um is None else um * 1e-6, [], outlook)


def look(comparison: Comparison, second: float, a: Proposal, b: Proposal, now: Present) -> None:
    state = guard_state()  # 40 .. 160 um are admissible
    comparison.proposals(a, b, now, state, NO_PREDICTOR, round(second * SECOND_NS))


def test_words_are_counted_once_both_have_heard_enough() -> None:
    comparison = Comparison(SETTINGS)
    comparison.diagnoses(said("normal", WINDOWS - 1), said("unknown"))
    assert comparison.state.counts == {}
    for verdict in ["normal"] * 4 + ["unbalance"] * 6:
        comparison.diagnoses(said("normal"), said(verdict))
    comparison.diagnoses(said("sensor_fault:disp_x"), said("sensor_fault:disp_y"))
    assert comparison.state.counts == {
        "decisions": 11.0, "agreed": 5.0, "said:normal>unbalance": 6.0
    }  # fmt: skip
    assert comparison.disagreement() == (0.6, "diagnoses")


def test_too_few_decisions_are_no_disagreement() -> None:
    comparison = Comparison(SETTINGS)
    for _ in range(9):
        comparison.diagnoses(said("normal"), said("unknown"))
    assert comparison.disagreement() == (0.0, "")
    comparison.diagnoses(said("normal"), said("unknown"))
    assert comparison.disagreement() == (1.0, "diagnoses")


def test_would_be_commands_are_those_that_the_guard_would_let_pass() -> None:
    comparison, now = Comparison(SETTINGS), present(0.0, 100.0, 5.0)
    for second, (a, b) in enumerate([(30.0, 20.0), (200.0, 150.0), (60.0, 90.0), (60.0, None)]):
        look(comparison, second, proposal(a), proposal(b), now)
        look(comparison, second + 0.5, proposal(a), proposal(b), now)  # once a second
    counts = comparison.state.counts
    assert (counts["advices"], counts["both"], counts["active_only"]) == (4.0, 3.0, 1.0)
    assert counts["apart_um"] == pytest.approx(0.0 + 10.0 + 30.0)
    assert "beside_only" not in counts
    assert comparison.state.clearances == [0, 0, 1, 1]


def test_forecasts_are_held_against_what_came() -> None:
    comparison = Comparison(SETTINGS)
    a, b = proposal(60.0, 100.0, 5.0), proposal(60.0, 120.0, 8.0)
    look(comparison, 0.0, a, b, present(0.0, 90.0, 4.0))
    look(comparison, 1.0, a, b, present(1.0, 90.0, 4.0))
    assert "active_forecasts" not in comparison.state.counts
    look(comparison, 2.0, a, b, present(2.0, 103.0, 6.0))
    counts = comparison.state.counts
    assert (counts["active_forecasts"], counts["beside_forecasts"]) == (1.0, 1.0)
    assert counts["active_power_W"] == pytest.approx(3.0)
    assert counts["beside_power_W"] == pytest.approx(17.0)
    assert counts["active_swing_um"] == pytest.approx(1.0)
    assert counts["beside_swing_um"] == pytest.approx(2.0)


def test_a_forecast_whose_future_did_not_come_is_not_judged() -> None:
    comparison = Comparison(SETTINGS)
    a = proposal(60.0, 100.0, 5.0)
    look(comparison, 0.0, a, a, present(0.0, 90.0, 4.0))
    look(comparison, 2.0, a, a, present(2.0, 90.0, 4.0, um=60.0 + 1.1 * HELD_UM))
    assert "active_forecasts" not in comparison.state.counts
    assert len(comparison.state.due) == 2  # only those of just now
