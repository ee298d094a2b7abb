"""The diagnosis: from the heads of single windows to one word that a person can act on (ISO 13374 HA).

In this order: ``sensor_fault:CHANNEL`` (a bad channel is never called a machine fault), ``none`` (nothing to
judge from), ``whirl`` (from clearance or light load, told to the policy), ``unknown`` (unlike everything that
was taught), ``doubt`` (more windows, please), then one of the six classes.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.features import from_orders
from firmware_py.acquire.orders import Orders, analyse
from firmware_py.acquire.windows import Window
from firmware_py.brain.errors import ModelAnswerError
from firmware_py.brain.store import HEADS, Model
from firmware_py.records import CHANNELS, Diagnosis, Quality

WINDOWS: Final = 10
"""Windows that speak together, as in the authors' practice of a vote over ten."""
DOUBT_BELOW: Final = 0.7
"""Probability of the best class under which the word is ``doubt``."""
CONFIRM_NS: Final = 3_000_000_000
"""A verdict held this long is confirmed."""
WHIRL_SHARE: Final = 0.3
WHIRL_CLEARANCE_SHARE: Final = 0.05
"""Whirl: the half-order band holds this share of the orbit's energy, with this amplitude per clearance."""

_HISTORY_NS: Final = 6_000_000_000
_LOG_ODDS_MAX: Final = 6.0

CLASSES: Final[dict[str, tuple[int, ...]]] = {
    "normal": (),
    "pedestal_bolt_loose": (0,),
    "pedestal_two_bolts_loose": (0, 1),
    "motor_bolt_loose": (2,),
    "unbalance": (3,),
    "pedestal_and_motor_bolt_loose": (0, 2),
}
"""Heads that each of the six classes switches on."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class _Vote:
    """What one window said."""

    end_ns: int
    log_odds: Floats
    score: float


class Diagnoser:
    """Turns windows into diagnoses.

    Parameters
    ----------
    model
        ``classifier.onnx``; without it the verdict is ``none`` (or whirl, or a sensor fault).
    """

    def __init__(self, model: Model | None) -> None:
        self._model = model
        self._threshold = _threshold(model)
        self._votes: deque[_Vote] = deque(maxlen=WINDOWS)
        self._held = ("none", 0)
        self._seq = 0
        self.counters = {"diagnoses": 0, "model_answers_refused": 0}

    def step(self, window: Window) -> tuple[Diagnosis, Orders | None]:
        """Diagnosis after ``window``, and the window's order analysis (None without usable turns)."""
        orders = None if window.quality & Quality.NO_MARK else analyse(window)
        bad = [name for index, name in enumerate(CHANNELS) if not window.channel_ok >> index & 1]
        if orders is not None and not bad:
            self._vote(window, orders)
        while self._votes and window.end_ns - self._votes[0].end_ns > _HISTORY_NS:
            self._votes.popleft()
        heads = self._heads()
        classes = class_probabilities(heads) if self._votes else {}
        score = float(np.median([vote.score for vote in self._votes])) if self._votes else 0.0
        verdict = self._verdict(window, orders, bad, classes, score)
        self._seq += 1
        self.counters["diagnoses"] += 1
        record = Diagnosis(
            seq=self._seq, t_acq_ns=window.end_ns, quality=int(window.quality), verdict=verdict,
            probability=classes.get(verdict, max(classes.values(), default=0.0)),
            heads=dict(zip(HEADS, heads.tolist(), strict=True)) if self._votes else {}, classes=classes,
            doubt=verdict == "doubt", unknown=verdict == "unknown",
            evidence=self._evidence(window, orders, score, verdict),
            model=self._model.label if self._model else "")
        return record, orders

    def _vote(self, window: Window, orders: Orders) -> None:
        """Ask the model about one window; an answer that is not finite, or rests on NaN, has no vote."""
        vector = from_orders(window, orders)
        if self._model is None or not np.isfinite(vector).all():
            return
        try:
            answer = self._model.session.run(vector[None, :])
        except ModelAnswerError:
            self.counters["model_answers_refused"] += 1
            return
        heads = np.clip(answer["heads"][0], 1e-6, 1 - 1e-6)
        log_odds = np.clip(np.log(heads / (1 - heads)), -_LOG_ODDS_MAX, _LOG_ODDS_MAX)
        self._votes.append(_Vote(window.end_ns, log_odds, float(answer["score"][0, 0])))

    def _heads(self) -> Floats:
        """Probabilities of the four heads from the mean log-odds, shape (4,)."""
        if not self._votes:
            return np.zeros(len(HEADS))
        mean = np.mean([vote.log_odds for vote in self._votes], axis=0)
        return np.asarray(1.0 / (1.0 + np.exp(-mean)))

    def _verdict(self, window: Window, orders: Orders | None, bad: list[str], classes: dict[str, float],
                 score: float) -> str:
        if bad:
            return f"sensor_fault:{'+'.join(bad)}"
        if orders is None:
            return "none"
        if is_whirl(orders, window.clearance_m):
            return "whirl"
        if not self._votes or window.end_ns != self._votes[-1].end_ns:
            return "none"
        if score > self._threshold:
            return "unknown"
        best = max(classes, key=lambda name: classes[name])
        return "doubt" if len(self._votes) < WINDOWS or classes[best] < DOUBT_BELOW else best

    def _evidence(self, window: Window, orders: Orders | None, score: float, verdict: str) -> dict[str, float]:
        """Why: the amplitudes behind the verdict, and for how long it has stood."""
        if verdict != self._held[0]:
            self._held = (verdict, window.end_ns)
        held_ns = window.end_ns - self._held[1]
        evidence = {"windows": float(len(self._votes)), "held_s": held_ns * 1e-9,
                    "confirmed": float(held_ns >= CONFIRM_NS)}
        if self._votes:
            evidence |= {"novelty": score, "novelty_threshold": self._threshold}
        return evidence | (amplitudes(orders) if orders is not None else {})


def class_probabilities(heads: Floats) -> dict[str, float]:
    """Probabilities of the six classes from four independent heads, normalised over the six."""
    joint = {name: math.prod(p if i in on else 1 - p for i, p in enumerate(heads.tolist()))
             for name, on in CLASSES.items()}
    total = sum(joint.values())
    return {name: value / total for name, value in joint.items()}


def is_whirl(orders: Orders, clearance_m: float) -> bool:
    """Whether a forward half-order orbit of notable size stands beside the first order."""
    return orders.subsync_share > WHIRL_SHARE and orders.half_forward > WHIRL_CLEARANCE_SHARE * clearance_m


def amplitudes(orders: Orders) -> dict[str, float]:
    """Orders and levels in the units of a report (um, m/s2)."""
    shaft = {f"shaft_{way}_{k}x_um": float(value) * 1e6
             for way, values in (("forward", orders.forward), ("backward", orders.backward))
             for k, value in enumerate(values[:2], 1)}
    acceleration = {f"{CHANNELS[c]}_{what}_m_s2": float(value) for c in (2, 3, 4) for what, value in (
        ("rms", orders.rms[c]), ("1x", abs(orders.harmonics[c, 0])), ("2x", abs(orders.harmonics[c, 1])))}
    return shaft | acceleration | {
        "speed_rpm": orders.speed_rad_s * 30 / math.pi,
        "shaft_half_um": orders.half_forward * 1e6,
        "shaft_not_1x_um": float(np.hypot(orders.not_1x[0], orders.not_1x[1])) * 1e6,
        "subsync_share": orders.subsync_share,
        "centre_x_um": float(orders.mean[0]) * 1e6,
        "centre_y_um": float(orders.mean[1]) * 1e6,
    }


def _threshold(model: Model | None) -> float:
    """Novelty score above which a window is unlike the training data."""
    value = model.card.settings.get("novelty_threshold") if model else None
    return float(value) if isinstance(value, int | float) else math.inf
