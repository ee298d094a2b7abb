"""An episode heard by the brain's own stages: what the predictor and its rivals said, beside what
then was true."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.channel_map import ChannelMap
from firmware_py.acquire.orders import analyse
from firmware_py.acquire.windows import Windower
from firmware_py.brain.measurement import Measured
from firmware_py.brain.observation import Observer, window_measured
from firmware_py.brain.prediction import Future, Predictor
from firmware_py.brain.store import Model
from firmware_py.config import Config
from firmware_py.records import Block, Quality
from models.prediction.episodes import (
    FORECASTS_S,
    HORIZON_S,
    ForecastEpisode,
    TrueState,
    heard,
    truth_at,
)
from models.prediction.rivals import forecasts
from sim_hil.plant.runs import SimulatedRecording
from sim_hil.rigs import RigData

Floats = NDArray[np.float64]

ADVICE_S: Final = 0.2
LIMIT_S: Final = 3.5


@dataclass(frozen=True)
class Said:
    """``n`` forecasts; columns of the quantities: power, peak-to-peak, smallest film, damping ratio
    (SI).

    ``expected``, ``deviation``, ``true`` (n, 4); ``rivals`` (n, 3, 4); ``now`` (n, 3, 3) virtual
    sensors at the time of the forecast, rows smallest film, bearing force, friction power, columns
    expected, deviation, true; ``static_film`` (n, 3) likewise, at the mean position; ``limit_s``
    (n, 3) time to a limit that a growing fault passes after :data:`LIMIT_S`: earliest, expected,
    latest (NaN: none); ``episode``, ``regime``, ``recognised`` (n,).
    """

    expected: Floats
    deviation: Floats
    true: Floats
    rivals: Floats
    now: Floats
    static_film: Floats
    limit_s: Floats
    episode: NDArray[np.int64]
    regime: NDArray[np.str_]
    recognised: NDArray[np.str_]


def join(parts: list[Said]) -> Said:
    """All forecasts in one."""
    return Said(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Said)))


def listen(
    rig: RigData,
    episode: ForecastEpisode,
    recording: SimulatedRecording,
    model: Model,
    config: Config,
) -> Said:
    """Feed ``recording`` to the brain's stages and note the forecasts of the episode."""
    channels = ChannelMap.from_config(config)
    observer, windower, predictor = (
        Observer(channels),
        Windower(channels, recording.rate_hz),
        Predictor(model, config),
    )
    due = list(FORECASTS_S)
    next_s, rows = 0.0, []
    for record in heard(recording):
        observer.take(record)
        if not isinstance(record, Block):
            windower.note(record)
            continue
        for window in windower.step(record):
            if window.quality & Quality.NO_MARK:
                continue
            seen = window_measured(window, analyse(window))
            if seen is not None:
                predictor.learn(*seen)
        now_s = 1e-6 * (record.tick_us + len(record.samples) // 16 * record.sample_period_us)
        present = observer.present() if now_s >= next_s else None
        if present is None:
            continue
        next_s = now_s + ADVICE_S - 1e-6
        measured = present.measured()
        predictor.estimate(measured)
        if due and now_s >= due[0]:
            rows.append(_row(rig, episode, recording, predictor, measured, now_s))
            due.pop(0)
    return join(rows)


def _row(
    rig: RigData,
    episode: ForecastEpisode,
    recording: SimulatedRecording,
    predictor: Predictor,
    measured: Measured,
    now_s: float,
) -> Said:
    """One forecast: the declared future is the episode's own, the clearance where it is told to
    go."""
    then_s = now_s + HORIZON_S
    (speed, load), (speed_then, load_then) = episode.duty.point(now_s), episode.duty.point(then_s)
    moves = speed_then != speed or load_then != load
    future = Future(HORIZON_S, speed_then if moves else None, load_then - load)
    target_m = episode.clearance(now_s + 1e-3)
    estimate = predictor.estimate(measured)
    outlook = predictor.forecast(measured, estimate, np.array([target_m]), future)
    here = predictor.forecast(measured, estimate, np.array([measured.clearance_m]), Future(0.0))
    true, now = (
        truth_at(rig, episode, recording, then_s),
        truth_at(rig, episode, recording, now_s - 0.1),
    )
    film_m, predicted_m = predictor.static_film()
    virtual = [
        [here.min_film_m[0, 1], here.deviation[0, 2], now.min_film_m],
        [estimate.load_N, estimate.load_N * estimate.log_covariance[0, 0] ** 0.5, now.load_N],
        [here.friction_W[0, 1], here.deviation[0, 0], now.friction_W],
    ]
    expected = [
        q[0, 1]
        for q in (outlook.power_W, outlook.peak_to_peak_m, outlook.min_film_m, outlook.whirl_margin)
    ]
    return Said(
        np.array([expected]),
        outlook.deviation[:1],
        np.array([_figures(true)]),
        forecasts(rig, measured, target_m, future)[None],
        np.array([virtual]),
        np.array([[film_m, predicted_m, now.static_film_m]]),
        np.array([_to_limit(rig, episode, recording, predictor, measured, now_s)]),
        np.array([episode.number]),
        np.array([episode.regime]),
        np.array([outlook.regime[0]]),
    )


def _to_limit(
    rig: RigData,
    episode: ForecastEpisode,
    recording: SimulatedRecording,
    predictor: Predictor,
    measured: Measured,
    now_s: float,
) -> tuple[float, float, float]:
    """Time to the peak-to-peak (growing unbalance) or film (starvation) that is true
    :data:`LIMIT_S` later."""
    if episode.fault not in ("unbalance", "starvation") or now_s > FORECASTS_S[1]:
        return np.nan, np.nan, np.nan
    then = truth_at(rig, episode, recording, now_s + LIMIT_S)
    film_m, swing_m = (
        (0.0, then.peak_to_peak_m) if episode.fault == "unbalance" else (then.min_film_m, np.inf)
    )
    return predictor.time_to_limit(measured, predictor.estimate(measured), film_m, swing_m)


def _figures(true: TrueState) -> list[float]:
    return [true.power_W, true.peak_to_peak_m, true.min_film_m, true.whirl_margin]
