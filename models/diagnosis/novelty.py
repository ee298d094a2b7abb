"""How unlike everything that was taught a row of features is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire import ringing
from firmware_py.acquire.features import FEATURE_NAMES, GROUP_OF_FEATURE, GROUPS
from models.diagnosis.dataset import Dataset
from models.diagnosis.ladder import Scaler

Floats = NDArray[np.float64]

FLOATING: Final = np.isin(GROUP_OF_FEATURE, [GROUPS.index(name) for name in ("operation", "contact_orders")])
"""How the shaft floats in its film: what oil, wear and side loads change."""
RINGING: Final = np.isin(FEATURE_NAMES, ringing.names())
"""How pedestal and motor ring: what a foot changes that is no class."""


@dataclass(frozen=True)
class Part:
    """Mahalanobis distance to the nearest of the taught centres, over what all but a few inner rows keep.

    ``whitening`` ``(F, k)``: ``z @ whitening`` has unit covariance about the centres ``(K, k)``; features that are
    not looked at have zero rows.
    """

    whitening: Floats
    centres: Floats
    limit: float

    @classmethod
    def fit(
        cls, columns: NDArray[np.bool_], z: Floats, kind: NDArray[np.intp], z_inner: Floats, quantile: float
    ) -> Part:
        """Centres of the classes, covariance about them (shrunk, Ledoit and Wolf 2004), limit on the inner rows."""
        from sklearn.covariance import ledoit_wolf

        kinds = np.unique(kind)
        means = np.array([z[kind == k].mean(axis=0) for k in kinds])
        covariance, _ = ledoit_wolf((z - means[np.searchsorted(kinds, kind)])[:, columns])
        values, vectors = np.linalg.eigh(covariance)
        whitening = np.zeros((z.shape[1], len(values)))
        whitening[columns] = vectors / np.sqrt(values)
        raw = cls(whitening, means @ whitening, 1.0)
        return cls(whitening, raw.centres, float(np.quantile(raw.distance(z_inner), quantile)))

    def distance(self, z: Floats) -> Floats:
        """Distances ``(n,)`` of scaled rows, 1 at the limit."""
        found = [np.sqrt(np.mean((z @ self.whitening - centre) ** 2, axis=1)) for centre in self.centres]
        return np.asarray(np.min(found, axis=0) / self.limit)


def fit_novelty(scaler: Scaler, train: Dataset, inner: Dataset, quantile: float) -> tuple[Part, ...]:
    """The parts whose larger distance is the novelty score: above 1 a row is unlike what was taught.

    Parameters
    ----------
    quantile
        Share of the inner rows that each part keeps.
    """
    z = (train.features - scaler.mean) / scaler.deviation
    z_inner = (inner.features - scaler.mean) / scaler.deviation
    return tuple(Part.fit(columns, z, train.kind, z_inner, quantile) for columns in (FLOATING, RINGING))


def novelty(parts: Sequence[Part], z: Floats) -> Floats:
    """The larger of the parts' distances ``(n,)``."""
    return np.asarray(np.max([part.distance(z) for part in parts], axis=0))
