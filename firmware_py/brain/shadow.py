"""A classifier of a user's own recordings, running in shadow: it says what it would say, and
nothing follows from it.

It sees the fast channels that it was trained with, by name, in windows that do not overlap, and
features of :mod:`firmware_py.acquire.channel_features`: the same functions as its training.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import msgspec
import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.channel_features import (
    MARKS_LEAST,
    ORDERS_VIEW,
    VIEWS,
    angle_at,
    no_orders,
    window_samples,
)
from firmware_py.brain.errors import ModelAnswerError
from firmware_py.brain.journal import end_tick_us
from firmware_py.brain.own_card import OwnOptions
from firmware_py.brain.store import Model
from firmware_py.brain.verdict import DOUBT_BELOW, WINDOWS
from firmware_py.config import Config
from firmware_py.records import Block, Quality, ShadowDiagnosis

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class OwnVerdict:
    """One word from some windows; ``classes`` are mean probabilities, ``score`` is the median."""

    verdict: str
    probability: float = 0.0
    classes: dict[str, float] = field(default_factory=dict)
    score: float = 0.0


def decide(labels: Sequence[str], probabilities: Floats, scores: Floats) -> OwnVerdict:
    """The word for windows of one machine: ``unknown``, ``doubt`` or a label.

    Parameters
    ----------
    probabilities
        Of each window and label, ``(n, K)``.
    scores
        Distance of each window from all that was taught, ``(n,)``; 1 is the limit.
    """
    mean = probabilities.mean(axis=0)
    score, best = float(np.median(scores)), int(mean.argmax())
    word = labels[best] if mean[best] >= DOUBT_BELOW else "doubt"
    return OwnVerdict(
        "unknown" if score > 1.0 else word,
        float(mean[best]),
        dict(zip(labels, mean.tolist(), strict=True)),
        score,
    )


class OwnAnswer(msgspec.Struct, frozen=True, array_like=True):
    """The model's answer on one window."""

    probabilities: list[float]
    score: float


class ShadowState(msgspec.Struct):
    """``start_tick_us``: node tick at which the present window began; ``end_tick_us``: after its
    newest sample, -1 before the first; ``answers`` of the last windows without a gap."""

    start_tick_us: int = 0
    end_tick_us: int = -1
    answers: list[OwnAnswer] = []
    seq: int = 0
    answers_refused: int = 0
    windows_left_out: int = 0


class Shadow:
    """Gathers windows out of blocks, and says what the model would say.

    Parameters
    ----------
    model
        Which the store has found to fit ``config``.
    """

    def __init__(self, model: Model, config: Config) -> None:
        names = [channel.name for channel in config.machine.channel]
        rows = [config.machine.channel[names.index(name)] for name in model.card.channels]
        self.model = model
        self._options = OwnOptions.of(model.card.settings)
        self._columns = [names.index(row.name) for row in rows]
        self._scale = np.array([row.scale for row in rows])
        self._offset = np.array([row.offset for row in rows])
        self._rate_hz = float(config.sampling.rate_hz)
        self._n = window_samples(self._rate_hz, self._options.window_s)
        self._blocks: list[Block] = []
        self.state = ShadowState()

    @property
    def counters(self) -> dict[str, int]:
        """Words said, answers refused and windows without features."""
        state = self.state
        return {
            "shadow_diagnoses": state.seq,
            "shadow_answers_refused": state.answers_refused,
            "shadow_windows_left_out": state.windows_left_out,
        }

    def restore(self, state: ShadowState, blocks: Sequence[Block]) -> None:
        """Go on from ``state``; ``blocks`` hold the samples of its present window."""
        self.state = state
        self._blocks = [block for block in blocks if end_tick_us(block) > state.start_tick_us]

    def step(self, block: Block, active: str) -> list[ShadowDiagnosis]:
        """What is said once ``block`` is there; ``active`` is the word of the active classifier."""
        state = self.state
        if block.tick_us != state.end_tick_us or block.quality & Quality.GAP_BEFORE:
            self._blocks, state.answers, state.start_tick_us = [], [], block.tick_us
        self._blocks.append(block)
        state.end_tick_us = end_tick_us(block)
        span_us = self._n * block.sample_period_us
        said = []
        while state.end_tick_us - state.start_tick_us >= span_us:
            said.append(self._say(block, active))
            state.start_tick_us += span_us
            self._blocks = [b for b in self._blocks if end_tick_us(b) > state.start_tick_us]
        return said

    def _say(self, block: Block, active: str) -> ShadowDiagnosis:
        state, quality = self.state, 0
        for each in self._blocks:
            quality |= int(each.quality & ~Quality.GAP_BEFORE)
        decision = self._decision()
        state.seq += 1
        return ShadowDiagnosis(
            seq=state.seq,
            t_acq_ns=block.t_acq_ns + block.instants * block.period_ns,
            quality=quality,
            verdict=decision.verdict,
            probability=decision.probability,
            classes=decision.classes,
            score=decision.score,
            windows=len(state.answers),
            active=active,
            model=self.model.label,
        )

    def _decision(self) -> OwnVerdict:
        state = self.state
        bad = [
            name
            for name, column in zip(self.model.card.channels, self._columns, strict=True)
            if not all(block.channel_ok >> column & 1 for block in self._blocks)
        ]
        if bad:
            state.answers = []
            return OwnVerdict(f"sensor_fault:{'+'.join(bad)}")
        row = self._features()
        answer = None if row is None else self._ask(row)
        if answer is None:
            state.windows_left_out += 1
            return OwnVerdict("none")
        state.answers = [*state.answers, answer][-WINDOWS:]
        return decide(
            self._options.labels,
            np.array([each.probabilities for each in state.answers]),
            np.array([each.score for each in state.answers]),
        )

    def _features(self) -> Floats | None:
        """Features of the present window; None where it has no orders and the model needs them."""
        counts = np.concatenate(
            [np.frombuffer(b.samples, "<i2").reshape(-1, b.channels) for b in self._blocks]
        )
        period_us = self._blocks[0].sample_period_us
        first = (self.state.start_tick_us - self._blocks[0].tick_us) // period_us
        window = counts[first : first + self._n, self._columns] * self._scale + self._offset
        turns = None
        if self._options.view == ORDERS_VIEW:
            turns = self._turns(period_us)
            if no_orders(self._rate_hz, turns):
                return None
        row = VIEWS[self._options.view](np.ascontiguousarray(window.T), self._rate_hz, turns)
        return row if np.isfinite(row).all() else None

    def _turns(self, period_us: int) -> Floats | None:
        """Shaft angle of the window's instants by the marks in its blocks; None: too few."""
        ticks = np.array([t for b in self._blocks for t in b.mark_ticks_us], np.float64)
        if len(ticks) < MARKS_LEAST:
            return None
        places = (ticks - self.state.start_tick_us) / period_us
        return angle_at(places, np.arange(self._n, dtype=np.float64))

    def _ask(self, row: Floats) -> OwnAnswer | None:
        try:
            said = self.model.session.run(row[None, :])
        except ModelAnswerError:
            self.state.answers_refused += 1
            return None
        return OwnAnswer(said["classes"][0].tolist(), float(said["score"][0, 0]))
