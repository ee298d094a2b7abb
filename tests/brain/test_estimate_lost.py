"""Readings that no bearing can show end no process: the estimate is lost by name, and begins
anew."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from firmware_py.brain.errors import EstimateLostError
from firmware_py.brain.estimate import Synchroniser
from firmware_py.brain.measurement import Measured
from firmware_py.brain.policy import NO_FORECAST
from firmware_py.brain.prediction import Predictor

from .machine import CONFIG, film, model
from .onnx_models import short_film
from .test_prediction import CASES, measure

FILM = film()
STEP_NS = 100_000_000


def impossible(rng: np.random.Generator, t_ns: int) -> Measured:
    """Readings within their ranges that have nothing to do with each other."""
    reach = 160e-6
    return Measured(
        float(rng.uniform(150.0, 1300.0)),
        float(rng.uniform(20e-6, 170e-6)),
        *rng.uniform(-reach, reach, 2).tolist(),
        float(rng.uniform(0.0, 2.0 * reach)),
        float(rng.uniform(-50.0, 2000.0)),
        float(rng.uniform(-20.0, 150.0)),
        float(rng.uniform(-0.1, 2.2)),
        t_ns=t_ns,
    )


def test_whatever_is_read_there_is_an_estimate_or_a_reason() -> None:
    lost = estimated = 0
    for seed in range(40):
        rng, synchroniser = np.random.default_rng(seed), Synchroniser(FILM, CONFIG)
        for k in range(12):
            try:
                found = synchroniser.step(impossible(rng, (k + 1) * STEP_NS))
            except NO_FORECAST:
                lost += 1
                continue
            estimated += 1
            assert np.isfinite(found.mean).all()
            assert found.clearance_m > 0.0
            assert np.isfinite(found.load_interval_N).all()
    assert lost > 0
    assert estimated > 100


def lost_after(synchroniser: Synchroniser) -> int:
    """After how many impossible readings the estimate is lost."""
    rng = np.random.default_rng(1)
    for k in range(1000):
        try:
            synchroniser.step(impossible(rng, (k + 1) * STEP_NS))
        except EstimateLostError:
            return k + 1
    raise AssertionError("never lost")


def test_an_estimate_that_was_lost_begins_anew_and_finds_the_machine() -> None:
    good, synchroniser = measure(*CASES[0]), Synchroniser(FILM, CONFIG)
    fresh = Synchroniser(FILM, CONFIG)
    after = lost_after(synchroniser)
    for k in range(after, after + 3):
        at = dataclasses.replace(good, t_ns=(k + 1) * STEP_NS)
        found, wanted = synchroniser.step(at), fresh.step(at)
    assert found.load_N == pytest.approx(wanted.load_N, rel=0.02)
    assert found.viscosity_Pa_s == pytest.approx(wanted.viscosity_Pa_s, rel=0.02)


def test_a_window_after_the_clearance_has_jumped_is_refused_by_name() -> None:
    predictor, good = Predictor(model(short_film()), CONFIG), measure(*CASES[0])
    predictor.estimate(dataclasses.replace(good, t_ns=STEP_NS))
    predictor.state.synchroniser.mean = predictor.state.synchroniser.mean.copy()
    predictor.state.synchroniser.mean[2] = -1e6 * good.clearance_m
    with pytest.raises(EstimateLostError):
        predictor.learn(dataclasses.replace(good, t_ns=9 * STEP_NS), 1e-6 + 0j)
