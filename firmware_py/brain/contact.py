"""Law of the contact channel: its voltage over the smallest film, and what the unknown roughness does to it.

Source: film resistance proportional to the smallest film, beside asperity contacts ``10 ohm exp(h / roughness)``
(Greenwood and Williamson 1966), behind a series resistor.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.config.schema import Contact

Floats = NDArray[np.float64]

ROUGHNESS_M: Final = (0.5e-6, 1.0e-6)
ASPERITY_OHM: Final = 10.0


def contact_volt(contact: Contact, film_m: Floats, roughness_m: float = 0.5 * sum(ROUGHNESS_M)) -> Floats:
    """Voltage of the contact channel over the smallest film (m)."""
    film = contact.film_ohm_per_m * np.maximum(film_m, 1e-9)
    asperity = ASPERITY_OHM * np.exp(np.minimum(film_m / roughness_m, 60.0))
    parallel = 1.0 / (1.0 / film + 1.0 / asperity)
    return np.asarray(contact.circuit_V * parallel / (parallel + contact.circuit_ohm))


def roughness_volt(contact: Contact, volt: float) -> float:
    """Deviation of the voltage that comes from the unknown roughness of the surfaces, even within its range."""
    film = np.array([contact.circuit_ohm * volt / max(contact.circuit_V - volt, 1e-3)]) / contact.film_ohm_per_m
    smooth, rough = (contact_volt(contact, film, sigma)[0] for sigma in ROUGHNESS_M)
    return float(abs(smooth - rough)) / (2.0 * math.sqrt(3.0))
