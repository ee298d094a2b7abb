"""What each missing sensor costs the diagnosis of a machine, and which classes its sensors cannot
tell apart.

The form that the device runs (a small network a head, on features of its own) is trained again on
the training builds without the features that a sensor takes part in, and judged on the unseen ones.
Which features those are is not told but tried: a sensor's signal is disturbed, and what moves
depends on it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.features import features
from firmware_py.acquire.windows import Window
from firmware_py.brain.verdict import class_probabilities
from firmware_py.machine import Machine
from firmware_py.records import CHANNELS
from models.diagnosis import scores
from models.diagnosis.dataset import Dataset
from models.diagnosis.ladder import OWN_FEATURES, HeadNetwork, fit_heads
from models.diagnosis.scores import Decisions, confused, decide

Floats = NDArray[np.float64]
Columns = NDArray[np.bool_]

READINGS: Final = ("clearance_m", "shaft_power_W", "oil_outlet_C")
L2: Final = 1e-4

SENSORS: Final[Mapping[str, tuple[str, ...]]] = {
    "both displacement probes": ("disp_x", "disp_y"),
    **{name: (name,) for name in CHANNELS if not name.startswith("disp_")},
    "clearance reading": ("clearance_m",),
    "shaft power reading": ("shaft_power_W",),
    "oil outlet reading": ("oil_outlet_C",),
}
"""What may be missing, by name: channels and readings that go together."""


def columns_of(sensor: str, windows: Sequence[Window], machine: Machine) -> Columns:
    """Features (F,) that move when ``sensor`` shows something else."""
    rng, moved = np.random.default_rng(0), np.zeros(len(OWN_FEATURES), bool)
    for window in windows:
        moved |= features(window, machine) != features(_disturbed(window, sensor, rng), machine)
    return moved


def _disturbed(window: Window, sensor: str, rng: np.random.Generator) -> Window:
    samples, changed = window.samples.copy(), {}
    for part in SENSORS[sensor]:
        if part in READINGS:
            changed[part] = 1.01 * getattr(window, part)
        else:
            column = samples[:, CHANNELS.index(part)]
            column += (0.1 * column.std() + 1e-3 * np.abs(column).max()) * (
                1.0 + rng.standard_normal(len(column))
            )
    return replace(window, samples=samples, **changed)


def costs(
    outer: Dataset,
    inner: Dataset,
    judged: Dataset,
    lost: Mapping[str, Columns],
    sizes: tuple[int, int],
    seed: int,
    progress: Callable[[int], None],
) -> dict[str, object]:
    """Figures with every sensor, and without each.

    Parameters
    ----------
    outer, inner, judged
        Decisions that train, that stop the training, and that judge.
    lost
        By sensor the features that go with it.
    sizes
        Neurons a head, and iterations.
    """

    def figures(without: Columns | None) -> dict[str, object]:
        columns = OWN_FEATURES if without is None else OWN_FEATURES & ~without[:, None]
        network = _fitted(columns, outer, inner, sizes, seed)
        return told_apart(decide(class_probabilities(network.logits(judged.features)), judged))

    progress(0)
    whole, without = figures(None), {}
    for done, (sensor, columns) in enumerate(lost.items(), 1):
        without[sensor] = {**figures(columns), "features_lost": int(columns.sum())}
        progress(done)
    return {"all_sensors": whole, "without": without}


def _fitted(
    columns: Columns, outer: Dataset, inner: Dataset, sizes: tuple[int, int], seed: int
) -> HeadNetwork:
    hidden, iterations = sizes
    rng = np.random.default_rng(seed)
    return fit_heads("", columns, hidden, outer, inner, L2, iterations, rng).calibrated(inner)


def told_apart(decisions: Decisions) -> dict[str, object]:
    """Balanced accuracy at the severities that must be found, and of which pairs of classes it
    falls below :data:`~models.diagnosis.scores.APART`."""
    needed = scores.required(decisions)
    if not len(needed.kind):
        return {"balanced_accuracy": None, "cannot_be_told_apart": []}
    return {
        "balanced_accuracy": round(scores.six_classes(needed), 4),
        "cannot_be_told_apart": confused(needed),
    }
