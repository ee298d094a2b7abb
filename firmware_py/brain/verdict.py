"""The verdict: which word a diagnosis says, as a pure function of what was found, many rows at
once.

The device asks with one row (:class:`firmware_py.brain.diagnosis.Diagnoser`), training and
evaluation with as many as they have: there is no second form of these rules.  The first that
applies decides: ``sensor_fault`` (a bad channel is never called a machine fault), ``none`` (no
whole turns to judge from), ``whirl``, ``no_channel`` (the machine has not what the model was taught
with), ``none`` (no answer of the model), ``unknown``, ``doubt``, and then one of the six classes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.brain.store import HEADS

WINDOWS: Final = 10
"""Windows whose features are averaged, as the authors voted over ten: noise falls before anything
is decided."""
DOUBT_BELOW: Final = 0.7
"""Probability of the best class under which the word is ``doubt``."""
CONFIRM_NS: Final = 3_000_000_000
"""A verdict held this long is confirmed."""
WHIRL_SHARE: Final = 0.3
WHIRL_CLEARANCE_SHARE: Final = 0.05
"""Whirl: the half-order band holds this share of the orbit's energy, with this amplitude per
clearance."""
OWN_LIMIT: Final = 1.0
"""Distance from the machine's own normal state beyond which it is not normal: it is scaled to 1."""

CLASSES: Final[dict[str, tuple[int, ...]]] = {
    "normal": (),
    "pedestal_bolt_loose": (0,),
    "pedestal_two_bolts_loose": (0, 1),
    "motor_bolt_loose": (2,),
    "unbalance": (3,),
    "pedestal_and_motor_bolt_loose": (0, 2),
}
"""Heads that each of the six classes switches on."""
HEADS_OF_CLASS: Final = np.array(
    [[float(head in on) for head in range(len(HEADS))] for on in CLASSES.values()]
)
"""The same as a matrix, shape (classes, heads)."""

WORDS: Final = (*CLASSES, "unknown", "doubt", "whirl", "none", "no_channel", "sensor_fault")
"""All verdicts; the device adds the channel's name to the last two."""
UNKNOWN, DOUBT, WHIRL, NONE, NO_CHANNEL, SENSOR_FAULT = range(len(CLASSES), len(WORDS))
NOT_LEARNED: Final = (WHIRL, NONE, NO_CHANNEL, SENSOR_FAULT)
"""Verdicts in which nothing is learned of what is normal for the machine."""

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Words = NDArray[np.intp]
"""Indices into :data:`WORDS`."""


@dataclass(frozen=True, slots=True)
class VerdictLimits:
    """Limits that come with the model.

    Attributes
    ----------
    novelty
        Novelty above which a machine is like nothing that was taught.
    named_above
        Shape (5,): odds of each fault against normal from which it is named.
    """

    novelty: float
    named_above: Floats

    @classmethod
    def of(cls, settings: Mapping[str, Any]) -> VerdictLimits:
        """From the settings in a model's metadata; what is not there is no limit."""
        novelty, odds = settings.get("novelty_threshold"), settings.get("named_above")
        odds = odds if isinstance(odds, dict) else {}
        return cls(
            float(novelty) if isinstance(novelty, int | float) else math.inf,
            np.array([float(odds.get(name, 0.0)) for name in list(CLASSES)[1:]]),
        )


@dataclass(frozen=True, slots=True)
class Found:
    """What ``n`` verdicts rest on.

    Attributes
    ----------
    log_odds
        Shape (n, 4): of the heads, beyond what this machine shows when healthy.
    novelty
        Shape (n,): by the model.
    own
        Shape (n,): largest distance from the machine's own normal state, 1 at its limit; NaN for a
        machine that was not commissioned.
    whirl
        Shape (n,): the newest window shows whirl (:func:`is_whirl`).
    windows
        Shape (n,): how many the answer is the mean of.
    bad, turning, answered
        Shape (n,): a channel is not OK; there are whole turns; the model has answered on the newest
        window.
    absent
        The machine has not all channels of the model.
    """

    log_odds: Floats
    novelty: Floats
    own: Floats
    whirl: Flags
    windows: Words
    bad: Flags
    turning: Flags
    answered: Flags
    absent: bool = False

    def subset(self, rows: Flags | Words) -> Found:
        """The verdicts at ``rows``."""
        names = [f.name for f in fields(self) if f.name != "absent"]
        columns: dict[str, Any] = {name: getattr(self, name)[rows] for name in names}
        return replace(self, **columns)


def verdicts(found: Found, limits: VerdictLimits) -> Words:
    """The word on each row, shape (n,)."""
    probability = class_probabilities(found.log_odds)
    best, surest = probability.argmax(axis=1), probability.max(axis=1)
    strange = found.novelty > limits.novelty
    taught = (best > 0) & (surest >= DOUBT_BELOW) & ~strange
    unknown = np.where(np.isnan(found.own), strange, (found.own > OWN_LIMIT) & ~taught)
    named_above = np.r_[0.0, limits.named_above][best] * probability[:, 0]
    sure = (surest >= np.maximum(DOUBT_BELOW, named_above)) & (found.windows >= WINDOWS)
    absent = np.full(len(best), found.absent)
    return np.asarray(
        np.select(
            [found.bad, ~found.turning, found.whirl, absent, ~found.answered, unknown, ~sure],
            [SENSOR_FAULT, NONE, WHIRL, NO_CHANNEL, NONE, UNKNOWN, DOUBT],
            best,
        ),
        np.intp,
    )


def log_odds(probability: Floats) -> Floats:
    """Log-odds of probabilities, within those of float32."""
    p = np.clip(probability, 1e-6, 1.0 - 1e-6)
    odds: Floats = np.log(p) - np.log1p(-p)
    return odds


def class_probabilities(head_log_odds: Floats) -> Floats:
    """Six class probabilities ``(n, 6)`` from the heads' log-odds ``(n, 4)``.

    The heads are taken as independent, and of their 16 patterns only the six classes are allowed.
    """
    log_p, log_not = -np.logaddexp(0.0, -head_log_odds), -np.logaddexp(0.0, head_log_odds)
    joint = log_p @ HEADS_OF_CLASS.T + log_not @ (1.0 - HEADS_OF_CLASS).T
    joint = np.exp(joint - joint.max(axis=1, keepdims=True))
    probability: Floats = joint / joint.sum(axis=1, keepdims=True)
    return probability


def is_whirl(subsync_share: Floats, half_forward_m: Floats, clearance_m: Floats) -> Flags:
    """Whether a forward half-order orbit of notable size stands beside the first order, shape (n,).

    Parameters
    ----------
    subsync_share
        Shape (n,): share of the orbit's energy in the half-order band.
    half_forward_m, clearance_m
        Shape (n,): its forward amplitude, and the reported clearance (NaN: unknown, no whirl).
    """
    large = half_forward_m > WHIRL_CLEARANCE_SHARE * clearance_m
    return np.asarray((subsync_share > WHIRL_SHARE) & large)


def held_since_ns(words: NDArray[Any], end_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Since when each of successive verdicts has stood, shape (n,).

    Parameters
    ----------
    words
        Shape (n,): of one machine, oldest first.
    end_ns
        Shape (n,): end of the newest window of each; of the first, since when it has stood.
    """
    begun = np.r_[True, words[1:] != words[:-1]]
    return np.asarray(end_ns[np.maximum.accumulate(np.where(begun, np.arange(len(words)), 0))])


def confirmed(words: NDArray[Any], end_ns: NDArray[np.int64]) -> Flags:
    """Which of successive verdicts have stood for :data:`CONFIRM_NS`, shape (n,)."""
    return np.asarray(end_ns - held_since_ns(words, end_ns) >= CONFIRM_NS)
