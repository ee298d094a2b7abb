"""How far a window lies from all that was taught: Mahalanobis distance to the nearest class.

Classes share one covariance (Lee, Lee, Lee and Shin 2018), shrunk (Ledoit and Wolf 2004).  The
limit, at which the score is 1, is what all but a few windows of groups keep that the fit has not
seen.  With the one class ``normal`` this is fit normal, then detect.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

QUANTILE: Final = 0.99
"""Share of windows of unseen groups within the limit."""


@dataclass(frozen=True)
class TaughtDistance:
    """``score = min_k |(x - centre_k) @ whitening| / limit``.

    ``centres`` ``(K, F)``, ``whitening`` ``(F, F)``.
    """

    centres: Floats
    whitening: Floats
    limit: float = 1.0

    @classmethod
    def fit(cls, x: Floats, label: Indices) -> TaughtDistance:
        """Centres of the labels that occur, covariance about them; the limit is still to be set."""
        from sklearn.covariance import ledoit_wolf

        kinds = np.unique(label)
        centres = np.array([x[label == kind].mean(axis=0) for kind in kinds])
        about = x - centres[np.searchsorted(kinds, label)]
        unit = about.std(axis=0) + 1e-9
        covariance, _ = ledoit_wolf(about / unit, assume_centered=True)
        values, vectors = np.linalg.eigh(covariance)
        white = vectors / np.sqrt(np.maximum(values, 1e-9 * values[-1]))
        return cls(centres, white / unit[:, None])

    def __call__(self, x: Floats) -> Floats:
        """Scores ``(n,)``; above 1 a window is unlike all that was taught."""
        white = x @ self.whitening
        away = white[:, None, :] - self.centres @ self.whitening
        return np.asarray(np.sqrt((away * away).mean(axis=2)).min(axis=1) / self.limit)


def fit_score(x: Floats, label: Indices, group: Indices) -> TaughtDistance:
    """A score whose limit :data:`QUANTILE` of the windows of left-out groups keep.

    Where no group can be left out (each class is in one group), the fit's own windows set it.
    """
    away = left_out_scores(x, label, group)
    whole = TaughtDistance.fit(x, label)
    seen = away[np.isfinite(away)]
    return replace(whole, limit=float(np.quantile(seen if len(seen) else whole(x), QUANTILE)))


def left_out_scores(x: Floats, label: Indices, group: Indices) -> Floats:
    """Distance of every window, without limit, by a fit that has not seen its group; NaN where no
    other group holds its class."""
    away = np.full(len(x), np.nan)
    for each in np.unique(group):
        train, test = group != each, group == each
        test &= np.isin(label, label[train])
        if train.any() and test.any():
            away[test] = TaughtDistance.fit(x[train], label[train])(x[test])
    return away
