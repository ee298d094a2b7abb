"""Scores: what counts as a name, a kept forecast, a violated film, a survived kill."""

from __future__ import annotations

import pytest

from firmware_py.records import Diagnosis, Forecast, NodeState, RigReading, RigStatus
from sim_hil.demo.observer import StoryObserver, StoryTruth
from sim_hil.demo.scores import (
    confirmed_names,
    score_faults,
    score_film,
    score_forecasts,
    score_kill,
)
from sim_hil.demo.story import Beat


def diagnosis(verdict: str, doubt: bool = False) -> Diagnosis:
    return Diagnosis(0, 0, 0, verdict, 0.9, {}, {}, doubt, False, {}, "")


def truth(
    t_s: float, *, power_W: float = 50.0, film_um: float = 30.0, load_N: float = 100.0
) -> StoryTruth:
    return StoryTruth(t_s, 600.0, load_N, 60.0, power_W, film_um, 10.0, 0.01)


def forecast(
    power_W: float, peak_um: float, clearance_um: float = 60.0, quality: int = 0
) -> Forecast:
    exact = (0.0, 0.0, 0.0)
    return Forecast(
        0,
        0,
        quality,
        2.0,
        "held",
        clearance_um,
        (0.0, peak_um, 0.0),
        (0.0, power_W, 0.0),
        exact,
        exact,
        exact,
        exact,
        exact,
        "",
    )


def observed(*verdicts: str, start_s: float = 10.0) -> StoryObserver:
    observer = StoryObserver(0)
    observer.beats = [
        (start_s, Beat(start_s, "inject", fault="unbalance", severity=16.0)),
        (start_s + 20, Beat(start_s + 20, "clear", fault="unbalance")),
    ]
    observer.diagnoses = [
        (start_s + i + 1.0, diagnosis(verdict)) for i, verdict in enumerate(verdicts)
    ]
    return observer


def test_a_name_needs_three_equal_decisions_in_a_row() -> None:
    seen = [
        (float(i), diagnosis(v))
        for i, v in enumerate(["unbalance", "unbalance", "normal", "unbalance"])
    ]
    assert confirmed_names(seen) == []
    seen += [(4.0, diagnosis("unbalance")), (5.0, diagnosis("unbalance"))]
    assert [t for t, _ in confirmed_names(seen)] == [5.0]


def test_doubt_breaks_a_row() -> None:
    doubtful = [diagnosis("unbalance"), diagnosis("unbalance", doubt=True), diagnosis("unbalance")]
    assert confirmed_names([(float(i), each) for i, each in enumerate(doubtful)]) == []


@pytest.mark.parametrize("quiet", ["normal", "none", "doubt", "whirl"])
def test_verdicts_that_name_no_fault(quiet: str) -> None:
    assert confirmed_names([(float(i), diagnosis(quiet)) for i in range(5)]) == []


def test_a_named_fault_with_its_delay() -> None:
    (score,) = score_faults(observed("normal", "unbalance", "unbalance", "unbalance"))
    assert (score.named, score.delay_s, score.correct, score.also_named) == (
        "unbalance",
        4.0,
        True,
        (),
    )


def test_a_wrong_name_is_listed_beside_the_last_one() -> None:
    (score,) = score_faults(observed(*["motor_bolt_loose"] * 3, *["unbalance"] * 3))
    assert (score.named, score.correct, score.also_named) == (
        "unbalance",
        True,
        ("motor_bolt_loose",),
    )


def test_unknown_is_told_beside_a_name_and_replaces_none() -> None:
    (score,) = score_faults(observed(*["unbalance"] * 3, *["unknown"] * 3))
    assert (score.named, score.correct, score.also_named) == ("unbalance", True, ("unknown",))
    (score,) = score_faults(observed(*["unknown"] * 4))
    assert (score.named, score.correct, score.also_named) == ("unknown", False, ())


def test_a_missed_fault() -> None:
    (score,) = score_faults(observed(*["normal"] * 8))
    assert (score.named, score.correct) == (None, False)


def test_names_after_the_fault_was_mended_do_not_count() -> None:
    observer = observed()
    observer.diagnoses = [(40.0 + i, diagnosis("unbalance")) for i in range(3)]
    assert score_faults(observer)[0].named is None


def test_forecast_errors_are_those_one_horizon_later() -> None:
    observer = StoryObserver(0)
    observer.truth = [truth(0.1 * i, power_W=50.0 if i < 30 else 40.0) for i in range(60)]
    observer.forecasts = [(2.05, forecast(power_W=44.0, peak_um=12.0))]
    score = score_forecasts(observer)
    assert (score.scored, score.unannounced_apart) == (1, 0)
    assert score.power_error_pct_p95 == pytest.approx(10.0)
    assert score.peak_to_peak_error_pct_p95 == pytest.approx(20.0)


def test_forecasts_across_a_change_are_set_apart() -> None:
    observer = StoryObserver(0)
    observer.truth = [truth(0.1 * i, load_N=100.0 if i < 30 else 200.0) for i in range(60)]
    observer.forecasts = [
        (1.5, forecast(50.0, 10.0)),
        (3.2, forecast(50.0, 10.0)),
        (0.2, forecast(50.0, 10.0, 80.0)),
    ]
    score = score_forecasts(observer)
    assert (score.scored, score.unannounced_apart) == (1, 2)


def test_forecasts_beyond_the_end_or_of_bad_quality_are_not_scored() -> None:
    observer = StoryObserver(0)
    observer.truth = [truth(0.1 * i) for i in range(30)]
    observer.forecasts = [(2.5, forecast(50.0, 10.0)), (0.2, forecast(50.0, 10.0, quality=1))]
    score = score_forecasts(observer)
    assert (score.scored, score.unannounced_apart, score.power_error_pct_p95) == (0, 0, None)


def test_film_violation_counts_tenths_of_a_second_after_the_run_up() -> None:
    observer = StoryObserver(0)
    standing = StoryTruth(1.7, 10.0, 100.0, 60.0, 0.0, 0.5, 0.1, 0.01)
    observer.truth = [
        truth(0.5, film_um=2.0),
        truth(1.5, film_um=9.9),
        truth(1.6, film_um=10.0),
        standing,
    ]
    score = score_film(observer, 10.0, 1.0, 150.0)
    assert (score.min_um, score.violation_s) == (9.9, 0.1)


def test_kill_follows_the_nodes_own_target_and_the_clearance() -> None:
    observer = StoryObserver(0)
    observer.beats = [(5.0, Beat(5.0, "kill_brain"))]
    for t_s, target, actual in ((4.9, 80.0, 80.0), (5.1, 50.0, 78.0), (5.7, 50.0, 50.4)):
        node = NodeState(0, 0, 1, 1, 0, target, 1.0, True, 0, 0, 0, 0)
        observer.readings.append(
            (t_s, RigReading(0, 0, 0, RigStatus(0, 0, 50.0, 40.0, actual, 1.0), node))
        )
    score = score_kill(observer, 50.0, 6.0)
    assert (score.target_safe_ms, score.arrived_safe_s, score.back_s) == (100.0, 0.7, 6.0)
