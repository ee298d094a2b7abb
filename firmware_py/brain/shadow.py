"""A classifier of a user's own recordings, running in shadow: it says what it would say, and
nothing follows from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firmware_py.brain.verdict import DOUBT_BELOW

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Decision:
    """One word from some windows; ``classes`` are mean probabilities, ``score`` is the median."""

    verdict: str
    probability: float
    classes: dict[str, float]
    score: float


def decide(labels: Sequence[str], probabilities: Floats, scores: Floats) -> Decision:
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
    return Decision(
        "unknown" if score > 1.0 else word,
        float(mean[best]),
        dict(zip(labels, mean.tolist(), strict=True)),
        score,
    )
