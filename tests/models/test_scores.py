"""Scores on cases whose answer is known."""

from dataclasses import replace

import numpy as np
import pytest

from firmware_py.brain.verdict import class_probabilities
from models.diagnosis import scores
from models.diagnosis.dataset import HEADS_OF_CLASS, SLIGHT_WEIGHT, Dataset
from models.diagnosis.scores import Decisions


def decisions(kind, named, severity=25.0, confidence=0.9):
    probability = np.full((len(kind), 6), (1 - confidence) / 5)
    probability[np.arange(len(kind)), named] = confidence
    regime = np.zeros((len(kind), 3), int)
    return Decisions(
        probability, np.array(kind), np.full(len(kind), severity), np.arange(len(kind)), regime
    )


def test_sure_heads_give_their_class():
    logits = 20.0 * (2.0 * HEADS_OF_CLASS - 1.0)
    np.testing.assert_allclose(class_probabilities(logits), np.eye(6), atol=1e-8)


def test_class_probabilities_are_those_of_independent_heads_over_the_six_patterns():
    logits = np.array([[0.3, -1.0, 0.2, -2.0]])
    p = 1 / (1 + np.exp(-logits[0]))
    joint = np.array([np.prod(np.where(row > 0, p, 1 - p)) for row in HEADS_OF_CLASS])
    np.testing.assert_allclose(class_probabilities(logits)[0], joint / joint.sum(), rtol=1e-12)


def test_balanced_accuracy_weighs_classes_not_rows():
    assert scores.balanced_accuracy(np.array([0, 0, 0, 1]), np.array([0, 0, 0, 0])) == 0.5


def test_calibration_error_of_the_overconfident():
    ten = decisions([0] * 10, [0] * 6 + [1] * 4)
    assert scores.calibration_error(ten) == pytest.approx(0.3)


def test_required_severities():
    ten = decisions([1, 4, 4, 0], [1, 4, 4, 0])
    ten = replace(ten, severity=np.array([50.0, 6.3, 16.0, 100.0]))
    assert list(scores.required(ten).kind) == [4, 0]


def test_temperature_finds_the_overconfidence():
    rng = np.random.default_rng(0)
    true = rng.normal(0.0, 1.5, (4000, 4))
    heads = (rng.random((4000, 4)) < 1 / (1 + np.exp(-true))).astype(float)
    assert scores.temperatures(np.array([3.0, 1.0, 0.5, 3.0]) * true, heads) == pytest.approx(
        [3, 1, 0.5, 3], rel=0.1
    )


def test_beats_needs_more_than_luck():
    rng = np.random.default_rng(1)
    kind = np.repeat([0, 1, 2, 3], 50)
    simple = np.where(rng.random(200) < 0.7, kind, 5)
    simpler, better = (
        decisions(kind, simple),
        decisions(kind, np.where(rng.random(200) < 0.5, kind, simple)),
    )
    assert scores.beats(better, simpler)
    assert not scores.beats(simpler, simpler)
    one_more = simple.copy()
    one_more[np.argmax(simple == 5)] = kind[np.argmax(simple == 5)]
    assert not scores.beats(decisions(kind, one_more), simpler)


def test_beats_weighs_classes_not_rows():
    kind = np.repeat([0, 1], [180, 20])
    simpler = decisions(kind, np.where(kind == 0, 0, 5))
    better = decisions(kind, np.where(np.arange(200) < 10, 5, kind))
    assert scores.beats(better, simpler)


def test_worst_group_is_the_regime_with_the_lowest_score():
    kind = np.tile([0, 1], 30)
    some = decisions(kind, np.where(np.arange(60) < 20, 0, kind))
    loops = np.repeat([0, 1, 2], 20)
    name, rows = scores.worst_group(
        replace(some, regime=np.column_stack([loops, np.zeros((60, 2), int)]))
    )
    assert name == "fixed"
    assert list(np.flatnonzero(rows)) == list(range(20))


def test_slight_faults_weigh_less_in_training():
    severity = np.array([100.0, 50.0, 25.0, 16.0])
    data = Dataset(np.zeros((4, 1)), np.array([0, 1, 1, 4]), severity, *np.zeros((5, 4), int))
    assert list(data.weight) == [1.0, SLIGHT_WEIGHT, 1.0, 1.0]
    logits = np.array([[1.0, -1.0, 0.5, 2.0]] * 4)
    whole = scores.nll(logits, data.heads, data.weight[:, None])
    each = [scores.nll(logits[i : i + 1], data.heads[i : i + 1]) for i in range(4)]
    assert whole == pytest.approx(np.mean(np.array(each) * data.weight))


def test_alarm_limits_reach_the_rate_they_were_asked_for():
    """Log-odds with exponential tails, but one that is bounded: far beyond what the rows could
    show."""
    rng = np.random.default_rng(3)
    odds = rng.exponential([1.0, 1.0, 0.5, 1.0, 2.0], (4000, 5))
    odds[:, 3] = rng.uniform(0.0, 6.0, 4000)

    def limits(rate: float, shift: float = 0.0) -> np.ndarray:
        probability = np.exp(np.column_stack([np.zeros(4000), odds + shift]))
        return np.log(
            scores.alarm_limits(probability / probability.sum(axis=1, keepdims=True), rate)
        )

    at = limits(5e-4)  # 1e-4 a fault
    assert at[:3] == pytest.approx(np.array([1.0, 1.0, 0.5]) * np.log(1e4), abs=1.5)
    assert at[3] == pytest.approx(6.0, abs=0.3), "no healthy machine lies beyond the bound"
    assert (limits(5e-6) > at).all()
    assert np.exp(limits(5e-4, -20.0)) == pytest.approx(scores.LEAST_ODDS)


def test_log_score_punishes_a_sure_mistake_more_than_a_doubtful_one():
    kind = [0, 1]
    sure, doubtful = (
        decisions(kind, [0, 0], confidence=0.99),
        decisions(kind, [0, 0], confidence=0.5),
    )
    assert (
        scores.log_score(sure)
        < scores.log_score(doubtful)
        < scores.log_score(decisions(kind, kind))
        < 0.0
    )
