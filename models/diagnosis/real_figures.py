"""What the classifier's method reaches on real recordings: stands beside every simulated figure.

Measured once on the public recordings of other people's machines with ``orbitd evaluate classifier
--data DIR`` (:mod:`models.diagnosis.measured`); these do not come with this repository.
"""

from __future__ import annotations

from typing import Final

REAL_RECORDINGS: Final[dict[str, object]] = {
    "build_never_heard": {"balanced_accuracy_of_four_classes": 0.28, "chance": 0.25},
    "speed_never_heard_balanced_accuracy": {"fan": 0.82, "microphone": 0.98, "vibration": 0.66},
    "the_same_by_random_forest": {"fan": 0.79, "microphone": 0.71, "vibration": 0.53},
}
"""Of reports, beside the figures of simulated builds."""

REAL_SENTENCE: Final = (
    "On a real build never heard the same method reaches a balanced accuracy of 0.28 over four "
    "classes (chance is 0.25); on a speed never heard 0.82 (fan), 0.98 (microphone), 0.66 "
    "(vibration)."
)
"""Of texts."""
